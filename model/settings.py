"""What the calibration loads into the chip: registers and tables, as plain integers."""

from dataclasses import dataclass, field

__all__ = ["EROSION_MODES", "RADIAL_WORDS", "RECIPROCAL_WORDS", "Settings"]

#: Erosion modes in the order of their codes.
EROSION_MODES = ("off", "erode", "gate")
RADIAL_WORDS = 1024
RECIPROCAL_WORDS = 256


@dataclass(frozen=True)
class Settings:
    """Every integer that the RTL and the golden model are loaded with.

    Parameters
    ----------
    level_fixed : :class:`int` or None
        Fixed threshold, 1 to 255; None for the adaptive one.
    alpha : :class:`int`
        Standard deviations above the mean, unsigned Q4.4.
    erosion : :class:`str`
        One of :data:`EROSION_MODES`.
    weighted : :class:`bool`
        Weigh pixels by grey - T + 1 instead of 1.
    area_min, area_max : :class:`int`
        Areas of spots in pixels, both included, 1 to 255.
    report_rejected : :class:`bool`
        Send rejected spots too, not only their number.
    principal_u, principal_v : :class:`int`
        Principal point, unsigned Q9.9 pixels.
    tangential_1, tangential_2 : :class:`int`
        p1 and p2 over the focal length, in the unit of ``model.stereo.undistort``.
    radial, reciprocal, line, window, depth : :class:`tuple` of :class:`int`
        Memory contents, a word each; formats in ``hdl/README.md``.
    """

    level_fixed: int | None = None
    alpha: int = 5 << 4
    erosion: str = "gate"
    weighted: bool = True
    area_min: int = 3
    area_max: int = 255
    report_rejected: bool = False
    principal_u: int = 0
    principal_v: int = 0
    tangential_1: int = 0
    tangential_2: int = 0
    radial: tuple = field(default=(), repr=False)
    reciprocal: tuple = field(default=(), repr=False)
    line: tuple = field(default=(), repr=False)
    window: tuple = field(default=(), repr=False)
    depth: tuple = field(default=(), repr=False)
