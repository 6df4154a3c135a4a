"""What the chip sent: an independent decoder of the link, fed with octets as they come.

Numbers come from ``hdl/protocol.py``; nothing else is shared with the hardware or its model.
Whatever comes in, the decoder does not raise: it counts what it cannot use and goes on with the
next packet.
"""

import numpy as np

from hdl.protocol import COMPACT, TEXTURE_FIELDS, TRAILER_FIELDS, Flag, PacketKind
from scripts.host.framing import Deframer
from scripts.host.messages import (
    POINT,
    RECORD_OCTETS,
    Frame,
    Reply,
    TextureFrame,
    TexturePiece,
    fields_of,
)
from scripts.host.rebuild import point_check
from scripts.host.texture_packet import unpack

__all__ = ["POINT", "Decoder", "Frame", "Reply", "TextureFrame", "TexturePiece"]

_COUNTS = ("spots", "ok", "noise", "ambiguous", "rejected", "dropped", "unlisted")
_TEXTURE_OCTETS = sum(field.bits for field in TEXTURE_FIELDS) // 8
_TRAILER_OCTETS = sum(field.bits for field in TRAILER_FIELDS) // 8
#: Frames that may come after a later one, and how late, in microseconds.
_LATE_FRAMES, _LATE_US = 64, 2_000_000
#: Points of a frame, at most: the counts of the trailer have 16 bits.
_MOST_POINTS = 1 << 16


