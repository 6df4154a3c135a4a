"""The calibration file: one versioned JSON that refuses any flipped bit.

The last line but one holds the CRC-32 of all bytes before that line, so that the file is read
exactly as it was written or not at all.
"""

import json
import shlex
import zlib
from dataclasses import asdict, dataclass, field, fields, replace

import numpy as np

from calibration.checked import InvalidError, parse_json
from calibration.content import checked_content
from calibration.files import beside, read_octets
from calibration.lens import Lens
from calibration.projector import Projector
from model.errors import UserError
from model.settings import Settings

__all__ = ["FORMAT", "VERSION", "Beam", "Calibration", "decode", "encode", "load", "save"]

FORMAT = "cyclope calibration"
VERSION = 1
#: Octets of a file; 512 beams need a quarter of them.
_MOST = 1 << 20

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
    ``residual_u`` and ``residual_v`` are RMS over the ``planes`` distances that were used;
    ``relative_area`` is the size of its spots, 1 being usual.
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
    relative_area: float
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
    beams : tuple of :class:`Beam` or None
        In order of their numbers; None is a beam that was left out, which no spot matches.
    settings : :class:`model.settings.Settings`
        What RTL and golden model are loaded with.
    inverse_z_unit : :class:`float`
        1/mm of one LSB of the inverse depth.
    z_min, z_max : :class:`float`
        Depth range in mm, without the windows' margin.
    budget : :class:`dict`
        What was measured: RMS of lens and lines, rounding errors.
    remarks : :class:`dict`
        From numbers of beams to texts: why one was left out, or what is unusual about it.
    bayer : :class:`str` or None
        Pattern of the sensor's colour filters, one of :data:`model.bayer.BAYER`.
    """

    lens: Lens
    projector: Projector
    beams: tuple = field(repr=False)
    settings: Settings = field(repr=False)
    inverse_z_unit: float
    z_min: float
    z_max: float
    budget: dict = field(repr=False)
    remarks: dict = field(default_factory=dict)
    bayer: str | None = None

    @property
    def left_out(self):
        """Numbers of the beams that were left out."""
        return tuple(number for number, beam in enumerate(self.beams) if beam is None)

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
    if calibration.bayer:
        sensor["bayer"] = calibration.bayer
    content = _plain({
        "format": FORMAT, "version": VERSION, "sensor": sensor, "units": _UNITS, "lens": lens,
        "projector": asdict(calibration.projector),
        "depth_range": [calibration.z_min, calibration.z_max],
        "inverse_z_unit": calibration.inverse_z_unit, "budget": calibration.budget,
        "remarks": {str(beam): text for beam, text in calibration.remarks.items()}})
    lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)},"
             for key, value in content.items()]
    beams = ",\n".join(json.dumps(_plain(asdict(beam)) if beam else None, allow_nan=False)
                       for beam in calibration.beams)
    # The table of the whole image follows from the lens: the file only says that there is one.
    settings = asdict(replace(calibration.settings, remap=()))
    settings["remap"] = bool(calibration.settings.remap)
    settings = ",\n".join(f"{json.dumps(key)}: {json.dumps(_plain(value))}"
                          for key, value in settings.items())
    lines += ['"beams": [', beams, "],", '"settings": {', settings, "},", ""]
    body = ("{\n" + "\n".join(lines)).encode()
    return body + _TRAILER % zlib.crc32(body)


def save(calibration, path):
    """Write the file beside ``path``, then rename it: there is never half a calibration."""
    with beside(path) as file:
        file.write(encode(calibration))


def decode(data, name="The calibration"):
    """A :class:`Calibration` from the file's bytes; ``name`` is for messages.

    Parameters
    ----------
    data : :class:`bytes`
        The whole file.
    name : :class:`str`
        What to call it in messages.

    Raises
    ------
    UserError
        If a bit is wrong, or if the values are none that a calibration can have, even with a
        correct check sum.
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
        content = parse_json(data)
        if content.get("format") != FORMAT:
            raise UserError(f"{name} is not a calibration file: {again}")
        if content.get("version") != VERSION:
            raise UserError(f"{name} is of version {str(content.get('version'))[:20]}, this "
                            f"program reads version {VERSION}: {again}")
        values = checked_content(content, [each.name for each in fields(Beam)])
    except InvalidError as error:
        raise UserError(f"{name} cannot be used ({error}): {again}") from error
    beams = tuple(None if beam is None else Beam(**beam) for beam in values.pop("beams"))
    return Calibration(beams=beams, **values)


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
    name = f"The calibration {path}"
    data = read_octets(
        path, f"make one with `cyclope calibrate CAPTURE -o {shlex.quote(str(path))}`", _MOST, name)
    return decode(data, name)
