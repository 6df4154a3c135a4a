"""Which provisional labels belong together: a table of parents."""

from amaranth import *
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

__all__ = ["LabelJoiner", "label_pair"]


def label_pair(labels):
    """Layout of two labels that meet, out of ``labels`` and the label 0."""
    label = unsigned(labels.bit_length())
    return data.StructLayout({"one": label, "other": label})


class LabelJoiner(wiring.Component):
    """Gives out labels, joins those that meet, and then replaces each by its root.

    Labels are given out in ascending order, from 1 on; label 0 always exists. All labels that are
    joined, directly or through others, have one root: the lowest of them.

    **Clocks.** A pair takes three clocks, one less if its labels have the same parent and the next
    pair already waits, and one more for each further step on the way to the two roots. One pair is
    buffered while another is joined. A clock with ``allocate`` delays the pair that is being joined
    by a clock. Resolving takes two clocks for each label that was given out, and one more. After
    that ``root`` is the root of ``lookup``, :attr:`latency` clocks later, in every clock with
    ``read``, until the next ``clear``.

    Nothing overflows: ``full`` says when no label is left. After reset, ``clear`` must come before
    anything else.

    **How.** Rem's algorithm: no label has a parent above itself. Of two labels, the one with the
    higher parent is attached to the other's parent, and the search goes on from its former
    parent, until both searches meet. A parent is lower than its label, so one pass in ascending
    order resolves all labels.

    Paper, section on labelling: the equivalence table of classical two-pass labelling.

    Parameters
    ----------
    labels : :class:`int`
        Labels besides label 0, 1 to 32,767.

    Members
    -------
    clear : :py:`In(1)`
        Take back all labels. Only while ``settled``.
    allocate : :py:`In(1)`
        Give out ``next_label`` in this clock. Not while ``full``, ``clear`` or ``resolve``.
    next_label : :py:`Out(label)`
        The label that is given out next.
    used : :py:`Out(label)`
        How many labels have been given out.
    full : :py:`Out(1)`
        There is no label left.
    pairs : :py:`In(stream.Signature(label_pair(labels)))`
        Labels to be joined; both have been given out or are 0.
    settled : :py:`Out(1)`
        All pairs that were taken are joined. Means nothing while ``resolve`` is high.
    resolve : :py:`In(1)`
        Replace the parents by the roots; held until ``resolved``. Only while ``settled``.
    resolved : :py:`Out(1)`
        High in the last clock of that.
    lookup, read : :py:`In(label)`, :py:`In(1)`
        Label to look up.
    root : :py:`Out(label)`
        Its root, one clock later.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``lookup`` to ``root``.
    """

    latency = 1

    def __init__(self, labels=1023):
        if not isinstance(labels, int) or not 1 <= labels < 1 << 15:
            raise ValueError(f"Labels must be an integer from 1 to 32767, not {labels!r}")
        self.labels = labels
        label = unsigned(labels.bit_length())
        super().__init__({
            "clear": In(1),
            "allocate": In(1),
            "next_label": Out(label),
            "used": Out(label),
            "full": Out(1),
            "pairs": In(stream.Signature(label_pair(labels))),
            "settled": Out(1),
            "resolve": In(1),
            "resolved": Out(1),
            "lookup": In(label),
            "read": In(1),
            "root": Out(label),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.parents = parents = Memory(
            shape=len(self.next_label), depth=self.labels + 1, init=[])
        write, read = parents.write_port(), parents.read_port()
        m.d.comb += [
            self.next_label.eq(self.used + 1),
            self.full.eq(self.used == self.labels),
            self.root.eq(read.data),
            read.addr.eq(self.lookup),
            read.en.eq(self.read),
        ]
        with m.If(self.allocate):
            m.d.sync += self.used.eq(self.next_label)
            m.d.comb += [
                write.addr.eq(self.next_label), write.data.eq(self.next_label), write.en.eq(1)]
        with m.If(self.clear):
            m.d.sync += self.used.eq(0)
            m.d.comb += [write.addr.eq(0), write.data.eq(0), write.en.eq(1)]

        # One pair waits while another is being joined.
        pair_pending, takes_pair = Signal(), Signal()
        pair = Signal(self.pairs.p.shape(), reset_less=True)
        m.d.comb += self.pairs.ready.eq(~pair_pending | takes_pair)
        with m.If(takes_pair):
            m.d.sync += pair_pending.eq(0)
        with m.If(self.pairs.valid & self.pairs.ready):
            m.d.sync += [pair_pending.eq(1), pair.eq(self.pairs.p)]

        # Resolving takes two clocks a label: its root is written while the next one's parent is
        # read, then that parent's root is read.
        index = Signal(range(self.labels + 2), init=1)
        resolving, root_known = Signal.like(self.next_label, reset_less=True), Signal()
        with m.FSM() as joining:
            with m.State("IDLE"):
                with m.If(self.resolve):
                    m.d.comb += [
                        write.addr.eq(resolving), write.data.eq(read.data),
                        write.en.eq(root_known), read.addr.eq(index), read.en.eq(1),
                        self.resolved.eq(index > self.used),
                    ]
                    with m.If(self.resolved):
                        m.d.sync += [index.eq(1), root_known.eq(0)]
                    with m.Else():
                        m.next = "PARENT"
                with m.Elif(pair_pending):
                    m.d.comb += [read.addr.eq(pair.other), read.en.eq(1)]
                    m.next = "SECOND"
            with m.State("PARENT"):
                m.d.comb += [read.addr.eq(read.data), read.en.eq(1)]
                m.d.sync += [resolving.eq(index), index.eq(index + 1), root_known.eq(1)]
                m.next = "IDLE"
            self._join(m, read, write, pair, pair_pending, takes_pair)
        m.d.comb += self.settled.eq(~pair_pending & joining.ongoing("IDLE"))
        return m

    def _join(self, m, read, write, pair, pair_pending, takes_pair):
        """States that join ``pair``. In the first one its second label's parent has been read."""
        u, v, v_parent = (Signal.like(self.next_label, reset_less=True) for _ in range(3))
        u_parent = read.data
        with m.State("SECOND"):
            m.d.sync += [u.eq(pair.one), v.eq(pair.other), v_parent.eq(read.data)]
            m.d.comb += [read.addr.eq(pair.one), read.en.eq(1), takes_pair.eq(1)]
            m.next = "STEP"
        # A new label's entry goes first.
        with m.State("STEP"):
            m.d.comb += read.en.eq(~self.allocate)
            with m.If(self.allocate):
                pass
            with m.Elif(u_parent == v_parent):
                m.d.comb += read.addr.eq(pair.other)
                with m.If(pair_pending):
                    m.next = "SECOND"
                with m.Else():
                    m.next = "IDLE"
            with m.Elif(u_parent > v_parent):
                m.d.comb += [
                    write.addr.eq(u), write.data.eq(v_parent), write.en.eq(1),
                    read.addr.eq(u_parent),
                ]
                m.d.sync += u.eq(u_parent)
                with m.If(u == u_parent):
                    m.next = "IDLE"
            with m.Else():
                m.d.comb += [
                    write.addr.eq(v), write.data.eq(u_parent), write.en.eq(1),
                    read.addr.eq(v_parent),
                ]
                m.d.sync += [u.eq(v_parent), v.eq(u), v_parent.eq(u_parent)]
                with m.If(v == v_parent):
                    m.next = "IDLE"
