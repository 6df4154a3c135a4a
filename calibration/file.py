"""The calibration file: one versioned JSON that refuses any flipped bit.

The last line but one holds the CRC-32 of all bytes before that line, so that the file is read
exactly as it was written or not at all.
"""

import json
import os
import tempfile
import zlib
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from calibration.lens import Lens
from calibration.projector import Projector
from calibration.remap import remap_table
from model.errors import UserError
from model.settings import EROSION_MODES, RADIAL_WORDS, RECIPROCAL_WORDS, Settings

__all__ = ["FORMAT", "VERSION", "Beam", "Calibration", "beside", "decode", "encode", "load", "save"]

FORMAT = "cyclope calibration"
VERSION = 1

_UNITS = {
    "length": "mm", "angle": "degree", "image": "px, (0, 0) at the centre of the first pixel",
    "undistorted": "px, from the image centre ((width - 1) / 2, (height - 1) / 2)",
    "alpha": "1 / (mm px)", "beta": "1 / mm", "inverse_z_unit": "1 / mm per LSB"}
_TRAILER = b'"crc32": "%08x"\n}\n'


@dataclass(frozen=True)
class Beam:
    """A beam in float: v = a u + b and 1/z = alpha u + beta in undistorted px and 1/mm.

    ``u_min`` to ``u_max`` is its window and ``tolerance`` the largest distance from its line;
    ``separation`` is the distance to the nearest line that shares columns (None if there is none).
    ``residual_u`` and ``residual_v`` are RMS over the ``planes`` distances that were used.
    """

    a: float
    b: float
    alpha: float
    beta: float
    u_min: float
    u_max: float
    tolerance: float
    separation: float | None
    residual_u: float
    residual_v: float
    planes: int


@dataclass(frozen=True)
class Calibration:
    """All that is known of a rig.

    Parameters
    ----------
    lens : :class:`calibration.lens.Lens`
        Camera and sensor size.
    projector : :class:`calibration.projector.Projector`
        The fitted mesh.
    beams : tuple of :class:`Beam`
        In order of their numbers.
    settings : :class:`model.settings.Settings`
        What RTL and golden model are loaded with.
    inverse_z_unit : :class:`float`
        1/mm of one LSB of the inverse depth.
    z_min, z_max : :class:`float`
        Depth range in mm, without the windows' margin.
    budget : :class:`dict`
        What was measured: RMS of lens and lines, rounding errors.
    """

    lens: Lens
    projector: Projector
    beams: tuple = field(repr=False)
    settings: Settings = field(repr=False)
    inverse_z_unit: float
    z_min: float
    z_max: float
    budget: dict = field(repr=False)

    @property
    def width(self):
        """Columns of the sensor."""
        return self.lens.width

    @property
    def height(self):
        """Rows of the sensor."""
        return self.lens.height

    @property
    def rows(self):
        """Rows of the mesh."""
        return self.projector.rows

    @property
    def columns(self):
        """Columns of the mesh."""
        return self.projector.columns

    def check_sensor(self, width, height):
        """Raise :class:`UserError` unless frames have the size that was calibrated."""
        if (width, height) != (self.width, self.height):
            raise UserError(
                f"The calibration is for a sensor of {self.width} x {self.height} pixels, not "
                f"{width} x {height}: calibrate this sensor.")


def _plain(value):
    """numpy scalars to Python's, deeply."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


def encode(calibration):
    """The file's bytes."""
    lens = asdict(calibration.lens)
    sensor = {"width": lens.pop("width"), "height": lens.pop("height")}
    content = _plain({
        "format": FORMAT, "version": VERSION, "sensor": sensor, "units": _UNITS, "lens": lens,
        "projector": asdict(calibration.projector),
        "depth_range": [calibration.z_min, calibration.z_max],
        "inverse_z_unit": calibration.inverse_z_unit, "budget": calibration.budget})
    lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)},"
             for key, value in content.items()]
    beams = ",\n".join(json.dumps(_plain(asdict(beam)), allow_nan=False)
                       for beam in calibration.beams)
    # The table of the whole image follows from the lens: the file only says that there is one.
    settings = asdict(replace(calibration.settings, remap=()))
    settings["remap"] = bool(calibration.settings.remap)
    settings = ",\n".join(f"{json.dumps(key)}: {json.dumps(_plain(value))}"
                          for key, value in settings.items())
    lines += ['"beams": [', beams, "],", '"settings": {', settings, "},", ""]
    body = ("{\n" + "\n".join(lines)).encode()
    return body + _TRAILER % zlib.crc32(body)


