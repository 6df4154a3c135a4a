"""Connected components of a mask, in one pass."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import MaskPixel, Spot
from .features import Features, empty, merge, of_pixel

__all__ = ["Labelling"]


class Labelling(wiring.Component):
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

        columns = range(self.width)
        run_bits = max(1, ((self.width + 1) // 2 - 1).bit_length())
        Run = unsigned(run_bits)
        Entry = data.StructLayout({"connected": 1, "joined": 1, "head": Run, "tail": Run})
        Record = data.StructLayout({"tail": Run, "features": Features})
        depth_bits = (self.width // 4 + 1).bit_length()
        half = max(depth_bits, (self.width - 1).bit_length())

        m.submodules.records = records = Memory(shape=Record, depth=2 << run_bits, init=[])
        m.submodules.carried = carried = Memory(shape=1, depth=2 << run_bits, init=[])
        m.submodules.rows = rows = Memory(shape=Entry, depth=2 << half, init=[])
        record_write, record_read = records.write_port(), records.read_port()
        carried_write, carried_read = carried.write_port(), carried.read_port()
        row_write, row_read = rows.write_port(), rows.read_port()
        stack_write = rows.write_port()
        stack_read = rows.read_port(transparent_for=(stack_write,))

        go = Signal()
        m.d.comb += [
            go.eq(~self.o.valid | self.o.ready),
            record_read.en.eq(go),
            carried_read.en.eq(go),
            row_read.en.eq(go),
            stack_read.en.eq(go),
        ]

        # Acceptance.
        column, row, first_row = Signal(columns), Signal(range(self.height)), Signal(init=1)
        walk, walking, closing, owed = Signal(columns), Signal(), Signal(), Signal()
        mark = self.i.p.mark
        accept, step_b, step_a, last_a, broken, send_owed = (Signal() for _ in range(6))
        m.d.comb += [
            send_owed.eq(owed & ~walking & ~closing),
            accept.eq(~send_owed & ~(owed & mark.broken)),
            self.i.ready.eq(go & accept),
            step_b.eq(self.i.valid & accept & ~mark.broken),
            broken.eq(self.i.valid & accept & mark.broken),
            step_a.eq(Mux(walking, ~step_b | (walk == column), step_b & ~first_row)),
            last_a.eq(Mux(walking, walk == self.width - 1, mark.line_end)),
            row_write.addr.eq(Cat(Mux(step_b, column, walk), C(0, half + 1))),
            row_read.addr.eq(row_write.addr),
            row_write.data.eq(self.i.p.lit),
            row_write.en.eq(go & step_b),
        ]
        with m.If(go):
            with m.If(step_b):
                m.d.sync += column.eq(column + 1)
                with m.If(mark.line_end):
                    m.d.sync += [column.eq(0), row.eq(row + 1), first_row.eq(0)]
            with m.If(step_a & walking):
                m.d.sync += walk.eq(walk + 1)
            m.d.sync += closing.eq(walking & step_a & last_a)
            with m.If(walking & step_a & last_a):
                m.d.sync += walking.eq(0)
            with m.If((step_b & mark.frame_end) | broken):
                m.d.sync += [column.eq(0), row.eq(0), first_row.eq(1)]
            with m.If(step_b & mark.frame_end):
                m.d.sync += [walking.eq(1), walk.eq(0)]
            with m.If(broken & (walking | closing)):
                m.d.sync += owed.eq(1)
            with m.If(send_owed):
                m.d.sync += owed.eq(0)

        # Stage 1: decide.
        at_b, at_a, end_b, end_a, linkable, clear_b, clear_a = (Signal() for _ in range(7))
        finished, lost = Signal(), Signal()
        lit, core, excess = Signal(), Signal(), Signal(8, reset_less=True)
        pixel_column = Signal(columns, reset_less=True)
        pixel_row = Signal(range(self.height), reset_less=True)
        with m.If(go):
            m.d.sync += [
                at_b.eq(step_b), at_a.eq(step_a),
                end_b.eq(mark.line_end), end_a.eq(last_a),
                linkable.eq(~first_row),
                clear_b.eq(broken | step_b & mark.line_end),
                clear_a.eq(broken & ~walking | step_a & last_a),
                finished.eq(closing),
                lost.eq(broken & ~walking & ~closing | send_owed),
                lit.eq(step_b & self.i.p.lit),
                core.eq(step_b & self.i.p.lit & self.i.p.core),
                excess.eq(self.i.p.excess),
                pixel_column.eq(column), pixel_row.eq(row),
            ]

        with m.If(go & ~(self.weighted & step_b)):
            m.d.sync += excess.eq(0)

        parity = Signal()
        above = Signal()
        was_lit, was_above, linked, waits = (Signal() for _ in range(4))
        a, a_next, b, b_next, head = (Signal(Run) for _ in range(5))
        depth, depth_next = Signal(depth_bits), Signal(depth_bits)
        begun = Signal()

        start_a, start_b, stop_a, stop_b, fresh, was_fresh = (Signal() for _ in range(6))
        link, known, append, pop, is_tail = (Signal() for _ in range(5))
        entry, entry_next = Signal(Entry), Signal(Entry)
        head_next = Signal(Run)
        stale, late_tail = Signal(), Signal(Run)

        # Stage 2
        add, store, emit, end, end_broken = (Signal() for _ in range(5))
        address = Signal(run_bits + 1)
        tail = Signal(Run)
        pixel, run = Signal(Features, reset_less=True), Signal(Features, reset_less=True)

        m.d.comb += [
            above.eq(row_read.data.as_value()[0] & at_a),
            start_a.eq(above & ~was_above),
            start_b.eq(lit & ~was_lit),
            stop_b.eq(at_b & Mux(lit, end_b, was_lit)),
            stop_a.eq(at_a & Mux(above, end_a, was_above)),
            fresh.eq(start_a & ~(carried_read.data & begun)),

            entry.connected.eq(stack_read.data.connected & ~fresh),
            entry.joined.eq(stack_read.data.joined & ~fresh),
            entry.head.eq(Mux(fresh, a, stack_read.data.head)),
            entry.tail.eq(stack_read.data.tail),
        ]
        with m.If(was_fresh):
            m.d.comb += entry.tail.eq(Mux(stale, tail, record_read.data.tail))

        m.d.comb += [
            link.eq(linkable & at_b & (start_a & (lit | was_lit) | start_b & was_above)),
            known.eq(linked & ~start_b),
            append.eq(link & entry.connected & ~(known & waits)),
            head_next.eq(Mux(append, stack_read.data.head, head)),

            entry_next.connected.eq(entry.connected | link),
            entry_next.joined.eq(Mux(link & ~entry.connected, known & waits, entry.joined)),
            entry_next.head.eq(Mux(link & ~entry.connected, head, entry.head)),
            entry_next.tail.eq(entry.tail),

            is_tail.eq((entry.tail == a) | end_a),
            pop.eq(stop_a & is_tail),
            a_next.eq(a + stop_a),
            b_next.eq(b + stop_b),
            depth_next.eq(depth + Cat(fresh | pop, pop.replicate(depth_bits - 1))),

            stack_write.addr.eq(Cat(depth_next, C(0, half - depth_bits), 1)),
            stack_read.addr.eq(stack_write.addr),
            stack_write.data.eq(entry_next),
            stack_write.en.eq(go & (at_a | was_fresh) & ~pop),
            carried_read.addr.eq(Cat(a_next, ~parity)),
            carried_write.addr.eq(Cat(head, parity)),
            carried_write.data.eq(append),
            carried_write.en.eq(go & (start_b | append)),
            record_read.addr.eq(Cat(entry.head, ~(parity ^ entry.connected))),
        ]
        hit = Signal()
        m.d.comb += hit.eq(store & (record_read.addr == address))
        weight = Signal(9)
        m.d.comb += weight.eq(excess + 1)
        with m.If(go):
            m.d.sync += [
                a.eq(a_next),
                depth.eq(depth_next),
                was_fresh.eq(fresh & ~clear_a),
                stale.eq(hit),
                head.eq(Mux(stop_b, b_next, head_next)),
                b.eq(b_next),
                add.eq(link & ~(entry.connected & known & waits) & ~hit),
                emit.eq(pop & ~entry_next.connected),
                store.eq(stop_b),
                address.eq(Cat(head_next, parity)),
                end.eq(finished), end_broken.eq(lost),
            ]
            with m.If(link):
                m.d.sync += linked.eq(1)
            with m.Elif(start_b):
                m.d.sync += linked.eq(0)
            with m.If(at_b):
                m.d.sync += was_lit.eq(lit)
            with m.If(clear_b):
                m.d.sync += was_lit.eq(0)
            with m.If(at_a):
                m.d.sync += was_above.eq(above)
            with m.If(clear_a):
                m.d.sync += was_above.eq(0)
            with m.If(stop_a):
                m.d.sync += waits.eq(~is_tail | entry_next.joined)
            with m.If(stop_b):
                m.d.sync += tail.eq(b)
            with m.If(clear_b):
                m.d.sync += [b.eq(0), head.eq(0)]
            with m.If(start_a):
                m.d.sync += begun.eq(1)
            with m.If(clear_a):
                m.d.sync += [a.eq(0), depth.eq(0), begun.eq(0)]
            with m.If(at_b & end_b):
                m.d.sync += parity.eq(~parity)

            m.d.sync += pixel.eq(of_pixel(core, weight, pixel_column, pixel_row))
        with m.If(go & ~lit):
            m.d.sync += pixel.eq(empty())

        # Stage 2: add, store, emit.
        stored = Signal(Features)
        # Kept apart, so that synthesis does not make one adder of three operands of the two.
        partial = Signal(Features, attrs={"keep": 1})
        sums = Signal(Features)
        found = record_read.data.features
        m.d.comb += [
            stored.eq(Mux(add, found.as_value(), 0)),
            partial.eq(merge(run, pixel)),
            sums.eq(merge(partial, stored)),
            record_write.addr.eq(address),
            record_write.data.tail.eq(tail),
            record_write.data.features.eq(sums),
            record_write.en.eq(go & store),
        ]
        spot = Signal(Spot, reset_less=True)
        m.d.comb += self.o.p.eq(spot)
        rst = ResetSignal()
        with m.If(go):
            m.d.sync += [
                run.eq(sums),
                self.o.valid.eq(emit | end | end_broken),
                spot.core.eq(found.core),
                spot.area.eq(found.area),
                spot.weight.eq(found.weight),
                spot.sum_u.eq(found.sum_u),
                spot.sum_v.eq(found.sum_v),
                spot.end.eq(end | end_broken),
                spot.broken.eq(end_broken),
            ]
        with m.If(rst | go & store & ~(hit & link)):
            m.d.sync += run.eq(empty())
        with m.If(go & (~emit | found.area[8])):
            m.d.sync += [
                spot.area[:8].eq(0), spot.weight.eq(0), spot.sum_u.eq(0), spot.sum_v.eq(0),
            ]
        with m.If(go & ~emit):
            m.d.sync += [spot.core.eq(0), spot.area[8].eq(0)]

        return m
