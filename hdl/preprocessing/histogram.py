"""Histogram of the part of a frame that the threshold is measured on."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import GreyPixel
from .threshold import BIN_BITS, CLEAR_CLOCKS, Threshold, counted_rows

__all__ = ["Histogram"]


class Histogram(wiring.Component):
    """Counts the grey values of a frame's middle rows, or of all of them.

    From the end of a frame until the next one's first counted row the bins are cleared, one a
    clock; then pixels are counted; while the last rows pass the bins can be read. The number of
    rows that this takes follows from the width, for pixels that come without a pause: the level is
    known when the next frame begins, and never depends on blanking. The rows in the middle are
    chosen so that no bin can overflow; of frames of more than 131,071 pixels some are left out.
    ``rows`` holds the first row that is counted and the first one after.

    With ``whole``, frames wait in a memory for their own level, so there is time between them: all
    rows count, and the bins are cleared, in 257 clocks, after ``clear``, after a broken frame and
    after reset. Frames must begin while ``clean`` is high.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.
    whole : :class:`bool`
        Count whole frames.

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
        Pixels in it, a clock later.
    done, lost : :py:`Out(1)`
        High for a clock with a frame's last pixel, or when a frame was broken off.
    clear : :py:`In(1)`
        With ``whole``: the bins have been read.
    clean : :py:`Out(1)`
        With ``whole``: all bins are empty, or a frame is being counted.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``address`` to ``count``.
    """

    latency = 1

    def __init__(self, width, height, whole=False):
        self.rows = counted_rows(width, height, whole)
        self.width, self.height, self.whole = width, height, whole
        super().__init__({
            **({"clear": In(1), "clean": Out(1)} if whole else {}),
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
        assert self.whole or first * self.width >= CLEAR_CLOCKS
        assert self.whole or (self.height - stop) * self.width >= Threshold.latency

        m.submodules.bins = bins = Memory(shape=BIN_BITS, depth=256, init=[])
        write, read = bins.write_port(), bins.read_port()

        marker = self.i.p.marker
        pixel = Signal()
        row = Signal(range(self.height))
        clearing = Signal(init=1)
        counting = Signal()
        m.d.comb += [
            pixel.eq(self.i.valid & ~marker.broken),
            self.done.eq(pixel & marker.frame_end),
            self.lost.eq(self.i.valid & marker.broken),
        ]
        m.d.sync += self.closed.eq(0)
        if self.whole:
            self._whole_frames(m, row, clearing, counting)
        else:
            with m.If(self.done | self.lost):
                m.d.sync += [row.eq(0), clearing.eq(1), counting.eq(0)]
            with m.Elif(pixel & marker.line_end):
                m.d.sync += row.eq(row + 1)
                with m.If(row == first - 1):
                    m.d.sync += [clearing.eq(0), counting.eq(1)]
                with m.If(row == stop - 1):
                    m.d.sync += [counting.eq(0), self.closed.eq(1)]

        # A pixel's bin is read in its clock and written in the next one. The very next pixel reads
        # the old count then: if it is of the same grey, it goes on from what was just written.
        # While clearing, the register of the grey value counts through the bins.
        counted = Signal()
        grey = Signal(8)
        again = Signal()
        before, after = Signal(BIN_BITS), Signal(BIN_BITS)
        m.d.comb += [
            after.eq(Mux(clearing, 0, Mux(again, before, read.data)) + ~clearing),
            read.addr.eq(Mux(counting, self.i.p.grey, self.address)),
            write.en.eq(clearing | counted),
            write.addr.eq(grey),
            write.data.eq(after),
            self.count.eq(read.data),
        ]
        m.d.sync += [
            counted.eq(pixel & counting),
            grey.eq(Mux(clearing, grey, self.i.p.grey) + clearing),
            again.eq(counted & (grey == self.i.p.grey)),
            before.eq(after),
        ]
        return m

    def _whole_frames(self, m, row, clearing, counting):
        first, stop = self.rows
        line_end = self.i.valid & self.i.p.marker.line_end
        cleared = Signal(9)  # its top bit ends the clearing
        with m.If(clearing):
            m.d.sync += cleared.eq(cleared + 1)
            with m.If(cleared[-1]):
                m.d.sync += [clearing.eq(0), self.clean.eq(1), counting.eq(first == 0)]
        with m.Elif(self.clear | self.lost):
            m.d.sync += [
                row.eq(0), cleared.eq(0), clearing.eq(1), self.clean.eq(0), counting.eq(0)]
        with m.Elif(self.done):
            m.d.sync += [row.eq(0), self.clean.eq(0), counting.eq(0), self.closed.eq(1)]
        with m.Elif(line_end):
            m.d.sync += row.eq(row + 1)
            with m.If(row == first - 1):
                m.d.sync += counting.eq(1)
            with m.If(row == stop - 1):
                m.d.sync += counting.eq(0)
