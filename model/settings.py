"""What the calibration loads into the chip: registers and tables, as plain integers."""

from dataclasses import dataclass, field

from model.preprocessing.remap import pack_remap

__all__ = ["EROSION_MODES", "RADIAL_WORDS", "RECIPROCAL_WORDS", "DEPTH", "RECIPROCAL", "RADIAL",
           "BEAMS", "Settings", "table_contents"]

#: Erosion modes in the order of their codes.
EROSION_MODES = ("off", "erode", "gate")
RADIAL_WORDS = 1024
RECIPROCAL_WORDS = 256
#: Numbers of the chip's tables; those of beams are lines (low 36 bits) and windows.
DEPTH, RECIPROCAL, RADIAL, BEAMS = range(4)
_MASK_18 = (1 << 18) - 1


@dataclass(frozen=True)
class Settings:
    """Every integer that the RTL and the golden model are loaded with.

    Parameters
    ----------
    level_fixed : :class:`int` or None
        Fixed threshold, 1 to 255; None for the adaptive one.
    threshold_alpha : :class:`int`
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
    remap : :class:`tuple` of :class:`int`
        A word for each pixel of the corrected image, see ``model/preprocessing/remap.py``; empty
        but for the preset ``paper``.
    """

    level_fixed: int | None = None
    threshold_alpha: int = 5 << 4
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
    remap: tuple = field(default=(), repr=False)

    def registers(self):
        """Register names of the chip's top and their values, negative ones in two's complement."""
        return {
            "threshold_fixed": int(self.level_fixed is not None),
            "threshold_level": int(self.level_fixed or 0),
            "threshold_alpha": int(self.threshold_alpha),
            "erosion_mode": EROSION_MODES.index(self.erosion),
            "weighted": int(self.weighted),
            "area_min": int(self.area_min),
            "area_max": int(self.area_max),
            "report_rejected": int(self.report_rejected),
            "principal_u": int(self.principal_u),
            "principal_v": int(self.principal_v),
            "tangential_1": int(self.tangential_1) & _MASK_18,
            "tangential_2": int(self.tangential_2) & _MASK_18,
        }

    def table_words(self):
        """Yield (table, address, word) of every table write, tables as above."""
        beams = (int(line) | int(window) << 36
                 for line, window in zip(self.line, self.window, strict=True))
        for table, words in ((DEPTH, self.depth), (RECIPROCAL, self.reciprocal),
                             (RADIAL, self.radial), (BEAMS, beams)):
            for address, word in enumerate(words):
                yield table, address, int(word)


def table_contents(settings):
    """Words of every table of the preset that the settings are for, by the table's name."""
    words = {
        "depth": [int(word) for word in settings.depth],
        "reciprocal": [int(word) for word in settings.reciprocal],
        "radial": [int(word) & 0x3FFFF for word in settings.radial],
        "beams": [int(line) | int(window) << 36
                  for line, window in zip(settings.line, settings.window, strict=True)]}
    if settings.remap:
        places = [int(word) for word in pack_remap(settings.remap)]
        places += [0] * (len(places) % 2)
        words["remap"] = [low | high << 32
                           for low, high in zip(places[::2], places[1::2], strict=True)]
    return words
