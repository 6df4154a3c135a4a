"""Texture frames to packets of pixels, without a frame store."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import FrameInfo, GreyPixel, PacketOctet
from ..protocol import CONTENT_LIMIT, SENSOR_PIXELS, TEXTURE_FIELDS, PacketKind
from .packet_fields import bits_of_fields, flags_octet

__all__ = ["Texture"]

_BANK = 1024
#: Pixels of a packet: kind, sequence number, number, row, column and check take the rest.
_PIXELS = CONTENT_LIMIT - 4 - 7
_HEAD = 6  # octets before the pixels, without the sequence number
_FRAME_OCTETS = 2 + sum(field.bits for field in TEXTURE_FIELDS) // 8


class _Shared:
    """What capture and sending share."""

    def __init__(self, width, height):
        # The next pixel to be sent: row and column, its position in either half, and the half.
        self.row = Signal(range(height))
        self.column = Signal(range(width))
        self.position = Signal(range(_BANK))
        self.half = Signal()
        self.number = Signal(8, reset_less=True)  # of the frame that it is from
        self.counters = Signal(16, reset_less=True)

        # The frame that has passed: the end of its captured pixels, whether these are to be sent,
        # in which clock sending switches to them; whether its packet is to be sent, and was.
        self.info = Signal(FrameInfo, reset_less=True)
        self.broken = Signal(reset_less=True)
        self.captured_end = Signal(range(_BANK))
        self.whole = Signal()
        self.switch = Signal()
        self.frame_due = Signal()
        self.frame_sent = Signal()


class Texture(wiring.Component):
    """Sends the image piece by piece, a few rows from each texture frame that passes.

    Pixels are sent in raster order, round and round. From each frame the pixels from the next one
    to be sent on are captured, up to 1023 or to the image's end, in one half of a memory, while
    those of the frame before are sent from the other. When the frame has arrived whole, the next
    packet continues with its pixels. So pixels come from the newest whole frame that has them, and
    never from a broken one. When all are sent, sending waits for the next frame. A packet of pixels
    ends at the row's end, at 86 pixels or at the last captured one.

    For each frame there is one packet of kind TEXTURE_FRAME, after its last pixel, before any
    packet of pixels that is not offered yet. A frame that begins while the packet of the one before
    has not been sent is not taken: ``info`` is not ready.

    ``i.ready`` is always high. Octets follow each other within 2 clocks, once the packet's first is
    taken. After reset sending begins at the first pixel.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels, 2 to 1024.
    domain : :class:`str`
        Clock domain of ``o``, ``enable``, ``bad_sync`` and ``overrun``, and of all that works for
        them. Its clock is that of ``sync``, and may be stopped while ``busy`` is low.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel))`
        Texture frames, whole or broken; ``ready`` is constant.
    info : :py:`In(stream.Signature(FrameInfo))`
        One for each frame, in the clock of its first pixel.
    enable : :py:`In(1)`
        Send pixels; packets of frames are sent all the same.
    bad_sync, overrun : :py:`In(8)`
        The camera's counters, for packets of frames; sampled when one begins.
    o : :py:`Out(stream.Signature(PacketOctet))`
        Packets.
    busy : :py:`Out(1)`
        The clock of ``domain`` is needed.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a frame's last pixel to its packet, if no other is being sent.
    """

    latency = 2

    def __init__(self, width, height, domain="sync"):
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, int) or not 2 <= value <= SENSOR_PIXELS[1]:
                raise ValueError(
                    f"Frame {name} must be an integer from 2 to {SENSOR_PIXELS[1]}, not {value!r}")
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
        m.submodules.pixels = memory = Memory(shape=8, depth=2 * _BANK, init=[])
        s = _Shared(self.width, self.height)
        self._capture(m, s, memory.write_port())
        self._send(m, s, memory.read_port(domain=self.domain))
        return m

    def _capture(self, m, s, write):
        """Pixels from a passing frame to one half of the memory.

        A pixel has the same position in both halves, so capture starts at the next pixel to be sent
        as the frame passes it. Sending may get ahead of it, but not beyond what was captured
        before, which began no later and so ends no later.
        """
        marker = self.i.p.marker
        passing_row, passing_column = Signal.like(s.row), Signal.like(s.column)
        following, first = Signal(range(_BANK)), Signal(range(_BANK))
        starts, capturing, captured = Signal(), Signal(), Signal()
        m.d.comb += [
            self.i.ready.eq(1),
            # Sending has switched to a frame before its packet is sent, so pixels wait no longer.
            self.info.ready.eq(~s.frame_due),
            starts.eq((passing_row == s.row) & (passing_column == s.column) & ~captured),
            write.addr.eq(Cat(Mux(starts, s.position, s.captured_end), ~s.half)),
            write.data.eq(self.i.p.grey),
            following.eq(write.addr[:-1] + 1),
            write.en.eq(self.i.valid & ~marker.broken
                        & (starts | capturing & (following != first))),
        ]
        with m.If(self.info.valid & self.info.ready):
            m.d.sync += s.info.eq(self.info.p)
        with m.If(s.switch):
            m.d.sync += s.whole.eq(0)
        with m.If(s.frame_sent):
            m.d.sync += s.frame_due.eq(0)
        with m.If(write.en):
            m.d.sync += s.captured_end.eq(following)
            with m.If(starts):
                m.d.sync += first.eq(s.position)
        with m.If(self.i.valid):
            m.d.sync += [
                passing_column.eq(passing_column + 1), capturing.eq(write.en),
                captured.eq(captured | starts)]
            with m.If(marker.line_end):
                m.d.sync += [passing_column.eq(0), passing_row.eq(passing_row + 1)]
            with m.If(marker.frame_end):
                m.d.sync += [
                    passing_row.eq(0), capturing.eq(0), captured.eq(0),
                    s.broken.eq(marker.broken),
                    s.whole.eq((starts | captured) & ~marker.broken), s.frame_due.eq(1),
                ]

    def _send(self, m, s, read):
        """Packets of frames, and of the pixels in the other half of the memory."""
        link = m.d[self.domain]
        end = Signal(range(_BANK))
        index = Signal(range(_HEAD + _PIXELS + 1))
        of_frame = Signal()
        fetch, in_pixels = Signal(), Signal()
        pixels_left = self.enable & (s.position != end)
        self._fill_octet(m, s, read.data, index, of_frame, in_pixels)
        m.d.comb += [
            read.addr.eq(Cat(s.position, s.half)),
            read.en.eq(fetch),
            s.switch.eq(s.whole & (index == 0)),
            self.o.p.last.eq(Mux(
                of_frame, index == _FRAME_OCTETS - 1,
                in_pixels & ((index == _HEAD + _PIXELS) | (s.column == 0)
                             | (s.position == end)))),
        ]
        with m.If(s.switch):
            link += [s.half.eq(~s.half), end.eq(s.captured_end), s.number.eq(s.info.number)]
        with m.If(fetch):
            link += [s.position.eq(s.position + 1), s.column.eq(s.column + 1)]
            with m.If(s.column == self.width - 1):
                link += [s.column.eq(0), s.row.eq(Mux(s.row == self.height - 1, 0, s.row + 1))]

        with m.FSM(domain=self.domain) as fsm:
            with m.State("IDLE"):
                link += [
                    of_frame.eq(s.frame_due), s.counters.eq(Cat(self.bad_sync, self.overrun))]
                with m.If(s.frame_due | pixels_left):
                    m.next = "HEAD"

            with m.State("HEAD"):
                m.d.comb += self.o.valid.eq(1)
                with m.If(self.o.ready):
                    link += index.eq(index + 1)
                    with m.If(~of_frame & (index[:3] == _HEAD - 1)):
                        m.next = "FETCH"
                    with m.If(self.o.p.last):
                        m.d.comb += s.frame_sent.eq(1)
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

            m.d.comb += self.busy.eq(s.whole | s.frame_due | ~fsm.ongoing("IDLE") | pixels_left)

    def _fill_octet(self, m, s, pixel, index, of_frame, in_pixels):
        """The octet that is sent: a pixel, or one of a head."""
        info = s.info
        head = Cat(C(PacketKind.TEXTURE, 8), s.number, Cat(s.row, C(0, 16))[:16],
                   Cat(s.column, C(0, 16))[:16])
        flags = flags_octet(
            broken=s.broken, laser=info.tag.laser, capture=info.tag.capture, tripped=info.tripped,
            tables_valid=info.tables_valid, texture=info.tag.texture)
        fields = Cat(
            C(PacketKind.TEXTURE_FRAME, 8), info.number[:8], bits_of_fields(TEXTURE_FIELDS, {
                "number": info.number, "skipped": info.skipped,
                "exposure_us": info.tag.exposure_us, "timestamp_us": info.tag.timestamp_us,
                "bad_sync": s.counters[:8], "overrun": s.counters[8:], "flags": flags}))
        with m.If(in_pixels):
            m.d.comb += self.o.p.data.eq(pixel)
        with m.Elif(of_frame):
            m.d.comb += self.o.p.data.eq(fields.word_select(index[:4], 8))
        with m.Else():
            m.d.comb += self.o.p.data.eq(head.word_select(index[:3], 8))