class Decoder:
    """Finds packets in octets, and frames in packets.

    Parameters
    ----------
    rebuild : :class:`scripts.host.rebuild.Rebuilder` or None
        Gives status, beam and inverse depth of compact points.

    Attributes
    ----------
    packets : :class:`int`
        Packets that were accepted.
    garbage : :class:`int`
        Octets outside of anything that could be a packet.
    damaged : :class:`int`
        Packets whose check or COBS is wrong.
    unknown : :class:`int`
        Packets of a kind or a length that is not known here, and those of texture that hold
        what no chip packs.
    lost : :class:`int`
        Packets that are missing between accepted ones by their sequence numbers, damaged ones
        included.
    unbalanced : :class:`int`
        Frames whose counts do not add up.
    mismatched : :class:`int`
        Frames whose check is not that of their points.
    """

    def __init__(self, rebuild=None):
        self.rebuild = rebuild
        self.packets = self.unknown = self.lost = self.unbalanced = self.mismatched = 0
        self._deframer = Deframer()
        self._sequence = None
        self._index = None  # of the latest frame
        self._timestamp = None
        self._counters = (0, 0)
        self._frame_lost = 0
        self._frames = 0
        self._forget()

    @property
    def octets(self):
        """Octets that were fed."""
        return self._deframer.octets

    @property
    def garbage(self):
        """Octets outside of anything that could be a packet."""
        return self._deframer.garbage

    @property
    def damaged(self):
        """Packets whose check or COBS is wrong."""
        return self._deframer.damaged

    def feed(self, octets):
        """Pattern frames that end in ``octets``, in a list."""
        return [event for event in self.events(octets) if isinstance(event, Frame)]

    def events(self, octets):
        """All that ends in ``octets``, in its order, in a list.

        :class:`Frame`, :class:`TextureFrame`, :class:`TexturePiece` or :class:`Reply` each.
        """
        return [event for _, events in self.packets_of(octets) for event in events]

    def packets_of(self, octets):
        """Yield, for each packet that ends in ``octets``, where, and a list of what it completes.

        Yields
        ------
        (:class:`int`, list)
            How many of ``octets`` end with the packet; events as of :meth:`events`.
        """
        for end, content in self._deframer.packets(octets):
            events = []
            self._packet(content, events)
            yield end, events

    def finish(self):
        """What is left of a frame whose last packet did not come, in a list."""
        events = []
        self._close(events)
        return events

    def _packet(self, content, events):
        self.packets += 1
        kind, sequence, body = content[0], content[1], content[2:]
        if self._sequence is not None:
            missing = (sequence - self._sequence) & 0xFF
            self.lost += missing
            self._frame_lost += missing
        self._sequence = (sequence + 1) & 0xFF
        if self._trailer is not None and kind != PacketKind.UNMATCHED:
            self._close(events)
        take = _PACKETS.get(kind)
        if take is None or not body or not take(self, body, events):
            self.unknown += 1

    # Each of these gives back False for a body that its kind cannot have.

    def _points(self, body, events):
        points = _compact(body[1:])
        if not points:
            return False
        self._more(body[0], points, True, events)
        return True

    def _points_last(self, body, events):
        return self._last(body, True, events)

    def _records(self, body, events):
        points = _records(body[1:])
        if not points:
            return False
        self._more(body[0], points, False, events)
        return True

    def _records_last(self, body, events):
        return self._last(body, False, events)

    def _unmatched(self, body, events):
        points = _records(body[1:])
        if not points:
            return False
        self._more(body[0], points, self._is_compact, events)
        self._close(events)
        return True

    def _texture(self, body, events):
        pieces = unpack(body)
        if pieces is None:
            return False
        index = self._on(body[0], 8)
        events += [TexturePiece(index, *piece) for piece in pieces]
        return True

    def _texture_frame(self, body, events):
        if len(body) != 1 + _TEXTURE_OCTETS:
            return False
        values = fields_of(body[1:], TEXTURE_FIELDS)
        if values["number"] & 0xFF != body[0]:
            return False
        self._counters = values["bad_sync"], values["overrun"]
        self._number(values)
        events.append(TextureFrame(**values))
        return True

    def _reply(self, body, events):
        if len(body) < 3:
            return False
        events.append(Reply(body[0], body[1], body[2], body[3:]))
        return True

    def _last(self, body, compact, events):
        """Points and trailer."""
        wide = _COUNTS if body[-1] >> Flag.WIDE & 1 else ()
        size = _TRAILER_OCTETS + len(wide)
        if len(body) < 1 + size:
            return False
        octets, values = body[1:-size], fields_of(body[-size:], TRAILER_FIELDS, wide)
        if values["number"] & 0xFF != body[0]:
            return False
        points = _compact(octets) if compact else _records(octets)
        if points is None:
            return False
        self._more(body[0], points, compact, events)
        self._number(values)
        self._trailer = values
        frame = Frame(**values)
        if not compact or frame.listed <= 0:
            self._close(events)
        return True

    def _more(self, low, points, compact, events):
        """Points of the frame whose number ends in ``low``."""
        if low != self._low or len(self._pieces) > _MOST_POINTS:
            self._close(events)
            self._low, self._is_compact = low, compact
        self._pieces += points

    def _close(self, events):
        """The frame that is under way, if there is one."""
        if self._low is None:
            return
        points = np.array(self._pieces, POINT)
        lost, self._frame_lost = self._frame_lost, 0
        bad_sync, overrun = self._counters
        values, compact = self._trailer, self._is_compact
        if values is None:
            ok, noise, ambiguous, rejected = np.bincount(points["status"], minlength=4).tolist()
            index = self._on(self._low, 8)
            self._index = index if self._index is None else max(self._index, index)
            values = {"number": index & 0xFFFF, "index": index, "summarised": False,
                      "spots": len(points), "ok": ok, "noise": noise, "ambiguous": ambiguous,
                      "rejected": rejected}
        trailer = self._trailer
        self._forget()
        sane = self._rebuilt(points, compact)
        values = {**values, "points": points, "compact": compact, "lost": lost,
                  "bad_sync": bad_sync, "overrun": overrun}
        frame = Frame(**values)
        if not self._frames and not self.lost and not frame.complete:
            values["joined"] = True
            frame = Frame(**values)
        self._frames += 1
        if trailer is not None:
            self.unbalanced += not frame.balanced
            ok = points[points["status"] == 0]
            if len(ok) == frame.ok and (not compact or self.rebuild or not len(ok)):
                verified = sane and point_check(ok["beam"], ok["inverse_z"]) == frame.check
                self.mismatched += not verified
                frame = Frame(**values, verified=verified)
        events.append(frame)

    def _forget(self):
        self._low = None  # of the number of the frame that is under way
        self._pieces = []
        self._is_compact = False
        self._trailer = None

    def _rebuilt(self, points, compact):
        """Whether ok points are so by the calibration; fills in what compact ones lack."""
        ok = points["status"] == 0
        if self.rebuild is None or not ok.any():
            return True
        status, beam, inverse_z = self.rebuild(points["u"][ok], points["v"][ok])
        if compact:
            points["beam"][ok], points["inverse_z"][ok] = beam, inverse_z
            return not status.any()
        return not status.any() and np.array_equal(beam, points["beam"][ok]) and np.array_equal(
            inverse_z, points["inverse_z"][ok])

    def _number(self, values):
        """Count the frame's number and time on beyond their bits."""
        values["index"] = self._on(values["number"], 16)
        self._index = values["index"] if self._index is None else max(
            self._index, values["index"])
        values["timestamp_us"] = _onward(self._timestamp, values["timestamp_us"], 24, _LATE_US)
        self._timestamp = values["timestamp_us"] if self._timestamp is None else max(
            self._timestamp, values["timestamp_us"])

    def _on(self, number, bits):
        return _onward(self._index, number, bits, _LATE_FRAMES)


