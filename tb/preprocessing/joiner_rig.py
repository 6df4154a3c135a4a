"""The label joiner as a block with one stream in and one out, for the native engine."""

from amaranth import Module, Signal, unsigned
from amaranth.lib import data, enum, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.preprocessing.label_joiner import LabelJoiner

__all__ = ["JoinerCommand", "JoinerRig", "Kind"]


class Kind(enum.Enum, shape=3):
    """What the joiner is to do."""

    CLEAR = 0
    ALLOCATE = 1
    PAIR = 2
    RESOLVE = 3
    LOOKUP = 4


class JoinerCommand(data.Struct):
    """A command; ``one`` and ``other`` are labels."""

    kind: Kind
    one: 15
    other: 15


class JoinerRig(wiring.Component):
    """Commands in; the labels that were given out and the roots that were looked up out.

    Labels are given out while pairs are still being joined, as fast as commands come.
    """

    def __init__(self, labels):
        self.labels = labels
        super().__init__({
            "i": In(stream.Signature(JoinerCommand)),
            "o": Out(stream.Signature(unsigned(15))),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.joiner = joiner = LabelJoiner(self.labels)
        command = self.i.p
        free, looked_up = Signal(), Signal()
        m.d.comb += [
            free.eq(~looked_up & (~self.o.valid | self.o.ready)),
            joiner.pairs.p.one.eq(command.one),
            joiner.pairs.p.other.eq(command.other),
            joiner.lookup.eq(command.one),
        ]
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        m.d.sync += looked_up.eq(0)
        with m.If(looked_up):
            m.d.sync += [self.o.valid.eq(1), self.o.payload.eq(joiner.root)]
        with m.If(self.i.valid), m.Switch(command.kind):
            with m.Case(Kind.CLEAR), m.If(joiner.settled):
                m.d.comb += [joiner.clear.eq(1), self.i.ready.eq(1)]
            with m.Case(Kind.ALLOCATE), m.If(free & ~joiner.full):
                m.d.comb += [joiner.allocate.eq(1), self.i.ready.eq(1)]
                m.d.sync += [self.o.valid.eq(1), self.o.payload.eq(joiner.next_label)]
            with m.Case(Kind.PAIR):
                m.d.comb += [
                    joiner.pairs.valid.eq(1), self.i.ready.eq(joiner.pairs.ready)]
            with m.Case(Kind.RESOLVE):
                self._resolve(m, joiner)
            with m.Case(Kind.LOOKUP), m.If(free):
                m.d.comb += [joiner.read.eq(1), self.i.ready.eq(1)]
                m.d.sync += looked_up.eq(1)
        return m

    def _resolve(self, m, joiner):
        resolving = Signal()
        with m.If(joiner.settled | resolving):
            m.d.comb += [joiner.resolve.eq(1), self.i.ready.eq(joiner.resolved)]
            m.d.sync += resolving.eq(~joiner.resolved)
