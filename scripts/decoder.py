"""What the chip sent: an independent decoder of the link, fed with octets as they come.

The format is in ``hdl/link/README.md``; nothing is shared with the hardware or its model. Whatever
comes in, the decoder does not raise: it counts what it cannot use and goes on at the next flag.
"""

import binascii
from dataclasses import dataclass, field

import numpy as np

__all__ = ["POINT", "Decoder", "Frame"]

#: A point in the integer units of the link.
POINT = np.dtype([("status", np.uint8), ("beam", np.uint8), ("area", np.uint8), ("u", np.uint32),
                  ("v", np.uint32), ("inverse_z", np.uint32)])

_FLAG = b"\x7e"
_WIRE_LIMIT = 100
_CRC_OCTETS = 2
_SHORTEST = 4 + _CRC_OCTETS
_POINTS, _FRAME = 0x50, 0x46
_POINT_OCTETS = 9
_SUMMARY_OCTETS = 22
_VERSION = 1
_MIRROR = bytes(int(f"{octet:08b}"[::-1], 2) for octet in range(256))


@dataclass(frozen=True)
class Frame:
    """What is known of one frame.

    Parameters
    ----------
    number : :class:`int`
        As the chip counts frames, 16 bits.
    level : :class:`int`
        Threshold.
    learning, broken : :class:`bool`
        No threshold was learnt yet; the frame lost synchronism.
    skipped : :class:`int`
        Frames that the chip left out before this one.
    spots, ok, noise, ambiguous, rejected, dropped : :class:`int`
        All spots, and what became of them.
    bad_sync, overrun : :class:`int`
        The camera's counters, which stop at 255.
    points : array of :data:`POINT`
        Those that arrived, in the order of sending.
    lost : :class:`int`
        Packets that are missing since the frame before.
    summarised : :class:`bool`
        False if the frame's summary was lost: the counts are then those of ``points``, and what
        else the summary would have told is zero.
    """

    number: int
    level: int = 0
    learning: bool = False
    broken: bool = False
    skipped: int = 0
    spots: int = 0
    ok: int = 0
    noise: int = 0
    ambiguous: int = 0
    rejected: int = 0
    dropped: int = 0
    bad_sync: int = 0
    overrun: int = 0
    points: np.ndarray = field(default_factory=lambda: np.zeros(0, POINT), repr=False)
    lost: int = 0
    summarised: bool = True

    @property
    def balanced(self):
        """Every spot is accounted for."""
        return self.spots == (
            self.ok + self.noise + self.ambiguous + self.rejected + self.dropped)

    @property
    def complete(self):
        """Every point that the summary counts has arrived."""
        if not self.summarised:
            return False
        ok, noise, ambiguous, rejected = np.bincount(self.points["status"], minlength=4)
        return ((ok, noise, ambiguous) == (self.ok, self.noise, self.ambiguous)
                and rejected <= self.rejected)


