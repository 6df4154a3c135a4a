"""Connected components of a mask, in two passes over an image of labels."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped

from ..payloads import MaskPixel, MemoryCommand, Spot
from .component_sums import ComponentSums
from .label_joiner import LabelJoiner

__all__ = ["TwoPassLabelling"]

#: Half of a memory word: the label, and above it whether the pixel survived the erosion.
_CORE = 15


class TwoPassLabelling(wiring.Component):
    """Finds the 8-connected components of lit pixels and sums up the features of each.

    Pass 1 gives each lit pixel the label of a neighbour that came before it, or a new one if it
    has none, writes the labels to an image in external memory, and joins labels that meet. Then
    the labels are resolved, pass 2 reads the image back and adds up the pixels of each component,
    and the spots leave, in the order of their first pixels. All pixels weigh 1.

    **Limits.** A frame has ``labels`` provisional labels. If a pixel needs a new label and none is
    left, its whole component is dropped, even if some of its pixels have a label. ``dropped``
    counts the pixels that found no label, up to 65,535: at least one for each dropped component,
    and exactly one if the component starts only once (a U starts twice). All other components are
    those of any other labelling. An area stops at :data:`..payloads.AREA_LIMIT`.

    **Clocks.** If pixels and memory never stall it, a frame takes ``2 width height + 3 n +
    overhead`` clocks from its first pixel to its end marker, n being the number of labels that it
    uses; spots that have to wait come on top::

        pass 1    width * height      a pixel a clock, a word of two labels every second clock
        resolve   2 n
        pass 2    width * height      a word every second clock
        report    n                   a label a clock; each spot makes interval - 1 clocks more

    Labels are joined while pass 1 goes on, see :class:`.label_joiner.LabelJoiner`. Pass 1 stalls
    only if two labels meet while the pair before still waits to be joined. On the worst image
    that we know, bands of a checkerboard, that takes n clocks more. ``i.ready`` is low from a
    frame's last pixel until its end marker is in the output register, and one clock longer.

    A ``broken`` beat discards the frame; its end marker follows at once, without spots. Reset
    discards everything.

    **How.** Label 0 stands for all components that are dropped: a pixel that finds no label gets
    label 0, and labels that meet it are joined to it as to any other. The root of a component is
    its lowest label, so components leave in the order of their first pixels.

    Two blocks do the rest: :class:`.label_joiner.LabelJoiner` keeps the labels, and
    :class:`.component_sums.ComponentSums` adds up pass 2.

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
        Least clocks from a spot to the next, 1 to 64. All spots of a frame leave at its end: the
        block behind must be as fast as this, or have room for all of them, or stall them.

    Members
    -------
    i : :py:`In(stream.Signature(MaskPixel))`
        Frames of mask pixels, in raster order. ``excess`` is not used.
    o : :py:`Out(stream.Signature(Spot))`
        Components, and an ``end`` beat after each frame's last.
    dropped : :py:`Out(16)`
        See above; of the frame whose end marker came last, valid with the marker.
    command : :py:`Out(stream.Signature(MemoryCommand))`
        Accesses to the image of labels.
    answer : :py:`In(stream.Signature(32, always_ready=True))`
        Words that were read, each a fixed number of clocks after its command was taken.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a frame's first pixel to its end marker if the frame has no label and nothing
        stalls; labels and spots add to it, see above.
    overhead : :class:`int`
        Clocks of a frame that depend on nothing, with a memory that answers after two clocks; a
        frame without a label saves one of them.
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
        self.latency = 2 * width * height + self.overhead - 1
        super().__init__({
            "i": In(stream.Signature(MaskPixel)),
            "o": Out(stream.Signature(Spot)),
            "dropped": Out(16),
            "command": Out(stream.Signature(MemoryCommand)),
            "answer": In(stream.Signature(32, always_ready=True)),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.label_joiner = joiner = LabelJoiner(self.labels)
        m.submodules.component_sums = sums = ComponentSums(
            self.width, self.height, self.labels, self.interval)
        m.d.comb += [
            sums.empty.eq(joiner.allocate), sums.empty_label.eq(joiner.next_label),
            sums.used.eq(joiner.used),
            joiner.lookup.eq(sums.lookup), joiner.read.eq(sums.read), sums.root.eq(joiner.root),
        ]
        connect(m, sums.o, flipped(self.o))

        column = Signal(range(self.width))  # in pass 1, and again in pass 2
        word = Signal(range((self.width * self.height + 1) // 2))
        command = Signal(MemoryCommand, reset_less=True)
        m.d.comb += self.command.p.eq(command)
        with m.If(self.command.ready):
            m.d.sync += self.command.valid.eq(0)

        taking = Signal()  # in pass 1
        takes, broken = Signal(), Signal()
        advance, stalled = Signal(), Signal()
        marker = self.i.p.marker
        m.d.comb += [
            advance.eq(~stalled & (~joiner.pairs.valid | joiner.pairs.ready)),
            self.i.ready.eq(taking & advance),
            takes.eq(self.i.valid & self.i.ready & ~marker.broken),
            broken.eq(self.i.valid & self.i.ready & marker.broken),
        ]

        restart = Signal()
        lost = Signal()
        missed = Signal(16)
        valid_1, pixel_1, label_1 = self._label(
            m, column, takes, advance, stalled, joiner, missed, restart)
        self._write(m, valid_1, pixel_1, label_1, advance, stalled, word, command, restart)
        with m.FSM() as course:
            with m.State("START"):
                m.d.comb += [restart.eq(1), joiner.clear.eq(1)]
                m.d.sync += taking.eq(1)
                m.next = "LABEL"
            with m.State("LABEL"), m.If(broken | takes & marker.frame_end):
                m.d.sync += [taking.eq(0), lost.eq(broken)]
                m.next = "SETTLE"
            with m.State("SETTLE"), m.If(~valid_1 & ~self.command.valid & joiner.settled):
                m.d.comb += sums.cancel.eq(lost)
                m.d.sync += [word.eq(0), column.eq(0)]
                with m.If(lost):
                    m.next = "REPORT"
                with m.Else():
                    m.next = "RESOLVE"
            with m.State("RESOLVE"):
                m.d.comb += joiner.resolve.eq(1)
                with m.If(joiner.resolved):
                    m.next = "READ"
            with m.State("READ"), m.If(sums.i.valid & sums.i.p.last):
                m.next = "REPORT"
            with m.State("REPORT"), m.If(sums.done):
                m.d.sync += self.dropped.eq(Mux(lost, 0, missed))
                m.next = "START"
        self._read(m, course.ongoing("READ"), column, word, command, sums.i, restart)
        return m

    def _label(self, m, column, takes, advance, stalled, joiner, missed, restart):
        """Pass 1: the label of each pixel, in the clock after it was taken.

        Neighbours are named by their position: north-west, north, north-east, west.
        """
        label = joiner.next_label.shape()
        above = data.StructLayout({"lit": 1, "label": label})
        m.submodules.row = row_above = Memory(shape=above, depth=self.width, init=[])
        write, read = row_above.write_port(), row_above.read_port()
        marker = self.i.p.marker
        first_row = Signal(init=1)
        valid_1 = Signal()
        pixel_1 = Signal(data.StructLayout({
            "lit": 1, "core": 1, "column": range(self.width), "first": 1, "last": 1, "top": 1,
            "frame_end": 1}), reset_less=True)
        m.d.comb += [read.addr.eq(Mux(marker.line_end, 0, column + 1)), read.en.eq(advance)]
        with m.If(advance):
            m.d.sync += [
                valid_1.eq(takes), pixel_1.lit.eq(self.i.p.lit), pixel_1.core.eq(self.i.p.core),
                pixel_1.column.eq(column), pixel_1.first.eq(column == 0),
                pixel_1.last.eq(marker.line_end), pixel_1.top.eq(first_row),
                pixel_1.frame_end.eq(marker.frame_end),
            ]
        with m.If(takes):
            m.d.sync += column.eq(column + 1)
            with m.If(marker.line_end):
                m.d.sync += [column.eq(0), first_row.eq(0)]

        ne = read.data
        n, nw, w = Signal(above), Signal(above), Signal(above)
        ne_lit, n_lit, nw_lit, w_lit = Signal(), Signal(), Signal(), Signal()
        left, left_lit = Signal(label), Signal()
        alone, step = Signal(), Signal()
        label_1 = Signal(label)
        m.d.comb += [
            ne_lit.eq(ne.lit & ~pixel_1.top & ~pixel_1.last),
            n_lit.eq(n.lit & ~pixel_1.top),
            nw_lit.eq(nw.lit & ~pixel_1.top & ~pixel_1.first),
            w_lit.eq(w.lit & ~pixel_1.first),
            left.eq(Mux(w_lit, w.label, nw.label)),
            left_lit.eq(w_lit | nw_lit),
            alone.eq(pixel_1.lit & ~n_lit & ~ne_lit & ~left_lit),
            step.eq(valid_1 & advance),
            joiner.allocate.eq(step & alone & ~joiner.full),
            joiner.pairs.valid.eq(valid_1 & ~stalled & pixel_1.lit & ~n_lit & ne_lit & left_lit
                                  & (left != ne.label)),
            joiner.pairs.p.one.eq(ne.label),
            joiner.pairs.p.other.eq(left),
            write.addr.eq(pixel_1.column), write.en.eq(step),
            write.data.lit.eq(pixel_1.lit), write.data.label.eq(label_1),
        ]
        with m.If(n_lit):
            m.d.comb += label_1.eq(n.label)
        with m.Elif(ne_lit):
            m.d.comb += label_1.eq(ne.label)
        with m.Elif(left_lit):
            m.d.comb += label_1.eq(left)
        with m.Elif(~joiner.full):
            m.d.comb += label_1.eq(joiner.next_label)
        with m.If(step):
            # At a line's end this is the current line's first pixel, north of the next.
            m.d.sync += [n.eq(ne), nw.eq(n), w.lit.eq(pixel_1.lit), w.label.eq(label_1)]
            with m.If(alone & joiner.full & ~missed.all()):
                m.d.sync += missed.eq(missed + 1)
        with m.If(restart):
            m.d.sync += [column.eq(0), first_row.eq(1), missed.eq(0)]
        return valid_1, pixel_1, label_1

    def _write(self, m, valid_1, pixel_1, label_1, advance, stalled, word, command, restart):
        """Pass 1: labelled pixels to the image of labels, two in a word."""
        odd, ends_word = Signal(), Signal()
        half = Signal(16)
        low = Signal(16, reset_less=True)
        m.d.comb += [
            ends_word.eq(odd | pixel_1.frame_end),
            half.eq(Mux(
                pixel_1.lit, Cat(label_1, C(0, _CORE - len(label_1)), pixel_1.core), 0)),
            stalled.eq(valid_1 & ends_word & self.command.valid & ~self.command.ready),
        ]
        with m.If(valid_1 & advance):
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
        with m.If(restart):
            m.d.sync += [odd.eq(0), word.eq(0)]

    def _read(self, m, reading, column, word, command, pixels, restart):
        """Pass 2: words of the image of labels to labelled pixels."""
        words = (self.width * self.height + 1) // 2
        row = Signal(range(max(2, self.height)))  # Verilog has no signals without bits
        all_words = Signal()
        high = Signal(16, reset_less=True)
        holds_high = Signal()
        half = Signal(16)
        m.d.comb += [
            half.eq(Mux(holds_high, high, self.answer.p[:16])),
            pixels.valid.eq(reading & (self.answer.valid | holds_high)),
            pixels.p.label.eq(half),
            pixels.p.core.eq(half[_CORE]),
            pixels.p.border.eq((column == 0) | (column == self.width - 1)
                               | (row == 0) | (row == self.height - 1)),
            pixels.p.column.eq(column),
            pixels.p.row.eq(row),
            pixels.p.last.eq((column == self.width - 1) & (row == self.height - 1)),
        ]
        with m.If(reading):
            with m.If(~self.command.valid & ~all_words):
                m.d.sync += [
                    self.command.valid.eq(1),
                    command.write.eq(0),
                    command.address.eq(self.base + word),
                    word.eq(word + 1),
                    all_words.eq(word == words - 1),
                ]
            m.d.sync += holds_high.eq(self.answer.valid)
            with m.If(self.answer.valid):
                m.d.sync += high.eq(self.answer.p[16:])
        with m.If(pixels.valid):
            m.d.sync += column.eq(column + 1)
            with m.If(column == self.width - 1):
                m.d.sync += [column.eq(0), row.eq(row + 1)]
        with m.If(restart):
            m.d.sync += [row.eq(0), all_words.eq(0), holds_high.eq(0)]
