"""Connected components of a mask, in one pass."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import AREA_LIMIT, MaskPixel, Spot
from ..protocol import SENSOR_PIXELS
from .features import Features, empty, merge, of_pixel, sum_bits

__all__ = ["Labelling"]


class _Signals:
    """What the stages of the labelling share."""

    def __init__(self, width, height):
        self.columns, self.rows = range(width), range(height)
        self.run_bits = max(1, ((width + 1) // 2 - 1).bit_length())
        self.half_bits = max((width // 4 + 1).bit_length(), (width - 1).bit_length())
        self.run = unsigned(self.run_bits)
        self.record = data.StructLayout({"tail": self.run, "features": Features})
        entry = data.StructLayout({"connected": 1, "joined": 1, "head": self.run, "tail": self.run})
        self.advance = Signal()  # low while the output register waits: everything stalls

        # From stage 0: which of the two rows steps, and the current pixel. Either row may step
        # alone. ``end``: that row's last pixel; ``clear``: forget its runs after this step.
        self.at_above, self.at_current = Signal(), Signal()
        self.end_above, self.end_current = Signal(), Signal()
        self.clear_above, self.clear_current = Signal(), Signal()
        self.linkable = Signal()  # there is a row above
        self.frame_ended, self.frame_lost = Signal(), Signal()
        self.lit, self.core, self.saturated, self.border = (Signal() for _ in range(4))
        self.excess = Signal(8, reset_less=True)
        self.column = Signal(self.columns, reset_less=True)
        self.row = Signal(self.rows, reset_less=True)

        # Runs of both rows in stage 1.
        self.parity = Signal()  # the current row's half of the tables
        self.run_above, self.run_above_next = Signal(self.run), Signal(self.run)
        self.run_current, self.run_current_next = Signal(self.run), Signal(self.run)
        self.start_above, self.stop_above = Signal(), Signal()
        self.start_current, self.stop_current = Signal(), Signal()
        self.link = Signal()  # a run above and the current one come into contact

        # The component above.
        self.is_new = Signal()
        self.entry, self.entry_next = Signal(entry), Signal(entry)
        self.last_run = Signal()  # ... has no further run in the row above
        self.update_top = Signal()
        self.tail = Signal(self.run)  # last run that was stored

        # To stage 2.
        self.add = Signal()  # add the record that was read
        self.store = Signal()  # the current run has ended
        self.store_address = Signal(self.run_bits + 1)
        self.just_stored = Signal()  # the record that is read is being written
        self.emit = Signal()  # the record that was read leaves as a spot


class Labelling(wiring.Component):
    """Finds the 8-connected components of lit pixels and sums up the features of each.

    One pixel a clock, frames back to back without blanking, whatever the image. A spot leaves
    :attr:`latency` clocks after the pixel that ends its component was taken: the one below and to
    the right of its last pixel, or just below in the last column. That is at most a row and 4
    clocks after the last pixel itself. A frame's last row needs no further pixel: it is drained,
    one column a clock, while the next frame's first row may come in, and ``latency`` clocks later
    the frame's end marker leaves. (Draining waits in clocks that bring a pixel left of it.) Spots
    come in the order of their last pixels.

    Nothing can overflow. All memories are O(width) and as large as the worst row needs; there is
    no image of labels. ``i.ready`` is low only while a spot waits in the output register, and for
    a few clocks if frames break within one row of another frame's end.

    A ``broken`` beat discards the components that have not ended; then a ``broken`` end marker
    leaves, after everything that the frame before has still to send. Reset discards everything.

    **How.** Lit pixels form runs, numbered from 0 in each row. The row above and the current row
    are passed together; in a column at most one run above comes into contact with one below. A
    component goes by its first run (``head``): ``records`` holds its features so far, in one half
    for the row above and in the other for the current row. What makes this small is that
    components cannot cross, so a row's runs nest like parentheses: a component that has further
    runs in the row above waits on a stack, and is on top when the next of them comes::

        row above   11.222.33..2.1..44..1     a digit for each component
        stack, top  1  2   3   2 1  4   1     while its run is passed
                       1   2   1    1
                           1

    A run thus need not know its component. One bit (``carried``) says that it belongs to the top
    of the stack rather than to a new component, and its number that it is the component's last run
    (``tail``), with which the entry goes. A component that goes without contact to the current row
    has ended, and its record leaves as a spot. When a run below comes into contact with a second
    component, the later record of the current row is added to the earlier one. ``joined`` notes
    where the entry below on the stack is of the same component, so that it is not added twice.

    Parameters
    ----------
    width, height : :class:`int`
        Size of a frame, up to 1024 x 1024.

    Members
    -------
    i : :py:`In(stream.Signature(MaskPixel))`
        Frames of mask pixels, in raster order.
    o : :py:`Out(stream.Signature(Spot))`
        Components, and an end marker after each frame's last.
    weighted : :py:`In(1)`
        A lit pixel weighs ``excess + 1`` rather than 1. Sampled with each pixel.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from the pixel that ends a component to its spot.
    """

    latency = 3

    def __init__(self, width, height):
        if not isinstance(width, int) or not 2 <= width <= SENSOR_PIXELS[1]:
            raise ValueError(
                f"Frame width must be an integer from 2 to {SENSOR_PIXELS[1]}, not {width!r}")
        if not isinstance(height, int) or not 1 <= height <= SENSOR_PIXELS[1]:
            raise ValueError(
                f"Frame height must be an integer from 1 to {SENSOR_PIXELS[1]}, not {height!r}")
        self.width = width
        self.height = height
        super().__init__({
            "i": In(stream.Signature(MaskPixel)),
            "o": Out(stream.Signature(Spot)),
            "weighted": In(1),
        })

    def elaborate(self, platform):
        m = Module()
        s = _Signals(self.width, self.height)

        # Tables of runs have a half for each parity of the row. The stack shares its memory with
        # the pixels of the row above: each of the two only ever uses one address at a time.
        m.submodules.records = records = Memory(shape=s.record, depth=2 << s.run_bits, init=[])
        m.submodules.carried = carried = Memory(shape=1, depth=2 << s.run_bits, init=[])
        m.submodules.row_and_stack = row_and_stack = Memory(
            shape=s.entry.shape(), depth=2 << s.half_bits, init=[])
        record_write, record_read = records.write_port(), records.read_port()
        carried_write, carried_read = carried.write_port(), carried.read_port()
        row_write, row_read = row_and_stack.write_port(), row_and_stack.read_port()
        stack_write = row_and_stack.write_port()
        stack_read = row_and_stack.read_port(transparent_for=(stack_write,))
        m.d.comb += [
            s.advance.eq(~self.o.valid | self.o.ready),
            *(port.en.eq(s.advance)
              for port in (record_read, carried_read, row_read, stack_read)),
        ]

        # Stage 0, stage 1, stage 2.
        self._take(m, s, row_write, row_read)
        self._runs(m, s, row_read)
        self._component_above(m, s, carried_read, record_read, stack_read)
        self._contact(m, s, carried_write, record_read, stack_read)
        self._stack(m, s, stack_write, stack_read)
        self._add(m, s, record_write, record_read)
        self._emit(m, s, record_read)
        return m

    def _take(self, m, s, row_write, row_read):
        """Stage 0: take a pixel, and exchange it for the pixel above it in the row memory.

        After a frame's last pixel its last row is drained. The memory gives one column a clock:
        draining waits where a pixel comes in for a column that it has already passed.
        """
        marker = self.i.p.marker
        column, row = Signal(s.columns), Signal(s.rows)
        first_row = Signal(init=1)
        draining, drained = Signal(), Signal()
        drain_column = Signal(s.columns)
        abort_pending, emit_abort = Signal(), Signal()
        step_above, step_current = Signal(), Signal()
        last_above = Signal()
        broken, accept = Signal(), Signal()
        m.d.comb += [
            emit_abort.eq(abort_pending & ~draining & ~drained),
            accept.eq(~emit_abort & ~(abort_pending & marker.broken)),
            self.i.ready.eq(s.advance & accept),
            step_current.eq(self.i.valid & accept & ~marker.broken),
            broken.eq(self.i.valid & accept & marker.broken),
            step_above.eq(Mux(draining, ~step_current | (drain_column == column),
                              step_current & ~first_row)),
            last_above.eq(Mux(draining, drain_column == self.width - 1, marker.line_end)),
            row_write.addr.eq(
                Cat(Mux(step_current, column, drain_column), C(0, s.half_bits + 1))),
            row_read.addr.eq(row_write.addr),
            row_write.data.eq(self.i.p.lit),
            row_write.en.eq(s.advance & step_current),
        ]
        with m.If(s.advance):
            with m.If(step_current):
                m.d.sync += column.eq(column + 1)
                with m.If(marker.line_end):
                    m.d.sync += [column.eq(0), row.eq(row + 1), first_row.eq(0)]
            with m.If(step_current & marker.frame_end | broken):
                m.d.sync += [column.eq(0), row.eq(0), first_row.eq(1)]
            with m.If(step_above & draining):
                m.d.sync += drain_column.eq(drain_column + 1)
                with m.If(last_above):
                    m.d.sync += [draining.eq(0), drain_column.eq(0)]
            with m.If(step_current & marker.frame_end):
                m.d.sync += draining.eq(1)
            m.d.sync += drained.eq(step_above & draining & last_above)
            with m.If(broken & (draining | drained)):
                m.d.sync += abort_pending.eq(1)
            with m.If(emit_abort):
                m.d.sync += abort_pending.eq(0)

            m.d.sync += [
                s.at_above.eq(step_above),
                s.at_current.eq(step_current),
                s.end_above.eq(last_above),
                s.end_current.eq(marker.line_end),
                s.clear_above.eq(step_above & last_above | broken & ~draining),
                s.clear_current.eq(step_current & marker.line_end | broken),
                s.linkable.eq(~first_row),
                s.frame_ended.eq(drained),
                s.frame_lost.eq(broken & ~draining & ~drained | emit_abort),
                s.lit.eq(step_current & self.i.p.lit),
                s.core.eq(self.i.p.core),
                s.saturated.eq(self.i.p.saturated),
                s.border.eq(first_row | (row == self.height - 1) | (column == 0) | marker.line_end),
                s.excess.eq(self.i.p.excess),
                s.column.eq(column),
                s.row.eq(row),
            ]
        with m.If(s.advance & ~(step_current & self.weighted)):
            m.d.sync += s.excess.eq(0)

    def _runs(self, m, s, row_read):
        """Stage 1: where runs of either row begin and end, and their numbers."""
        above, was_above, was_lit = Signal(), Signal(), Signal()
        m.d.comb += [
            above.eq(s.at_above & row_read.data.as_value()[0]),
            s.start_above.eq(above & ~was_above),
            s.start_current.eq(s.lit & ~was_lit),
            s.stop_above.eq(s.at_above & Mux(above, s.end_above, was_above)),
            s.stop_current.eq(s.at_current & Mux(s.lit, s.end_current, was_lit)),
            s.run_above_next.eq(s.run_above + s.stop_above),
            s.run_current_next.eq(s.run_current + s.stop_current),
            s.link.eq(s.linkable & s.at_current & (
                s.start_above & (s.lit | was_lit) | s.start_current & was_above)),
        ]
        with m.If(s.advance):
            m.d.sync += [
                s.run_above.eq(s.run_above_next), s.run_current.eq(s.run_current_next)]
            with m.If(s.at_above):
                m.d.sync += was_above.eq(above)
            with m.If(s.at_current):
                m.d.sync += [was_lit.eq(s.lit), s.parity.eq(s.parity ^ s.end_current)]
            with m.If(s.clear_above):
                m.d.sync += [s.run_above.eq(0), was_above.eq(0)]
            with m.If(s.clear_current):
                m.d.sync += [s.run_current.eq(0), was_lit.eq(0)]

    def _component_above(self, m, s, carried_read, record_read, stack_read):
        """Stage 1: the component of the run above. It is the top of the stack, or a new one.

        The tail of a new one comes from its record a clock later, unless that was still on its way
        to the memory.
        """
        row_begun = Signal()
        was_new = Signal()
        late = Signal()
        top = stack_read.data
        m.d.comb += [
            carried_read.addr.eq(Cat(s.run_above_next, ~s.parity)),
            # A row's first run is not carried.
            s.is_new.eq(s.start_above & ~(row_begun & carried_read.data)),
            s.entry.connected.eq(top.connected & ~s.is_new),
            s.entry.joined.eq(top.joined & ~s.is_new),
            s.entry.head.eq(Mux(s.is_new, s.run_above, top.head)),
            s.entry.tail.eq(Mux(was_new, Mux(late, s.tail, record_read.data.tail), top.tail)),
            s.update_top.eq(s.at_above | was_new),
        ]
        with m.If(s.advance):
            m.d.sync += [was_new.eq(s.is_new & ~s.clear_above), late.eq(s.just_stored)]
            with m.If(s.start_above):
                m.d.sync += row_begun.eq(1)
            with m.If(s.clear_above):
                m.d.sync += row_begun.eq(0)

    def _contact(self, m, s, carried_write, record_read, stack_read):
        """Stage 1: contact between the run above and the current one.

        ``head`` is the first run of the component of the current run; between runs it is the run
        that comes next.
        """
        head, head_next = Signal(s.run), Signal(s.run)
        on_stack = Signal()  # that component has an entry on top of the stack
        linked, was_linked = Signal(), Signal()
        same, append, adopt = Signal(), Signal(), Signal()
        m.d.comb += [
            linked.eq(was_linked & ~s.start_current),
            same.eq(linked & on_stack),
            append.eq(s.link & s.entry.connected & ~same),
            adopt.eq(s.link & ~s.entry.connected),
            head_next.eq(Mux(append, stack_read.data.head, head)),
            carried_write.addr.eq(Cat(head, s.parity)),
            carried_write.data.eq(append),
            carried_write.en.eq(s.advance & (s.start_current | append)),

            s.entry_next.connected.eq(s.entry.connected | adopt),
            s.entry_next.joined.eq(Mux(adopt, same, s.entry.joined)),
            s.entry_next.head.eq(Mux(adopt, head, s.entry.head)),
            s.entry_next.tail.eq(s.entry.tail),
            record_read.addr.eq(Cat(s.entry.head, ~(s.parity ^ s.entry.connected))),
            s.just_stored.eq(s.store & (record_read.addr == s.store_address)),
        ]
        with m.If(s.advance):
            m.d.sync += [
                head.eq(Mux(s.stop_current, s.run_current_next, head_next)),
                s.add.eq(s.link & ~(s.entry.connected & same) & ~s.just_stored),
                s.store.eq(s.stop_current),
                s.store_address.eq(Cat(head_next, s.parity)),
            ]
            with m.If(s.start_current | s.link):
                m.d.sync += was_linked.eq(s.link)
            with m.If(s.stop_above):
                m.d.sync += on_stack.eq(~s.last_run | s.entry_next.joined)
            with m.If(s.stop_current):
                m.d.sync += s.tail.eq(s.run_current)
            with m.If(s.clear_current):
                m.d.sync += head.eq(0)

    def _stack(self, m, s, stack_write, stack_read):
        """Stage 1: every step writes the top entry in place; if the stack is empty, anywhere."""
        pop = Signal()
        bits = (self.width // 4 + 1).bit_length()
        depth, depth_next = Signal(bits), Signal(bits)
        m.d.comb += [
            s.last_run.eq((s.entry.tail == s.run_above) | s.end_above),
            pop.eq(s.stop_above & s.last_run),
            depth_next.eq(depth + Cat(s.is_new | pop, pop.replicate(bits - 1))),
            stack_write.addr.eq(Cat(depth_next, C(0, s.half_bits - bits), 1)),
            stack_read.addr.eq(stack_write.addr),
            stack_write.data.eq(s.entry_next),
            stack_write.en.eq(s.advance & s.update_top & ~pop),
        ]
        with m.If(s.advance):
            m.d.sync += [depth.eq(depth_next), s.emit.eq(pop & ~s.entry_next.connected)]
            with m.If(s.clear_above):
                m.d.sync += depth.eq(0)

    def _add(self, m, s, record_write, record_read):
        """Stage 2: add up the current run, with the record of the component above where they meet.

        A record that is read in the clock in which it is written is still in ``run``.
        """
        bits = sum_bits(self.width, self.height)
        weight = Signal(9)
        drop = Signal()
        pixel = Signal(Features, reset_less=True)
        run = Signal(Features, reset_less=True)
        m.d.comb += weight.eq(s.excess + 1)
        with m.If(s.advance):
            m.d.sync += [
                drop.eq(s.clear_current & ~s.at_current),
                pixel.eq(of_pixel(
                    s.core, s.saturated, s.border, weight, s.column, s.row)),
            ]
        with m.If(ResetSignal() | s.advance & ~s.lit):
            m.d.sync += pixel.eq(empty())

        stored = Signal(Features)
        sums = Signal(Features)
        # Kept, and named to come before `stored`: yosys would otherwise make adders of three
        # operands, or gates of their own for `stored`, both at twice the size.
        partial = Signal(Features, attrs={"keep": 1})
        m.d.comb += [
            stored.eq(Mux(s.add, record_read.data.features.as_value(), 0)),
            partial.eq(merge(run, pixel, bits)),
            sums.eq(merge(partial, stored, bits)),
            record_write.addr.eq(s.store_address),
            record_write.data.tail.eq(s.tail),
            record_write.data.features.eq(sums),
            record_write.en.eq(s.advance & s.store),
        ]
        with m.If(s.advance):
            m.d.sync += run.eq(sums)
        with m.If(ResetSignal() | s.advance & (drop | s.store & ~(s.just_stored & s.link))):
            m.d.sync += run.eq(empty())

    def _emit(self, m, s, record_read):
        """Stage 2: components that have ended, and the frame's end marker."""
        close, close_broken = Signal(), Signal()
        with m.If(s.advance):
            m.d.sync += [close.eq(s.frame_ended), close_broken.eq(s.frame_lost)]
        found = record_read.data.features
        spot = Signal(Spot, reset_less=True)
        full = found.area[AREA_LIMIT.bit_length() - 1]
        m.d.comb += self.o.p.eq(spot)
        with m.If(s.advance):
            m.d.sync += [
                self.o.valid.eq(s.emit | close | close_broken),
                spot.end.eq(close | close_broken),
                spot.broken.eq(close_broken),
                *(spot[name].eq(found[name]) for name in ("core", "saturated", "border")),
                spot.area.eq(found.area),
                spot.weight.eq(found.weight),
                spot.sum_u.eq(found.sum_u),
                spot.sum_v.eq(found.sum_v),
            ]
        with m.If(s.advance & (~s.emit | full)):
            m.d.sync += [
                spot.area.eq(Mux(s.emit, AREA_LIMIT, 0)),
                spot.weight.eq(0), spot.sum_u.eq(0), spot.sum_v.eq(0),
            ]
        with m.If(s.advance & ~s.emit):
            m.d.sync += [spot.core.eq(0), spot.saturated.eq(0), spot.border.eq(0)]
