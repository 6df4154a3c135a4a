"""Capture folders: read, check, and refuse in one sentence what cannot be used.

The folder's contract: ``capture.toml`` with the nominal values, ``lens/`` with photographs of a
chessboard, ``planes/`` with pattern frames of a flat target and ``planes/planes.csv`` with its
distances. The frames to measure are no business of the calibration.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from calibration.csv_table import read_table
from calibration.files import list_names, read_octets, unused_files
from calibration.image import LARGEST, SUFFIXES, image_size, read_image
from calibration.projector import Projector
from hdl.protocol import MOST_BEAMS
from model.bayer import BAYER
from model.errors import UserError

__all__ = ["Capture", "read_capture", "read_image", "read_nominal"]

#: Larger lengths are typing errors.
MOST_MM, MOST_PX = 100_000, 100_000
#: Octets of a capture.toml; it needs a few hundred.
_MOST_TOML = 1 << 14
_OPTIONAL = {"projector": ("dead",), "sensor": ("bayer",)}
_KEYS = {
    "sensor": ("width", "height", "focal_px"),
    "projector": ("rows", "columns", "pitch_deg", "rotation_deg", "toe_in_deg", "base_mm"),
    "lens": ("board_columns", "board_rows", "square_mm")}


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
    notes : tuple of :class:`str`
        What is there and not used.
    dead : frozenset of :class:`int`
        Beams that are known to be dead.
    bayer : :class:`str` or None
        Pattern of the sensor's colour filters, one of :data:`model.bayer.BAYER`.
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
    notes: tuple = ()
    dead: frozenset = frozenset()
    bayer: str | None = None

    def check_sizes(self):
        """Refuse a wrong size in capture.toml, and photographs of another sensor than the planes'.

        A single file of another size is refused when it is read.
        """
        wanted, toml = (self.width, self.height), self.folder / "capture.toml"
        lens = {image_size(path) for path in self.lens_paths} - {None}
        planes = {image_size(path) for path, _ in self.planes} - {None}
        if len(lens) != 1 or len(planes) != 1 or lens == planes == {wanted}:
            return
        (photograph,), (frame,) = lens, planes
        sizes = [f"{columns} x {rows}" for columns, rows in (photograph, frame, wanted)]
        if photograph == frame:
            raise UserError(
                f"All images have {sizes[0]} pixels, but {toml} says {sizes[2]}: correct width and "
                "height in [sensor].")
        turned = (", turned by a quarter" if photograph == frame[::-1] else
                  ", of another sensor, scaled or cropped")
        raise UserError(
            f"The chessboard photographs have {sizes[0]} pixels{turned}, and the plane frames "
            f"{sizes[1]} ({toml} says {sizes[2]}): take both with the camera that measures, "
            "unchanged.")

    def lens_images(self) -> list:
        """Names and pixels of the chessboard photographs."""
        return [(path.name, read_image(path, self.width, self.height, colour=True))
                for path in self.lens_paths]

    def plane_images(self) -> list:
        """Names, distances in mm and pixels of the plane frames."""
        return [(path.name, z_mm, read_image(path, self.width, self.height))
                for path, z_mm in self.planes]


class _Table:
    """One section of ``capture.toml``: takes values, and refuses by file, section and key."""

    def __init__(self, path, content, name):
        self._path, self._name = path, name
        self._values = content.get(name)
        if not isinstance(self._values, dict):
            raise UserError(f"{path} has no section [{name}]: add it.")

    def _refuse(self, key, must):
        value = repr(self._values[key])
        value = value if len(value) <= 60 else f"{value[:60]}..."
        raise UserError(f"{self._path}: {key} in [{self._name}] must be {must}, not {value}.")

    def _get(self, key):
        if key not in self._values:
            raise UserError(f"{self._path} has no {key} in [{self._name}]: add it.")
        return self._values[key]

    def integer(self, key, low, high):
        value = self._get(key)
        if type(value) is not int or not low <= value <= high:
            self._refuse(key, f"an integer from {low} to {high}")
        return value

    def number(self, key, low, high, must):
        value = self._get(key)
        if type(value) not in (int, float) or not low < value < high:
            self._refuse(key, must)
        return float(value)

    def vector(self, key):
        value = self._get(key)
        good = isinstance(value, list) and len(value) == 3 and all(
            type(part) in (int, float) and abs(part) <= MOST_MM for part in value)
        if not good or value[0] == 0:
            self._refuse(key, f"three numbers [x, y, z] of up to {MOST_MM} mm, x other than 0")
        return tuple(float(part) for part in value)

    def choice(self, key, choices):
        """One of some texts; None if the key is missing."""
        value = self._values.get(key)
        if key in self._values and (not isinstance(value, str) or value not in choices):
            self._refuse(key, f"one of {', '.join(choices)}, or left out")
        return value

    def beams(self, key, mesh):
        """Numbers of beams by rows and columns; none if the key is missing."""
        if key not in self._values:
            return frozenset()
        pairs = self._values[key]
        if not isinstance(pairs, list) or not all(
                isinstance(pair, list) and len(pair) == 2
                and all(type(part) is int for part in pair)
                and 0 <= pair[0] < mesh.rows and 0 <= pair[1] < mesh.columns for pair in pairs):
            self._refuse(key, "a list of beams [row, column], counted from 0, "
                              f"of the {mesh.rows} x {mesh.columns} mesh")
        return frozenset(row * mesh.columns + column for row, column in pairs)


def _read_toml(path):
    data = read_octets(path, "name a capture folder, which holds a capture.toml", _MOST_TOML)
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except RecursionError:
        raise UserError(f"{path} is nested too deeply: write sections of plain values.") from None
    except ValueError as error:
        raise UserError(f"{path} is not valid TOML: {' '.join(str(error).split())}.") from error


def _unknown_keys(path, content):
    """A note on what nobody reads, for it may be misspelt."""
    unknown = [name for name in content if name not in _KEYS]
    unknown += [f"{key} in [{name}]" for name, keys in _KEYS.items()
                for key in content[name] if key not in (*keys, *_OPTIONAL.get(name, ()))]
    return [f"{path} has values that are not used: {list_names(unknown)}"] if unknown else []


def _read_planes(path):
    planes, lines = [], {}
    for row in read_table(path, ("file", "z_mm"),
                          "list the plane frames in it, with the columns file,z_mm"):
        name = row.text("file")
        if not name or Path(name).name != name:
            row.refuse(f"{name!r} is not the name of a file beside it")
        if name in lines:
            raise UserError(f"{path} names {name} twice, in lines {lines[name]} and {row.line}.")
        lines[name] = row.line
        z_mm = row.number("z_mm", 1e-3, MOST_MM,
                          f"the distance in mm, above 0 and up to {MOST_MM}")
        image = path.with_name(name)
        if not image.is_file():
            row.refuse(f"{image} does not exist")
        planes.append((image, z_mm))
    if not planes:
        raise UserError(f"{path} names no plane frames: add a line file,z_mm for each.")
    return tuple(planes)


def _read_nominal(folder):
    """The folder as a path, and the contents of its ``capture.toml``."""
    folder = Path(folder)
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        raise UserError(f"{folder} {what}: name a capture folder.")
    if not any(folder.iterdir()):
        raise UserError(
            f"{folder} is empty: a capture folder holds capture.toml, lens/ and planes/.")
    return folder, _read_toml(folder / "capture.toml")


def _sensor(path, content):
    """Width, height and focal length."""
    sensor = _Table(path, content, "sensor")
    return {"width": sensor.integer("width", 8, LARGEST),
            "height": sensor.integer("height", 8, LARGEST),
            "focal_px": sensor.number("focal_px", 0, MOST_PX,
                                      f"a number of pixels, up to {MOST_PX}")}


def _projector(path, mesh):
    """The nominal mesh, from its section."""
    def angle(key, low, high):
        return mesh.number(key, low, high, f"an angle between {low} and {high} degrees")

    projector = Projector(
        rows=mesh.integer("rows", 1, MOST_BEAMS), columns=mesh.integer("columns", 1, MOST_BEAMS),
        pitch_deg=angle("pitch_deg", 0, 45), rotation_deg=angle("rotation_deg", -180, 180),
        toe_in_deg=angle("toe_in_deg", -60, 60), base_mm=mesh.vector("base_mm"))
    if projector.beams > MOST_BEAMS:
        raise UserError(
            f"{path}: {projector.rows} x {projector.columns} beams are more than {MOST_BEAMS}.")
    return projector


def read_nominal(folder):
    """Nominal values of a capture folder, which need not hold any images yet.

    Returns a :class:`dict` with ``width``, ``height``, ``focal_px`` and ``projector``, and
    ``depth``: the smallest and largest z_mm of its plane frames, or None without planes.csv. Raises
    :class:`model.errors.UserError` if something is missing or wrong.
    """
    folder, content = _read_nominal(folder)
    path, planes = folder / "capture.toml", folder / "planes" / "planes.csv"
    distances = [z_mm for _, z_mm in _read_planes(planes)] if planes.is_file() else []
    return {**_sensor(path, content),
            "projector": _projector(path, _Table(path, content, "projector")),
            "depth": (min(distances), max(distances)) if distances else None}


def read_capture(folder) -> Capture:
    """A capture folder, without its images, which are read when asked for.

    Raises :class:`model.errors.UserError` if anything the calibration needs is missing or wrong.
    """
    folder, content = _read_nominal(folder)
    path = folder / "capture.toml"
    sensor = _sensor(path, content)
    bayer = _Table(path, content, "sensor").choice("bayer", BAYER)
    mesh, board = _Table(path, content, "projector"), _Table(path, content, "lens")
    projector = _projector(path, mesh)
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
    planes = _read_planes(folder / "planes" / "planes.csv")
    notes = [*_unknown_keys(path, content),
             *unused_files(lens, {image.name for image in photographs}),
             *unused_files(folder / "planes", {"planes.csv", *(image.name for image, _ in planes)})]
    return Capture(
        folder=folder, **sensor, projector=projector,
        board_columns=board.integer("board_columns", 3, 100),
        board_rows=board.integer("board_rows", 3, 100),
        square_mm=board.number("square_mm", 0, MOST_MM, f"a number of mm, up to {MOST_MM}"),
        lens_paths=tuple(photographs), planes=planes, notes=tuple(notes),
        dead=mesh.beams("dead", projector), bayer=bayer)
