"""Points and counts of pattern frames to packets."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.crc import catalog
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import Counts, FrameInfo, PacketOctet, Point
from ..ports import register_ports
from ..protocol import COMPACT, CONTENT_LIMIT, TRAILER_FIELDS, PacketKind

__all__ = ["Points"]

_RECORD_BITS = 72
_RECORDS = 10  # in a full packet
#: Bits for points: sequence number, kind, frame number and check take the rest.
_ROOM = 8 * (CONTENT_LIMIT - 7)
_COUNTS = 7
_NARROW = sum(field.bits for field in TRAILER_FIELDS)
#: The most bits in a packet before a point, or before the trailer, of each form.
_LIMIT_SHORT, _LIMIT_LONG = _ROOM - COMPACT.SHORT_BITS, _ROOM - COMPACT.LONG_BITS
_LIMIT_NARROW, _LIMIT_WIDE = _ROOM - _NARROW, _ROOM - _NARROW - 8 * _COUNTS

# Places of a point's fields in its payload.
_BEAM, _AREA, _U, _V, _INVERSE_Z, _END = 3, 10, 18, 36, 54, 72
# Places of head and trailer in the order of sending; the counts stand at multiples of 16.
_HEAD, _NUMBER, _BODY, _TAIL_END = 32, 40, 48, 248


class Points(wiring.Component):
    """Packs a frame's points as they come, closes the frame with its counts.

    ``hdl/protocol.py`` has the format. Ok points go into packets in the compact form, the first
    ten others into one packet that follows the frame's last. With ``full_records`` all points go
    into packets as records. A packet is closed when the next point does not fit, by length alone.
    Points are collected in a memory, bit by bit, so that a packet is offered only when it is
    whole: from its first octet on, one follows within 10 clocks of the other. The packet of
    the others begins within 14 clocks of the frame's last octet.

    A point takes 73 clocks if it is not ok, else 75 more than its bits, if its packet has room;
    then 73 more after the packet was taken. A point waits while the packet before it does. The
    counts of points by status are kept here. Counts that do not add up (spots = points + rejected
    + dropped) make a trailer that may miss upper halves of counts. Reset forgets everything.

    Members
    -------
    i : :py:`In(stream.Signature(Point))`
        Points and end markers.
    counts : :py:`In(stream.Signature(Counts))`
        One for each frame, needed once its end marker is there, and taken with it.
    info : :py:`In(stream.Signature(FrameInfo))`
        One for each frame, needed once a packet is full or its end marker is there, and taken with
        that.
    full_records : :py:`In(1)`
        Send all points as records; heard with a frame's first point or end marker.
    o : :py:`Out(stream.Signature(PacketOctet))`
        Packets.
    """

    registers = register_ports("full_records")

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(Point)),
            "counts": In(stream.Signature(Counts)),
            "info": In(stream.Signature(FrameInfo)),
            **self.registers,
            "o": Out(stream.Signature(PacketOctet)),
        })

    def elaborate(self, platform):
        m = Module()
        point, counts, info = self.i.p, self.counts.p, self.info.p
        m.submodules.check = check = catalog.CRC16_IBM_SDLC(data_width=1).create()

        # One bit a word: the packet's points below, the others above.
        m.submodules.bits = memory = Memory(shape=1, depth=2048, init=[])
        write, read = memory.write_port(), memory.read_port()
        used = Signal(10)  # bits of the packet's points
        others = Signal(10)  # bits of the others' records
        others_full = Signal()
        used_full = Signal()  # only records can fill it to the end
        put, put_bit = Signal(), Signal()
        to_others = Signal()
        full = _RECORDS * _RECORD_BITS
        m.d.comb += [
            others_full.eq(self._has_bits_of(others, full)),
            used_full.eq(self._has_bits_of(used, full)),
            write.addr.eq(Mux(to_others, Cat(others, C(1, 1)), Cat(used, C(0, 1)))),
            write.data.eq(put_bit),
            write.en.eq(put),
        ]
        with m.If(put & to_others):
            m.d.sync += others.eq(others + 1)
        with m.If(put & ~to_others):
            m.d.sync += used.eq(used + 1)

        # `index` is the place in the point's payload while that is read and written, else the
        # place in head and trailer, or in the memory.
        index = Signal(10)
        ok, record = Signal(), Signal()
        inside, kept = Signal(), Signal()  # something of the frame was taken; its form
        records = Signal()
        reading, writing = Signal(), Signal()
        again = Signal()  # the point has been read before
        bit = Signal()
        m.d.comb += [
            ok.eq(point.status.as_value() == 0),
            records.eq(Mux(inside, kept, self.full_records)),
            record.eq(records | ~ok),
            bit.eq(Cat(point.as_value(), C(0, 1)).bit_select(index[:7], 1)),
        ]

        # v less the one before, plus one pixel, from the lowest bit on. While the point is read
        # the one before goes round; while it is written this one takes its place.
        v_before = Signal(18)
        borrow_not, ahead, ahead_now = Signal(), Signal(), Signal()
        difference, step = Signal(), Signal()
        in_v = Signal()
        too_far, is_long = Signal(), Signal()
        m.d.comb += [
            in_v.eq((index[:7] >= _V) & (index[:7] < _INVERSE_Z)),
            difference.eq(bit ^ ~v_before[0] ^ borrow_not),
            ahead_now.eq(ahead | (index[:7] == _V + (COMPACT.V_OFFSET - 1).bit_length())),
            step.eq(difference ^ ahead_now),
            # Of a step that fits, the bits above V_BITS are zero and so is its sign.
            is_long.eq(too_far | (borrow_not == ahead) | point.area[COMPACT.AREA_BITS:].any()),
        ]
        with m.If((reading | writing) & in_v):
            m.d.sync += [
                v_before.eq(Cat(v_before[1:], Mux(writing, bit, v_before[0]))),
                borrow_not.eq((bit & ~v_before[0]) | (borrow_not & (bit | ~v_before[0]))),
                ahead.eq(ahead_now & difference),
            ]
            with m.If(index[:7] >= _V + COMPACT.V_BITS):
                m.d.sync += too_far.eq(too_far | step)
        form_long = Signal()

        # Counts of points by status, then those that no packet lists. While a point is read its
        # counter goes round, one is added; in the trailer all leave as one chain, zeros following,
        # and the spots rejected before they were points are added to two of them on the way.
        shift, tail = Signal(), Signal()
        counters = [Signal(16, name=f"count_{n}") for n in range(5)]
        own, field = Signal(), Signal()
        carry, carry_in = Signal(), Signal()
        chain = Signal()
        selected = Signal(5)
        m.d.comb += [
            chain.eq(index[7] & (index[4:7] != 0) & (index[4:7] != 5) & (index[4:7] != 7)),
            carry_in.eq(Mux(index[:4] == 0, ~tail, carry)),
            own.eq((Cat(counter[0] for counter in counters) & selected).any()),
        ]
        with m.If(tail):
            m.d.comb += selected.eq(chain)
        with m.Elif(index[4]):
            m.d.comb += selected.eq(Cat(point.status.as_value() == n for n in range(4)))
        with m.Else():
            m.d.comb += selected[4].eq(record & ~records & others_full)
        with m.If(reading | shift):
            m.d.sync += carry.eq((own & carry_in) | (field & tail & (own | carry_in)))
        with m.If(shift & tail & chain):
            m.d.sync += Cat(counters).eq(Cat(counters) >> 1)
        with m.Elif(reading & ~again & (index[4] ^ index[5]) & ~index[6]):
            for n, counter in enumerate(counters):
                with m.If(index[5] if n == 4 else index[4]):
                    m.d.sync += counter.eq(
                        Cat(counter[1:], counter[0] ^ (selected[n] & carry_in)))

        # Head and trailer.
        wide, closing, listing, body = Signal(), Signal(), Signal(), Signal()
        kind = Cat(closing & ~listing, records, listing, C(PacketKind.POINTS >> 3, 5))
        fields = Cat(
            C(0, _HEAD), kind, info.number, info.level, info.skipped, info.tag.exposure_us,
            info.tag.timestamp_us, check.crc[0].replicate(16), counts.spots, C(0, 48),
            counts.rejected, counts.dropped, counts.rejected,
            wide, info.learning, counts.broken, info.tag.laser, info.tag.capture, info.tripped,
            info.tables_valid, info.tag.texture)
        in_check = Signal()
        m.d.comb += [
            wide.eq(counts.spots[8:].any()),
            # In two steps, so that what stands in two places costs once.
            field.eq(Cat(fields[at:at + 16].bit_select(index[:4], 1) for at in range(0, 256, 16))
                     .bit_select(index[4:8], 1)),
            in_check.eq(tail & (index[4:8] == 7)),
            # A CRC that is fed with what it gives, inverted, shifts out unchanged.
            check.valid.eq(Mux(
                reading, ok & ~again & (
                    (index[:7] >= _BEAM) & (index[:7] < _AREA)
                    | (index[:7] >= _INVERSE_Z) & (index[:7] < _END)),
                shift & in_check)),
            check.data.eq(Mux(reading, bit, ~check.crc[0])),
        ]

        # Sending: the memory's bit is there a clock after its address, so the others wait too.
        octet, shifted, other_bit = Signal(8), Signal(), Signal()
        end = Signal(7)
        body_ends, tail_ends = Signal(), Signal()
        skip = Signal()  # the upper half of a narrow count
        m.d.comb += [
            read.addr.eq(Cat(index, listing)),
            end.eq(Mux(listing, others[3:], used[3:])),
            body_ends.eq(body & (index[3:] == end)),
            tail_ends.eq(tail & (index[3:8] == _TAIL_END >> 3)),
            skip.eq(tail & ~wide & index[7] & index[3] & (index[4:7] != 7)),
            self.o.p.data.eq(octet),
            self.o.p.last.eq(body_ends & (listing | ~closing) | tail_ends),
        ]
        m.d.sync += [shifted.eq(shift), other_bit.eq(field ^ ((own ^ carry_in) & tail & chain))]
        with m.If(shifted):
            m.d.sync += octet.eq(Cat(octet[1:], Mux(body, read.data, other_bit)))

        limit = Signal(10)
        too_full = Signal()
        m.d.comb += [
            limit.eq(Mux(point.end, Mux(wide, _LIMIT_WIDE, _LIMIT_NARROW),
                         Mux(is_long, _LIMIT_LONG, _LIMIT_SHORT))),
            too_full.eq(used > limit),
        ]

        def finish_frame():
            m.d.comb += [
                self.i.ready.eq(1), self.counts.ready.eq(1), self.info.ready.eq(1),
                check.start.eq(1)]
            m.d.sync += [others.eq(0), closing.eq(0), listing.eq(0), inside.eq(0)]

        with m.FSM():
            with m.State("NEXT"):
                m.d.sync += [index.eq(1), borrow_not.eq(1), ahead.eq(0), too_far.eq(0)]
                with m.If(self.i.valid):
                    m.d.sync += [inside.eq(1), kept.eq(records)]
                with m.If(self.i.valid & ~point.end & ~(records & used_full)):
                    m.next = "READ"
                with m.If(self.i.valid & self.info.valid
                          & Mux(point.end, self.counts.valid, records & used_full)):
                    m.d.sync += closing.eq(point.end & ~too_full)
                    m.next = "PAD"

            with m.State("READ"):
                m.d.comb += [
                    reading.eq(1), to_others.eq(~records), put_bit.eq(bit),
                    put.eq(record & ~(to_others & others_full)),
                ]
                m.d.sync += index.eq(index + 1)
                with m.If(index[:7] == _END):
                    m.next = "FORM"
                    with m.If(record):
                        m.d.comb += self.i.ready.eq(1)
                        m.next = "NEXT"

            with m.State("FORM"):
                m.d.sync += [form_long.eq(is_long), index.eq(_V), borrow_not.eq(1), ahead.eq(0)]
                m.d.comb += put_bit.eq(is_long)
                with m.If(~too_full):
                    m.d.comb += put.eq(1)
                    m.next = "WRITE"
                with m.Elif(self.info.valid):
                    m.d.sync += again.eq(1)
                    m.next = "PAD"

            with m.State("WRITE"):
                m.d.comb += [
                    writing.eq(1),
                    put.eq(~in_v | form_long | (index[:7] < _V + COMPACT.V_BITS)),
                    put_bit.eq(Mux(in_v & ~form_long, step, bit)),
                ]
                m.d.sync += index.eq(index + 1)
                with m.If(index[:7] == _INVERSE_Z - 1):
                    m.d.sync += index.eq(_U)
                with m.If(index[:7] == _V - 1):
                    m.d.sync += index.eq(_AREA)
                with m.If(index[:7] == Mux(form_long, _U - 1, _AREA + COMPACT.AREA_BITS - 1)):
                    m.d.comb += self.i.ready.eq(1)
                    m.d.sync += again.eq(0)
                    m.next = "NEXT"

            with m.State("PAD"):
                m.d.comb += put.eq(used[:3].any())
                m.d.sync += index.eq(_HEAD)
                with m.If(~put):
                    m.next = "SHIFT"

            with m.State("SHIFT"):
                m.d.comb += shift.eq(1)
                m.d.sync += index.eq(index + 1)
                with m.If(index[:3].all() & ~skip):
                    m.next = "OCTET"

            with m.State("OCTET"):
                m.d.comb += self.o.valid.eq(~shifted)
                with m.If(self.o.valid & self.o.ready):
                    m.next = "SHIFT"
                    with m.If(~body & ~tail & (index[:8] == _BODY)):
                        m.d.sync += [body.eq(1), index.eq(0)]
                        with m.If(~listing & (used == 0)):
                            m.d.sync += [body.eq(0), tail.eq(1), index.eq(_NUMBER)]
                    with m.If(body_ends & closing & ~listing):
                        m.d.sync += [body.eq(0), tail.eq(1), index.eq(_NUMBER)]
                    with m.If(self.o.p.last):
                        m.d.sync += [
                            body.eq(0), tail.eq(0), used.eq(0), v_before.eq(0), index.eq(_HEAD)]
                        with m.If(tail & (others != 0)):
                            m.d.sync += listing.eq(1)
                        with m.Else():
                            m.next = "NEXT"
                            with m.If(closing):
                                finish_frame()

        return m

    @staticmethod
    def _has_bits_of(value, number):
        """Whether ``value``, which only grows to ``number``, has come there."""
        return Cat(value[n] for n in range(len(value)) if number >> n & 1).all()
