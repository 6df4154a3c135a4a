"""What stands out of its surroundings: each pixel less the mean of a window around it."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import CONTRAST_FRACTION_BITS, ContrastPixel, GreyPixel
from ..ports import register_ports
from ..protocol import MEAN_WINDOW_PIXELS, SENSOR_PIXELS

__all__ = ["Background"]

#: Bits behind the binary point of the reciprocals of the number of pixels in a window.
_RECIPROCAL_BITS = 20
#: Bits of a column's sum that are left out of the window's.
_DROPPED_BITS = 2
#: Steps from a window's last column to its mean, and on to the output register.
_MEAN_STEPS = 6


class Background(wiring.Component):
    """Takes the local mean away from each pixel, and finds the dents that part two spots.

    The *difference* is the pixel less the mean of the ``window`` x ``window`` pixels around it, and
    less its last bit, which spares an inverter.
    Where the window would reach beyond the left, right or bottom edge, the mean of the nearest
    pixel is taken whose window does not; at the top, the part that lies inside the image. *Smooth*
    is the same of the image smoothed by (1 2 1) vertically and with the pixel to the right, (1 1);
    in the outermost rows and the last column (``border``) it has no meaning. A pixel is a *dent* if
    it lies by more than ``dent`` below both pixels two away from it in its column or in its row;
    not in the two outermost rows and columns.

    Everything advances in steps, one for each pixel that comes. A pixel leaves ``window // 2`` rows
    and ``window - 1`` columns after it came, and seven steps. After a frame's last pixel steps
    follow by themselves, one a clock, until the next frame begins; from then on its pixels drive
    them. One pixel a clock, frames back to back. A ``broken`` beat throws away the unfinished
    frame, and leaves after all pixels of the frames before.

    One memory of ``width`` words: ``window - 1`` rows of pixels, their sum, the mean of the row
    before, and where the column fell in the last two rows.

    Parameters
    ----------
    width : :class:`int`
        Pixels of a row, at least ``2 * window``, at most 1024. A frame must have at least
        ``window`` rows.
    window : :class:`int`
        Side of the window, odd, 5 to 31.

    Members
    -------
    i : :py:`In(stream.Signature(GreyPixel))`
        Pixels.
    o : :py:`Out(stream.Signature(ContrastPixel))`
        Their contrasts, in the same order.
    dent : :py:`In(10)`
        Depth of a dent in quarters of a grey value; 0 for no dents. It may change with the pixel
        after a frame's last one.
    saturation : :py:`In(8)`
        Grey value from which on a pixel is saturated. It may change while no frame passes.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a pixel at ``i`` to its contrast at ``o``, where every clock brings a pixel.
    """

    registers = register_ports("saturation")

    def __init__(self, width, window=11):
        least, most = MEAN_WINDOW_PIXELS
        if not isinstance(window, int) or not least <= window <= most or window % 2 == 0:
            raise ValueError(
                f"The window must be an odd integer from {least} to {most}, not {window!r}")
        if not isinstance(width, int) or not 2 * window <= width <= SENSOR_PIXELS[1]:
            raise ValueError(
                f"Frame width must be an integer from {2 * window} to {SENSOR_PIXELS[1]}, "
                f"not {width!r}")
        self.width, self.window = width, window
        half = window // 2
        #: Steps from a pixel in the middle row, in the column that enters, to its contrast.
        self._delay = 2 * half + _MEAN_STEPS
        #: Of the counter of columns: how long the last pixels may take to leave.
        self._flush_bit = (self._delay - 1).bit_length()
        self.latency = half * width + self._delay + 1
        super().__init__({
            "i": In(stream.Signature(GreyPixel)),
            "o": Out(stream.Signature(ContrastPixel)),
            "dent": In(10),
            **self.registers,
        })

    def elaborate(self, platform):
        m = Module()
        self._steps(m)
        self._entering(m)
        self._middle(m)
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
        self._step, self._accepts = Signal(), Signal()
        self._takes, self._breaks = Signal(), Signal()  # ... a pixel, a broken beat
        self._inside = Signal()  # a frame has begun to enter
        self._bottom = Signal()  # the last rows of a frame pass the middle
        self._abort_pending = Signal()  # a broken beat waits for the frame before
        self._flushing = Signal()  # the last pixels are on their way from the middle to `o`
        marker = self.i.p.marker
        free, alone, doomed = Signal(), Signal(), Signal()
        m.d.comb += [
            free.eq(~self.o.valid | self.o.ready),
            self.i.ready.eq(free & ~(self._abort_pending & marker.broken)),
            self._accepts.eq(self.i.valid & self.i.ready),
            self._takes.eq(self._accepts & ~marker.broken),
            self._breaks.eq(self._accepts & marker.broken),
            # What has entered of a frame that is to be thrown away need not keep its place.
            doomed.eq(self.i.valid & marker.broken),
            alone.eq((~self._inside | doomed)
                     & (self._bottom | self._abort_pending | self._flushing)),
            self._step.eq(self._accepts | (free & alone)),
        ]
        with m.If(self._accepts):  # a broken beat ends a frame too
            m.d.sync += self._inside.eq(~marker.frame_end)

    def _entering(self, m):
        """How many rows of the entering frame stand before its pixel, to ``window`` less one, and
        whether its row begins."""
        last = self.window - 1
        self._row, self._row_begins = Signal(range(self.window)), Signal(init=1)
        marker = self.i.p.marker
        with m.If(self._accepts):
            m.d.sync += self._row_begins.eq(marker.line_end)
        with m.If(self._accepts & marker.frame_end):
            m.d.sync += self._row.eq(0)
        with m.Elif(self._accepts & marker.line_end), m.Switch(self._row):
            for row in range(last):
                with m.Case(row):
                    m.d.sync += self._row.eq(row + 1)

    def _middle(self, m):
        """Where the pixel stands in its frame that is in the middle row, in the column that
        enters; its flags leave with it."""
        half, width = self.window // 2, self.width
        active, starts, here, aborts = Signal(), Signal(), Signal(), Signal()
        column = Signal(range(max(width, 2 << self._flush_bit)))
        turns = Signal()  # the last column whose window lies inside
        last, inner, ends = Signal(), Signal(), Signal()
        top, second = Signal(), Signal()
        bottom = Signal(half)  # which of the rows that follow the frame's last window
        # How many steps ago a column was the first one, or turned.
        first_columns, last_columns = Signal(half), Signal(half + 1)
        first, was_end, was_bottom, restarts = (Signal() for _ in range(4))
        m.d.comb += [
            starts.eq(self._takes & (self._row == half) & self._row_begins),
            # A broken beat takes this step's place.
            aborts.eq((self._breaks | self._abort_pending) & ~self._bottom),
            here.eq((active | starts) & ~aborts),
            # The counter is one behind: the step after a row's first column begins it.
            turns.eq(active & ~restarts & (column == width - 2 - half)),
            last.eq(last_columns[half - 1]),
            first.eq(starts | last_columns[half] & active),
            ends.eq(last & bottom[half - 1]),
        ]
        with m.If(self._step):
            m.d.sync += [
                self._abort_pending.eq((self._breaks | self._abort_pending) & self._bottom),
                restarts.eq(first | aborts | ends),
                column.eq(1 + Mux(restarts, 0, column)),
                last_columns.eq(Cat(turns, last_columns)),
                first_columns.eq(Cat(first, first_columns)),
                inner.eq(~first & (first_columns[half - 2] | inner & ~turns)),
                self._flushing.eq(here | aborts | self._flushing
                                  & (restarts | ~column[self._flush_bit])),
                active.eq(here & ~ends),
                self._bottom.eq(self._takes & self.i.p.marker.frame_end | self._bottom & ~ends),
                was_end.eq(ends), was_bottom.eq(self._bottom),
            ]
            with m.If(last):
                m.d.sync += [
                    second.eq(top), top.eq(0),
                    bottom.eq(Cat(self._takes & self.i.p.marker.frame_end, bottom))]
            with m.If(starts):
                m.d.sync += [top.eq(1), second.eq(0)]

        # A step later. Border: the outermost rows, the last column; edge: the outermost two rows
        # and columns. In last columns, row flags are those of the next row already.
        valid = Signal(data.StructLayout({"here": 1, "aborts": 1}), name="valid")
        flags = Signal(data.StructLayout(dict.fromkeys(
            "last frame_end bottom first inner border edge_row edge_column".split(), 1)),
            name="flags")
        was_inner = self._delayed(m, inner, 1)
        m.d.comb += [
            valid.here.eq(here), valid.aborts.eq(aborts),
            flags.last.eq(last_columns[half]), flags.frame_end.eq(was_end),
            flags.bottom.eq(was_bottom),
            flags.first.eq(first_columns[0]), flags.inner.eq(was_inner),
            flags.border.eq(top | bottom[half - 1] | last_columns[half]),
            flags.edge_row.eq(top | second | bottom[half - 2:].any()),
            flags.edge_column.eq(first_columns[:2].any() | last_columns[half - 1:].any()),
        ]
        # Where the mean is chosen, where it may stay, and at the output.
        self._flags, shape, flags = [], flags.shape(), flags.as_value()
        for steps in (self._delay - 3, 1, 1):
            flags = self._delayed(m, flags, steps)
            self._flags.append(data.View(shape, flags))
        self._valid = data.View(
            valid.shape(), self._delayed(m, valid.as_value(), self._delay, reset_less=False))

    def _rows(self, m):
        """The memory: what it gives of the entering column, and what is put back."""
        half, last, width = self.window // 2, self.window - 1, self.width
        self._sum_bits = (255 * self.window).bit_length()
        self._mean_bits = 8 + CONTRAST_FRACTION_BITS
        Column = data.StructLayout({
            "rows": data.ArrayLayout(8, last), "sum": self._sum_bits, "no_mean": self._mean_bits,
            "fell": 2})
        m.submodules.columns = columns = Memory(shape=Column, depth=width, init=[])
        write, read = columns.write_port(), columns.read_port()
        address, ahead = Signal(range(width)), Signal(range(width), init=1)
        m.d.comb += [
            read.addr.eq(ahead), read.en.eq(self._step),
            write.addr.eq(address), write.en.eq(self._step),
        ]
        with m.If(self._step):
            m.d.sync += [address.eq(ahead), ahead.eq(ahead + 1)]
            with m.If(ahead == width - 1):
                m.d.sync += ahead.eq(0)
        rows = [self.i.p.grey, *(read.data.rows[number] for number in range(last))]
        self._total = Signal(self._sum_bits)
        m.d.comb += [
            self._total.eq(rows[0] + Mux(self._row == 0, 0, read.data.sum)),
            write.data.sum.eq(self._total - Mux(self._row == last, rows[last], 0)),
            *(write.data.rows[number].eq(rows[number]) for number in range(last)),
        ]
        self._kept, self._keep = read.data.no_mean, write.data.no_mean

        # Rows about the middle one, which came `half` rows before.
        self._grey = Signal(8, name="grey")
        self._vertical = Signal(10, name="vertical")
        outer, grey_1 = Signal(9), Signal(8)
        m.d.comb += self._grey.eq(rows[half])
        with m.If(self._step):
            m.d.sync += [
                outer.eq(rows[half - 1] + rows[half + 1]), grey_1.eq(self._grey),
                self._vertical.eq(Cat(outer[0], outer[1:] + grey_1)),
            ]
        # A dent lies below the pixel two rows before it: that is known two rows before the other.
        rises, falls = self._steep(m, rows[half - 2], rows[half], "column")
        self._column_dent = Signal(name="column_dent")
        m.d.comb += [
            self._column_dent.eq(rises & read.data.fell[1]),
            write.data.fell.eq(Cat(falls, read.data.fell[0])),
        ]

    def _steep(self, m, later, before, name):
        """Whether one pixel lies above another by more than a dent's depth, or below: two steps
        later."""
        change = Signal(signed(9), name=f"{name}_change")
        step = Signal(9, name=f"{name}_step")
        depth = Signal(8)
        rises, falls = Signal(name=f"{name}_rises"), Signal(name=f"{name}_falls")
        margin = Signal(signed(10), name=f"{name}_margin")
        m.d.comb += [
            depth.eq(self.dent[2:]),
            # Of a change below zero the complement, and one more: a carry.
            step.eq(Cat(change[-1], change[:-1] ^ change[-1].replicate(8))),
            margin.eq(Cat(C(0, 1), depth) - step),
        ]
        with m.If(self._step):
            m.d.sync += [
                change.eq(later - before),
                rises.eq(margin[-1] & ~change[-1]), falls.eq(margin[-1] & change[-1]),
            ]
        return rises, falls

    def _mean(self, m):
        """The window's sum and its mean."""
        half = self.window // 2
        column_bits = self._sum_bits - _DROPPED_BITS
        bits = ((255 * self.window >> _DROPPED_BITS) * self.window).bit_length()
        table = [round((1 << _RECIPROCAL_BITS) / ((half + 1 + rows) * self.window))
                 for rows in range(half + 1)]
        # The sum runs on from row to row: means of windows that lie in two rows are not used.
        column_sum = Signal(column_bits, name="column_sum")
        change, window_sum = Signal(signed(column_bits + 1)), Signal(bits)
        reciprocal = Signal(max(table).bit_length())
        product = Signal(bits + len(reciprocal))
        computed = Signal(self._mean_bits, name="computed")
        oldest = self._delayed(m, column_sum, self.window, reset_less=False)
        m.d.comb += product.eq(window_sum * reciprocal)
        row = self._delayed(m, self._row, 2)
        with m.If(self._step):
            m.d.sync += [
                column_sum.eq(self._total >> _DROPPED_BITS),
                change.eq(column_sum - oldest),
                window_sum.eq(window_sum + change),
                computed.eq(
                    product >> _RECIPROCAL_BITS - CONTRAST_FRACTION_BITS - _DROPPED_BITS),
            ]
            with m.Switch(row):
                for rows in range(half + 1):
                    with m.Case(half + rows):
                        m.d.sync += reciprocal.eq(table[rows])

        # A mean is there `half` steps before its pixel, which is early enough for a row's first
        # pixels. At the sides the mean stays, at the bottom that of the row above does.
        late = self._delayed(m, computed, half)
        chosen = Signal(self._mean_bits)
        self._no_mean = Signal(self._mean_bits)  # all bits of the mean inverted
        choosing, staying, _ = self._flags
        m.d.comb += self._keep.eq(Mux(staying.bottom, self._kept, ~chosen))
        with m.If(self._step):
            with m.If(choosing.first | choosing.inner):
                m.d.sync += chosen.eq(Mux(choosing.first, computed, late))
            m.d.sync += self._no_mean.eq(self._keep)

    def _contrast(self, m):
        """Differences, and the output register."""
        flags, valid = self._flags[-1], self._valid
        grey = self._delayed(m, self._grey, self._delay)
        # Row dents are known 4 steps after their pixel, column dents 2.
        ahead = self._delayed(m, self._grey, 2)
        rises, falls = self._steep(m, self._grey, ahead, "row")
        fell = self._delayed(m, falls, 2)
        dent_4 = Signal()
        m.d.comb += dent_4.eq(rises & fell | self._delayed(m, self._column_dent, 2))
        dent = self._delayed(m, dent_4, self._delay - 4)
        # A column is smooth two steps after its pixel, the image two later.
        vertical = self._delayed(m, self._vertical, self._delay - 4)
        left = self._delayed(m, vertical, 1)
        smooth = Signal(11)
        with m.If(self._step):
            m.d.sync += smooth.eq(vertical + left)
        with m.If(~self.o.valid | self.o.ready):
            m.d.sync += self.o.valid.eq(self._step & (valid.here | valid.aborts))
        with m.If(self._step):
            m.d.sync += [
                self.o.p.difference.eq(
                    (grey << CONTRAST_FRACTION_BITS) + Cat(self._no_mean, 1).as_signed()),
                self.o.p.smooth.eq(smooth + Cat(self._no_mean[1:], 1).as_signed()),
                self.o.p.dent.eq(dent & self.dent.any() & ~flags.edge_row & ~flags.edge_column),
                self.o.p.border.eq(flags.border),
                self.o.p.saturated.eq(grey >= self.saturation),
                self.o.p.marker.line_end.eq(flags.last | valid.aborts),
                self.o.p.marker.frame_end.eq(flags.frame_end | valid.aborts),
                self.o.p.marker.broken.eq(valid.aborts),
            ]
