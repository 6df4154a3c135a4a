"""What the calibration loads into the chip: registers and tables, as plain integers."""

from dataclasses import dataclass, field, fields

from hdl.protocol import REMAP, TABLES, registers
from model.preprocessing.remap import pack_remap

__all__ = ["EROSION_MODES", "RADIAL_WORDS", "RECIPROCAL_WORDS", "Settings"]

#: Erosion modes in the order of their codes.
EROSION_MODES = ("off", "erode", "gate")
_WORDS = {table.name: table.words for table in TABLES}
RADIAL_WORDS, RECIPROCAL_WORDS = _WORDS["radial"], _WORDS["reciprocal"]


@dataclass(frozen=True)
class Settings:
    """Every integer that the RTL and the golden model are loaded with.

    Parameters
    ----------
    mean_window : :class:`int`
        Side of the window of the local mean in pixels, odd: a constructor choice of the chip,
        preset ``capsule``.
    fixed_noise : :class:`int`
        Noise in eighths of a grey value, up to 511, instead of the learnt one; 0 to learn it.
        Preset ``capsule``, as are the next three.
    lit_gain, core_gain, dent_gain : :class:`int`
        Levels as multiples of the noise, unsigned Q2.4.
    level_fixed : :class:`int` or None
        Fixed threshold, 1 to 255; None for the adaptive one. Preset ``paper``, as are the next two.
    threshold_alpha : :class:`int`
        Standard deviations above the mean, unsigned Q4.4.
    erosion : :class:`str`
        One of :data:`EROSION_MODES`.
    weighted : :class:`bool`
        Weigh pixels by their excess above the lit level, plus 1, instead of 1.
    area_min, area_max : :class:`int`
        Areas of spots in pixels, both included, 1 to 1023.
    saturation : :class:`int`
        Grey value of the sensor's maximum: pixels from it on are saturated. Preset ``capsule``.
    report_rejected : :class:`bool`
        Send rejected spots too, not only their number.
    principal_u, principal_v : :class:`int`
        Principal point, in LSBs of a coordinate.
    tangential_1, tangential_2 : :class:`int`
        p1 and p2 over the focal length, in the unit of ``model.stereo.undistort``.
    radial, reciprocal, line, window, depth : :class:`tuple` of :class:`int`
        Memory contents, a word each; formats in ``hdl/README.md``.
    remap : :class:`tuple` of :class:`int`
        A word for each pixel of the corrected image, see ``model/preprocessing/remap.py``; empty
        but for the preset ``paper``.
    """

    mean_window: int = 11
    fixed_noise: int = 0
    lit_gain: int = 18
    core_gain: int = 24
    dent_gain: int = 4
    level_fixed: int | None = None
    threshold_alpha: int = 5 << 4
    erosion: str = "gate"
    weighted: bool = True
    area_min: int = 2
    area_max: int = 1023
    saturation: int = 255
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
        """Registers of the chip and their values, by name, negative ones in two's complement."""
        values = {
            **{entry.name: getattr(self, entry.name) for entry in fields(self)},
            "threshold_fixed": self.level_fixed is not None,
            "threshold_level": self.level_fixed or 0,
            "erosion_mode": EROSION_MODES.index(self.erosion),
        }
        return {register.name: int(values[register.name]) & ((1 << register.bits) - 1)
                for register in registers() if register.name in values}

    def tables(self):
        """Words of every table of the preset that the settings are for, by the table's name."""
        words = {table.name: _packed(table, (getattr(self, part.name) for part in table.fields))
                 for table in TABLES}
        if self.remap:
            positions = [int(word) for word in pack_remap(self.remap)]
            positions += [0] * (len(positions) % 2)
            words[REMAP.name] = _packed(REMAP, (positions[::2], positions[1::2]))
        return words

    @classmethod
    def from_chip(cls, values, words):
        """Settings of a chip of the preset ``capsule`` that holds these registers and tables.

        Parameters
        ----------
        values : :class:`dict`
            Value of every register of :meth:`registers`, by its name.
        words : :class:`dict`
            Words of every table, by its name.
        """
        names = {entry.name for entry in fields(cls)}
        same = {}
        for register in registers():
            if register.name in names:
                value = values[register.name] & ((1 << register.bits) - 1)
                same[register.name] = value - (
                    register.signed << register.bits if value >> register.bits - 1 else 0)
        parts = {part.name: column for table in TABLES for part, column in zip(
            table.fields, _unpacked(table, words[table.name]), strict=True)}
        return cls(
            level_fixed=values["threshold_level"] if values["threshold_fixed"] else None,
            erosion=EROSION_MODES[values["erosion_mode"]],
            **{**same, "weighted": bool(same["weighted"]),
               "report_rejected": bool(same["report_rejected"])},
            **parts)


def _packed(table, columns):
    """Words of a table, from a sequence of values for each field."""
    words = []
    for values in zip(*columns, strict=True):
        word = place = 0
        for part, value in zip(table.fields, values, strict=True):
            word |= (int(value) & ((1 << part.bits) - 1)) << place
            place += part.bits
        words.append(word)
    return words


def _unpacked(table, words):
    """The values of each field of a table, from its words."""
    place, columns = 0, []
    for part in table.fields:
        columns.append(tuple(word >> place & ((1 << part.bits) - 1) for word in words))
        place += part.bits
    return columns
