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
        size = 1 << (self.width + self.width // 4 + 1).bit_length()

        m.submodules.records = records = Memory(shape=Record, depth=2 << run_bits, init=[])
        m.submodules.carried = carried = Memory(shape=1, depth=2 << run_bits, init=[])
        m.submodules.rows = rows = Memory(shape=Entry, depth=size, init=[])
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
            row_write.addr.eq(Mux(step_b, column, walk)),
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
        lit, core, excess = Signal(), Signal(), Signal(8)
        pixel_column, pixel_row = Signal(columns), Signal(range(self.height))
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
                excess.eq(Mux(self.weighted & step_b, self.i.p.excess, 0)),
                pixel_column.eq(column), pixel_row.eq(row),
            ]

        parity = Signal()
        above = Signal()
        was_lit, was_above, linked, waits = (Signal() for _ in range(4))
        b, a, a_next, head = Signal(Run), Signal(Run), Signal(Run), Signal(Run)
        top, top_next = Signal(range(size), init=size - 1), Signal(range(size))

        start_a, start_b, stop_a, stop_b, fresh, was_fresh = (Signal() for _ in range(6))
        link, known, append, pop, is_tail = (Signal() for _ in range(5))
        entry, entry_next = Signal(Entry), Signal(Entry)
        head_b, head_next = Signal(Run), Signal(Run)
        stale, late_tail = Signal(), Signal(Run)

        # Stage 2
        add, store, emit, end, end_broken = (Signal() for _ in range(5))
        address = Signal(run_bits + 1)
        tail = Signal(Run)
        pixel, run = Signal(Features), Signal(Features)

        m.d.comb += [
            above.eq(row_read.data.as_value()[0] & at_a),
            start_a.eq(above & ~was_above),
            start_b.eq(lit & ~was_lit),
            stop_b.eq(at_b & Mux(lit, end_b, was_lit)),
            stop_a.eq(at_a & Mux(above, end_a, was_above)),
            fresh.eq(start_a & ~carried_read.data),

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
            head_b.eq(Mux(start_b, b, head)),
            head_next.eq(Mux(append, entry.head, head_b)),

            entry_next.connected.eq(entry.connected | link),
            entry_next.joined.eq(Mux(link & ~entry.connected, known & waits, entry.joined)),
            entry_next.head.eq(Mux(link & ~entry.connected, head_b, entry.head)),
            entry_next.tail.eq(entry.tail),

            is_tail.eq((entry.tail == a) | end_a),
            pop.eq(stop_a & is_tail),
            a_next.eq(Mux(clear_a, 0, a + stop_a)),
            top_next.eq(Mux(clear_a, size - 1, top - fresh + pop)),

            stack_write.addr.eq(top_next),
            stack_read.addr.eq(top_next),
            stack_write.data.eq(entry_next),
            stack_write.en.eq(go & (at_a | was_fresh) & ~pop & ~clear_a),
            carried_read.addr.eq(Cat(a_next, Mux(at_b & end_b, parity, ~parity))),
            carried_write.addr.eq(Cat(head_b, parity)),
            carried_write.data.eq(append),
            carried_write.en.eq(go & (start_b | append)),
            record_read.addr.eq(Cat(entry.head, ~(parity ^ entry.connected))),
        ]
        hit = Signal()
        m.d.comb += hit.eq(store & (record_read.addr == address))
        with m.If(go):
            m.d.sync += [
                a.eq(a_next),
                top.eq(top_next),
                was_fresh.eq(fresh & ~clear_a),
                stale.eq(hit),
                head.eq(head_next),
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
                m.d.sync += [b.eq(b + 1), tail.eq(b)]
            with m.If(clear_b):
                m.d.sync += b.eq(0)
            with m.If(at_b & end_b):
                m.d.sync += parity.eq(~parity)

            m.d.sync += pixel.eq(Mux(lit, of_pixel(core, excess + 1, pixel_column, pixel_row).as_value(), 0))

        # Stage 2: add, store, emit.
        sums = Signal(Features)
        m.d.comb += [
            sums.eq(merge(merge(run, pixel), Features(Mux(add, record_read.data.features.as_value(), 0)))),
            record_write.addr.eq(address),
            record_write.data.tail.eq(tail),
            record_write.data.features.eq(sums),
            record_write.en.eq(go & store),
        ]
        found = record_read.data.features
        with m.If(go):
            m.d.sync += run.eq(sums)
            with m.If(store & ~(hit & link)):
                m.d.sync += run.eq(empty())

            m.d.sync += [
                self.o.valid.eq(emit | end | end_broken),
                self.o.p.end.eq(end | end_broken),
                self.o.p.broken.eq(end_broken),
                self.o.p.core.eq(emit & found.core),
                self.o.p.area.eq(found.area),
                self.o.p.weight.eq(found.weight),
                self.o.p.sum_u.eq(found.sum_u),
                self.o.p.sum_v.eq(found.sum_v),
            ]
            with m.If(~emit | found.area[8]):
                m.d.sync += [
                    self.o.p.area.eq(Mux(emit, 256, 0)),
                    self.o.p.weight.eq(0), self.o.p.sum_u.eq(0), self.o.p.sum_v.eq(0),
                ]

        return m