@contextmanager
def beside(path):
    """A binary file to write that becomes ``path`` when all went well, and nothing if not."""
    path = Path(path)
    try:
        handle, part = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                yield file
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(part, 0o666 & ~mask)
            os.replace(part, path)
        except BaseException:
            os.unlink(part)
            raise
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror}.") from error


def save(calibration, path):
    """Write the file beside ``path``, then rename it: there is never half a calibration."""
    with beside(path) as file:
        file.write(encode(calibration))


def _settings(content, lens):
    remapped = content.pop("remap", False)
    content = {key: tuple(value) if isinstance(value, list) else value
               for key, value in content.items()}
    settings = Settings(**content)
    sizes = ((settings.radial, RADIAL_WORDS), (settings.reciprocal, RECIPROCAL_WORDS),
             (settings.window, len(settings.line)), (settings.depth, 2 * len(settings.line)))
    if any(len(table) != words for table, words in sizes) or (
            settings.erosion not in EROSION_MODES):
        raise ValueError("a table has the wrong length")
    return replace(settings, remap=remap_table(lens)) if remapped else settings


def decode(data, name="The calibration"):
    """A :class:`Calibration` from the file's bytes; ``name`` is for messages.

    Parameters
    ----------
    data : :class:`bytes`
        The whole file.
    name : :class:`str`
        What to call it in messages.
    """
    again = "calibrate again with `cyclope calibrate`."
    size = len(_TRAILER % 0)
    body, trailer = data[:-size], data[-size:]
    if not data:
        raise UserError(f"{name} is empty: {again}")
    if trailer != _TRAILER % zlib.crc32(body):
        raise UserError(f"{name} is not a calibration, or is corrupt (its check sum is wrong): "
                        f"copy it again, or {again}")
    try:
        content = json.loads(data)
        if content["format"] != FORMAT:
            raise UserError(f"{name} is not a calibration file: {again}")
        if content["version"] != VERSION:
            raise UserError(f"{name} is of version {content['version']}, this program reads "
                            f"version {VERSION}: {again}")
        projector = content["projector"]
        projector["base_mm"] = tuple(projector["base_mm"])
        lens = Lens(**content["sensor"], **content["lens"])
        calibration = Calibration(
            lens=lens, projector=Projector(**projector),
            beams=tuple(Beam(**beam) for beam in content["beams"]),
            settings=_settings(content["settings"], lens), inverse_z_unit=content["inverse_z_unit"],
            z_min=content["depth_range"][0], z_max=content["depth_range"][1],
            budget=content["budget"])
        if len(calibration.beams) != calibration.projector.beams or (
                len(calibration.settings.line) != len(calibration.beams)):
            raise ValueError("beams are missing")
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise UserError(f"{name} lacks something that a calibration must have ({error}): "
                        f"{again}") from error
    return calibration


def load(path):
    """The calibration in a file.

    Raises :class:`UserError` if it is missing, unreadable, corrupt or of another version.

    Parameters
    ----------
    path : path
        As written by :func:`save`.

    Returns
    -------
    :class:`Calibration`
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise UserError(f"The calibration {path} does not exist: make it with `cyclope calibrate "
                        f"CAPTURE -o {path}`.") from error
    except OSError as error:
        raise UserError(f"The calibration {path} cannot be read: {error.strerror}.") from error
    return decode(data, f"The calibration {path}")
