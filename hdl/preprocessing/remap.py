"""Distortion correction of the whole image: a second reading through a table of places."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out

from ..payloads import GreyPixel

__all__ = ["OUTSIDE", "Remap"]

#: Word of a corrected pixel that no pixel of the image shows.
OUTSIDE = (1 << 18) - 1
#: Pixels that may be on their way from the table to ``o``.
_ON_THEIR_WAY = 16


class Remap(wiring.Component):
    """Reads a stored image in the order of the corrected one, nearest neighbour.

    The table has a word for each pixel of the corrected image, in raster order: the number of the
    image's pixel that it shows, in raster order too. :data:`OUTSIDE`, and all numbers that the
    image does not have, show 0.

    A frame waits at ``start`` while it is read, and is taken when the image is needed no longer.
    A frame that lost synchronism is not read: a ``broken`` beat stands for it.

    One pixel a clock as long as ``ask`` and ``o`` are ready and a word answers within 12 clocks;
    a pixel is at ``o`` three clocks after its word. No more words are asked for than there is room
    for their pixels. Reset forgets all frames.

    Paper, section on distortion correction: a look-up table computed off-line, nearest neighbour,
    8-bit pixels, 18-bit coordinates.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.

    Members
    -------
    start : :py:`In(stream.Signature(1))`
        A frame is stored; high if it lost synchronism.
    ask : :py:`Out(stream.Signature(18))`
        Word of the table that is wanted.
    answer : :py:`In(stream.Signature(18, always_ready=True))`
        Words, in the order in which they were asked for.
    address, read : :py:`Out(18)`, :py:`Out(1)`
        Pixel of the image that is read in this clock.
    grey : :py:`In(8)`
        Its grey value, one clock later.
    o : :py:`Out(stream.Signature(GreyPixel))`
        The corrected image.
    """

    def __init__(self, width, height):
        for name, value in [("width", width), ("height", height)]:
            if not isinstance(value, int) or not 2 <= value <= 512:
                raise ValueError(f"Frame {name} must be an integer from 2 to 512, not {value!r}")
        self.width, self.height = width, height
        super().__init__({
            "start": In(stream.Signature(1)),
            "ask": Out(stream.Signature(18)),
            "answer": In(stream.Signature(18, always_ready=True)),
            "address": Out(18),
            "read": Out(1),
            "grey": In(8),
            "o": Out(stream.Signature(GreyPixel)),
        })

    def elaborate(self, platform):
        m = Module()
        pixels = self.width * self.height

        # `unread` counts words that were asked for and pixels that have not been read yet,
        # `unsent` those that have not left, both on their way.
        asked = Signal(range(pixels))
        all_asked = Signal()
        unread = Signal(range(_ON_THEIR_WAY + 1))
        unsent = Signal(range(_ON_THEIR_WAY + 1))
        asks, sends, reads, done = Signal(), Signal(), Signal(), Signal()
        m.d.comb += [
            self.ask.p.eq(asked),
            self.ask.valid.eq(self.start.valid & ~self.start.p & ~all_asked & ~unsent[-1]),
            asks.eq(self.ask.valid & self.ask.ready),
            done.eq(all_asked & (unread == 0)),
        ]
        with m.If(asks):
            m.d.sync += [
                asked.eq(Mux(asked == pixels - 1, 0, asked + 1)),
                all_asked.eq(asked == pixels - 1),
            ]
        with m.If(done):
            m.d.sync += all_asked.eq(0)
        for counter, less in [(unread, reads), (unsent, sends)]:
            with m.If(asks & ~less):
                m.d.sync += counter.eq(counter + 1)
            with m.Elif(less & ~asks):
                m.d.sync += counter.eq(counter - 1)

        # A word comes, its pixel is read, and queued.
        arrived, outside = Signal(), Signal()
        dark = Signal()
        m.submodules.queue = queue = SyncFIFO(width=8, depth=_ON_THEIR_WAY)
        m.d.comb += [
            self.read.eq(arrived),
            queue.w_en.eq(reads),
            queue.w_data.eq(Mux(dark, 0, self.grey)),
        ]
        m.d.sync += [
            arrived.eq(self.answer.valid),
            self.address.eq(self.answer.p),
            outside.eq(self.answer.p >= min(pixels, OUTSIDE)),
            reads.eq(arrived),
            dark.eq(outside),
        ]

        column, row = Signal(range(self.width)), Signal(range(self.height))
        line_end, frame_end, breaks = Signal(), Signal(), Signal()
        m.d.comb += [
            line_end.eq(column == self.width - 1),
            frame_end.eq(line_end & (row == self.height - 1)),
            breaks.eq(self.start.valid & self.start.p & (unsent == 0)),
            queue.r_en.eq(self.o.ready),
            sends.eq(queue.r_rdy & self.o.ready),
            self.start.ready.eq(Mux(self.start.p, breaks & self.o.ready, done)),
            self.o.valid.eq(queue.r_rdy | breaks),
            self.o.p.grey.eq(Mux(breaks, 0, queue.r_data)),
            self.o.p.mark.line_end.eq(line_end | breaks),
            self.o.p.mark.frame_end.eq(frame_end | breaks),
            self.o.p.mark.broken.eq(breaks),
        ]
        with m.If(sends):
            m.d.sync += column.eq(Mux(line_end, 0, column + 1))
            with m.If(line_end):
                m.d.sync += row.eq(Mux(frame_end, 0, row + 1))
        return m