class Decoder:
    """Finds packets in octets, and frames in packets.

    Attributes
    ----------
    packets : :class:`int`
        Packets that were accepted.
    garbage : :class:`int`
        Octets outside of anything that could be a packet.
    damaged : :class:`int`
        Packets whose check or escapes are wrong.
    unknown : :class:`int`
        Packets of a type, version or length that is not known here.
    lost : :class:`int`
        Packets that are missing between accepted ones, as their numbers tell; damaged ones are
        among them.
    unbalanced : :class:`int`
        Frames whose counts do not add up.
    """

    def __init__(self):
        self.packets = self.garbage = self.damaged = self.unknown = self.lost = 0
        self.unbalanced = 0
        self._pending = b""  # since the last flag
        self._overlong = False  # that much came without a flag that it cannot be a packet
        self._sequence = None
        self._number = None  # of the frame that the points are of
        self._points = bytearray()
        self._frame_lost = 0

    def feed(self, octets):
        """Frames that end in ``octets``, in a list."""
        *pieces, rest = (self._pending + bytes(octets)).split(_FLAG)
        frames = []
        for piece in pieces:
            if self._overlong:
                self.garbage += len(piece)
                self._overlong = False
            elif piece:
                content = self._content(piece)
                if content is not None:
                    self._packet(content, frames)
        if self._overlong or len(rest) >= _WIRE_LIMIT:
            self.garbage += len(rest)
            self._overlong = True
            rest = b""
        self._pending = rest
        return frames

    def finish(self):
        """What is left of a frame whose summary did not come, in a list."""
        frames = []
        self._unsummarised(frames)
        return frames

    def _content(self, piece):
        """A packet without escapes and check, or None."""
        if len(piece) < _SHORTEST or len(piece) > _WIRE_LIMIT - 2:
            self.garbage += len(piece)
            return None
        content = piece
        escapes = piece.count(0x7D)
        if escapes:
            if escapes != piece.count(b"\x7d\x5e") + piece.count(b"\x7d\x5d"):
                self.damaged += 1
                return None
            content = content.replace(b"\x7d\x5e", b"\x7e").replace(b"\x7d\x5d", b"\x7d")
        # FCS-16 is CRC-CCITT over mirrored bits; over a packet and its check it leaves 0x1D0F.
        if len(content) < _SHORTEST or (
                binascii.crc_hqx(content.translate(_MIRROR), 0xFFFF) != 0x1D0F):
            self.damaged += 1
            return None
        return content[:-_CRC_OCTETS]

    def _packet(self, content, frames):
        self.packets += 1
        kind, sequence, number = content[0], content[1], content[2] | content[3] << 8
        if self._sequence is not None:
            missing = (sequence - self._sequence) & 0xFF
            self.lost += missing
            self._frame_lost += missing
        self._sequence = (sequence + 1) & 0xFF

        if kind == _POINTS and len(content) > 4 and not (len(content) - 4) % _POINT_OCTETS:
            if number != self._number:
                self._unsummarised(frames)
                self._number = number
            self._points += content[4:]
        elif kind == _FRAME and len(content) == _SUMMARY_OCTETS and content[7] == _VERSION:
            if number != self._number:
                self._unsummarised(frames)
            spots, ok, noise, ambiguous, rejected, dropped = (
                content[at] | content[at + 1] << 8 for at in range(8, 20, 2))
            frame = Frame(
                number, content[4], bool(content[5] & 1), bool(content[5] & 2), content[6],
                spots, ok, noise, ambiguous, rejected, dropped, content[20], content[21],
                *self._taken())
            self.unbalanced += not frame.balanced
            frames.append(frame)
        else:
            self.unknown += 1

    def _taken(self):
        """Points and lost packets up to here."""
        taken = _points(bytes(self._points)), self._frame_lost
        self._number = None
        self._points.clear()
        self._frame_lost = 0
        return taken

    def _unsummarised(self, frames):
        if self._points:
            number = self._number
            points, lost = self._taken()
            counts = (int(count) for count in np.bincount(points["status"], minlength=4))
            ok, noise, ambiguous, rejected = counts
            frames.append(Frame(
                number, spots=len(points), ok=ok, noise=noise, ambiguous=ambiguous,
                rejected=rejected, points=points, lost=lost, summarised=False))


def _points(octets):
    """Points from their octets, 9 each."""
    raw = np.frombuffer(octets, np.uint8).reshape(-1, _POINT_OCTETS)
    low = np.ascontiguousarray(raw[:, :8]).view("<u8").reshape(-1)
    points = np.zeros(len(raw), POINT)
    for name, place, bits in [("status", 0, 2), ("beam", 2, 7), ("area", 9, 8), ("u", 17, 18),
                              ("v", 35, 18), ("inverse_z", 53, 11)]:
        points[name] = low >> np.uint64(place) & np.uint64((1 << bits) - 1)
    points["inverse_z"] |= raw[:, 8].astype(np.uint32) << np.uint32(11)
    return points
