"""3x3 erosion of the mask."""

from amaranth import *
from amaranth.lib import data, enum, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import MaskPixel

__all__ = ["Erosion", "ErosionMode"]


class ErosionMode(enum.Enum, shape=2):
    """What the erosion does to a component."""

    OFF = 0
    ERODE = 1
    GATE = 2


class Erosion(wiring.Component):
    """Finds the lit pixels that have eight lit neighbours; outside the image all is dark.

    In mode *off* every lit pixel is core; in *erode* only the survivors stay lit (the paper's
    form); in *gate* all stay and the survivors are core.

    A pixel leaves when its lower right neighbour has come, ``width + 1`` pixels later. The frame's
    last row is drained, a pixel a clock, while the next frame may already come in: draining is
    never behind the new pixels. One pixel a clock, frames back to back. A ``broken`` beat discards
    the unfinished frame, and leaves once all of the frame before has left. Reset discards
    everything.

    One memory of ``width`` words: two rows of mask, one of grey.

    Parameters
    ----------
    width : :class:`int`
        Pixels of a row, 3 to 512.

    Members
    -------
    i : :py:`In(stream.Signature(MaskPixel))`
        Mask after the threshold.
    o : :py:`Out(stream.Signature(MaskPixel))`
        Mask after the erosion, in the same order.
    mode : :py:`In(ErosionMode)`
        Sampled with each pixel that leaves.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from the pixel that is ``width + 1`` pixels behind, at ``i``, to the pixel at ``o``.
    """

    latency = 1

    def __init__(self, width):
        if not isinstance(width, int) or not 3 <= width <= 512:
            raise ValueError(f"Frame width must be an integer from 3 to 512, not {width!r}")
        self.width = width
        super().__init__({
            "i": In(stream.Signature(MaskPixel)),
            "o": Out(stream.Signature(MaskPixel)),
            "mode": In(ErosionMode),
        })

    def elaborate(self, platform):
        m = Module()
        Column = data.StructLayout({"lit": 1, "lit_above": 1, "excess": 8})

        m.submodules.rows = rows = Memory(shape=Column, depth=self.width, init=[])
        write, read = rows.write_port(), rows.read_port()

        advance = Signal()  # the output register is free
        m.d.comb += advance.eq(~self.o.valid | self.o.ready)
        draining = Signal()
        takes, breaks, step, last = Signal(), Signal(), Signal(), Signal()
        abort_pending = Signal()  # a broken beat waits for the frame before
        first_row = self._walk(m, advance, abort_pending, draining, takes, breaks, step, last,
                               write, read)
        m.d.comb += [
            write.data.lit.eq(self.i.p.lit),
            write.data.lit_above.eq(read.data.lit & ~first_row),
            write.data.excess.eq(self.i.p.excess),
        ]

        # The window: of its right and left column only whether all three pixels are lit.
        right, centre, left = Signal(), Signal(), Signal()
        lit, excess = Signal(), Signal(8)
        held = Signal()  # the centre is a pixel,
        line_end, frame_end = Signal(), Signal()  # ... and ends its line, its frame
        ends_here = Signal()
        m.d.comb += [
            right.eq(~draining & self.i.p.lit & read.data.lit & read.data.lit_above),
            ends_here.eq(~draining & ~frame_end),
        ]
        with m.If(step):
            m.d.sync += [
                left.eq(centre & ~line_end),
                centre.eq(right),
                lit.eq(read.data.lit),
                excess.eq(read.data.excess),
                held.eq(1),
                line_end.eq(last),
                frame_end.eq(draining & last),
            ]
        with m.Elif(advance & (frame_end | (breaks & ends_here))):
            m.d.sync += [held.eq(0), line_end.eq(0), frame_end.eq(0)]

        # The centre leaves when the column to its right comes; a line's last pixel with the next
        # line's first, a frame's last one by itself.
        core, stays, broken = Signal(), Signal(), Signal()
        m.d.comb += [
            core.eq(lit & ((self.mode == ErosionMode.OFF) | left & centre & right & ~line_end)),
            stays.eq(Mux(self.mode == ErosionMode.ERODE, core, lit)),
            broken.eq((breaks | abort_pending) & ends_here),
        ]
        with m.If(advance):
            m.d.sync += [
                abort_pending.eq((breaks | abort_pending) & ~ends_here),
                self.o.valid.eq((step & held) | frame_end | broken),
                self.o.p.lit.eq(stays & ~broken),
                self.o.p.core.eq(core & ~broken),
                self.o.p.excess.eq(excess),
                self.o.p.marker.line_end.eq(line_end | broken),
                self.o.p.marker.frame_end.eq(frame_end | broken),
                self.o.p.marker.broken.eq(broken),
            ]
            with m.If(~stays | broken):
                m.d.sync += self.o.p.excess.eq(0)

        return m

    def _walk(self, m, advance, abort_pending, draining, takes, breaks, step, last, write, read):
        """The column of the pixel that comes, and that of the memory that enters the window.

        In ordinary rows both are the same. After the frame's last pixel the window is drained on
        its own, while row 0 of the next frame only fills the memory behind it. Returns whether the
        pixel is in row 0.
        """
        columns = range(self.width)
        column = Signal(columns)
        first_row = Signal(init=1)
        drain_column = Signal(columns)
        drain_ends = Signal()  # draining is at the last column
        ahead = Signal(columns)
        marker = self.i.p.marker
        m.d.comb += [
            self.i.ready.eq(advance & ~(abort_pending & marker.broken)),
            takes.eq(self.i.valid & self.i.ready & ~marker.broken),
            breaks.eq(self.i.valid & self.i.ready & marker.broken),
            step.eq(Mux(draining, advance, takes & ~first_row)),
            last.eq(Mux(draining, drain_ends, marker.line_end)),
            ahead.eq(Mux(last, 0, Mux(draining, drain_column, column) + 1)),
            # The memory is read a column ahead.
            read.addr.eq(ahead),
            read.en.eq(step | takes),
            write.en.eq(takes),
            write.addr.eq(column),
        ]
        with m.If(breaks | (takes & marker.line_end)):
            m.d.sync += [column.eq(0), first_row.eq(marker.frame_end)]
        with m.Elif(takes):
            m.d.sync += column.eq(column + 1)
        with m.If(~draining):
            m.d.sync += [drain_column.eq(0), drain_ends.eq(0)]
        with m.Elif(advance):
            m.d.sync += [drain_column.eq(ahead), drain_ends.eq(ahead == self.width - 1)]
        with m.If(takes & marker.frame_end):
            m.d.sync += draining.eq(1)
        with m.Elif(advance & drain_ends):
            m.d.sync += draining.eq(0)
        return first_row
