"""Capture folders: read, check, and refuse in one sentence what cannot be used.

The folder's contract: ``capture.toml`` with the nominal values, ``lens/`` with photographs of a
chessboard, ``planes/`` with pattern frames of a flat target and ``planes/planes.csv`` with its
distances. The frames to measure are no business of the calibration.
"""

import csv
import math
import struct
import tomllib
import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration.projector import Projector
from model.errors import UserError

__all__ = ["Capture", "read_capture", "read_image"]

SUFFIXES = (".png", ".jpg", ".jpeg")
#: Coordinates have 9 bits before the point.
LARGEST = 512
MOST_BEAMS = 128


@dataclass(frozen=True)
class Capture:
    """A capture folder whose ``capture.toml`` and file lists have been checked.

    Parameters
    ----------
    folder : :class:`pathlib.Path`
        Where it is.
    width, height : :class:`int`
        Of the sensor.
    focal_px : :class:`float`
        Nominal focal length.
    projector : :class:`calibration.projector.Projector`
        Nominal mesh.
    board_columns, board_rows : :class:`int`
        Inner corners of the chessboard.
    square_mm : :class:`float`
        Side of one of its squares.
    lens_paths : tuple of :class:`pathlib.Path`
        Photographs of it, sorted by name.
    planes : tuple of (:class:`pathlib.Path`, :class:`float`)
        Pattern frames and their distances in mm, in the order of ``planes.csv``.
    """

    folder: Path
    width: int
    height: int
    focal_px: float
    projector: Projector
    board_columns: int
    board_rows: int
    square_mm: float
    lens_paths: tuple
    planes: tuple

    def lens_images(self) -> list:
        """Names and pictures of the chessboard photographs."""
        return [(path.name, read_image(path, self.width, self.height)) for path in self.lens_paths]

    def plane_images(self) -> list:
        """Names, distances in mm and pictures of the plane frames."""
        return [(path.name, z_mm, read_image(path, self.width, self.height))
                for path, z_mm in self.planes]


def _png_is_whole(data):
    """Whether every chunk of a PNG is there, up to the last, with the checksum it names."""
    place = 8
    while place + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        end = place + 12 + length
        if end > len(data):
            return False
        if zlib.crc32(data[place + 4:end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            return False
        if kind == b"IEND":
            return True
        place = end
    return False


def _is_whole(data):
    """Whether the file ends where its format says; OpenCV shows half a picture without a word."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return _png_is_whole(data)
    if data.startswith(b"\xff\xd8"):
        return b"\xff\xd9" in data[-1024:]
    if data.startswith(b"BM") and len(data) >= 6:
        return len(data) >= struct.unpack_from("<I", data, 2)[0]
    return True


def _octets(path, what):
    """Contents of a file, or a sentence."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise UserError(f"{path} does not exist: {what}.") from None
    except (IsADirectoryError, NotADirectoryError):
        raise UserError(f"{path} is not a file: {what}.") from None
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror}): {what}.") from error


def _decode(data):
    """Picture, or None; without OpenCV's own remarks, for one sentence is enough."""
    logging = cv2.utils.logging
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    finally:
        logging.setLogLevel(level)


def read_image(path, width=None, height=None) -> np.ndarray:
    """An 8-bit grey picture of the sensor's size, as a 2-D ``uint8`` array.

    Raises :class:`model.errors.UserError` if the file is missing, empty, truncated, unreadable,
    in colour, of another depth than 8 bits, or of another size.

    Parameters
    ----------
    path : path
        PNG, JPEG or whatever else OpenCV reads.
    width, height : :class:`int` or None
        The size it must have; any if None.
    """
    path = Path(path)
    data = _octets(path, "name an 8-bit grey image")
    if not data:
        raise UserError(f"{path} is empty: copy or record it again.")
    if not _is_whole(data):
        raise UserError(f"{path} is truncated or damaged: copy or record it again.")
    image = _decode(data)
    if image is None or not image.size:
        raise UserError(f"{path} cannot be read as an image: save it as an 8-bit grey PNG.")
    if image.ndim != 2:
        raise UserError(f"{path} is a colour image: save it as 8-bit grey.")
    if image.dtype != np.uint8:
        raise UserError(
            f"{path} has {8 * image.dtype.itemsize} bits per pixel: save it as 8-bit grey.")
    if width is not None and image.shape != (height, width):
        raise UserError(
            f"{path} has {image.shape[1]} x {image.shape[0]} pixels instead of the sensor's "
            f"{width} x {height}: record it with that sensor, neither scaled nor cropped.")
    return image


