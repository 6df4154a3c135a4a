"""Connected components of a mask, in one pass."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import AREA_LIMIT, MaskPixel, Spot
from .features import Features, empty, merge, of_pixel

__all__ = ["Labelling"]


class Labelling(wiring.Component):
    """Finds the 8-connected components of lit pixels and sums up the features of each.

    One pixel a clock, frames back to back without blanking, whatever the image. A spot leaves
    ``latency`` clocks after the pixel that ends its component was taken: the one below and to the
    right of its last pixel, or just below in the last column. That is at most a row and 4 clocks
    after the last pixel itself. After a frame's last row no further pixel is needed: the row is
    walked over once more, one column a clock, while the next frame's first row may come in, and
    ``latency`` clocks later the frame's ``end`` beat leaves. (In a clock that brings a pixel left
    of the walk the walk waits.) Spots come in the order of their last pixels.

    Nothing can overflow. All memories are O(width) and as large as the worst row needs; there is
    no image of labels. ``i.ready`` is low only while a spot waits in the output register, and for
    moments when frames break within one row of another frame's end.

    A ``broken`` beat forgets the components that have not ended; then an ``end`` beat with
    ``broken`` leaves, after all that the frame before still owes. Reset forgets everything.

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

    A run thus need not know its component. One bit (``carried``) tells that it belongs to the top
    of the stack rather than to a new component, and its number that it is the component's last run
    (``tail``), with which the entry goes. A component that goes without contact to the current row
    has ended, and its record leaves as a spot. When a run below comes into contact with a second
    component, the later record of the current row is added to the earlier one. ``joined`` notes
    where the entry below on the stack is of the same component, so that it is not added twice.

    Parameters
    ----------
    width, height : :class:`int`
        Size of a frame, up to 512 x 512.

    Members
    -------
    i : :py:`In(stream.Signature(MaskPixel))`
        Frames of mask pixels, in raster order.
    o : :py:`Out(stream.Signature(Spot))`
        Components, and an ``end`` beat after each frame's last.
    weighted : :py:`In(1)`
        A lit pixel weighs ``excess + 1`` rather than 1. Sampled with each pixel.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from the pixel that ends a component to its spot.
    """

    latency = 3

    def __init__(self, width, height):
        if not isinstance(width, int) or not 2 <= width <= 512:
            raise ValueError(f"Frame width must be an integer from 2 to 512, not {width!r}")
        if not isinstance(height, int) or not 1 <= height <= 512:
            raise ValueError(f"Frame height must be an integer from 1 to 512, not {height!r}")
        self.width = width
        self.height = height
        super().__init__({
            "i": In(stream.Signature(MaskPixel)),
            "o": Out(stream.Signature(Spot)),
            "weighted": In(1),
        })

    def elaborate(self, platform):
        m = Module()

        columns, rows = range(self.width), range(self.height)
        run_bits = max(1, ((self.width + 1) // 2 - 1).bit_length())
        depth_bits = (self.width // 4 + 1).bit_length()
        half_bits = max(depth_bits, (self.width - 1).bit_length())
        Run = unsigned(run_bits)
        Entry = data.StructLayout({"connected": 1, "joined": 1, "head": Run, "tail": Run})
        Record = data.StructLayout({"tail": Run, "features": Features})

        # Tables of runs have a half for each parity of the row. The stack shares its memory with
        # the pixels of the row above: each of the two only ever uses one address at a time.
        m.submodules.records = records = Memory(shape=Record, depth=2 << run_bits, init=[])
        m.submodules.carried = carried = Memory(shape=1, depth=2 << run_bits, init=[])
        m.submodules.row_and_stack = row_and_stack = Memory(
            shape=Entry, depth=2 << half_bits, init=[])
        record_write, record_read = records.write_port(), records.read_port()
        carried_write, carried_read = carried.write_port(), carried.read_port()
        row_write, row_read = row_and_stack.write_port(), row_and_stack.read_port()
        stack_write = row_and_stack.write_port()
        stack_read = row_and_stack.read_port(transparent_for=(stack_write,))

        go = Signal()  # everything stands still while the output register waits
        m.d.comb += [
            go.eq(~self.o.valid | self.o.ready),
            record_read.en.eq(go),
            carried_read.en.eq(go),
            row_read.en.eq(go),
            stack_read.en.eq(go),
        ]

        # Stage 0: take a pixel, and the pixel above it from the row memory in exchange.
        #
        # A finished frame's last row is walked by itself. The memory gives one column a clock: the
        # walk waits where a pixel comes in for a column that it has already passed.
        marker = self.i.p.marker
        column = Signal(columns)
        row = Signal(rows)
        first_row = Signal(init=1)
        walk = Signal(columns)
        walking = Signal()
        walked = Signal()
        owed = Signal()
        step_b = Signal()
        step_a = Signal()
        last_a = Signal()
        broken = Signal()
        pay = Signal()
        accept = Signal()
        m.d.comb += [
            pay.eq(owed & ~walking & ~walked),
            accept.eq(~pay & ~(owed & marker.broken)),
            self.i.ready.eq(go & accept),
            step_b.eq(self.i.valid & accept & ~marker.broken),
            broken.eq(self.i.valid & accept & marker.broken),
            step_a.eq(Mux(walking, ~step_b | (walk == column), step_b & ~first_row)),
            last_a.eq(Mux(walking, walk == self.width - 1, marker.line_end)),
            row_write.addr.eq(Cat(Mux(step_b, column, walk), C(0, half_bits + 1))),
            row_read.addr.eq(row_write.addr),
            row_write.data.eq(self.i.p.lit),
            row_write.en.eq(go & step_b),
        ]
        with m.If(go):
            with m.If(step_b):
                m.d.sync += column.eq(column + 1)
                with m.If(marker.line_end):
                    m.d.sync += [column.eq(0), row.eq(row + 1), first_row.eq(0)]
            with m.If(step_b & marker.frame_end | broken):
                m.d.sync += [column.eq(0), row.eq(0), first_row.eq(1)]
            with m.If(step_a & walking):
                m.d.sync += walk.eq(walk + 1)
                with m.If(last_a):
                    m.d.sync += [walking.eq(0), walk.eq(0)]
            with m.If(step_b & marker.frame_end):
                m.d.sync += walking.eq(1)
            m.d.sync += walked.eq(step_a & walking & last_a)
            with m.If(broken & (walking | walked)):
                m.d.sync += owed.eq(1)
            with m.If(pay):
                m.d.sync += owed.eq(0)

        # What a step carries to stage 1. Of the two rows either may step alone; `a` is a run of
        # the row above, `b` one of the current row.
        at_a = Signal()
        at_b = Signal()
        end_a = Signal()
        end_b = Signal()
        clear_a = Signal()
        clear_b = Signal()
        linkable = Signal()
        ended = Signal()
        lost = Signal()
        lit = Signal()
        core = Signal()
        excess = Signal(8, reset_less=True)
        lit_column = Signal(columns, reset_less=True)
        lit_row = Signal(rows, reset_less=True)
        with m.If(go):
            m.d.sync += [
                at_a.eq(step_a),
                at_b.eq(step_b),
                end_a.eq(last_a),
                end_b.eq(marker.line_end),
                clear_a.eq(step_a & last_a | broken & ~walking),
                clear_b.eq(step_b & marker.line_end | broken),
                linkable.eq(~first_row),
                ended.eq(walked),
                lost.eq(broken & ~walking & ~walked | pay),
                lit.eq(step_b & self.i.p.lit),
                core.eq(self.i.p.core),
                excess.eq(self.i.p.excess),
                lit_column.eq(column),
                lit_row.eq(row),
            ]
        with m.If(go & ~(step_b & self.weighted)):
            m.d.sync += excess.eq(0)

        # Stage 1: decide.
        parity = Signal()  # the current row's half of the tables
        above = Signal()
        was_above = Signal()
        was_lit = Signal()
        a = Signal(Run)
        a_next = Signal(Run)
        b = Signal(Run)
        b_next = Signal(Run)
        start_a = Signal()
        stop_a = Signal()
        start_b = Signal()
        stop_b = Signal()
        m.d.comb += [
            above.eq(at_a & row_read.data.as_value()[0]),
            start_a.eq(above & ~was_above),
            start_b.eq(lit & ~was_lit),
            stop_a.eq(at_a & Mux(above, end_a, was_above)),
            stop_b.eq(at_b & Mux(lit, end_b, was_lit)),
            a_next.eq(a + stop_a),
            b_next.eq(b + stop_b),
            carried_read.addr.eq(Cat(a_next, ~parity)),
        ]

        # The component above: the top of the stack, or a new one. The tail of a new one comes from
        # its record a clock later, except when that was still on its way to the memory.
        begun = Signal()
        fresh = Signal()
        was_fresh = Signal()
        late = Signal()
        entry = Signal(Entry)
        entry_next = Signal(Entry)
        top = stack_read.data
        tail = Signal(Run)
        m.d.comb += [
            fresh.eq(start_a & ~(begun & carried_read.data)),  # a row's first run is not carried
            entry.connected.eq(top.connected & ~fresh),
            entry.joined.eq(top.joined & ~fresh),
            entry.head.eq(Mux(fresh, a, top.head)),
            entry.tail.eq(Mux(was_fresh, Mux(late, tail, record_read.data.tail), top.tail)),
        ]

        # Contact. `head` is the first run of the component of the current run; between runs it is
        # the run that will come next. `waits`: that component has an entry on top of the stack.
        head = Signal(Run)
        head_next = Signal(Run)
        linked = Signal()
        was_linked = Signal()
        waits = Signal()
        link = Signal()
        same = Signal()
        append = Signal()
        adopt = Signal()
        m.d.comb += [
            linked.eq(was_linked & ~start_b),
            same.eq(linked & waits),
            link.eq(linkable & at_b & (start_a & (lit | was_lit) | start_b & was_above)),
            append.eq(link & entry.connected & ~same),
            adopt.eq(link & ~entry.connected),
            head_next.eq(Mux(append, top.head, head)),
            carried_write.addr.eq(Cat(head, parity)),
            carried_write.data.eq(append),
            carried_write.en.eq(go & (start_b | append)),

            entry_next.connected.eq(entry.connected | adopt),
            entry_next.joined.eq(Mux(adopt, same, entry.joined)),
            entry_next.head.eq(Mux(adopt, head, entry.head)),
            entry_next.tail.eq(entry.tail),
            record_read.addr.eq(Cat(entry.head, ~(parity ^ entry.connected))),
        ]

        # Every step writes the top entry in place; with the stack empty that place does not matter.
        last = Signal()
        pop = Signal()
        depth = Signal(depth_bits)
        depth_next = Signal(depth_bits)
        m.d.comb += [
            last.eq((entry.tail == a) | end_a),
            pop.eq(stop_a & last),
            depth_next.eq(depth + Cat(fresh | pop, pop.replicate(depth_bits - 1))),
            stack_write.addr.eq(Cat(depth_next, C(0, half_bits - depth_bits), 1)),
            stack_read.addr.eq(stack_write.addr),
            stack_write.data.eq(entry_next),
            stack_write.en.eq(go & (at_a | was_fresh) & ~pop),
        ]

        # A record that is read in the clock in which it is written is still in `run`.
        add = Signal()
        store = Signal()
        emit = Signal()
        close = Signal()
        close_broken = Signal()
        drop = Signal()
        address = Signal(run_bits + 1)
        hit = Signal()
        m.d.comb += hit.eq(store & (record_read.addr == address))

        weight = Signal(9)
        pixel = Signal(Features, reset_less=True)
        run = Signal(Features, reset_less=True)
        m.d.comb += weight.eq(excess + 1)
        with m.If(go):
            m.d.sync += [
                a.eq(a_next),
                b.eq(b_next),
                head.eq(Mux(stop_b, b_next, head_next)),
                depth.eq(depth_next),
                was_fresh.eq(fresh & ~clear_a),
                late.eq(hit),
                add.eq(link & ~(entry.connected & same) & ~hit),
                store.eq(stop_b),
                address.eq(Cat(head_next, parity)),
                emit.eq(pop & ~entry_next.connected),
                close.eq(ended),
                close_broken.eq(lost),
                drop.eq(clear_b & ~at_b),
                pixel.eq(of_pixel(core, weight, lit_column, lit_row)),
            ]
            with m.If(start_b | link):
                m.d.sync += was_linked.eq(link)
            with m.If(at_a):
                m.d.sync += was_above.eq(above)
            with m.If(at_b):
                m.d.sync += [was_lit.eq(lit), parity.eq(parity ^ end_b)]
            with m.If(start_a):
                m.d.sync += begun.eq(1)
            with m.If(stop_a):
                m.d.sync += waits.eq(~last | entry_next.joined)
            with m.If(stop_b):
                m.d.sync += tail.eq(b)
            with m.If(clear_a):
                m.d.sync += [a.eq(0), depth.eq(0), was_above.eq(0), begun.eq(0)]
            with m.If(clear_b):
                m.d.sync += [b.eq(0), head.eq(0), was_lit.eq(0)]
        with m.If(ResetSignal() | go & ~lit):
            m.d.sync += pixel.eq(empty())

        # Stage 2: add, store, or let go.
        found = record_read.data.features
        stored = Signal(Features)
        sums = Signal(Features)
        # Kept, and named to come before `stored`: yosys would otherwise make adders of three
        # operands, or gates of their own for `stored`, both at twice the size.
        partial = Signal(Features, attrs={"keep": 1})
        m.d.comb += [
            stored.eq(Mux(add, found.as_value(), 0)),
            partial.eq(merge(run, pixel)),
            sums.eq(merge(partial, stored)),
            record_write.addr.eq(address),
            record_write.data.tail.eq(tail),
            record_write.data.features.eq(sums),
            record_write.en.eq(go & store),
        ]
        with m.If(go):
            m.d.sync += run.eq(sums)
        with m.If(ResetSignal() | go & (drop | store & ~(hit & link))):
            m.d.sync += run.eq(empty())

        spot = Signal(Spot, reset_less=True)
        full = found.area[AREA_LIMIT.bit_length() - 1]
        m.d.comb += self.o.p.eq(spot)
        with m.If(go):
            m.d.sync += [
                self.o.valid.eq(emit | close | close_broken),
                spot.end.eq(close | close_broken),
                spot.broken.eq(close_broken),
                spot.core.eq(found.core),
                spot.area.eq(found.area),
                spot.weight.eq(found.weight),
                spot.sum_u.eq(found.sum_u),
                spot.sum_v.eq(found.sum_v),
            ]
        with m.If(go & (~emit | full)):
            m.d.sync += [
                spot.area.eq(Mux(emit, AREA_LIMIT, 0)),
                spot.weight.eq(0), spot.sum_u.eq(0), spot.sum_v.eq(0),
            ]
        with m.If(go & ~emit):
            m.d.sync += spot.core.eq(0)

        return m
