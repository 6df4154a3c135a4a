"""Points and counts to the octets of packets."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.crc import catalog
from amaranth.lib.data import View
from amaranth.lib.wiring import In, Out

from hdl.payloads import Counts, FrameInfo, Point

__all__ = ["Packet", "CRC", "WIRE_LIMIT", "FORMAT_VERSION"]

#: The check of a packet: RFC 1662's FCS-16, made for this framing. Any algorithm will do that is
#: reflected, with all bits of its initial value and of its output inverted: its bits can then be
#: sent as they leave the register. CRC32_ISO_HDLC is RFC 1662's FCS-32.
CRC = catalog.CRC16_IBM_SDLC
#: Octets of a packet on the wire, flags and escapes included.
WIRE_LIMIT = 100
FORMAT_VERSION = 1

_FLAG, _ESCAPE, _ESCAPE_XOR = 0x7E, 0x7D, 0x20
_TYPE_POINTS, _TYPE_FRAME = 0x50, 0x46
_HEAD_OCTETS, _POINT_OCTETS, _SUMMARY_OCTETS = 4, 9, 22
_CRC_OCTETS = CRC(1).algorithm.crc_width // 8
#: The most octets on the wire before a point that is all escapes, such a CRC and a flag still fit.
_ROOM = WIRE_LIMIT - 2 * _POINT_OCTETS - 2 * _CRC_OCTETS - 1


class Packet(wiring.Component):
    """Sends points in packets as they come, and a summary at each frame's end.

    ``hdl/link/README.md`` has the format. A packet of points opens with a frame's first point and
    stays open until the frame ends, or until it might outgrow :data:`WIRE_LIMIT` octets with one
    more point. Nothing is stored: everything is sent bit by bit from where it waits, and a point
    is taken with its last bit, the end mark, ``info`` and ``counts`` with the last but two octets
    of the summary. The counts of points by status are kept here, and start again with each
    summary.

    Octets follow each other every 10 clocks or faster while there is something to send.

    Members
    -------
    i : :py:`In(stream.Signature(Point))`
        Points and end marks.
    counts : :py:`In(stream.Signature(Counts))`
        One for each frame, needed once its end mark is there.
    info : :py:`In(stream.Signature(FrameInfo))`
        One for each frame, needed once its first point or end mark is there.
    bad_sync, overrun : :py:`In(8)`
        The camera's counters, sampled when a packet opens.
    o : :py:`Out(stream.Signature(8))`
        Octets.
    """

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(Point)),
            "counts": In(stream.Signature(Counts)),
            "info": In(stream.Signature(FrameInfo)),
            "bad_sync": In(8),
            "overrun": In(8),
            "o": Out(stream.Signature(8)),
        })

    def elaborate(self, platform):
        m = Module()
        point = View(Point, self.i.payload)
        counts = View(Counts, self.counts.payload)
        info = View(FrameInfo, self.info.payload)
        m.submodules.crc = crc = CRC(data_width=1).create()

        summary = Signal()  # a frame's summary, not points
        head, body = Signal(), Signal()  # where we are; the CRC comes after both
        place = Signal(8)  # bit within the head, point, summary (its head included) or CRC
        octet = Signal(8)
        escaped = Signal()
        wire = Signal(range(WIRE_LIMIT + 1))  # octets on the wire
        between = Signal()  # a point was just sent
        closing = Signal()
        bad_sync, overrun = Signal(8), Signal(8)

        # Counters that go round a bit at a time, so that one adder serves them all: the packet's
        # number while it is sent, the count of a point's status while the point's first two
        # octets are sent, and in a summary the sum of both counts of rejected spots.
        number = Signal(8)
        by_status = [Signal(16, name=f"status_{status}") for status in range(4)]
        counted = Signal(4)
        for status in range(4):
            m.d.comb += counted[status].eq(~summary & (point.status.as_value() == status))
        term, other, carry, carry_in, total = Signal(), Signal(), Signal(), Signal(), Signal()
        fresh = Signal()
        m.d.comb += [
            fresh.eq((place[:3] == 0) & (head | ~place[3])),
            carry_in.eq(Mux(fresh, head | ~summary, carry)),
            total.eq(term ^ other ^ carry_in),
        ]
        with m.If(head):
            m.d.comb += term.eq(number[0])
        with m.Elif(summary):
            m.d.comb += [
                term.eq(by_status[3][0]),
                other.eq(counts.rejected.bit_select(place[:4], 1)),
            ]
        with m.Else():
            m.d.comb += term.eq(Cat(bits[0] for bits in by_status).bit_select(
                point.status.as_value(), 1))

        # The bit to send.
        bit = Signal()
        kind = Mux(summary, C(_TYPE_FRAME, 8), C(_TYPE_POINTS, 8))
        low, high = place[:3], place[3:]
        with m.If(head), m.Switch(high[:2]):
            with m.Case(0):
                m.d.comb += bit.eq(kind.bit_select(low, 1))
            with m.Case(1):
                m.d.comb += bit.eq(number[0])
            with m.Default():
                m.d.comb += bit.eq(info.number.bit_select(place[:4], 1))
        with m.Elif(body & ~summary):
            m.d.comb += bit.eq(self.i.payload.as_value()[1:].bit_select(place[:7], 1))
        with m.Elif(body), m.Switch(high):
            for at, field in enumerate([
                    info.level, Cat(info.learning, counts.broken), info.skipped,
                    C(FORMAT_VERSION, 8)], 4):
                with m.Case(at):
                    m.d.comb += bit.eq(field.bit_select(low, 1))
            for at, field in [(8, counts.spots), (18, counts.dropped)]:
                with m.Case(at, at + 1):
                    m.d.comb += bit.eq(field.bit_select(place[:4], 1))
            for status in range(3):
                with m.Case(10 + 2 * status, 11 + 2 * status):
                    m.d.comb += bit.eq(by_status[status][0])
            with m.Case(16, 17):
                m.d.comb += bit.eq(total)
            with m.Case(20):
                m.d.comb += bit.eq(bad_sync.bit_select(low, 1))
            with m.Case(21):
                m.d.comb += bit.eq(overrun.bit_select(low, 1))
        with m.Else():
            m.d.comb += bit.eq(crc.crc[0])

        # A CRC that is fed with what it sends, inverted, shifts out unchanged.
        m.d.comb += crc.data.eq(bit ^ ~(head | body))

        last_bit = Signal()
        last_of_body = Signal()
        m.d.comb += last_of_body.eq(
            body & ~head & (place == Mux(summary, 8 * _SUMMARY_OCTETS - 1, 8 * _POINT_OCTETS - 1)))

        more = Signal()  # another point, and room for it
        m.d.comb += more.eq(~point.end & (wire <= _ROOM))

        with m.FSM():
            with m.State("IDLE"):
                m.d.comb += crc.start.eq(1)
                m.d.sync += [
                    summary.eq(point.end), head.eq(1), body.eq(1), place.eq(0), wire.eq(0),
                    closing.eq(0), bad_sync.eq(self.bad_sync), overrun.eq(self.overrun),
                ]
                with m.If(self.i.valid & self.info.valid & (~point.end | self.counts.valid)):
                    m.next = "FLAG"

            with m.State("FLAG"):
                m.d.comb += [self.o.valid.eq(1), self.o.payload.eq(_FLAG)]
                with m.If(self.o.ready):
                    with m.If(closing):
                        m.next = "IDLE"
                    with m.Else():
                        m.next = "SHIFT"

            with m.State("SHIFT"):
                m.d.comb += [crc.valid.eq(1), last_bit.eq(place[:3] == 7)]
                m.d.sync += [
                    octet.eq(Cat(octet[1:], bit)),
                    carry.eq((term & other) | (carry_in & (term | other))),
                    place.eq(place + 1),
                ]
                with m.If(head & (high == 1)):
                    m.d.sync += number.eq(Cat(number[1:], total))
                for status in range(4):
                    bits = by_status[status]
                    with m.If(~head & body & Mux(summary, high[1:] == 5 + status, high[1:] == 0)):
                        m.d.sync += bits.eq(Cat(
                            bits[1:], Mux(counted[status], total, bits[0] & ~summary)))
                with m.If(last_bit):
                    m.next = "OCTET"
                    with m.If(head & (high == _HEAD_OCTETS - 1)):
                        m.d.sync += head.eq(0)
                        with m.If(~summary):
                            m.d.sync += place.eq(0)
                    with m.If(~body & (high == _CRC_OCTETS - 1)):
                        m.d.sync += closing.eq(1)
                with m.If(last_of_body):
                    m.d.comb += self.i.ready.eq(1)
                    m.d.sync += place.eq(0)
                    with m.If(summary):
                        m.d.comb += [self.counts.ready.eq(1), self.info.ready.eq(1)]
                        m.d.sync += body.eq(0)
                    with m.Else():
                        m.d.sync += between.eq(1)

            with m.State("OCTET"):
                special = octet[2:] == _FLAG >> 2
                special &= octet[0] ^ octet[1]
                m.d.comb += self.o.valid.eq(1)
                m.d.comb += self.o.payload.eq(octet)
                with m.If(special):
                    m.d.comb += self.o.payload.eq(
                        Mux(escaped, octet ^ _ESCAPE_XOR, _ESCAPE))
                with m.If(self.o.ready):
                    with m.If(special & ~escaped):
                        m.d.sync += escaped.eq(1)
                    with m.Else():
                        m.d.sync += escaped.eq(0)
                        with m.If(closing):
                            m.next = "FLAG"
                        with m.Elif(between):
                            m.next = "BETWEEN"
                        with m.Else():
                            m.next = "SHIFT"

            with m.State("BETWEEN"), m.If(self.i.valid):
                m.d.sync += between.eq(0)
                with m.If(~more):
                    m.d.sync += body.eq(0)
                m.next = "SHIFT"

        with m.If(self.o.valid & self.o.ready):
            m.d.sync += wire.eq(wire + 1)

        return m
