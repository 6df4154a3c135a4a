"""Texture frames to packets of pixels, without a frame store."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import FrameInfo, GreyPixel, PacketOctet
from ..protocol import CONTENT_LIMIT, TEXTURE_FIELDS, PacketKind
from .packet_fields import bits_of_fields, flags_octet

__all__ = ["Texture"]

_BANK = 1024
#: Pixels of a packet: kind, sequence number, number, row, column and check take the rest.
_PIXELS = CONTENT_LIMIT - 4 - 7
_HEAD = 6  # octets before the pixels, without the sequence number
_FRAME_OCTETS = 2 + sum(field.bits for field in TEXTURE_FIELDS) // 8


class Texture(wiring.Component):
    """Sends the image bit by bit, a few rows from each texture frame that passes.

    Sending goes through the image in raster order, round and round. From each frame the pixels
    from the place on where sending stands are captured, up to 1023 or to the image's end, in one
    half of a memory while those of the frame before are sent from the other. Once the frame has
    come whole, sending goes on from its pixels, at the next packet. So pixels come from the newest
    whole frame that has any there, and none from a broken one. When all are sent, the next frame is
    waited for. A packet of pixels ends at the row's end, at 86 pixels or where there are no more.

    For each frame there is one packet of kind TEXTURE_FRAME, after its last pixel, before any
    packet of pixels that is not offered yet. A frame that begins while that of the one before is
    still to be sent is not taken: ``info`` is not ready.

    ``i.ready`` is always high. Octets follow each other within 2 clocks, once the packet's first is
    taken. After reset sending begins at the first pixel.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels, 2 to 512.
    domain : :class:`str`
        Clock domain of ``o``, ``enable``, ``bad_sync`` and ``overrun``, and of all that works for
        them. Its clock is that of ``sync``, and may stand still while ``busy`` is low.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel))`
        Texture frames, whole or broken; ``ready`` is constant.
    info : :py:`In(stream.Signature(FrameInfo))`
        One for each frame, in the clock of its first pixel.
    enable : :py:`In(1)`
        Send pixels; packets of frames are sent all the same.
    bad_sync, overrun : :py:`In(8)`
        The camera's counters, for packets of frames; heard when one begins.
    o : :py:`Out(stream.Signature(PacketOctet))`
        Packets.
    busy : :py:`Out(1)`
        The clock of ``domain`` is needed.
    """

    def __init__(self, width, height, domain="sync"):
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, int) or not 2 <= value <= 512:
                raise ValueError(f"Frame {name} must be an integer from 2 to 512, not {value!r}")
        self.width, self.height, self.domain = width, height, domain
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "info": In(stream.Signature(FrameInfo)),
            "enable": In(1),
            "bad_sync": In(8),
            "overrun": In(8),
            "o": Out(stream.Signature(PacketOctet)),
            "busy": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        link = m.d[self.domain]
        m.submodules.pixels = memory = Memory(shape=8, depth=2 * _BANK, init=[])
        write, read = memory.write_port(), memory.read_port(domain=self.domain)

        # Where sending stands: the next pixel's row and column, and its place in either half.
        row, column = Signal(range(self.height)), Signal(range(self.width))
        place, end = Signal(range(_BANK)), Signal(range(_BANK))
        half = Signal()

        # Capture. A pixel's place is the same in both halves, so it starts wherever sending stands
        # when the frame comes past, wherever that is. Sending may get ahead of it, but not beyond
        # what was captured before, which began no later and so ends no later.
        pixel, marker = self.i.p, self.i.p.marker
        info, broken = Signal(FrameInfo, reset_less=True), Signal(reset_less=True)
        passing_row, passing_column = Signal.like(row), Signal.like(column)
        write_place, following, first = (Signal(range(_BANK)) for _ in range(3))
        starts, capturing, captured = Signal(), Signal(), Signal()
        whole, take_over = Signal(), Signal()  # its pixels wait; sending goes over to them
        due = Signal()  # so does the packet of the frame
        told = Signal()  # its last octet is taken
        m.d.comb += [
            self.i.ready.eq(1),
            # Sending goes over before this is told, so pixels never wait for longer.
            self.info.ready.eq(~due),
            starts.eq((passing_row == row) & (passing_column == column) & ~captured),
            write.addr.eq(Cat(Mux(starts, place, write_place), ~half)),
            write.data.eq(pixel.grey),
            following.eq(write.addr[:-1] + 1),
            write.en.eq(self.i.valid & ~marker.broken
                        & (starts | capturing & (following != first))),
        ]
        with m.If(self.info.valid & self.info.ready):
            m.d.sync += info.eq(self.info.p)
        with m.If(take_over):
            m.d.sync += whole.eq(0)
        with m.If(told):
            m.d.sync += due.eq(0)
        with m.If(write.en):
            m.d.sync += write_place.eq(following)
            with m.If(starts):
                m.d.sync += first.eq(place)
        with m.If(self.i.valid):
            m.d.sync += [
                passing_column.eq(passing_column + 1), capturing.eq(write.en),
                captured.eq(captured | starts)]
            with m.If(marker.line_end):
                m.d.sync += [passing_column.eq(0), passing_row.eq(passing_row + 1)]
            with m.If(marker.frame_end):
                m.d.sync += [
                    passing_row.eq(0), capturing.eq(0), captured.eq(0), broken.eq(marker.broken),
                    whole.eq((starts | captured) & ~marker.broken), due.eq(1),
                ]

        # Sending.
        index = Signal(range(_HEAD + _PIXELS + 1))
        of_frame = Signal()
        number = Signal(8, reset_less=True)
        counters = Signal(16, reset_less=True)
        head = Cat(C(PacketKind.TEXTURE, 8), number, Cat(row, C(0, 16))[:16],
                   Cat(column, C(0, 16))[:16])
        flags = flags_octet(
            broken=broken, laser=info.tag.laser, capture=info.tag.capture, tripped=info.tripped,
            tables_valid=info.tables_valid, texture=info.tag.texture)
        fields = Cat(
            C(PacketKind.TEXTURE_FRAME, 8), info.number[:8], bits_of_fields(TEXTURE_FIELDS, {
                "number": info.number, "skipped": info.skipped,
                "exposure_us": info.tag.exposure_us, "timestamp_us": info.tag.timestamp_us,
                "bad_sync": counters[:8], "overrun": counters[8:], "flags": flags}))
        fetch, in_pixels = Signal(), Signal()
        m.d.comb += [
            read.addr.eq(Cat(place, half)),
            read.en.eq(fetch),
            take_over.eq(whole & (index == 0)),
            self.o.p.last.eq(Mux(
                of_frame, index == _FRAME_OCTETS - 1,
                in_pixels & ((index == _HEAD + _PIXELS) | (column == 0) | (place == end)))),
        ]
        with m.If(in_pixels):
            m.d.comb += self.o.p.data.eq(read.data)
        with m.Elif(of_frame):
            m.d.comb += self.o.p.data.eq(fields.word_select(index[:4], 8))
        with m.Else():
            m.d.comb += self.o.p.data.eq(head.word_select(index[:3], 8))
        with m.If(take_over):
            link += [half.eq(~half), end.eq(write_place), number.eq(info.number)]
        with m.If(fetch):
            link += [place.eq(place + 1), column.eq(column + 1)]
            with m.If(column == self.width - 1):
                link += [column.eq(0), row.eq(Mux(row == self.height - 1, 0, row + 1))]

        with m.FSM(domain=self.domain) as fsm:
            with m.State("IDLE"):
                link += [of_frame.eq(due), counters.eq(Cat(self.bad_sync, self.overrun))]
                with m.If(due | (self.enable & (place != end))):
                    m.next = "HEAD"

            with m.State("HEAD"):
                m.d.comb += self.o.valid.eq(1)
                with m.If(self.o.ready):
                    link += index.eq(index + 1)
                    with m.If(~of_frame & (index[:3] == _HEAD - 1)):
                        m.next = "FETCH"
                    with m.If(self.o.p.last):
                        m.d.comb += told.eq(1)
                        link += index.eq(0)
                        m.next = "IDLE"

            with m.State("FETCH"):
                m.d.comb += fetch.eq(1)
                link += index.eq(index + 1)
                m.next = "PIXELS"

            with m.State("PIXELS"):
                m.d.comb += [self.o.valid.eq(1), in_pixels.eq(1)]
                with m.If(self.o.ready):
                    m.next = "FETCH"
                    with m.If(self.o.p.last):
                        link += index.eq(0)
                        m.next = "IDLE"

            m.d.comb += self.busy.eq(
                whole | due | ~fsm.ongoing("IDLE") | (self.enable & (place != end)))

        return m
