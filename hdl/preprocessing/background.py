"""What stands out of its surroundings: each pixel less the mean of a window around it."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import CONTRAST_FRACTION_BITS, ContrastPixel, GreyPixel
from ..protocol import MEAN_WINDOW_PIXELS

__all__ = ["Background"]

#: Bits behind the binary point of the reciprocals of the number of pixels in a window.
_RECIPROCAL_BITS = 20
#: Steps from a window's last column to its mean.
_MEAN_STEPS = 3


class Background(wiring.Component):
    """Takes the local mean away from each pixel, and finds the dents that part two spots.

    The *difference* is the pixel less the mean of the ``window`` x ``window`` pixels around it.
    Where the window would reach beyond the left, right or bottom edge, the mean of the nearest
    pixel is taken whose window does not; at the top, the part that lies inside the image. *Smooth*
    is the same of the image smoothed by (1 2 1) both ways; in the outermost rows and columns
    (``border``) it has no meaning. A pixel is a *dent* if it lies by ``dent`` below both pixels two
    away from it in its column or, all three smoothed vertically, in its row; not in the two
    outermost rows and columns.

    Everything advances in steps, one for each pixel that comes. A pixel leaves ``window // 2`` rows
    and ``window - 1`` columns after it came, and some steps. After a frame's last pixel steps
    follow by themselves, one a clock, until the next frame begins; from then on its pixels drive
    them. One pixel a clock, frames back to back. A ``broken`` beat throws away the unfinished
    frame, and leaves after all pixels of the frames before.

    One memory of ``width`` words: ``window - 1`` rows of pixels, their sum, and the mean of the row
    before.

    Parameters
    ----------
    width : :class:`int`
        Pixels of a row, at least ``2 * window``, at most 512. A frame must have at least
        ``window`` rows.
    window : :class:`int`
        Side of the window, odd, 5 to 21.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel))`
        Pixels.
    o : :py:`Out(stream.Signature(ContrastPixel))`
        Their contrasts, in the same order.
    dent : :py:`In(10)`
        Depth of a dent in quarters of a grey value; 0 for no dents. It may change with the pixel
        after a frame's last one.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a pixel at ``i`` to its contrast at ``o``, where every clock brings a pixel.
    """

    def __init__(self, width, window=9):
        least, most = MEAN_WINDOW_PIXELS
        if not isinstance(window, int) or not least <= window <= most or window % 2 == 0:
            raise ValueError(
                f"The window must be an odd integer from {least} to {most}, not {window!r}")
        if not isinstance(width, int) or not 2 * window <= width <= 512:
            raise ValueError(
                f"Frame width must be an integer from {2 * window} to 512, not {width!r}")
        self.width, self.window = width, window
        half = window // 2
        #: Steps from a pixel in the middle row, in the column that enters, to its contrast.
        self._delay = 2 * half + _MEAN_STEPS
        self.latency = half * width + self._delay + 1
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "o": Out(stream.Signature(ContrastPixel)),
            "dent": In(10),
        })

    def elaborate(self, platform):
        m = Module()
        self._steps(m)
        self._entering(m)
        self._centre(m)
        self._rows(m)
        self._mean(m)
        self._contrast(m)
        return m

    def _delayed(self, m, signal, steps, reset_less=True):
        """The signal so many steps ago."""
        name = signal.name
        for number in range(steps):
            later = Signal(signal.shape(), name=f"{name}_{number + 1}", reset_less=reset_less)
            with m.If(self._step):
                m.d.sync += later.eq(signal)
            signal = later
        return signal

    def _steps(self, m):
        """A step: a pixel or a broken beat is taken, or one follows by itself."""
        self._step, self._takes, self._breaks = Signal(), Signal(), Signal()
        self._inside = Signal()  # a frame has begun to enter
        self._bottom = Signal()  # the last rows of a frame pass the middle
        self._abort_pending = Signal()  # a broken beat waits for the frame before
        self._draining = Signal(range(self._delay + 1))
        marker = self.i.p.marker
        free, alone, doomed = Signal(), Signal(), Signal()
        m.d.comb += [
            free.eq(~self.o.valid | self.o.ready),
            self.i.ready.eq(free & ~(self._abort_pending & marker.broken)),
            self._takes.eq(self.i.valid & self.i.ready & ~marker.broken),
            self._breaks.eq(self.i.valid & self.i.ready & marker.broken),
            # What has entered of a frame that is to be thrown away need not keep its place.
            doomed.eq(self.i.valid & marker.broken),
            alone.eq((~self._inside | doomed)
                     & (self._bottom | self._abort_pending | self._draining.any())),
            self._step.eq(self._takes | self._breaks | (free & alone)),
        ]
        with m.If(self._takes):
            m.d.sync += self._inside.eq(~marker.frame_end)
        with m.Elif(self._breaks):
            m.d.sync += self._inside.eq(0)

    def _entering(self, m):
        """How many rows and columns of the entering frame stand before its pixel, to ``window``
        less one."""
        last = self.window - 1
        self._row, self._column = Signal(range(self.window)), Signal(range(self.window))
        marker = self.i.p.marker
        with m.If(self._breaks | (self._takes & marker.line_end)):
            m.d.sync += self._column.eq(0)
        with m.Elif(self._takes & (self._column != last)):
            m.d.sync += self._column.eq(self._column + 1)
        with m.If(self._breaks | (self._takes & marker.frame_end)):
            m.d.sync += self._row.eq(0)
        with m.Elif(self._takes & marker.line_end & (self._row != last)):
            m.d.sync += self._row.eq(self._row + 1)

    def _centre(self, m):
        """Where the pixel stands in its frame that is in the middle row, in the column that
        enters; its flags leave with it."""
        half, width = self.window // 2, self.width
        active, starts, here, aborts = Signal(), Signal(), Signal(), Signal()
        column, rows_left = Signal(range(width)), Signal(range(half))
        first_row, second_row = Signal(), Signal()
        last_column, last_row = Signal(), Signal()
        m.d.comb += [
            starts.eq(self._takes & (self._row == half) & (self._column == 0) & ~active),
            # A broken beat takes this step's place.
            aborts.eq((self._breaks | self._abort_pending) & ~self._bottom),
            here.eq((active | starts) & ~aborts),
            last_column.eq(column == width - 1),
            last_row.eq(self._bottom & (rows_left == 0)),
        ]
        with m.If(self._step):
            m.d.sync += self._abort_pending.eq((self._breaks | self._abort_pending) & self._bottom)
            with m.If(aborts | (here & last_column & last_row)):
                m.d.sync += [active.eq(0), self._bottom.eq(0), column.eq(0)]
            with m.Elif(here):
                m.d.sync += [active.eq(1), column.eq(Mux(last_column, 0, column + 1))]
            with m.If(starts):
                m.d.sync += [first_row.eq(1), second_row.eq(0)]
            with m.Elif(last_column):
                m.d.sync += [first_row.eq(0), second_row.eq(first_row),
                             rows_left.eq(rows_left - self._bottom)]
            with m.If(here | aborts):
                m.d.sync += self._draining.eq(self._delay)
            with m.Elif(self._draining.any()):
                m.d.sync += self._draining.eq(self._draining - 1)
        with m.If(self._takes & self.i.p.marker.frame_end):
            m.d.sync += [self._bottom.eq(1), rows_left.eq(half - 1)]

        # Sides: columns where the mean stays. Edge, border: the outermost two rows and columns,
        # and the outermost one.
        valid = Signal(data.StructLayout({"here": 1, "aborts": 1}), name="valid")
        names = "last frame_end bottom first side edge border".split()
        flags = Signal(data.StructLayout(dict.fromkeys(names, 1)), name="flags")
        top = Signal()
        m.d.comb += [
            valid.here.eq(here), valid.aborts.eq(aborts),
            top.eq(starts | first_row),
            flags.last.eq(last_column), flags.frame_end.eq(last_column & last_row),
            flags.bottom.eq(self._bottom),
            flags.first.eq(column == 0),
            flags.side.eq((column <= half) | (column >= width - half)),
            flags.border.eq(top | last_row | flags.first | last_column),
            flags.edge.eq(top | second_row | (self._bottom & (rows_left <= 1))
                          | (column <= 1) | (column >= width - 2)),
        ]
        self._flags = data.View(
            flags.shape(), self._delayed(m, flags.as_value(), self._delay))
        self._valid = data.View(
            valid.shape(), self._delayed(m, valid.as_value(), self._delay, reset_less=False))

    def _rows(self, m):
        """The memory: what it gives of the entering column, and what is put back."""
        half, last = self.window // 2, self.window - 1
        self._sum_bits = (255 * self.window).bit_length()
        self._mean_bits = 8 + CONTRAST_FRACTION_BITS
        Column = data.StructLayout({
            "rows": data.ArrayLayout(8, last), "sum": self._sum_bits, "mean": self._mean_bits})
        m.submodules.columns = columns = Memory(shape=Column, depth=self.width, init=[])
        write, read = columns.write_port(), columns.read_port()
        address, ahead = Signal(range(self.width)), Signal(range(self.width))
        m.d.comb += [
            ahead.eq(Mux(address == self.width - 1, 0, address + 1)),
            read.addr.eq(ahead), read.en.eq(self._step),
            write.addr.eq(address), write.en.eq(self._step),
        ]
        with m.If(self._step):
            m.d.sync += address.eq(ahead)
        grey = self.i.p.grey
        rows = [grey, *(read.data.rows[number] for number in range(last))]
        self._total = Signal(self._sum_bits)
        m.d.comb += [
            self._total.eq(grey + Mux(self._row == 0, 0, read.data.sum)),
            write.data.sum.eq(self._total - Mux(self._row == last, rows[last], 0)),
            *(write.data.rows[number].eq(rows[number]) for number in range(last)),
        ]
        self._kept, self._keep = read.data.mean, write.data.mean
        # Rows about the middle one, which came `half` rows before.
        self._grey = Signal(8, name="grey")
        self._vertical = Signal(10, name="vertical")
        self._column_dent = Signal(name="column_dent")
        reach = Signal(11)
        m.d.comb += [
            self._grey.eq(rows[half]),
            self._vertical.eq(rows[half - 1] + (rows[half] << 1) + rows[half + 1]),
            reach.eq((rows[half] << 2) + self.dent),
            self._column_dent.eq(
                ((rows[half - 2] << 2) >= reach) & ((rows[half + 2] << 2) >= reach)),
        ]

    def _mean(self, m):
        """The window's sum and its mean."""
        half, last = self.window // 2, self.window - 1
        bits = (255 * self.window ** 2).bit_length()
        table = [round((1 << _RECIPROCAL_BITS) / ((half + 1 + rows) * self.window))
                 for rows in range(half + 1)]
        column_sum = Signal(self._sum_bits, name="column_sum")
        first, whole = Signal(), Signal()
        held, total, window_sum = Signal(bits), Signal(bits), Signal(bits)
        reciprocal = Signal(max(table).bit_length())
        row = Signal.like(self._row)
        product = Signal(bits + len(reciprocal))
        computed = Signal(self._mean_bits, name="computed")
        oldest = self._delayed(m, column_sum, last)
        m.d.comb += [
            total.eq(column_sum + Mux(first, 0, held)),
            product.eq(window_sum * reciprocal),
        ]
        with m.If(self._step):
            m.d.sync += [
                column_sum.eq(self._total),
                first.eq(self._column == 0),
                whole.eq(self._column == last),
                held.eq(total - Mux(whole, oldest, 0)),
                window_sum.eq(total),
                computed.eq(product >> _RECIPROCAL_BITS - CONTRAST_FRACTION_BITS),
            ]
            # Late enough for the row's last window, early enough for its first whole one.
            m.d.sync += row.eq(self._row)
            with m.Switch(row):
                for rows in range(half + 1):
                    with m.Case(half + rows):
                        m.d.sync += reciprocal.eq(table[rows])

        # A mean is there `half` steps before its pixel, which is early enough for a row's first
        # pixels. At the sides the mean stays, at the bottom that of the row above does.
        late = self._delayed(m, computed, half)
        before, self._local_mean = Signal(self._mean_bits), Signal(self._mean_bits)
        flags = self._flags
        m.d.comb += [
            self._local_mean.eq(Mux(flags.bottom, self._kept, Mux(
                flags.first, computed, Mux(flags.side, before, late)))),
            self._keep.eq(self._local_mean),
        ]
        with m.If(self._step):
            m.d.sync += before.eq(self._local_mean)

    def _contrast(self, m):
        """Differences, and the output register."""
        flags, valid = self._flags, self._valid
        grey = self._delayed(m, self._grey, self._delay)
        column_dent = self._delayed(m, self._column_dent, self._delay)
        right_2 = self._delayed(m, self._vertical, self._delay - 2)
        right = self._delayed(m, right_2, 1)
        here = self._delayed(m, right, 1)
        left = self._delayed(m, here, 1)
        left_2 = self._delayed(m, left, 1)
        reach, row_dent, smooth = Signal(11), Signal(), Signal(12)
        m.d.comb += [
            reach.eq(here + self.dent),
            row_dent.eq((left_2 >= reach) & (right_2 >= reach)),
            smooth.eq(left + (here << 1) + right),
        ]
        with m.If(~self.o.valid | self.o.ready):
            m.d.sync += self.o.valid.eq(self._step & (valid.here | valid.aborts))
        with m.If(self._step):
            m.d.sync += [
                self.o.p.difference.eq((grey << CONTRAST_FRACTION_BITS) - self._local_mean),
                self.o.p.smooth.eq(smooth - self._local_mean),
                self.o.p.dent.eq((column_dent | row_dent) & self.dent.any() & ~flags.edge),
                self.o.p.border.eq(flags.border),
                self.o.p.saturated.eq(grey.all()),
                self.o.p.marker.line_end.eq(flags.last | valid.aborts),
                self.o.p.marker.frame_end.eq(flags.frame_end | valid.aborts),
                self.o.p.marker.broken.eq(valid.aborts),
            ]
