"""Capture folders: what the user, the simulator and the runs exchange.

The layout is in the README. Everything is checked where it is read; what cannot be used is
refused with a sentence that names the file.
"""

import csv
import math
import tomllib
import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration.identity import Projector
from scripts.errors import UserError

__all__ = ["Capture", "read_capture", "read_image"]

_PHOTOGRAPHS = (".png", ".jpg", ".jpeg")
_PNG = b"\x89PNG\r\n\x1a\n"


def _complete_png(content):
    """Every chunk is whole, down to the last one."""
    place = len(_PNG)
    while place + 12 <= len(content):
        length = int.from_bytes(content[place:place + 4])
        end = place + 12 + length
        if end > len(content):
            return False
        body, check = content[place + 4:end - 4], int.from_bytes(content[end - 4:end])
        if zlib.crc32(body) != check:
            return False
        if body[:4] == b"IEND":
            return True
        place = end
    return False


def read_image(path, width, height):
    """A frame of the sensor.

    Parameters
    ----------
    path : path
        Any format that OpenCV reads; a PNG or JPEG that was cut short is not read half.
    width, height : :class:`int`
        Size of the sensor in pixels.

    Returns
    -------
    array (height, width) of uint8

    Raises
    ------
    UserError
        If the image is missing, empty, damaged, in colour, deeper than 8 bits, or of another size.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}.") from error
    if not content:
        raise UserError(f"{path} is empty: record or copy it again.")
    whole = True
    if content.startswith(_PNG):
        whole = _complete_png(content)
    elif content.startswith(b"\xff\xd8"):
        whole = content.rstrip(b"\0").endswith(b"\xff\xd9")
    image = None
    if whole:
        try:
            image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:
            image = None
    if image is None:
        raise UserError(f"{path} is no image, or is damaged or cut short: record or copy it again.")
    if image.ndim != 2:
        raise UserError(f"{path} is a colour image: convert it to 8-bit grey first.")
    if image.dtype != np.uint8:
        raise UserError(f"{path} has {8 * image.dtype.itemsize} bits a pixel: convert it to 8-bit "
                        "grey first.")
    if image.shape != (height, width):
        raise UserError(f"{path} has {image.shape[1]} x {image.shape[0]} pixels, but the sensor "
                        f"has {width} x {height}: use frames of that sensor, at full size.")
    return image


@dataclass(frozen=True)
class Capture:
    """A capture folder's nominal values, and its images on demand.

    Parameters
    ----------
    folder : :class:`pathlib.Path`
        Where it is.
    width, height : :class:`int`
        Sensor size in pixels.
    focal_px : :class:`float`
        Nominal focal length.
    projector : :class:`calibration.identity.Projector`
        Nominal laser mesh.
    board_columns, board_rows : :class:`int`
        Inner corners of the chessboard.
    square_mm : :class:`float`
        Side of its squares.
    """

    folder: Path
    width: int
    height: int
    focal_px: float
    projector: Projector
    board_columns: int
    board_rows: int
    square_mm: float

    def lens_images(self):
        """(name, image) of every chessboard photograph."""
        folder = self.folder / "lens"
        paths = sorted(path for path in _entries(folder)
                       if path.suffix.lower() in _PHOTOGRAPHS and not path.name.startswith("."))
        if not paths:
            raise UserError(f"{folder} holds no photographs (.png, .jpg): put some of a chessboard "
                            "there.")
        return [(path.name, read_image(path, self.width, self.height)) for path in paths]

    def plane_images(self):
        """(name, distance in mm, image) of every plane frame, as planes.csv lists them."""
        table = self.folder / "planes" / "planes.csv"
        return [(name, z_mm, read_image(table.parent / name, self.width, self.height))
                for name, z_mm in _plane_rows(table)]


def _entries(folder):
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise UserError(f"{folder} cannot be read: {error.strerror}.") from error


def _plane_rows(table):
    try:
        with open(table, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or "it is no text"
        raise UserError(f"{table} cannot be read: {why}; it must list `file,z_mm` for every plane "
                        "frame.") from error
    if not {"file", "z_mm"} <= set(reader.fieldnames or ()):
        raise UserError(f"{table} must begin with the line `file,z_mm`.")
    if not rows:
        raise UserError(f"{table} lists no plane frames.")
    found = []
    for row in rows:
        try:
            z_mm = float(row["z_mm"])
        except (TypeError, ValueError):
            z_mm = math.nan
        name = (row["file"] or "").strip()
        if not name or not z_mm > 0 or math.isinf(z_mm):
            raise UserError(f"{table}, line {len(found) + 2}: a file and a positive distance in mm "
                            "are wanted.")
        if name in (other for other, _ in found):
            raise UserError(f"{table} lists {name} twice: take one of the lines out.")
        found.append((name, z_mm))
    return found


def _value(tables, path, section, key, kind, least=None):
    """One checked value of capture.toml."""
    if not isinstance(tables.get(section), dict) or key not in tables[section]:
        raise UserError(f"{path} has no `{key}` in [{section}]: add it (see the README).")
    value = tables[section][key]
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or (kind is int and value != int(value)):
        raise UserError(f"{path}: `{key}` in [{section}] must be "
                        f"{'a whole number' if kind is int else 'a number'}, not {value!r}.")
    if least is not None and not value >= least:
        raise UserError(f"{path}: `{key}` in [{section}] must be {least} or more, not {value!r}.")
    return kind(value)


def read_capture(folder):
    """The nominal values of a capture folder.

    Raises
    ------
    UserError
        If capture.toml is missing, is not TOML, or lacks or misstates a value.
    """
    folder = Path(folder)
    path = folder / "capture.toml"
    if not folder.is_dir():
        raise UserError(f"{folder} is not a folder: name a capture folder.")
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}; a capture folder holds its "
                        "nominal values there.") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(f"{path} is not valid TOML: {error}.") from error

    def value(section, key, kind, least=None):
        return _value(tables, path, section, key, kind, least)

    width, height = (value("sensor", key, int, 16) for key in ("width", "height"))
    if max(width, height) > 512:
        raise UserError(f"{path}: the sensor has {width} x {height} pixels, but the chip takes "
                        "512 x 512 at most.")
    rows, columns = (value("projector", key, int, 1) for key in ("rows", "columns"))
    if rows * columns > 128:
        raise UserError(f"{path}: the projector has {rows} x {columns} beams, but the chip takes "
                        "128 at most.")
    angles = [value("projector", key, float)
              for key in ("pitch_deg", "rotation_deg", "toe_in_deg")]
    base = tables["projector"].get("base_mm")
    if not (isinstance(base, list) and len(base) == 3 and all(
            isinstance(part, (int, float)) and not isinstance(part, bool) and math.isfinite(part)
            for part in base)):
        raise UserError(f"{path}: `base_mm` in [projector] must be three numbers, [x, y, z].")
    return Capture(
        folder=folder, width=width, height=height,
        focal_px=value("sensor", "focal_px", float, 1),
        projector=Projector(rows, columns, *angles, tuple(float(part) for part in base)),
        board_columns=value("lens", "board_columns", int, 3),
        board_rows=value("lens", "board_rows", int, 3),
        square_mm=value("lens", "square_mm", float, 1e-6))
