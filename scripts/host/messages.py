"""What packets from the chip contain, each in a class of its own."""

from dataclasses import dataclass, field

import numpy as np

from hdl.protocol import Flag

__all__ = ["POINT", "RECORD_OCTETS", "Frame", "Reply", "TextureFrame", "TexturePiece", "fields_of"]

#: Octets of a record of a point.
RECORD_OCTETS = 10
#: A point in the integer units of the link.
POINT = np.dtype([("status", np.uint8), ("beam", np.uint16), ("area", np.uint16),
                  ("saturated", np.bool_), ("border", np.bool_), ("u", np.uint32),
                  ("v", np.uint32), ("inverse_z", np.uint32)])


class _Flags:
    """The bits of ``flags`` by their names, for what has such an octet."""

    def _flag(self, bit):
        return bool(self.flags >> bit & 1)

    @property
    def learning(self):
        """No level was known: the frame has no points."""
        return self._flag(Flag.LEARNING)

    @property
    def broken(self):
        """The frame lost synchronism."""
        return self._flag(Flag.BROKEN)

    @property
    def laser(self):
        """The laser was lit."""
        return self._flag(Flag.LASER)

    @property
    def capture(self):
        """Taken in calibration capture."""
        return self._flag(Flag.CAPTURE)

    @property
    def tripped(self):
        """The laser guard holds a cause."""
        return self._flag(Flag.TRIPPED)

    @property
    def tables_valid(self):
        """The chip holds tables that were committed and checked."""
        return self._flag(Flag.TABLES_VALID)


@dataclass(frozen=True)
class Frame(_Flags):
    """What is known of a pattern frame.

    Parameters
    ----------
    number : :class:`int`
        As the chip counts frames, 16 bits.
    level : :class:`int`
        Level from which on pixels were lit, in sixteenths of a grey value: above the local mean, or
        in the preset ``paper`` above 0.
    every : :class:`int`
        One pattern frame in so many is measured, the others are left out; 0 is as 1.
    grey_noise : :class:`int`
        What the level is a multiple of, in eighths of a grey value; 0 in the preset ``paper``.
    saturated : :class:`int`
        Pixels at the sensor's maximum; 0 in the preset ``paper``.
    skipped : :class:`int`
        Frames that the chip left out before this one.
    exposure_us : :class:`int`
        Integration time in microseconds.
    timestamp_us : :class:`int`
        Start of the integration in microseconds, counted on beyond the chip's 24 bits.
    check : :class:`int`
        The chip's CRC over beam and inverse depth of all ok points.
    spots, ok, noise, ambiguous, rejected, dropped, unlisted : :class:`int`
        All spots, what became of them, and those not ok that no packet lists.
    flags : :class:`int`
        Bits of :class:`hdl.protocol.Flag`, properties here.
    index : :class:`int`
        ``number``, counted on beyond its 16 bits.
    points : array of :data:`POINT`
        Those that arrived, in the order of sending. ``beam`` and ``inverse_z`` of compact points
        are zero unless the decoder has what it needs to rebuild them.
    compact : :class:`bool`
        The points came without beam and inverse depth.
    verified : :class:`bool` or None
        Whether ``check`` is that of ``points``, and beam and depth are those of the calibration;
        None if points are missing or were not rebuilt.
    lost : :class:`int`
        Packets that are missing since the pattern frame before.
    summarised : :class:`bool`
        False if the frame's trailer was lost: the counts are then those of ``points``, and all
        other fields of the trailer are zero.
    bad_sync, overrun : :class:`int`
        The camera's counters, which stop at 255, as of the last texture frame.
    joined : :class:`bool`
        The decoder started in the middle of this frame, so that its first packets are missing.
    """

    number: int
    level: int = 0
    every: int = 1
    grey_noise: int = 0
    saturated: int = 0
    skipped: int = 0
    exposure_us: int = 0
    timestamp_us: int = 0
    check: int = 0
    spots: int = 0
    ok: int = 0
    noise: int = 0
    ambiguous: int = 0
    rejected: int = 0
    dropped: int = 0
    unlisted: int = 0
    flags: int = 0
    index: int = 0
    points: np.ndarray = field(default_factory=lambda: np.zeros(0, POINT), repr=False)
    compact: bool = False
    verified: bool | None = None
    lost: int = 0
    summarised: bool = True
    bad_sync: int = 0
    overrun: int = 0
    joined: bool = False

    @property
    def balanced(self):
        """Every spot is accounted for."""
        return self.spots == (
            self.ok + self.noise + self.ambiguous + self.rejected + self.dropped)

    @property
    def listed(self):
        """Spots that are not ok and that packets list."""
        return self.noise + self.ambiguous + self.rejected - self.unlisted

    @property
    def complete(self):
        """Every point that the trailer counts has arrived."""
        if not self.summarised:
            return False
        ok, noise, ambiguous, rejected = np.bincount(self.points["status"], minlength=4)
        return bool(ok == self.ok and noise <= self.noise and ambiguous <= self.ambiguous
                    and rejected <= self.rejected and noise + ambiguous + rejected == self.listed)


@dataclass(frozen=True)
class TextureFrame(_Flags):
    """What is known of a texture frame; fields as those of :class:`Frame`."""

    number: int
    skipped: int
    exposure_us: int
    timestamp_us: int
    bad_sync: int
    overrun: int
    flags: int
    index: int


@dataclass(frozen=True)
class TexturePiece:
    """Pixels of a row of the texture frame ``index``, from ``column`` to the right."""

    index: int
    row: int
    column: int
    pixels: np.ndarray = field(repr=False)


@dataclass(frozen=True)
class Reply:
    """The answer to the command that had this tag."""

    tag: int
    command: int
    reason: int
    data: bytes = b""


def fields_of(octets, fields, wide=()):
    """Values of fields by their names, low octets first.

    Parameters
    ----------
    octets : :class:`bytes`
        Those of the fields, without gaps.
    fields : iterable of :class:`hdl.protocol.Field`
        Which they are.
    wide : collection of :class:`str`
        Names of fields that have 16 bits here.
    """
    word, values = int.from_bytes(octets, "little"), {}
    for each in fields:
        bits = 16 if each.name in wide else each.bits
        values[each.name] = word & ((1 << bits) - 1)
        word >>= bits
    return values