class _Table:
    """One section of ``capture.toml``: takes values, and refuses by file, section and key."""

    def __init__(self, path, content, name):
        self._path, self._name = path, name
        self._values = content.get(name)
        if not isinstance(self._values, dict):
            raise UserError(f"{path} has no section [{name}]: add it.")

    def _refuse(self, key, must):
        raise UserError(
            f"{self._path}: {key} in [{self._name}] must be {must}, not {self._values[key]!r}.")

    def _get(self, key):
        if key not in self._values:
            raise UserError(f"{self._path} has no {key} in [{self._name}]: add it.")
        return self._values[key]

    def integer(self, key, low, high):
        value = self._get(key)
        if type(value) is not int or not low <= value <= high:
            self._refuse(key, f"an integer from {low} to {high}")
        return value

    def number(self, key, low=None, high=None, must="a number"):
        value = self._get(key)
        if (type(value) not in (int, float) or not math.isfinite(value)
                or (low is not None and value <= low) or (high is not None and value >= high)):
            self._refuse(key, must)
        return float(value)

    def vector(self, key):
        value = self._get(key)
        good = isinstance(value, list) and len(value) == 3 and all(
            type(part) in (int, float) and math.isfinite(part) for part in value)
        if not good or value[0] == 0:
            self._refuse(key, "three numbers [x, y, z], x other than 0")
        return tuple(float(part) for part in value)


def _read_toml(path):
    data = _octets(path, "name a capture folder, which holds a capture.toml")
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{path} is not valid TOML: {' '.join(str(error).split())}.") from error


def _read_planes(path):
    data = _octets(path, "list the plane frames in it, with the columns file,z_mm")
    try:
        rows = list(csv.reader(data.decode("utf-8-sig").splitlines(), strict=True))
    except (csv.Error, UnicodeDecodeError) as error:
        raise UserError(f"{path} is not a table ({error}): write the columns file,z_mm.") from error
    rows = [(number, [cell.strip() for cell in row])
            for number, row in enumerate(rows, 1) if any(cell.strip() for cell in row)]
    header = rows[0][1] if rows else []
    if not {"file", "z_mm"} <= set(header):
        raise UserError(f"{path} must have the columns file,z_mm in its first line.")
    planes, lines = [], {}
    for number, row in rows[1:]:
        cells = dict(zip(header, row, strict=False))
        name, text = cells.get("file", ""), cells.get("z_mm", "")
        if not name or Path(name).name != name:
            raise UserError(
                f"{path}, line {number}: {name!r} is not the name of a file beside it.")
        if name in lines:
            raise UserError(f"{path} names {name} twice, in lines {lines[name]} and {number}.")
        lines[name] = number
        try:
            z_mm = float(text)
        except ValueError:
            z_mm = math.nan
        if not 0 < z_mm < math.inf:
            raise UserError(
                f"{path}, line {number}: z_mm must be the distance in mm, not {text!r}.")
        picture = path.with_name(name)
        if not picture.is_file():
            raise UserError(f"{path}, line {number}: {picture} does not exist.")
        planes.append((picture, z_mm))
    if not planes:
        raise UserError(f"{path} names no plane frames: add a line file,z_mm for each.")
    return tuple(planes)


def read_capture(folder) -> Capture:
    """A capture folder, without its pictures, which are read when asked for.

    Raises :class:`model.errors.UserError` if anything the calibration needs is missing or wrong.
    """
    folder = Path(folder)
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        raise UserError(f"{folder} {what}: name a capture folder.")
    if not any(folder.iterdir()):
        raise UserError(
            f"{folder} is empty: a capture folder holds capture.toml, lens/ and planes/.")
    path = folder / "capture.toml"
    content = _read_toml(path)
    sensor, mesh, board = (_Table(path, content, name) for name in ("sensor", "projector", "lens"))

    def angle(key, low, high):
        return mesh.number(key, low, high, f"an angle between {low} and {high} degrees")

    projector = Projector(
        rows=mesh.integer("rows", 1, MOST_BEAMS), columns=mesh.integer("columns", 1, MOST_BEAMS),
        pitch_deg=angle("pitch_deg", 0, 45), rotation_deg=angle("rotation_deg", -180, 180),
        toe_in_deg=angle("toe_in_deg", -60, 60), base_mm=mesh.vector("base_mm"))
    if projector.beams > MOST_BEAMS:
        raise UserError(
            f"{path}: {projector.rows} x {projector.columns} beams are more than {MOST_BEAMS}.")
    lens = folder / "lens"
    try:
        photographs = sorted(entry for entry in lens.iterdir()
                             if entry.suffix.lower() in SUFFIXES and not entry.name.startswith("."))
    except OSError:
        raise UserError(f"{lens} is not a folder that can be read: put photographs of the "
                        "chessboard there.") from None
    if not photographs:
        raise UserError(f"{lens} holds no images ({' '.join(SUFFIXES)}): put photographs of the "
                        "chessboard there.")
    return Capture(
        folder=folder, width=sensor.integer("width", 8, LARGEST),
        height=sensor.integer("height", 8, LARGEST),
        focal_px=sensor.number("focal_px", 0, None, "a positive number of pixels"),
        projector=projector, board_columns=board.integer("board_columns", 3, 100),
        board_rows=board.integer("board_rows", 3, 100),
        square_mm=board.number("square_mm", 0, None, "a positive number of mm"),
        lens_paths=tuple(photographs), planes=_read_planes(folder / "planes" / "planes.csv"))
