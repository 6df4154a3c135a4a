"""Points and counts of pattern frames to packets."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.crc import catalog
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import BEAM_BITS, Counts, Detection, FrameInfo, PacketOctet, Point
from ..ports import register_ports
from ..protocol import COMPACT, CONTENT_LIMIT, TRAILER_FIELDS, PacketKind
from .packet_fields import bits_of_fields, flags_octet

__all__ = ["Points"]

# The point as it is read: where its fields begin, the label at 0, and where it ends. The label is
# the beam of an ok point, whose 1/z is never zero, and the status of others.
_FIELDS = ("area", "saturated", "border", "u", "v", "inverse_z")
_POINT = data.StructLayout({
    "label": BEAM_BITS, **{name: Point.as_shape()[name].shape for name in _FIELDS}})
_AREA, _U, _V, _INVERSE_Z = (
    _POINT[name].offset for name in ("area", "u", "v", "inverse_z"))
_END = _POINT.size

#: A record is whole octets; zeros follow the point.
_RECORD_BITS = -(-_END // 8) * 8
_RECORDS = 9  # in a full packet
#: Bits for points: sequence number, kind, frame number and check take the rest.
_ROOM = 8 * (CONTENT_LIMIT - 7)
#: Counts of the trailer. Those that are counted here leave as one chain of counters.
_COUNTS = ("spots", "ok", "noise", "ambiguous", "rejected", "dropped", "unlisted")
_CHAINED = ("ok", "noise", "ambiguous", "rejected", "unlisted")
_NARROW = sum(field.bits for field in TRAILER_FIELDS)
#: The most bits in a packet before a point, or before the trailer, of each form.
_LIMIT_SHORT, _LIMIT_LONG = _ROOM - COMPACT.SHORT_BITS, _ROOM - COMPACT.LONG_BITS
_LIMIT_NARROW, _LIMIT_WIDE = _ROOM - _NARROW, _ROOM - _NARROW - 8 * len(_COUNTS)

#: Positions of head and trailer in the order of sending: kind, number, and so on; counts have
#: 16 bits there, and stand at multiples of 16, as does the check.
_WIDE = dict.fromkeys(_COUNTS, 16)
_HEAD, _NUMBER, _BODY = 32, 40, 48
_TRAILER, _TAIL_END = {}, _NUMBER
for _field in TRAILER_FIELDS:
    _TRAILER[_field.name] = _TAIL_END
    _TAIL_END += _WIDE.get(_field.name, _field.bits)
assert not any(_TRAILER[name] % 16 for name in ("check", *_COUNTS, "flags"))


class _Shared:
    """What the parts of the block share."""

    def __init__(self):
        #: Position in the point while that is read and written, else the one in head
        #: and trailer, or in the memory.
        self.index = Signal(10)

        # The point. It is read once or, where its packet was full, twice; then written.
        self.is_ok = Signal()
        self.is_record = Signal()
        self.reading = Signal()
        self.writing = Signal()
        self.was_read = Signal()
        self.bit = Signal()
        self.in_v = Signal()
        self.is_long = Signal()
        self.form_is_long = Signal()
        self.borrow_not = Signal()
        self.ahead = Signal()
        self.too_far = Signal()
        self.v_before = Signal(18)
        self.v_step = Signal()

        # The frame: whether some of it was taken, and its form.
        self.in_frame = Signal()
        self.frame_records = Signal()
        self.records = Signal()

        # The memory: a bit of the packet's points, or of the unmatched spots' records.
        self.store = Signal()
        self.stored_bit = Signal()
        self.to_unmatched = Signal()
        self.points_bits = Signal(10)
        self.unmatched_bits = Signal(10)
        self.points_full = Signal()  # with records only
        self.unmatched_full = Signal()

        # The packet: its last one of the frame, the one of the unmatched spots; what is sent of it.
        self.closing = Signal()
        self.is_unmatched = Signal()
        self.in_body = Signal()
        self.in_trailer = Signal()
        self.shift = Signal()
        self.field = Signal()
        self.wide = Signal()
        self.in_chain = Signal()
        self.counted = Signal()
        self.carry_in = Signal()


class Points(wiring.Component):
    """Packs a frame's points as they come, closes the frame with its counts.

    ``hdl/protocol.py`` has the format. Ok points go into packets in the compact form; the first
    nine unmatched spots, those that are not ok, go into one packet behind the frame's last. With
    ``full_records`` all points go into packets as records. A packet is closed when the next point
    does not fit, by length alone. Points are collected in a memory, bit by bit, so that a packet is
    offered only when it is whole: from its first octet on, one follows within 10 clocks of the
    other. The packet of unmatched spots begins within 14 clocks of the frame's last octet.

    A point takes 81 clocks if it is not ok, else 83 more than its bits, if its packet has room;
    then 81 more after the packet was taken. A point waits while the packet before it does. Points
    are counted here by status. If the counts do not add up (spots = points + rejected + dropped),
    upper halves of counts may be missing in the trailer. Reset forgets everything.

    Members
    -------
    i : :py:`In(stream.Signature(Point))`
        Points and end markers.
    counts : :py:`In(stream.Signature(Counts))`
        One for each frame, needed once its end marker is there, and taken with it.
    detection : :py:`In(stream.Signature(Detection))`
        Likewise.
    info : :py:`In(stream.Signature(FrameInfo))`
        One for each frame, needed once a packet is full or its end marker is there, and taken with
        that.
    full_records : :py:`In(1)`
        Send all points as records; sampled with a frame's first point or end marker.
    o : :py:`Out(stream.Signature(PacketOctet))`
        Packets.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a frame's end marker, with its info and counts, to the first octet of its last
        packet, at most, if that has room for the trailer.
    """

    latency = 18

    registers = register_ports("full_records")

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(Point)),
            "counts": In(stream.Signature(Counts)),
            "detection": In(stream.Signature(Detection)),
            "info": In(stream.Signature(FrameInfo)),
            **self.registers,
            "o": Out(stream.Signature(PacketOctet)),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.check = check = catalog.CRC16_IBM_SDLC(data_width=1).create()
        s = _Shared()
        point = self.i.p
        m.d.comb += [
            s.is_ok.eq(point.status.as_value() == 0),
            s.records.eq(Mux(s.in_frame, s.frame_records, self.full_records)),
            s.is_record.eq(s.records | ~s.is_ok),
            s.bit.eq(Cat(point.beam | point.status.as_value(), *(point[name] for name in _FIELDS))
                     .bit_select(s.index[:7], 1)),
        ]
        memory = self._store_bits(m, s)
        self._difference(m, s)
        self._count(m, s)
        self._fields(m, s, check)
        octet_ready = self._octet(m, s, memory)

        limit, too_full = Signal(10), Signal()
        m.d.comb += [
            limit.eq(Mux(point.end, Mux(s.wide, _LIMIT_WIDE, _LIMIT_NARROW),
                         Mux(s.is_long, _LIMIT_LONG, _LIMIT_SHORT))),
            too_full.eq(s.points_bits > limit),
        ]
        with m.FSM():
            self._collect(m, s, too_full)
            self._send(m, s, check, octet_ready)
        return m

    def _store_bits(self, m, s):
        """Memory of one bit a word: the packet's points below, the unmatched spots above."""
        m.submodules.bits = memory = Memory(shape=1, depth=2048, init=[])
        write = memory.write_port()
        full = _RECORDS * _RECORD_BITS
        m.d.comb += [
            s.unmatched_full.eq(self._has_reached(s.unmatched_bits, full)),
            s.points_full.eq(self._has_reached(s.points_bits, full)),
            write.addr.eq(Mux(s.to_unmatched, Cat(s.unmatched_bits, C(1, 1)),
                              Cat(s.points_bits, C(0, 1)))),
            write.data.eq(s.stored_bit),
            write.en.eq(s.store),
        ]
        with m.If(s.store & s.to_unmatched):
            m.d.sync += s.unmatched_bits.eq(s.unmatched_bits + 1)
        with m.If(s.store & ~s.to_unmatched):
            m.d.sync += s.points_bits.eq(s.points_bits + 1)
        return memory

    def _difference(self, m, s):
        """v less the one before, plus one pixel, from the lowest bit on.

        While the point is read, the one before is rotated; while it is written, this one replaces
        it.
        """
        ahead_now, difference = Signal(), Signal()
        m.d.comb += [
            s.in_v.eq((s.index[:7] >= _V) & (s.index[:7] < _INVERSE_Z)),
            difference.eq(s.bit ^ ~s.v_before[0] ^ s.borrow_not),
            ahead_now.eq(s.ahead | (
                s.index[:7] == _V + (COMPACT.V_OFFSET - 1).bit_length())),
            s.v_step.eq(difference ^ ahead_now),
            # Of a step that fits, the bits above V_BITS are zero and so is its sign.
            s.is_long.eq(s.too_far | (s.borrow_not == s.ahead)
                         | self.i.p.area[COMPACT.AREA_BITS:].any()
                         | self.i.p.saturated | self.i.p.border),
        ]
        with m.If((s.reading | s.writing) & s.in_v):
            m.d.sync += [
                s.v_before.eq(Cat(s.v_before[1:], Mux(s.writing, s.bit, s.v_before[0]))),
                s.borrow_not.eq((s.bit & ~s.v_before[0])
                                | (s.borrow_not & (s.bit | ~s.v_before[0]))),
                s.ahead.eq(ahead_now & difference),
            ]
            with m.If(s.index[:7] >= _V + COMPACT.V_BITS):
                m.d.sync += s.too_far.eq(s.too_far | s.v_step)

    def _count(self, m, s):
        """Counts of points by status, then those that no packet lists.

        While a point is read its counter is rotated and one is added; in the trailer all are
        shifted out as one chain, zeros following, and the spots that were rejected before they were
        points are added to two of them on the way.
        """
        index, status = s.index, self.i.p.status.as_value()
        counters = [Signal(16, name=f"count_{name}") for name in _CHAINED]
        selected = Signal(len(counters))
        carry = Signal()
        m.d.comb += [
            s.in_chain.eq(Cat(index[4:9] == _TRAILER[name] >> 4 for name in _CHAINED).any()),
            s.carry_in.eq(Mux(index[:4] == 0, ~s.in_trailer, carry)),
            s.counted.eq((Cat(counter[0] for counter in counters) & selected).any()),
        ]
        with m.If(s.in_trailer):
            m.d.comb += selected.eq(s.in_chain)
        with m.Elif(index[4]):
            m.d.comb += selected.eq(Cat(status == n for n in range(4)))
        with m.Else():
            m.d.comb += selected[4].eq(s.is_record & ~s.records & s.unmatched_full)
        with m.If(s.reading | s.shift):
            m.d.sync += carry.eq((s.counted & s.carry_in)
                                 | (s.field & s.in_trailer & (s.counted | s.carry_in)))
        with m.If(s.shift & s.in_trailer & s.in_chain):
            m.d.sync += Cat(counters).eq(Cat(counters) >> 1)
        with m.Elif(s.reading & ~s.was_read & (index[4] ^ index[5]) & ~index[6]):
            for n, counter in enumerate(counters):
                with m.If(index[5] if n == 4 else index[4]):
                    m.d.sync += counter.eq(
                        Cat(counter[1:], counter[0] ^ (selected[n] & s.carry_in)))

    def _fields(self, m, s, check):
        """Head and trailer, bit by bit, and the check over the points in it."""
        counts, info, index = self.counts.p, self.info.p, s.index
        detection = self.detection.p
        kind = Cat(s.closing & ~s.is_unmatched, s.records, s.is_unmatched,
                   C(PacketKind.POINTS >> 3, 5))
        flags = flags_octet(
            wide=s.wide, learning=detection.learning, broken=counts.broken, laser=info.tag.laser,
            capture=info.tag.capture, tripped=info.tripped, tables_valid=info.tables_valid,
            texture=info.tag.texture)
        fields = Cat(C(0, _HEAD), kind, bits_of_fields(TRAILER_FIELDS, {
            **dict.fromkeys(_CHAINED, C(0, 16)),
            "number": info.number, "level": detection.level, "every": info.every,
            "grey_noise": detection.noise, "saturated": detection.saturated,
            "skipped": info.skipped,
            "exposure_us": info.tag.exposure_us, "timestamp_us": info.tag.timestamp_us,
            "check": check.crc[0].replicate(16), "spots": counts.spots,
            "dropped": counts.dropped, "flags": flags,
            # Those rejected before they were points are added to what was counted here.
            "rejected": counts.rejected, "unlisted": counts.rejected,
        }, widths=_WIDE))
        in_check = Signal()
        m.d.comb += [
            s.wide.eq(counts.spots[8:].any()),
            # In two steps, so that what stands in two positions costs once.
            s.field.eq(Cat(fields[at:at + 16].bit_select(index[:4], 1)
                           for at in range(0, 304, 16)).bit_select(index[4:9], 1)),
            in_check.eq(s.in_trailer & (index[4:9] == _TRAILER["check"] >> 4)),
            # A CRC that is fed with what it gives, inverted, shifts out unchanged.
            check.valid.eq(Mux(
                s.reading, s.is_ok & ~s.was_read & (
                    (index[:7] < _AREA)
                    | (index[:7] >= _INVERSE_Z) & (index[:7] < _END)),
                s.shift & in_check)),
            check.data.eq(Mux(s.reading, s.bit, ~check.crc[0])),
        ]

    def _octet(self, m, s, memory):
        """The octet that is shifted together; high when it is.

        The memory's bit is there a clock after its address, so the others are as late.
        """
        read = memory.read_port()
        octet, shifted, other_bit = Signal(8), Signal(), Signal()
        m.d.comb += [read.addr.eq(Cat(s.index, s.is_unmatched)), self.o.p.data.eq(octet)]
        m.d.sync += [
            shifted.eq(s.shift),
            other_bit.eq(s.field ^ ((s.counted ^ s.carry_in) & s.in_trailer & s.in_chain))]
        with m.If(shifted):
            m.d.sync += octet.eq(Cat(octet[1:], Mux(s.in_body, read.data, other_bit)))
        return ~shifted

    def _collect(self, m, s, too_full):
        """Points to the memory, until the packet is full or the frame ends."""
        point, index = self.i.p, s.index
        with m.State("NEXT"):
            m.d.sync += [index.eq(0), s.borrow_not.eq(1), s.ahead.eq(0), s.too_far.eq(0)]
            with m.If(self.i.valid):
                m.d.sync += [s.in_frame.eq(1), s.frame_records.eq(s.records)]
            with m.If(self.i.valid & ~point.end & ~(s.records & s.points_full)):
                m.next = "READ"
            with m.If(self.i.valid & self.info.valid & Mux(
                    point.end, self.counts.valid & self.detection.valid,
                    s.records & s.points_full)):
                m.d.sync += s.closing.eq(point.end & ~too_full)
                m.next = "PAD"

        with m.State("READ"):
            m.d.comb += [
                s.reading.eq(1), s.to_unmatched.eq(~s.records), s.stored_bit.eq(s.bit),
                s.store.eq(s.is_record & ~(s.to_unmatched & s.unmatched_full)),
            ]
            m.d.sync += index.eq(index + 1)
            with m.If(index[:7] == _RECORD_BITS - 1):
                m.next = "FORM"
                with m.If(s.is_record):
                    m.d.comb += self.i.ready.eq(1)
                    m.next = "NEXT"

        with m.State("FORM"):
            m.d.sync += [
                s.form_is_long.eq(s.is_long), index.eq(_V), s.borrow_not.eq(1), s.ahead.eq(0)]
            m.d.comb += s.stored_bit.eq(s.is_long)
            with m.If(~too_full):
                m.d.comb += s.store.eq(1)
                m.next = "WRITE"
            with m.Elif(self.info.valid):
                m.d.sync += s.was_read.eq(1)
                m.next = "PAD"

        with m.State("WRITE"):
            m.d.comb += [
                s.writing.eq(1),
                s.store.eq(~s.in_v | s.form_is_long | (index[:7] < _V + COMPACT.V_BITS)),
                s.stored_bit.eq(Mux(s.in_v & ~s.form_is_long, s.v_step, s.bit)),
            ]
            m.d.sync += index.eq(index + 1)
            with m.If(index[:7] == _INVERSE_Z - 1):
                m.d.sync += index.eq(_U)
            with m.If(index[:7] == _V - 1):
                m.d.sync += index.eq(_AREA)
            with m.If(index[:7] == Mux(s.form_is_long, _U - 1, _AREA + COMPACT.AREA_BITS - 1)):
                m.d.comb += self.i.ready.eq(1)
                m.d.sync += s.was_read.eq(0)
                m.next = "NEXT"

    def _send(self, m, s, check, octet_ready):
        """The packet, octet by octet: head, body, and the trailer of the frame's last one."""
        index = s.index
        end = Signal(7)
        body_ends, trailer_ends = Signal(), Signal()
        skip = Signal()  # the upper half of a narrow count
        m.d.comb += [
            end.eq(Mux(s.is_unmatched, s.unmatched_bits[3:], s.points_bits[3:])),
            body_ends.eq(s.in_body & (index[3:] == end)),
            trailer_ends.eq(s.in_trailer & (index[3:9] == _TAIL_END >> 3)),
            skip.eq(s.in_trailer & ~s.wide & (index[4:9] >= _TRAILER["spots"] >> 4)
                    & (index[4:9] < _TRAILER["flags"] >> 4) & index[3]),
            self.o.p.last.eq(body_ends & (s.is_unmatched | ~s.closing) | trailer_ends),
        ]

        with m.State("PAD"):
            m.d.comb += s.store.eq(s.points_bits[:3].any())
            m.d.sync += index.eq(_HEAD)
            with m.If(~s.store):
                m.next = "SHIFT"

        with m.State("SHIFT"):
            m.d.comb += s.shift.eq(1)
            m.d.sync += index.eq(index + 1)
            with m.If(index[:3].all() & ~skip):
                m.next = "OCTET"

        with m.State("OCTET"):
            m.d.comb += self.o.valid.eq(octet_ready)
            with m.If(self.o.valid & self.o.ready):
                m.next = "SHIFT"
                with m.If(~s.in_body & ~s.in_trailer & (index[:8] == _BODY)):
                    m.d.sync += [s.in_body.eq(1), index.eq(0)]
                    with m.If(~s.is_unmatched & (s.points_bits == 0)):
                        m.d.sync += [s.in_body.eq(0), s.in_trailer.eq(1), index.eq(_NUMBER)]
                with m.If(body_ends & s.closing & ~s.is_unmatched):
                    m.d.sync += [s.in_body.eq(0), s.in_trailer.eq(1), index.eq(_NUMBER)]
                with m.If(self.o.p.last):
                    m.d.sync += [
                        s.in_body.eq(0), s.in_trailer.eq(0), s.points_bits.eq(0),
                        s.v_before.eq(0), index.eq(_HEAD)]
                    with m.If(s.in_trailer & (s.unmatched_bits != 0)):
                        m.d.sync += s.is_unmatched.eq(1)
                    with m.Else():
                        m.next = "NEXT"
                        with m.If(s.closing):
                            self._finish_frame(m, s, check)

    def _finish_frame(self, m, s, check):
        """Take the end marker and what belongs to the frame."""
        m.d.comb += [
            self.i.ready.eq(1), self.counts.ready.eq(1), self.detection.ready.eq(1),
            self.info.ready.eq(1),
            check.start.eq(1)]
        m.d.sync += [
            s.unmatched_bits.eq(0), s.closing.eq(0), s.is_unmatched.eq(0), s.in_frame.eq(0)]

    @staticmethod
    def _has_reached(value, number):
        """Whether ``value``, which only grows to ``number``, has come there."""
        return Cat(value[n] for n in range(len(value)) if number >> n & 1).all()
