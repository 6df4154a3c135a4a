"""Labelled pixels to spots: the sums of each component."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import AREA_LIMIT, Spot
from .features import Features, merge, of_pixel

__all__ = ["ComponentSums", "labelled_pixel"]

_SUM_BITS = 19  # 1,023 pixels times a row or column below 512


def labelled_pixel(width, height, labels):
    """Layout of a pixel of a labelled image, ``last`` with the last one of its frame."""
    return data.StructLayout({
        "label": labels.bit_length(), "core": 1, "border": 1, "last": 1,
        "column": range(width), "row": range(max(2, height))})


class ComponentSums(wiring.Component):
    """Adds up the pixels of each component, and then reports the components as spots.

    A frame begins with its labels, each of which empties its record. Then its pixels come, one a
    clock if need be. The root of each is looked up, and the pixel is added to the root's record;
    root 0 stands for background and for dropped components. Between two components there must be
    a pixel of root 0, as there is in any row of an image. All pixels weigh 1, and none is
    saturated. An area stops at :data:`..payloads.AREA_LIMIT`.

    From the fourth clock after the last pixel on, the frame's labels are looked up in ascending
    order, one a clock. Those that are roots leave as spots; a spot delays all that follows by
    ``interval`` - 1 clocks. The end marker leaves two clocks after the last label's spot would, or
    six clocks after the last pixel if there is no label; then the next frame may begin.

    Nothing overflows; ``o`` may stall at any time. ``cancel`` ends a frame before its first pixel,
    with a ``broken`` end marker and without spots. Reset discards the frame.

    Paper, section on labelling: the second pass of classical two-pass labelling.

    Parameters
    ----------
    width, height : :class:`int`
        Size of a frame, up to 512 x 512.
    labels : :class:`int`
        Labels besides label 0, 1 to 32,767.
    interval : :class:`int`
        Least clocks from a spot to the next, 1 to 64.

    Members
    -------
    empty, empty_label : :py:`In(1)`, :py:`In(label)`
        Empty the record of that label in this clock. Only before the frame's first pixel.
    used : :py:`In(label)`
        How many labels the frame has, from its last pixel until ``done``.
    i : :py:`In(stream.Signature(labelled_pixel(width, height, labels), always_ready=True))`
        Pixels in raster order.
    lookup, read : :py:`Out(label)`, :py:`Out(1)`
        Label whose root is needed, in clocks with ``read``.
    root : :py:`In(label)`
        Its root, one clock later, until the next clock with ``read``.
    cancel : :py:`In(1)`
        End the frame without pixels and spots.
    o : :py:`Out(stream.Signature(Spot))`
        Components in the order of their roots, and an ``end`` beat after each frame's last.
    done : :py:`Out(1)`
        The end marker is at ``o`` from the next clock on.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from the lookup of a root to its spot.
    """

    latency = 2

    def __init__(self, width, height, labels=1023, interval=1):
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, int) or not 1 <= value <= 512:
                raise ValueError(f"Frame {name} must be an integer from 1 to 512, not {value!r}")
        if not isinstance(labels, int) or not 1 <= labels < 1 << 15:
            raise ValueError(f"Labels must be an integer from 1 to 32767, not {labels!r}")
        if not isinstance(interval, int) or not 1 <= interval <= 64:
            raise ValueError(f"Interval must be an integer from 1 to 64, not {interval!r}")
        self.labels, self.interval = labels, interval
        label = unsigned(labels.bit_length())
        super().__init__({
            "empty": In(1),
            "empty_label": In(label),
            "used": In(label),
            "i": In(stream.Signature(labelled_pixel(width, height, labels), always_ready=True)),
            "lookup": Out(label),
            "read": Out(1),
            "root": In(label),
            "cancel": In(1),
            "o": Out(stream.Signature(Spot)),
            "done": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        record = data.StructLayout({
            "core": 1, "border": 1, "area": Features.as_shape()["area"].shape,
            "sum_u": _SUM_BITS, "sum_v": _SUM_BITS})
        m.submodules.records = records = Memory(shape=record, depth=self.labels + 1, init=[])
        write, read = records.write_port(), records.read_port()
        index = Signal(range(self.labels + 2), init=1)  # label that is reported
        added = Signal()  # the frame's sums are in the memory
        advance = Signal()  # ... and may be reported
        reported = Signal()
        cancelled = Signal()

        with m.FSM() as course:
            with m.State("ADD"):
                m.d.sync += [index.eq(1), cancelled.eq(self.cancel)]
                with m.If(self.cancel):
                    m.next = "END"
                with m.Elif(added):
                    m.next = "REPORT"
            with m.State("REPORT"), m.If(advance & reported):
                m.next = "END"
            with m.State("END"):
                m.d.comb += self.done.eq(advance)
                with m.If(advance):
                    m.next = "ADD"
        reporting = course.ongoing("REPORT")
        m.d.comb += [
            self.lookup.eq(Mux(reporting, index, self.i.p.label)),
            self.read.eq(~reporting | advance),
            read.addr.eq(Mux(reporting, index, self.root)),
            read.en.eq(self.read),
        ]
        self._add(m, write, read, added)
        self._report(m, reporting, read.data, index, advance, reported, cancelled)
        return m

    def _add(self, m, write, read, added):
        """Pixels to records. Their sums stay in a register until another component's pixel comes.

        Between two components there is a pixel of root 0, so a component's sums are back in the
        memory before they are needed again, unless they still are in the register.
        """
        valid_1, valid_2 = Signal(), Signal()
        pixel_1, pixel_2 = (Signal(self.i.p.shape(), reset_less=True) for _ in range(2))
        root = Signal.like(self.root, reset_less=True)
        m.d.sync += [
            valid_1.eq(self.i.valid), pixel_1.eq(self.i.p),
            valid_2.eq(valid_1), pixel_2.eq(pixel_1), root.eq(self.root),
        ]

        owner = Signal.like(self.root)
        changed = Signal()  # what is in `sums` is not in the memory
        sums = Signal(read.data.shape())  # zero between frames
        so_far = Signal.like(sums)
        total = Signal(Features)
        adds = Signal()
        m.d.comb += [
            adds.eq(valid_2 & (root != 0)),
            so_far.eq(Mux(root == owner, sums, read.data)),
            total.eq(merge(_features(so_far), of_pixel(
                pixel_2.core, C(0, 1), pixel_2.border, C(1, 1), pixel_2.column, pixel_2.row),
                _SUM_BITS)),
        ]
        with m.If(adds):
            m.d.sync += [
                owner.eq(root), changed.eq(1), *(sums[name].eq(total[name]) for name in (
                    sums.shape().members))]
        with m.Elif(valid_2):
            m.d.sync += changed.eq(0)

        all_came = Signal()
        with m.If(self.i.valid & self.i.p.last):
            m.d.sync += all_came.eq(1)
        m.d.comb += [
            added.eq(all_came & ~valid_1 & ~valid_2),
            write.addr.eq(owner), write.data.eq(sums),
            write.en.eq(changed & Mux(adds, root != owner, valid_2 | all_came)),
        ]
        with m.If(self.empty):
            m.d.comb += [write.addr.eq(self.empty_label), write.en.eq(1)]
        with m.If(added):
            m.d.sync += [all_came.eq(0), owner.eq(0), changed.eq(0), sums.eq(0)]

    def _report(self, m, reporting, record, index, advance, reported, cancelled):
        """Labels in their order; those that are their own root leave as spots."""
        pause = Signal(range(max(2, self.interval)))
        beyond = Signal()
        asked = Signal.like(self.lookup, reset_less=True)
        answered = Signal()  # ... in this clock, for a label of the frame
        is_root = Signal()
        m.d.comb += [
            advance.eq((~self.o.valid | self.o.ready) & (pause == 0)),
            beyond.eq(index > self.used),
            is_root.eq(answered & (self.root == asked)),
            reported.eq(beyond & ~answered),
        ]
        with m.If(pause != 0):
            m.d.sync += pause.eq(pause - 1)
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)

        spot = Signal(Spot, reset_less=True)
        too_large = record.area[AREA_LIMIT.bit_length() - 1]
        m.d.comb += self.o.p.eq(spot)
        with m.If(reporting & advance):
            m.d.sync += [
                answered.eq(~beyond), asked.eq(index), index.eq(index + ~beyond),
                self.o.valid.eq(is_root),
                spot.end.eq(0),
                spot.broken.eq(0),
                spot.core.eq(record.core),
                spot.border.eq(record.border),
                spot.area.eq(Mux(too_large, AREA_LIMIT, record.area)),
                spot.weight.eq(Mux(too_large, 0, record.area)),
                spot.sum_u.eq(Mux(too_large, 0, record.sum_u)),
                spot.sum_v.eq(Mux(too_large, 0, record.sum_v)),
            ]
            with m.If(is_root):
                m.d.sync += pause.eq(self.interval - 1)
        with m.If(self.done):
            m.d.sync += [
                self.o.valid.eq(1), spot.eq(0), spot.end.eq(1), spot.broken.eq(cancelled)]


def _features(record):
    """A record as features, with the weight and all bits of the sums."""
    fields = record.shape().members
    return Features(Cat(
        Cat(record[name] if name in fields else C(0, 0), C(0, field.width))[:field.width]
        for name, field in Features.as_shape()))
