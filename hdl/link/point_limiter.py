"""No more points of a frame than the line can carry."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.wiring import In, Out

from ..payloads import Counts, Point, Status

__all__ = ["PointLimiter"]


class PointLimiter(wiring.Component):
    """Passes at most ``limit`` ok points of a frame, and counts the others as dropped.

    So a frame full of false points loses its own points, and not the frames behind it, for which
    the buffer would be full. If the frame before had more ok points than that, those that pass are
    spread evenly over the frame, in the same proportion, so that what is left shows the whole mesh;
    otherwise they are the first ones. Points that are not ok pass: few are ever sent. An end marker
    waits for its frame's counts, and for space in their queue. Reset discards all counts.

    Parameters
    ----------
    frames : :class:`int`
        Frames whose counts the queue can hold.

    Members
    -------
    i, o : :py:`In(stream.Signature(Point))`, :py:`Out(stream.Signature(Point))`
        Points and end markers.
    counts_i, counts_o : :py:`In(stream.Signature(Counts))`, :py:`Out(stream.Signature(Counts))`
        One for each frame; ``dropped`` grows by the points taken out here, and stops at 65,535.
    limit : :py:`In(9)`
        Ok points of a frame; 0 is no limit. May change only between frames.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a point at ``i`` to the same at ``o``. Counts take one more, from their frame's
        end marker.
    """

    latency = 0

    def __init__(self, frames=4):
        if not isinstance(frames, int) or frames < 1:
            raise ValueError(f"Frames must be a positive integer, not {frames!r}")
        self.frames = frames
        super().__init__({
            "i": In(stream.Signature(Point)),
            "o": Out(stream.Signature(Point)),
            "counts_i": In(stream.Signature(Counts)),
            "counts_o": Out(stream.Signature(Counts)),
            "limit": In(9),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.queue = queue = SyncFIFO(width=Shape.cast(Counts).width, depth=self.frames)
        point = self.i.p

        passed = Signal(9)
        dropped = Signal(16)
        found, found_before = Signal(9), Signal(9)  # ok points, at most 511
        share = Signal(9)  # in parts of found_before
        more_share = Signal(10)
        spread, is_next = Signal(), Signal()
        is_ok, over, end_ready = Signal(), Signal(), Signal()
        total = Signal(17)
        counts = Signal(Counts)
        m.d.comb += [
            is_ok.eq(~point.end & (point.status == Status.OK)),
            # A point passes whenever the sum of limit / found_before reaches the next integer.
            spread.eq(found_before > self.limit),
            more_share.eq(share + self.limit),
            is_next.eq(more_share >= found_before),
            over.eq(is_ok & (self.limit != 0)
                    & ((passed == self.limit) | (spread & ~is_next))),
            end_ready.eq(self.counts_i.valid & queue.w_rdy),
            self.o.payload.eq(self.i.payload),
            self.o.valid.eq(self.i.valid & Mux(point.end, end_ready, ~over)),
            self.i.ready.eq(over | (self.o.ready & (~point.end | end_ready))),
            total.eq(self.counts_i.p.dropped + dropped),
            counts.eq(self.counts_i.payload),
            counts.dropped.eq(total[:16] | total[16].replicate(16)),
            queue.w_data.eq(counts),
            queue.w_en.eq(self.i.valid & self.i.ready & point.end),
            self.counts_i.ready.eq(queue.w_en),
            self.counts_o.payload.eq(queue.r_data),
            self.counts_o.valid.eq(queue.r_rdy),
            queue.r_en.eq(self.counts_o.ready),
        ]
        with m.If(self.i.valid & self.i.ready):
            with m.If(point.end):
                m.d.sync += [passed.eq(0), dropped.eq(0), share.eq(0), found.eq(0),
                             found_before.eq(found)]
            with m.Elif(over & (dropped != 0xFFFF)):
                m.d.sync += dropped.eq(dropped + 1)
            with m.If(is_ok):
                m.d.sync += share.eq(more_share - Mux(is_next, found_before, 0))
                with m.If(~over):
                    m.d.sync += passed.eq(passed + 1)
                with m.If(~found.all()):
                    m.d.sync += found.eq(found + 1)
        return m