_PACKETS = {
    PacketKind.POINTS: Decoder._points, PacketKind.POINTS_LAST: Decoder._points_last,
    PacketKind.RECORDS: Decoder._records, PacketKind.RECORDS_LAST: Decoder._records_last,
    PacketKind.UNMATCHED: Decoder._unmatched, PacketKind.TEXTURE: Decoder._texture,
    PacketKind.TEXTURE_FRAME: Decoder._texture_frame, PacketKind.REPLY: Decoder._reply}


def _onward(last, value, bits, late):
    """The number that ends in ``value`` and follows ``last``, or is at most ``late`` before it."""
    if last is None:
        return value
    step = (value - last) & ((1 << bits) - 1)
    behind = (1 << bits) - step
    return last - behind if step and behind <= min(late, last) else last + step


def _compact(octets):
    """Points as tuples of :data:`POINT`, or None if bits are left that cannot be padding."""
    word, left = int.from_bytes(octets, "little"), 8 * len(octets)
    points, v = [], 0
    while left >= COMPACT.SHORT_BITS:
        if word & 1:
            bits = COMPACT.LONG_BITS
            v, u, area = word >> 1 & 0x3FFFF, word >> 19 & 0x3FFFF, word >> 37 & 0x1FF
            flags = tuple(word >> bit & 1 for bit in (46, 47))
        else:
            bits = COMPACT.SHORT_BITS
            v += (word >> 1 & ((1 << COMPACT.V_BITS) - 1)) - COMPACT.V_OFFSET
            place = 1 + COMPACT.V_BITS
            u = word >> place & 0x3FFFF
            area = word >> place + 18 & ((1 << COMPACT.AREA_BITS) - 1)
            flags = 0, 0
        if bits > left or not 0 <= v < 1 << 18:
            return None
        points.append((0, 0, _area(area), *flags, u, v, 0))
        word >>= bits
        left -= bits
    return None if word or left >= 8 else points


def _area(code):
    """The smallest area that has this code."""
    return code if code < 256 else 2 * code - 256 if code < 384 else 4 * code - 1024


def _records(octets):
    """Points as tuples of :data:`POINT`, 10 octets each, or None if that is not what they are."""
    if len(octets) % RECORD_OCTETS:
        return None
    points = []
    for place in range(0, len(octets), RECORD_OCTETS):
        word = int.from_bytes(octets[place:place + RECORD_OCTETS], "little")
        label, inverse_z = word & 0x1FF, word >> 56
        if inverse_z >> 18 or (not inverse_z and not 1 <= label <= 3):
            return None
        points.append((0 if inverse_z else label, label if inverse_z else 0,
                       _area(word >> 9 & 0x1FF), *(word >> bit & 1 for bit in (18, 19)),
                       word >> 20 & 0x3FFFF, word >> 38 & 0x3FFFF, inverse_z))
    return points
