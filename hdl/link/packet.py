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
    more point. Nothing is stored: everything is sent bit by bit from where it waits. A point is
    taken when its last octet is; the end mark, ``info`` and ``counts`` when the summary's last
    octet before the check is. The counts of points by status are kept here, and start again with
    each summary.

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

        # What is being sent: the head, a point, the rest of a summary, or the check.
        head, body, summary, check = Signal(), Signal(), Signal(), Signal()
        is_summary = Signal()
        place = Signal(3)  # bit of the octet
        index = Signal(5)  # octet of the head and summary, of the point, or of the check
        octet = Signal(8)
        shift = Signal()
        bad_sync, overrun = Signal(8), Signal(8)

        # Counters go round a bit at a time: the packet's number while it is sent, the counts of
        # points by status while the first two octets of a point are. In a summary the four leave
        # as one chain, zeros following, and the last one is added to the other count of rejected
        # spots on the way.
        number = Signal(8)
        by_status = [Signal(16, name=f"status_{status}") for status in range(4)]
        first_bit = Signal()
        carry, carry_in = Signal(), Signal()
        own = Signal()
        rejected = Signal()
        at_16 = Cat(place, index[0])
        m.d.comb += [
            first_bit.eq((place == 0) & (head | ~index[0])),
            carry_in.eq(Mux(first_bit, ~summary, carry)),
            own.eq(Mux(head, number[0], Mux(
                body, Cat(bits[0] for bits in by_status).bit_select(point.status.as_value(), 1),
                by_status[0][0]))),
            rejected.eq(counts.rejected.bit_select(at_16, 1) & summary),
        ]
        with m.If(shift):
            m.d.sync += carry.eq((own & carry_in) | (rejected & (own | carry_in)))
            with m.If(head & (index == 1)):
                m.d.sync += number.eq(Cat(number[1:], number[0] ^ carry_in))
            with m.If((body & (index[1:] == 0)) | (summary & self._is_status(index))):
                for status, bits in enumerate(by_status):
                    after = by_status[status + 1][0] if status < 3 else 0
                    counted = (point.status.as_value() == status) & carry_in
                    m.d.sync += bits.eq(Cat(bits[1:], Mux(summary, after, bits[0] ^ counted)))

        # The bit to send.
        bit = Signal()
        fields = Cat(
            Mux(is_summary, C(_TYPE_FRAME, 8), C(_TYPE_POINTS, 8)), number[0].replicate(8),
            info.number, info.level, info.learning, counts.broken, C(0, 6), info.skipped,
            C(FORMAT_VERSION, 8), counts.spots, by_status[0][0].replicate(48),
            (by_status[0][0] ^ rejected ^ carry_in).replicate(16), counts.dropped, bad_sync,
            overrun)
        with m.If(body):
            m.d.comb += bit.eq(self.i.payload.as_value()[1:].bit_select(Cat(place, index[:4]), 1))
        with m.Elif(check):
            m.d.comb += bit.eq(crc.crc[0])
        with m.Else():
            m.d.comb += bit.eq(fields.bit_select(Cat(place, index), 1))

        # A CRC that is fed with what it sends, inverted, shifts out unchanged.
        m.d.comb += [
            crc.valid.eq(shift),
            crc.data.eq(bit ^ check),
        ]
        with m.If(shift):
            m.d.sync += [octet.eq(Cat(octet[1:], bit)), place.eq(place + 1)]

        sent = Signal()  # an octet has been taken, its escape too
        special, escaped, closing = Signal(), Signal(), Signal()
        wire = Signal(range(WIRE_LIMIT + 1))  # octets on the wire
        m.d.comb += special.eq((octet[2:] == _FLAG >> 2) & (octet[0] ^ octet[1]))
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += wire.eq(wire + 1)

        with m.FSM():
            with m.State("IDLE"):
                m.d.comb += crc.start.eq(1)
                m.d.sync += [
                    head.eq(1), is_summary.eq(point.end), check.eq(0), closing.eq(0),
                    index.eq(0), wire.eq(0),
                    bad_sync.eq(self.bad_sync), overrun.eq(self.overrun),
                ]
                with m.If(self.i.valid & self.info.valid & (~point.end | self.counts.valid)):
                    m.next = "FLAG"

            with m.State("FLAG"):
                m.d.comb += [self.o.valid.eq(1), self.o.payload.eq(_FLAG)]
                with m.If(self.o.ready):
                    m.next = "SHIFT"
                    with m.If(closing):
                        m.next = "IDLE"

            with m.State("SHIFT"):
                m.d.comb += shift.eq(1)
                with m.If(place == 7):
                    m.next = "OCTET"

            with m.State("OCTET"):
                m.d.comb += self.o.valid.eq(1)
                m.d.comb += self.o.payload.eq(octet)
                with m.If(special & ~escaped):
                    m.d.comb += self.o.payload.eq(_ESCAPE)
                with m.Elif(special):
                    m.d.comb += self.o.payload.eq(octet ^ _ESCAPE_XOR)
                m.d.comb += sent.eq(self.o.ready & (~special | escaped))
                with m.If(self.o.ready):
                    m.d.sync += escaped.eq(special & ~escaped)
                with m.If(sent):
                    m.d.sync += index.eq(index + 1)
                    m.next = "SHIFT"
                    with m.If(head & (index == _HEAD_OCTETS - 1)):
                        m.d.sync += [head.eq(0), summary.eq(is_summary), body.eq(~is_summary)]
                        with m.If(~is_summary):
                            m.d.sync += index.eq(0)
                    with m.If(body & (index == _POINT_OCTETS - 1)):
                        m.d.comb += self.i.ready.eq(1)
                        m.d.sync += index.eq(0)
                        m.next = "BETWEEN"
                    with m.If(summary & (index == _SUMMARY_OCTETS - 1)):
                        m.d.comb += [
                            self.i.ready.eq(1), self.counts.ready.eq(1), self.info.ready.eq(1)]
                        m.d.sync += [index.eq(0), summary.eq(0), check.eq(1)]
                    with m.If(check & (index == _CRC_OCTETS - 1)):
                        m.d.sync += closing.eq(1)
                        m.next = "FLAG"

            with m.State("BETWEEN"), m.If(self.i.valid):
                m.next = "SHIFT"
                with m.If(point.end | (wire > _ROOM)):
                    m.d.sync += [body.eq(0), check.eq(1)]

        return m

    @staticmethod
    def _is_status(index):
        """The octets of a summary that come from the counts by status."""
        return (index >= 10) & (index < 18)
