"""The label joiner with three labels, whatever is given out and joined, in whatever clocks.

Beside it stands the result that it must reach: the lowest label of those that each was joined with.
Its inputs are free, within what its docstring allows.
"""

from amaranth.hdl import Elaboratable, Module, Mux, ResetSignal, Signal, Value

from hdl.preprocessing.label_joiner import LabelJoiner
from tb.formal import symbiyosys as formal
from tb.formal.altered import altered
from tb.formal.streams import keeps

__all__ = ["DEPTH", "FAULTS", "JoinerProof", "joiner_fault_outcome", "joiner_outcome"]

#: Clocks from the start: three labels, some pairs, resolving, a lookup.
DEPTH = 21
_FILE = "hdl.preprocessing.label_joiner"
#: Planted faults: pairs of a text and what stands there instead.
FAULTS = {
    "a new label spoils the parent that is read": ("read.en.eq(~self.allocate)", "read.en.eq(1)"),
    "a new label's clock is not waited for": ("with m.If(self.allocate):\n                pass",
                                              "with m.If(C(0)):\n                pass"),
    "the higher label becomes the root": ("with m.Elif(u_parent > v_parent):",
                                          "with m.Elif(u_parent < v_parent):"),
    "the search ends a step early": ("with m.If(u == u_parent):", "with m.If(C(1)):"),
    "a pair that waits is overwritten": ("self.pairs.ready.eq(~pair_pending | takes_pair)",
                                         "self.pairs.ready.eq(1)"),
    "it settles before the last pair": ("~pair_pending & joining.ongoing", "joining.ongoing"),
    "parents of parents are not resolved": ("read.addr.eq(read.data), read.en.eq(1)]",
                                            "read.addr.eq(index), read.en.eq(1)]"),
    "the last label is not resolved": ("self.resolved.eq(index > self.used)",
                                       "self.resolved.eq(index >= self.used)"),
}


class JoinerProof(Elaboratable):
    """Claims on ``joiner``, a :class:`hdl.preprocessing.label_joiner.LabelJoiner`."""

    PROPERTIES = {
        "root": "after resolving, each label's root is the lowest that it was joined with",
        "labels": "labels are given out in order, and none twice",
    }

    def __init__(self, joiner):
        self.joiner = joiner

    @property
    def ports(self):
        """Free inputs."""
        joiner = self.joiner
        return [joiner.clear, joiner.allocate, joiner.resolve, joiner.lookup, joiner.read,
                joiner.pairs.valid, Value.cast(joiner.pairs.p)]

    def elaborate(self, platform):
        m = Module()
        m.submodules.joiner = joiner = self.joiner
        pair = joiner.pairs.p
        takes = joiner.pairs.valid & joiner.pairs.ready

        # The frame's course, as the docstring has it.
        cleared, resolving, resolved = Signal(), Signal(), Signal()
        m.d.sync += [
            cleared.eq(cleared | joiner.clear),
            resolving.eq(joiner.resolve & ~joiner.resolved),
            resolved.eq((resolved | joiner.resolve & joiner.resolved) & ~joiner.clear),
        ]
        busy = joiner.allocate | joiner.pairs.valid
        formal.assume(m, "no_reset", ~ResetSignal())
        formal.assume(m, "cleared", cleared | joiner.clear | ~(busy | joiner.resolve))
        formal.assume(m, "clear", ~joiner.clear | (
            joiner.settled & ~busy & ~joiner.resolve))
        formal.assume(m, "allocate", ~joiner.allocate | ~joiner.full)
        formal.assume(m, "pairs", ~joiner.pairs.valid | (
            (pair.one <= joiner.used) & (pair.other <= joiner.used)))
        formal.assume(m, "pairs_stay", keeps(m, "pairs", joiner.pairs))
        formal.assume(m, "resolve", ~joiner.resolve | resolving | (joiner.settled & ~busy))
        formal.assume(m, "resolve_stays", ~resolving | joiner.resolve & ~busy)
        formal.assume(m, "no_more", ~resolved | ~(busy | joiner.resolve))

        # The lowest label of those that each was joined with, and how many were given out.
        labels = range(joiner.labels + 1)
        lowest = [Signal.like(joiner.lookup, name=f"lowest_{label}") for label in labels]
        used = Signal(range(joiner.labels + 2))
        one, other, low, high = (Signal.like(joiner.lookup, name=name) for name in (
            "lowest_of_one", "lowest_of_other", "low", "high"))
        for chosen, label in ((one, pair.one), (other, pair.other)):
            with m.Switch(label):
                for each in labels:
                    with m.Case(each):
                        m.d.comb += chosen.eq(lowest[each])
        m.d.comb += [low.eq(Mux(one < other, one, other)), high.eq(Mux(one < other, other, one))]
        for label, value in enumerate(lowest):
            with m.If(joiner.clear):
                m.d.sync += value.eq(label)
            with m.Elif(takes & (value == high)):
                m.d.sync += value.eq(low)
        m.d.sync += used.eq(Mux(joiner.clear, 0, used + joiner.allocate))

        wanted, asked = Signal.like(joiner.lookup), Signal()
        with m.If(joiner.read):
            m.d.sync += asked.eq(resolved & (joiner.lookup <= used))
            with m.Switch(joiner.lookup):
                for each in labels:
                    with m.Case(each):
                        m.d.sync += wanted.eq(lowest[each])
        with m.If(joiner.clear):
            m.d.sync += asked.eq(0)
        formal.claim(m, "root", ~asked | (joiner.root == wanted))
        formal.claim(m, "labels", (joiner.used == used) & (
            ~joiner.allocate | (joiner.next_label == used + 1)))
        return m


def joiner_outcome():
    """All properties, for :data:`DEPTH` clocks from the start."""
    proof = JoinerProof(LabelJoiner(3))
    return formal.prove("label_joiner", formal.to_rtlil(proof), "bmc", DEPTH)


def joiner_fault_outcome(fault):
    """The joiner with a planted fault."""
    joiner = altered(_FILE, (FAULTS[fault],)).LabelJoiner(3)
    return formal.prove(f"fault label_joiner {fault}", formal.to_rtlil(JoinerProof(joiner)),
                        "bmc", DEPTH)
