"""Texture frames to packets of pixels, without a frame store."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import FrameInfo, GreyPixel, PacketOctet
from ..ports import register_ports
from ..protocol import SENSOR_PIXELS, TEXTURE_FIELDS, PacketKind
from .packet_fields import bits_of_fields, flags_octet
from .texture_code import PACKET_WORDS, TextureCode, quantise

__all__ = ["Texture"]

_PLACES = 16  # packets that wait
_PLACE_WORDS = 32  # of which a packet takes PACKET_WORDS
_PLACE_BITS = 10  # of row and column in a packet
_FRAME_OCTETS = 2 + sum(field.bits for field in TEXTURE_FIELDS) // 8


class _Shared:
    """What packing and sending share."""

    def __init__(self):
        # Packets: the one after those of whole frames, and the one to be sent. The highest bit
        # tells a full queue from an empty one.
        self.ready = Signal(range(2 * _PLACES))
        self.sent = Signal(range(2 * _PLACES))

        # The frame that has passed: what is said of it, whether its packet is to be sent, and was.
        self.info = Signal(FrameInfo, reset_less=True)
        self.broken = Signal(reset_less=True)
        self.frame_due = Signal()
        self.frame_sent = Signal()


class Texture(wiring.Component):
    """Sends the image packet by packet, packed from the texture frames that pass.

    Rows are packed in passes: every eighth from 0 on, every eighth from 4 on, every fourth from 2
    on, every second from 1 on, and from the beginning. From each frame the pixels from the next one
    on are packed, until the pass is over or no place is left for a packet; the README says how.
    Sixteen packets have a place each. When the frame has arrived whole they may be sent; those of a
    broken frame are forgotten. A packet holds pixels of one frame.

    For each frame there is one packet of kind TEXTURE_FRAME, after its last pixel, before any of
    its packets of pixels. A frame that begins while the packet of the one before has not been sent
    is not taken: ``info`` is not ready.

    ``i.ready`` is always high. Octets follow each other within 2 clocks, once the packet's first is
    taken. After reset packing begins at the first pixel.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels, 16 to 1024.
    domain : :class:`str`
        Clock domain of ``o``, ``enable``, ``bad_sync`` and ``overrun``, and of all that works for
        them. Its clock is that of ``sync``, and may be stopped while ``busy`` is low.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel))`
        Texture frames, whole or broken; ``ready`` is constant.
    info : :py:`In(stream.Signature(FrameInfo))`
        One for each frame, in the clock of its first pixel.
    texture_bound, texture_mosaic : :py:`In(3)`, :py:`In(1)`
        The registers; they may change only between texture frames.
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
    registers = register_ports("texture_bound", "texture_mosaic")

    def __init__(self, width, height, domain="sync"):
        low, high = SENSOR_PIXELS
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, int) or not low <= value <= high:
                raise ValueError(
                    f"Frame {name} must be an integer from {low} to {high}, not {value!r}")
        self.width, self.height, self.domain = width, height, domain
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "info": In(stream.Signature(FrameInfo)),
            **self.registers,
            "enable": In(1),
            "bad_sync": In(8),
            "overrun": In(8),
            "o": Out(stream.Signature(PacketOctet)),
            "busy": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        # A word's highest bit tells that it is its packet's last.
        m.submodules.words = memory = Memory(shape=33, depth=_PLACES * _PLACE_WORDS, init=[])
        m.submodules.code = code = TextureCode()
        s = _Shared()
        self._pack(m, s, code, memory.write_port())
        self._send(m, s, memory.read_port(domain=self.domain))
        return m

    def _pack(self, m, s, code, write):
        """Pixels of a passing frame to packets in the memory."""
        marker = self.i.p.marker
        m.d.comb += [
            self.i.ready.eq(1),
            # When a frame's packet has been sent, its pixels have long been packed.
            self.info.ready.eq(~s.frame_due),
        ]
        with m.If(self.info.valid & self.info.ready):
            m.d.sync += s.info.eq(self.info.p)
        with m.If(s.frame_sent):
            m.d.sync += s.frame_due.eq(0)
        with m.If(self.i.valid & marker.frame_end):
            m.d.sync += [s.frame_due.eq(1), s.broken.eq(marker.broken)]

        # The next pixel to be packed, and where a packet goes; and both as they were before this
        # frame.
        row, column = Signal(range(self.height)), Signal(range(self.width))
        kept_row, kept_column = Signal.like(row), Signal.like(column)
        place = Signal.like(s.ready)

        # A pixel one clock later, where it stands, and the last ones in the row to be packed.
        here, line_end, ended = Signal(), Signal(reset_less=True), Signal()
        value, last, other = (Signal(8, reset_less=True) for _ in range(3))
        passing_row, passing_column = Signal.like(row), Signal.like(column)
        in_row, difference = Signal(), Signal(signed(9))
        m.d.sync += [
            here.eq(self.i.valid & ~marker.broken), line_end.eq(marker.line_end),
            ended.eq(self.i.valid & marker.frame_end),
            value.eq(quantise(self.i.p.grey, self.texture_bound)),
        ]
        m.d.comb += [
            in_row.eq(here & (passing_row == row)),
            difference.eq(value - Mux(self.texture_mosaic, other, last)),
        ]
        with m.If(here):
            m.d.sync += passing_column.eq(passing_column + 1)
            with m.If(line_end):
                m.d.sync += [passing_column.eq(0), passing_row.eq(passing_row + 1)]
        with m.If(ended):
            m.d.sync += [passing_column.eq(0), passing_row.eq(0)]
        with m.If(in_row):
            m.d.sync += [last.eq(value), other.eq(last)]

        # Two clocks later.
        wanted, completes, settling, settled = Signal(), Signal(reset_less=True), Signal(), Signal()
        pass_over = Signal()
        following, wraps = self._next_row(m, row)
        room = (place ^ s.sent) != _PLACES
        m.d.sync += [
            wanted.eq(in_row & ((passing_column == column) | (code.pixel & ~completes))),
            completes.eq(line_end), code.value.eq(value),
            code.fold.eq(Cat(difference[8], difference[:8] ^ difference[8].replicate(8))),
            code.mark.eq(code.pixel & completes & ~code.full),
            settling.eq(ended | (settling & ~settled)),
        ]
        m.d.comb += [
            code.pixel.eq(wanted & (code.open | room)),
            code.mosaic.eq(self.texture_mosaic),
            settled.eq(settling & ~wanted & ~code.mark & ~code.closing),
            code.restart.eq(settled & s.broken),
        ]
        with m.If(code.pixel):
            m.d.sync += column.eq(column + 1)
            with m.If(completes):
                m.d.sync += [column.eq(0), row.eq(following), pass_over.eq(wraps)]
        with m.If(code.mark):
            m.d.sync += code.closing.eq(pass_over & ~code.full)
        with m.If(code.ends):
            m.d.sync += [place.eq(place + 1), code.closing.eq(0)]
        with m.If(settled):
            with m.If(s.broken):
                m.d.sync += [row.eq(kept_row), column.eq(kept_column), place.eq(s.ready)]
            with m.Else():
                m.d.sync += [kept_row.eq(row), kept_column.eq(column), s.ready.eq(place)]

        first_row, first_column = Signal.like(row), Signal.like(column)
        before, of_word = Signal(range(_PLACES)), Signal(range(_PLACES))
        m.d.sync += [before.eq(place), of_word.eq(before)]
        with m.If(code.first):
            m.d.sync += [first_row.eq(row), first_column.eq(column)]
        m.d.comb += [
            code.head.eq(Cat(
                s.info.number[:8], Cat(first_row, C(0, 10))[:10], Cat(first_column, C(0, 10))[:10],
                self.texture_bound[1:], self.texture_mosaic)),
            write.en.eq(code.write),
            write.addr.eq(Cat(code.word, of_word)),
            write.data.eq(Cat(code.data, code.last)),
        ]

    def _next_row(self, m, row):
        """The row that is packed after ``row``, and whether another pass begins with it."""
        following, wraps = Signal(11), Signal()
        step = Mux(row[0], 2, Mux(row[1], 4, 8))
        first = Mux(row[0], 0, Mux(row[1], 1, Mux(row[2], 2, 4)))
        m.d.comb += [following.eq(row + step), wraps.eq(following >= self.height)]
        return Mux(wraps, first, following), wraps

    def _send(self, m, s, read):
        """Packets of frames, and of pixels."""
        link = m.d[self.domain]
        # An octet's place in a packet of a frame, or in the words of one of pixels.
        index = Signal(range(4 * PACKET_WORDS))
        of_frame = Signal()
        in_words = Signal()
        counters = Signal(16, reset_less=True)
        pixels_left = self.enable & (s.sent != s.ready)
        self._fill_octet(m, s, read.data, index, of_frame, in_words, counters)
        m.d.comb += [
            read.addr.eq(Cat(index[2:], s.sent[:4])),
            self.o.p.last.eq(Mux(of_frame, index == _FRAME_OCTETS - 1,
                                 in_words & read.data[32] & index[:2].all())),
        ]
        with m.FSM(domain=self.domain) as fsm:
            with m.State("IDLE"):
                link += [of_frame.eq(s.frame_due), counters.eq(Cat(self.bad_sync, self.overrun))]
                with m.If(s.frame_due | pixels_left):
                    m.next = "HEAD"

            with m.State("HEAD"):
                m.d.comb += self.o.valid.eq(1)
                with m.If(self.o.ready):
                    with m.If(of_frame):
                        link += index.eq(index + 1)
                    with m.Else():
                        m.next = "FETCH"
                    with m.If(self.o.p.last):
                        m.d.comb += s.frame_sent.eq(1)
                        link += index.eq(0)
                        m.next = "IDLE"

            with m.State("FETCH"):
                m.next = "WORD"

            with m.State("WORD"):
                m.d.comb += [self.o.valid.eq(1), in_words.eq(1)]
                with m.If(self.o.ready):
                    link += index.eq(index + 1)
                    with m.If(index[:2].all()):
                        m.next = "FETCH"
                    with m.If(self.o.p.last):
                        link += [index.eq(0), s.sent.eq(s.sent + 1)]
                        m.next = "IDLE"

            m.d.comb += [
                read.en.eq(fsm.ongoing("FETCH")),
                self.busy.eq(s.frame_due | ~fsm.ongoing("IDLE") | pixels_left),
            ]

    def _fill_octet(self, m, s, word, index, of_frame, in_words, counters):
        """The octet that is sent."""
        info = s.info
        flags = flags_octet(
            broken=s.broken, laser=info.tag.laser, capture=info.tag.capture, tripped=info.tripped,
            tables_valid=info.tables_valid, texture=info.tag.texture)
        fields = Cat(
            C(PacketKind.TEXTURE_FRAME, 8), info.number[:8], bits_of_fields(TEXTURE_FIELDS, {
                "number": info.number, "skipped": info.skipped,
                "exposure_us": info.tag.exposure_us, "timestamp_us": info.tag.timestamp_us,
                "bad_sync": counters[:8], "overrun": counters[8:], "flags": flags}))
        with m.If(in_words):
            m.d.comb += self.o.p.data.eq(word.word_select(index[:2], 8))
        with m.Elif(of_frame):
            m.d.comb += self.o.p.data.eq(fields.word_select(index[:4], 8))
        with m.Else():
            m.d.comb += self.o.p.data.eq(PacketKind.TEXTURE)
