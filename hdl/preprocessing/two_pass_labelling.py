"""Connected components of a mask, in two passes over an image of labels."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import AREA_LIMIT, MaskPixel, MemoryCommand, Spot
from .features import Features, merge, of_pixel

__all__ = ["TwoPassLabelling"]

#: Half of a memory word: the label, and above it whether the pixel survived the erosion.
_CORE = 15
_SUM_BITS = 17  # 255 pixels times a row or column below 512


class TwoPassLabelling(wiring.Component):
    """Finds the 8-connected components of lit pixels and sums up the features of each.

    Pass 1 gives each lit pixel the label of a neighbour that came before it, or a new one if it
    has none, writes the labels to an image in external memory, and notes which labels meet. Then
    the table of labels is resolved, pass 2 reads the image back and adds up the pixels of each
    component, and the spots leave, in the order of their first pixels. All pixels weigh 1.

    **Limits.** A frame has ``labels`` provisional labels. Where a pixel needs a new one and there
    is none left, its component is dropped: whole, also where it has labels from before or gets
    them later. ``dropped`` counts the pixels that asked in vain, up to 65,535: at least one for
    each component that was dropped, and just one for each that has no second start (a U has two).
    Without them, the components are those of every other labelling. An area stops at
    :data:`..payloads.AREA_LIMIT`.

    **Clocks.** A frame takes ``2 width height + 3 n + overhead`` clocks from its first pixel to
    its end marker, n being the labels that it used, if pixels and memory never let it wait, and no
    spot is waited for::

        pass 1    width * height      a pixel a clock, a word of two labels every second clock
        resolve   2 n
        pass 2    width * height      a word every second clock
        report    n                   a label a clock; each spot makes interval - 1 clocks more

    Joining two labels that meet takes three clocks, and one more for each step on the way to
    their roots; pass 1 goes on meanwhile, and waits only where the next two labels meet before
    those before them are being joined. On the worst image that we know, bands of a checkerboard,
    that makes n clocks more. ``i.ready`` is low from a frame's last pixel until its end marker is
    in the output register, and for a clock after that.

    A ``broken`` beat discards the frame; its end marker follows at once, without spots. Reset
    discards everything.

    **How.** Label 0 stands for all components that are dropped: a pixel that gets no label is a
    pixel of label 0, and labels that meet it are joined to it as to any other. Labels are joined
    by Rem's algorithm: in the table of parents nothing has a parent above itself; of two labels
    the one with the higher parent is hung below the other's parent, and the walk goes on from the
    parent that it had, until both walks meet. The root of a component is so its lowest label.

    Paper, section on labelling: classical two-pass connected components.

    Parameters
    ----------
    width, height : :class:`int`
        Size of a frame, 4 to 512 pixels wide and up to 512 high.
    labels : :class:`int`
        Provisional labels of a frame, 1 to 32,767. Tables have a power of two of words if this is
        one less than that. No 352 x 288 frame needs more than 25,344.
    base : :class:`int`
        First word of the image of labels; it takes half a word for each pixel.
    interval : :class:`int`
        Least clocks from a spot to the next, 1 to 64. All spots of a frame leave at its end: what
        is behind must be as fast as this, or have room for all of them, or let them wait.

    Members
    -------
    i : :py:`In(stream.Signature(MaskPixel))`
        Frames of mask pixels, in raster order. ``excess`` is not used.
    o : :py:`Out(stream.Signature(Spot))`
        Components, and an ``end`` beat after each frame's last.
    dropped : :py:`Out(16)`
        See above; of the frame whose end marker came last, from the clock of the marker on.
    command : :py:`Out(stream.Signature(MemoryCommand))`
        Accesses to the image of labels.
    answer : :py:`In(stream.Signature(32, always_ready=True))`
        Words that were read, each a fixed number of clocks after its command was taken.

    Attributes
    ----------
    overhead : :class:`int`
        Clocks of a frame that depend on nothing, where the memory answers after two; a frame
        without a label saves one of them.
    """

    overhead = 13

    def __init__(self, width, height, labels=1023, base=0, interval=1):
        if not isinstance(width, int) or not 4 <= width <= 512:
            raise ValueError(f"Frame width must be an integer from 4 to 512, not {width!r}")
        if not isinstance(height, int) or not 1 <= height <= 512:
            raise ValueError(f"Frame height must be an integer from 1 to 512, not {height!r}")
        if not isinstance(labels, int) or not 1 <= labels < 1 << _CORE:
            raise ValueError(f"Labels must be an integer from 1 to 32767, not {labels!r}")
        last = (1 << 19) - (width * height + 1) // 2
        if not isinstance(base, int) or not 0 <= base <= last:
            raise ValueError(f"Base must be an integer from 0 to {last}, not {base!r}")
        if not isinstance(interval, int) or not 1 <= interval <= 64:
            raise ValueError(f"Interval must be an integer from 1 to 64, not {interval!r}")
        self.width, self.height = width, height
        self.labels, self.base, self.interval = labels, base, interval
        super().__init__({
            "i": In(stream.Signature(MaskPixel)),
            "o": Out(stream.Signature(Spot)),
            "dropped": Out(16),
            "command": Out(stream.Signature(MemoryCommand)),
            "answer": In(stream.Signature(32, always_ready=True)),
        })

    def elaborate(self, platform):
        m = Module()

        words = (self.width * self.height + 1) // 2
        Label = unsigned(self.labels.bit_length())
        Above = data.StructLayout({"lit": 1, "label": Label})
        Record = data.StructLayout({
            "core": 1, "area": Features.as_shape()["area"].shape,
            "sum_u": _SUM_BITS, "sum_v": _SUM_BITS})

        def expanded(record):
            fields = record.shape().members
            return Features(Cat(
                Cat(record[name] if name in fields else C(0, 0), C(0, field.width))[:field.width]
                for name, field in Features.as_shape()))

        m.submodules.parents = parents = Memory(shape=Label, depth=self.labels + 1, init=[])
        m.submodules.records = records = Memory(shape=Record, depth=self.labels + 1, init=[])
        m.submodules.row = row_above = Memory(shape=Above, depth=self.width, init=[])
        parent_write, parent = parents.write_port(), parents.read_port()
        record_write, record = records.write_port(), records.read_port()
        row_write, above = row_above.write_port(), row_above.read_port()

        column = Signal(range(self.width))
        row = Signal(range(max(2, self.height)))  # Verilog has no signals without bits
        used = Signal(Label)  # labels that were given
        label = Signal(range(self.labels + 2))  # where resolving and reporting have come to
        beyond = Signal()
        word = Signal(range(words))
        all_words = Signal()
        command = Signal(MemoryCommand, reset_less=True)
        command_free = Signal()
        m.d.comb += [
            beyond.eq(label > used),
            self.command.p.eq(command),
            command_free.eq(~self.command.valid | self.command.ready),
        ]
        with m.If(self.command.ready):
            m.d.sync += self.command.valid.eq(0)

        # Pass 1, stage 0: take a pixel, ask for what is above the next one.
        marker = self.i.p.marker
        first_row = Signal(init=1)
        open_ = Signal()  # in pass 1
        go = Signal()
        take = Signal()
        broken = Signal()
        m.d.comb += [
            self.i.ready.eq(open_ & go),
            take.eq(self.i.valid & self.i.ready & ~marker.broken),
            broken.eq(self.i.valid & self.i.ready & marker.broken),
            above.addr.eq(Mux(marker.line_end, 0, column + 1)),
            above.en.eq(go),
        ]

        at = Signal()
        lit = Signal(reset_less=True)
        core = Signal(reset_less=True)
        place = Signal.like(column, reset_less=True)
        first = Signal(reset_less=True)
        last = Signal(reset_less=True)
        top = Signal(reset_less=True)
        frame_end = Signal(reset_less=True)
        with m.If(go):
            m.d.sync += [
                at.eq(take),
                lit.eq(self.i.p.lit),
                core.eq(self.i.p.core),
                place.eq(column),
                first.eq(column == 0),
                last.eq(marker.line_end),
                top.eq(first_row),
                frame_end.eq(marker.frame_end),
            ]
        with m.If(take):
            m.d.sync += column.eq(column + 1)
            with m.If(marker.line_end):
                m.d.sync += [column.eq(0), first_row.eq(0)]

        # Stage 1: label it. Names are the neighbour's place: north-west, north, north-east, west.
        ne = above.data
        n, nw, w = Signal(Above), Signal(Above), Signal(Above)
        ne_lit, n_lit, nw_lit, w_lit = Signal(), Signal(), Signal(), Signal()
        left = Signal(Label)
        left_lit = Signal()
        alone = Signal()
        full = Signal()
        given = Signal(Label)
        new = Signal()
        fresh = Signal(Label)
        step = Signal()
        m.d.comb += [
            ne_lit.eq(ne.lit & ~top & ~last),
            n_lit.eq(n.lit & ~top),
            nw_lit.eq(nw.lit & ~top & ~first),
            w_lit.eq(w.lit & ~first),
            left.eq(Mux(w_lit, w.label, nw.label)),
            left_lit.eq(w_lit | nw_lit),
            alone.eq(lit & ~n_lit & ~ne_lit & ~left_lit),
            full.eq(used == self.labels),
            fresh.eq(used + 1),
            new.eq(step & alone & ~full),
            step.eq(at & go),
        ]
        with m.If(n_lit):
            m.d.comb += given.eq(n.label)
        with m.Elif(ne_lit):
            m.d.comb += given.eq(ne.label)
        with m.Elif(left_lit):
            m.d.comb += given.eq(left)
        with m.Elif(~full):
            m.d.comb += given.eq(fresh)
        missed = Signal(16)
        m.d.comb += [
            row_write.addr.eq(place),
            row_write.data.lit.eq(lit),
            row_write.data.label.eq(given),
            row_write.en.eq(step),
        ]
        with m.If(step):
            m.d.sync += [
                # At a line's end this is the current line's first pixel, north of the next.
                n.eq(ne),
                nw.eq(n),
                w.lit.eq(lit),
                w.label.eq(given),
            ]
            with m.If(alone & full & ~missed.all()):
                m.d.sync += missed.eq(missed + 1)
        with m.If(new):
            m.d.sync += used.eq(fresh)
            m.d.comb += [
                parent_write.addr.eq(fresh), parent_write.data.eq(fresh), parent_write.en.eq(1),
                record_write.addr.eq(fresh), record_write.data.eq(0), record_write.en.eq(1),
            ]

        # ... and write it, two to a word.
        odd = Signal()
        ends_word = Signal()
        half = Signal(16)
        low = Signal(16, reset_less=True)
        m.d.comb += [
            ends_word.eq(odd | frame_end),
            half.eq(Mux(lit, Cat(given, C(0, _CORE - len(given)), core), 0)),
        ]
        with m.If(step):
            m.d.sync += [odd.eq(~odd), low.eq(half)]
            with m.If(ends_word):
                m.d.sync += [
                    self.command.valid.eq(1),
                    command.write.eq(1),
                    command.address.eq(self.base + word),
                    command.data.eq(Mux(odd, Cat(low, half), half)),
                    command.lanes.eq(0b1111),
                    word.eq(word + 1),
                ]

        # Labels that meet, one pair waiting, one being joined.
        met = Signal()
        waits = Signal()
        ahead = Signal()
        one, other = Signal(Label, reset_less=True), Signal(Label, reset_less=True)
        m.d.comb += [
            met.eq(lit & ~n_lit & ne_lit & left_lit & (left != ne.label)),
            go.eq(~at | (command_free | ~ends_word) & (~waits | ahead | ~met)),
        ]
        with m.If(ahead):
            m.d.sync += waits.eq(0)
        with m.If(step & met):
            m.d.sync += [waits.eq(1), one.eq(ne.label), other.eq(left)]

        u, v, v_parent = (Signal(Label, reset_less=True) for _ in range(3))
        u_parent = parent.data
        with m.FSM(name="join") as join:
            with m.State("IDLE"), m.If(waits):
                m.d.comb += parent.addr.eq(other)
                m.next = "SECOND"
            with m.State("SECOND"):
                m.d.sync += [u.eq(one), v.eq(other), v_parent.eq(parent.data)]
                m.d.comb += [parent.addr.eq(one), ahead.eq(1)]
                m.next = "STEP"
            # A new label's entry goes first.
            with m.State("STEP"):
                m.d.comb += parent.en.eq(~new)
                with m.If(new):
                    pass
                with m.Elif(u_parent == v_parent):
                    m.d.comb += parent.addr.eq(other)
                    with m.If(waits):
                        m.next = "SECOND"
                    with m.Else():
                        m.next = "IDLE"
                with m.Elif(u_parent > v_parent):
                    m.d.comb += [
                        parent_write.addr.eq(u), parent_write.data.eq(v_parent),
                        parent_write.en.eq(1), parent.addr.eq(u_parent),
                    ]
                    m.d.sync += u.eq(u_parent)
                    with m.If(u == u_parent):
                        m.next = "IDLE"
                with m.Else():
                    m.d.comb += [
                        parent_write.addr.eq(v), parent_write.data.eq(u_parent),
                        parent_write.en.eq(1), parent.addr.eq(v_parent),
                    ]
                    m.d.sync += [u.eq(v_parent), v.eq(u), v_parent.eq(u_parent)]
                    with m.If(v == v_parent):
                        m.next = "IDLE"

        # Pass 2: a label, its root, the root's record. What lies between two components is dark, so
        # that a component's sums are back in the memory before they are asked for again, unless
        # they still are in `sums`.
        high = Signal(16, reset_less=True)
        holds_high = Signal()
        entry = Signal(16)
        got = Signal()
        summed = Signal()
        m.d.comb += [
            entry.eq(Mux(holds_high, high, self.answer.p[:16])),
            got.eq((self.answer.valid | holds_high) & ~summed),
        ]
        b, c = Signal(), Signal()
        b_core, c_core = Signal(reset_less=True), Signal(reset_less=True)
        b_column, c_column = (Signal.like(column, reset_less=True) for _ in range(2))
        b_row, c_row = (Signal.like(row, reset_less=True) for _ in range(2))
        root = Signal(Label, reset_less=True)
        m.d.sync += [
            b.eq(0), b_core.eq(entry[_CORE]), b_column.eq(column), b_row.eq(row),
            c.eq(b), c_core.eq(b_core), c_column.eq(b_column), c_row.eq(b_row),
            root.eq(parent.data),
        ]
        owner = Signal(Label)
        dirty = Signal()
        sums = Signal(Record, reset_less=True)
        so_far = Signal(Record)
        total = Signal(Features)
        adds = Signal()
        m.d.comb += [
            adds.eq(c & (root != 0)),
            so_far.eq(Mux(root == owner, sums, record.data)),
            total.eq(merge(expanded(so_far), of_pixel(c_core, C(1, 1), c_column, c_row))),
        ]
        with m.If(adds):
            m.d.sync += owner.eq(root)
            m.d.sync += [sums[name].eq(total[name]) for name in Record.members]

        # The frame's course.
        reports = Signal()
        asked = Signal(Label, reset_less=True)
        resolved = Signal()
        lost = Signal()
        moves = Signal()
        pause = Signal(range(max(2, self.interval)))
        m.d.comb += moves.eq((~self.o.valid | self.o.ready) & (pause == 0))
        with m.If(pause != 0):
            m.d.sync += pause.eq(pause - 1)
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        spot = Signal(Spot, reset_less=True)
        m.d.comb += self.o.p.eq(spot)
        found = record.data
        too_large = found.area[AREA_LIMIT.bit_length() - 1]

        with m.FSM(name="course"):
            with m.State("START"):
                m.d.comb += [parent_write.addr.eq(0), parent_write.data.eq(0),
                             parent_write.en.eq(1)]
                m.d.sync += [
                    column.eq(0), first_row.eq(1), used.eq(0), missed.eq(0), odd.eq(0),
                    word.eq(0), all_words.eq(0), lost.eq(0), open_.eq(1), label.eq(1),
                    resolved.eq(0), summed.eq(0), holds_high.eq(0), owner.eq(0), dirty.eq(0),
                    reports.eq(0), row.eq(0),
                ]
                m.next = "LABEL"

            with m.State("LABEL"), m.If(broken | take & marker.frame_end):
                m.d.sync += [open_.eq(0), lost.eq(broken)]
                m.next = "SETTLE"

            with m.State("SETTLE"), m.If(~at & ~self.command.valid & ~waits
                                         & join.ongoing("IDLE")):
                m.d.sync += [word.eq(0), column.eq(0)]
                with m.If(lost):
                    m.next = "END"
                with m.Else():
                    m.next = "RESOLVE"

            # A parent is lower, so it is resolved before.
            with m.State("RESOLVE"):
                m.d.comb += [
                    parent_write.addr.eq(asked), parent_write.data.eq(parent.data),
                    parent_write.en.eq(resolved), parent.addr.eq(label),
                ]
                with m.If(beyond):
                    m.d.sync += label.eq(1)
                    m.next = "SUM"
                with m.Else():
                    m.next = "PARENT"
            with m.State("PARENT"):
                m.d.comb += parent.addr.eq(parent.data)
                m.d.sync += [asked.eq(label), label.eq(label + 1), resolved.eq(1)]
                m.next = "RESOLVE"

            with m.State("SUM"):
                with m.If(~self.command.valid & ~all_words):
                    m.d.sync += [
                        self.command.valid.eq(1),
                        command.write.eq(0),
                        command.address.eq(self.base + word),
                        word.eq(word + 1),
                        all_words.eq(word == words - 1),
                    ]
                m.d.comb += [parent.addr.eq(entry), record.addr.eq(parent.data)]
                m.d.sync += [holds_high.eq(self.answer.valid), b.eq(got)]
                with m.If(self.answer.valid):
                    m.d.sync += high.eq(self.answer.p[16:])
                with m.If(got):
                    m.d.sync += column.eq(column + 1)
                    with m.If(column == self.width - 1):
                        m.d.sync += [column.eq(0), row.eq(row + 1)]
                        m.d.sync += summed.eq(row == self.height - 1)
                m.d.comb += [
                    record_write.addr.eq(owner), record_write.data.eq(sums),
                    record_write.en.eq(dirty & Mux(adds, root != owner, c | summed)),
                ]
                with m.If(adds):
                    m.d.sync += dirty.eq(1)
                with m.Elif(c):
                    m.d.sync += dirty.eq(0)
                with m.If(summed & ~b & ~c):
                    m.next = "REPORT"

            with m.State("REPORT"):
                m.d.comb += [
                    parent.addr.eq(label), record.addr.eq(label),
                    parent.en.eq(moves), record.en.eq(moves),
                ]
                with m.If(moves):
                    m.d.sync += [
                        reports.eq(~beyond),
                        asked.eq(label),
                        label.eq(label + ~beyond),
                        self.o.valid.eq(reports & (parent.data == asked)),
                        spot.end.eq(0),
                        spot.broken.eq(0),
                        spot.core.eq(found.core),
                        spot.area.eq(Mux(too_large, AREA_LIMIT, found.area)),
                        spot.weight.eq(Mux(too_large, 0, found.area)),
                        spot.sum_u.eq(Mux(too_large, 0, found.sum_u)),
                        spot.sum_v.eq(Mux(too_large, 0, found.sum_v)),
                    ]
                    with m.If(reports & (parent.data == asked)):
                        m.d.sync += pause.eq(self.interval - 1)
                    with m.If(beyond & ~reports):
                        m.next = "END"

            with m.State("END"), m.If(moves):
                m.d.sync += [
                    self.o.valid.eq(1), spot.eq(0), spot.end.eq(1), spot.broken.eq(lost),
                    self.dropped.eq(Mux(lost, 0, missed)),
                ]
                m.next = "START"

        return m
