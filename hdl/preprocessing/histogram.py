"""Histogram of the part of a frame that the threshold is learnt from."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import GreyPixel
from .threshold import Threshold

__all__ = ["BIN_BITS", "Histogram"]

#: Bits of a bin, which stops at its largest value.
BIN_BITS = 17
_BINS = 256


class Histogram(wiring.Component):
    """Counts the grey values of a frame's middle rows.

    While the first rows pass the bins are cleared, a bin a clock; the rows after them are counted;
    while the last rows pass the bins can be read. How many first and last rows that takes follows
    from the width, for pixels that come without any pause: the level is then known when the next
    frame begins, and never depends on blanking. ``rows`` holds the first row that is counted and
    the first one after.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel, always_ready=True))`
        Pixels; each is counted in the clock in which it is valid.
    closed : :py:`Out(1)`
        High for a clock when the last row that counts has passed; the bins may be read from the
        second clock after it.
    address : :py:`In(8)`
        Bin to be read.
    count : :py:`Out(17)`
        Pixels in it, a clock later; at most ``2**17 - 1``.
    done, lost : :py:`Out(1)`
        High for a clock with a frame's last pixel, or when a frame was broken off.
    """

    def __init__(self, width, height):
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, int) or not 1 <= value <= 512:
                raise ValueError(f"Frame {name} must be an integer from 1 to 512, not {value!r}")
        first = -(-(_BINS + 4) // width)
        stop = height - -(-Threshold.latency // width)
        if stop <= first:
            raise ValueError(f"A frame of {width} x {height} pixels is too small to learn a "
                             f"threshold from: it must have more than {first + height - stop} rows")
        self.rows = first, stop
        self.width, self.height = width, height
        super().__init__({
            "i": In(stream.Signature(GreyPixel, always_ready=True)),
            "closed": Out(1),
            "address": In(8),
            "count": Out(BIN_BITS),
            "done": Out(1),
            "lost": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        first, stop = self.rows

        m.submodules.bins = bins = Memory(shape=BIN_BITS, depth=_BINS, init=[])
        write, read = bins.write_port(), bins.read_port()

        mark = self.i.p.mark
        pixel = Signal()
        row = Signal(range(self.height))
        begun = Signal()  # a pixel of this frame has come
        counting = Signal()
        m.d.comb += [
            pixel.eq(self.i.valid & ~mark.broken),
            self.done.eq(pixel & mark.frame_end),
            self.lost.eq(self.i.valid & mark.broken),
        ]
        m.d.sync += self.closed.eq(0)
        with m.If(self.done | self.lost):
            m.d.sync += [row.eq(0), begun.eq(0), counting.eq(0)]
        with m.Elif(pixel):
            m.d.sync += begun.eq(1)
            with m.If(mark.line_end):
                m.d.sync += row.eq(row + 1)
                with m.If(row == first - 1):
                    m.d.sync += counting.eq(1)
                with m.If(row == stop - 1):
                    m.d.sync += [counting.eq(0), self.closed.eq(1)]

        # Clearing takes the write port for a clock per bin.
        bin_number = Signal(range(_BINS + 1), init=_BINS)
        clearing = Signal()
        m.d.comb += clearing.eq(~bin_number[-1])
        with m.If(pixel & ~begun):
            m.d.sync += bin_number.eq(0)
        with m.Elif(clearing):
            m.d.sync += bin_number.eq(bin_number + 1)

        # A pixel's bin is read in its clock and written in the next one. The very next pixel reads
        # the old count then: if it is of the same grey, it goes on from what was just written.
        counted = Signal()
        grey = Signal(8)
        again = Signal()
        before = Signal(BIN_BITS)
        after = Signal(BIN_BITS)
        stale = Mux(again, before, read.data)
        m.d.comb += [
            after.eq(stale + ~stale.all()),
            read.addr.eq(Mux(counting, self.i.p.grey, self.address)),
            read.en.eq(1),
            write.en.eq(clearing | counted),
            write.addr.eq(Mux(clearing, bin_number, grey)),
            write.data.eq(Mux(clearing, 0, after)),
            self.count.eq(read.data),
        ]
        m.d.sync += [
            counted.eq(pixel & counting),
            grey.eq(self.i.p.grey),
            again.eq(counted & (grey == self.i.p.grey)),
            before.eq(after),
        ]
        return m
