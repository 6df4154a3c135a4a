# amaranth: UnusedElaboratable=no
import pytest
from amaranth.hdl import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from tb.hdlsim import run


class Register(wiring.Component):
    """A word, which waits; with ``fault`` it does not stand ``clocks`` clocks of waiting."""

    i: In(stream.Signature(8))
    o: Out(stream.Signature(8))

    def __init__(self, fault=None, clocks=1):
        self.fault, self.clocks = fault, clocks
        super().__init__()

    def elaborate(self, platform):
        m = Module()
        waited = Signal(range(self.clocks + 2))
        m.d.comb += self.i.ready.eq(~self.o.valid | self.o.ready)
        with m.If(self.i.ready):
            m.d.sync += [self.o.valid.eq(self.i.valid), self.o.payload.eq(self.i.payload),
                         waited.eq(0)]
        with m.Elif(waited <= self.clocks):
            m.d.sync += waited.eq(waited + 1)
        with m.If((waited == self.clocks) & ~self.o.ready):
            if self.fault == "valid falls":
                m.d.sync += self.o.valid.eq(0)
            if self.fault == "payload changes":
                m.d.sync += self.o.payload.eq(~self.o.payload)
        return m


def test_harness(request):
    run(request, "register", "tb.common.tb_harness", component=Register())


@pytest.mark.parametrize("testcase", ["words_pass/gap=0.0/stall=0.95",
                                      "nothing_is_taken_until_it_is_asked_for"])
@pytest.mark.parametrize("clocks", [1, 9])
@pytest.mark.parametrize("fault,found", [
    ("valid falls", "valid fell before the word 0x[0-9a-f]+ was taken"),
    ("payload changes", "0x[0-9a-f]+ became 0x[0-9a-f]+ while waiting")])
def test_broken_rules_are_found(request, fault, found, clocks, testcase):
    """Whether the word is looked at in each clock, or only when something changes."""
    with pytest.raises(pytest.fail.Exception, match=found):
        run(request, "register", "tb.common.tb_harness", component=Register(fault, clocks),
            testcase=testcase)
