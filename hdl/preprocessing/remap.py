"""Distortion correction of the whole image: a second reading through a remap table."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out

from ..payloads import GreyPixel

__all__ = ["DIFFERENCE_BITS", "Remap"]

#: Bits of the difference between the two pixel numbers in a word of the table.
DIFFERENCE_BITS = 12
_WORD_BITS = 32
#: Words that may be under way from the table.
_UNDER_WAY = 8


class Remap(wiring.Component):
    """Reads a stored image in the order of the corrected one, nearest neighbour.

    The table has a word for each two pixels of the corrected image, in raster order. It holds the
    numbers of the pixels that they show, in raster order of the image:

    ======== ==================================================================
    bits     meaning
    ======== ==================================================================
    0 to 17  pixel that the first one shows
    18 to 29 pixel that the second one shows, less that; signed
    30, 31   the first one, the second one shows nothing and is 0
    ======== ==================================================================

    Pixels outside the image must be flagged as showing nothing.

    A frame waits at ``start`` while it is read, and is taken when the image is no longer needed. A
    frame that lost synchronism is not read: a ``broken`` beat is sent instead.

    One pixel a clock as long as ``ask`` and ``o`` are ready and a word answers within 12 clocks. No
    more words are requested than the queue has room for. Reset discards all frames.

    Paper, section on distortion correction: a look-up table computed off-line, nearest neighbour,
    8-bit pixels, 18-bit coordinates. Giving the second of two pixels as a difference is ours: it
    halves the traffic.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.

    Members
    -------
    start : :py:`In(stream.Signature(1))`
        A frame is stored; high if it lost synchronism.
    ask : :py:`Out(stream.Signature(17))`
        Word of the table to be read.
    answer : :py:`In(stream.Signature(32, always_ready=True))`
        Words, in the order in which they were requested.
    address, read : :py:`Out(18)`, :py:`Out(1)`
        Pixel of the image that is read in this clock.
    grey : :py:`In(8)`
        Its grey value, from the next clock until another one is read.
    o : :py:`Out(stream.Signature(GreyPixel))`
        The corrected image.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a word at ``answer`` to its first pixel at ``o``.
    """

    latency = 3

    def __init__(self, width, height):
        for name, value in [("width", width), ("height", height)]:
            if not isinstance(value, int) or not 2 <= value <= 512:
                raise ValueError(f"Frame {name} must be an integer from 2 to 512, not {value!r}")
        self.width, self.height = width, height
        super().__init__({
            "start": In(stream.Signature(1)),
            "ask": Out(stream.Signature(17)),
            "answer": In(stream.Signature(_WORD_BITS, always_ready=True)),
            "address": Out(18),
            "read": Out(1),
            "grey": In(8),
            "o": Out(stream.Signature(GreyPixel)),
        })

    def elaborate(self, platform):
        m = Module()
        pixels = self.width * self.height
        words = (pixels + 1) // 2

        # Words are requested as long as the queue has room for them.
        asked = Signal(range(words))
        all_asked = Signal()
        under_way = Signal(range(_UNDER_WAY + 1))
        asks, used, done = Signal(), Signal(), Signal()
        m.submodules.queue = queue = SyncFIFO(width=_WORD_BITS, depth=_UNDER_WAY)
        m.d.comb += [
            self.ask.p.eq(asked),
            self.ask.valid.eq(
                self.start.valid & ~self.start.p & ~all_asked & ~under_way[-1]),
            asks.eq(self.ask.valid & self.ask.ready),
            queue.w_en.eq(self.answer.valid),
            queue.w_data.eq(self.answer.p),
            queue.r_en.eq(used),
        ]
        with m.If(asks):
            m.d.sync += [
                asked.eq(Mux(asked == words - 1, 0, asked + 1)),
                all_asked.eq(asked == words - 1),
            ]
        with m.If(done):
            m.d.sync += all_asked.eq(0)
        with m.If(asks & ~used):
            m.d.sync += under_way.eq(under_way + 1)
        with m.Elif(used & ~asks):
            m.d.sync += under_way.eq(under_way - 1)

        # A word's two pixel numbers, one after the other; then the pixels.
        second, single = Signal(), Signal()
        number_free, pixel_free = Signal(), Signal()
        numbered = Signal()
        outside = Signal()
        shown = Signal()
        dark = Signal()
        first_number, difference = queue.r_data[:18], queue.r_data[18:30].as_signed()
        m.d.comb += [
            pixel_free.eq(~shown | self.o.ready),
            number_free.eq(~numbered | pixel_free),
            used.eq(queue.r_rdy & number_free & (second | single)),
            self.read.eq(numbered & pixel_free),
            done.eq(all_asked & (under_way == 0) & ~numbered),
        ]
        with m.If(number_free):
            m.d.sync += [
                numbered.eq(queue.r_rdy),
                second.eq(queue.r_rdy & ~second & ~single),
                self.address.eq(first_number + Mux(second, difference, 0)),
                outside.eq(Mux(second, queue.r_data[31], queue.r_data[30])),
            ]
        with m.If(pixel_free):
            m.d.sync += [shown.eq(numbered), dark.eq(outside)]
        if pixels % 2:
            # The last word has one pixel only.
            left = Signal(range(words), init=words - 1)
            m.d.comb += single.eq(left == 0)
            with m.If(used):
                m.d.sync += left.eq(Mux(single, words - 1, left - 1))

        column, row = Signal(range(self.width)), Signal(range(self.height))
        line_end, frame_end, breaks = Signal(), Signal(), Signal()
        m.d.comb += [
            line_end.eq(column == self.width - 1),
            frame_end.eq(line_end & (row == self.height - 1)),
            breaks.eq(self.start.valid & self.start.p & ~shown),
            self.start.ready.eq(Mux(self.start.p, breaks & self.o.ready, done)),
            self.o.valid.eq(shown | breaks),
            self.o.p.grey.eq(Mux(breaks | dark, 0, self.grey)),
            self.o.p.marker.line_end.eq(line_end | breaks),
            self.o.p.marker.frame_end.eq(frame_end | breaks),
            self.o.p.marker.broken.eq(breaks),
        ]
        with m.If(shown & self.o.ready):
            m.d.sync += column.eq(Mux(line_end, 0, column + 1))
            with m.If(line_end):
                m.d.sync += row.eq(Mux(frame_end, 0, row + 1))
        return m
