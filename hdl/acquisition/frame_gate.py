"""Whole frames, or none."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import FrameInfo, GreyPixel

__all__ = ["FrameGate"]


class FrameGate(wiring.Component):
    """Numbers frames, announces each, and keeps out those that the reader cannot be told of.

    A frame whose first pixel comes while ``info`` is not ready is taken and thrown away whole, and
    counted; the next announcement tells how many there were. Pixels pass without a clock between;
    nothing waits that ``o`` would take. A ``broken`` beat before any pixel of its frame is
    thrown away.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel))`
        Frames.
    o : :py:`Out(stream.Signature(GreyPixel))`
        Those that pass.
    info : :py:`Out(stream.Signature(FrameInfo))`
        One for each frame that passes, with its first pixel. ``valid`` does not wait for ``ready``,
        but is high for that one clock only: this stream is for a queue that takes at once or not.
    level : :py:`In(8)`
        Threshold, for the announcement.
    learnt : :py:`In(1)`
        Low if no threshold is known yet.
    """

    latency = 0

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "o": Out(stream.Signature(GreyPixel)),
            "info": Out(stream.Signature(FrameInfo)),
            "level": In(8),
            "learnt": In(1),
        })

    def elaborate(self, platform):
        m = Module()

        inside = Signal()  # the frame's first pixel has been taken
        passing = Signal()  # ... and the frame passes
        number = Signal(16)
        skipped = Signal(8)

        mark = self.i.p.mark
        begins = Signal()
        passes = Signal()
        m.d.comb += [
            begins.eq(~inside & ~mark.broken),
            passes.eq(Mux(inside, passing, begins & self.info.ready)),
            self.o.payload.eq(self.i.payload),
            self.o.valid.eq(self.i.valid & passes),
            self.i.ready.eq(self.o.ready | ~passes),
            self.info.valid.eq(self.i.valid & begins & self.o.ready),
            self.info.p.number.eq(number),
            self.info.p.level.eq(self.level),
            self.info.p.learning.eq(~self.learnt),
            self.info.p.skipped.eq(skipped),
        ]
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += [inside.eq(~mark.frame_end), passing.eq(passes)]
            with m.If(begins):
                m.d.sync += number.eq(number + 1)
                with m.If(passes):
                    m.d.sync += skipped.eq(0)
                with m.Elif(skipped != 255):
                    m.d.sync += skipped.eq(skipped + 1)

        return m
