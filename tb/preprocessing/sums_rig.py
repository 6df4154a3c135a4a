"""The component sums with a table of roots beside them, for the native engine."""

from amaranth import Module, Mux, Signal
from amaranth.lib import data, enum, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.payloads import Spot
from hdl.preprocessing.component_sums import ComponentSums

__all__ = ["Kind", "SumsCommand", "SumsRig"]


class Kind(enum.Enum, shape=2):
    """What comes next of a frame."""

    LABEL = 0
    PIXEL = 1
    CANCEL = 2


class SumsCommand(data.Struct):
    """A label with its root, or a pixel with its label."""

    kind: Kind
    label: 15
    root: 15
    core: 1
    border: 1
    last: 1
    column: 9
    row: 9


class SumsRig(wiring.Component):
    """Labels, then pixels or a cancel in; spots out. The next frame waits for the end marker."""

    def __init__(self, width, height, labels, interval=1):
        self.sums = ComponentSums(width, height, labels, interval)
        self.labels = labels
        super().__init__({
            "i": In(stream.Signature(SumsCommand)),
            "o": Out(stream.Signature(Spot)),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.sums = sums = self.sums
        m.submodules.roots = roots = Memory(
            shape=len(sums.lookup), depth=self.labels + 1, init=[])
        write, read = roots.write_port(), roots.read_port()
        command, takes = self.i.p, Signal()
        reporting = Signal()
        used = Signal.like(sums.used)
        connect(m, sums.o, flipped(self.o))
        m.d.comb += [
            self.i.ready.eq(~reporting),
            takes.eq(self.i.valid & self.i.ready),
            write.addr.eq(command.label), write.data.eq(command.root),
            read.addr.eq(sums.lookup), read.en.eq(sums.read), sums.root.eq(read.data),
            sums.used.eq(used),
            sums.empty_label.eq(command.label),
            *(getattr(sums.i.p, name).eq(getattr(command, name))
              for name in ("label", "core", "border", "last", "column", "row")),
        ]
        with m.If(takes), m.Switch(command.kind):
            with m.Case(Kind.LABEL):
                m.d.comb += [write.en.eq(1), sums.empty.eq(1)]
                m.d.sync += used.eq(Mux(command.label == 0, 0, used + 1))
            with m.Case(Kind.PIXEL):
                m.d.comb += sums.i.valid.eq(1)
                m.d.sync += reporting.eq(command.last)
            with m.Case(Kind.CANCEL):
                m.d.comb += sums.cancel.eq(1)
                m.d.sync += reporting.eq(1)
        with m.If(sums.done):
            m.d.sync += reporting.eq(0)
        return m
