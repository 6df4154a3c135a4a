# amaranth: UnusedElaboratable=no
"""Every path between clocks is found, and those of the design have waivers."""

import pytest
from amaranth.hdl import ClockDomain, ClockSignal, Module, ResetSignal, Signal
from amaranth.lib import wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from scripts.rtl.crossings import TOPS, crossings, explain, report
from scripts.rtl.netlist import netlist
from scripts.rtl.waivers import Waiver


@pytest.mark.parametrize("name", TOPS)
def test_all_have_waivers(name, capsys):
    assert report(name) == 0, capsys.readouterr().out


class Paths(wiring.Component):
    """A register `kept` of one clock, on its way to another."""

    def __init__(self, kind):
        self.kind = kind
        super().__init__({"i": In(1), "j": In(1), "o": Out(1)})

    def elaborate(self, platform):
        m = Module()
        kept = Signal(reset_less=True)
        other = Signal()
        taken = Signal()
        m.d.sync += [kept.eq(self.i), other.eq(kept ^ self.i)]
        m.d.comb += self.o.eq(taken ^ other ^ self.j)
        if self.kind == "synchroniser":
            m.submodules.sampled = FFSynchronizer(kept, taken, o_domain="far")
        elif self.kind == "logic before":
            m.submodules.sampled = FFSynchronizer(kept & other, taken, o_domain="far")
        elif self.kind == "logic between":
            stage = Signal(name="stage")
            m.d.far += [stage.eq(kept), taken.eq(stage ^ self.j)]
        elif self.kind == "sampled twice":
            stage, once = Signal(name="stage", reset_less=True), Signal(name="once")
            m.d.far += [stage.eq(kept), once.eq(stage), taken.eq(stage ^ once)]
        elif self.kind == "enable":
            with m.If(kept):
                m.d.far += taken.eq(self.j)
        elif self.kind == "reset":
            m.domains.held = ClockDomain(local=True, async_reset=True)
            m.d.comb += [ClockSignal("held").eq(ClockSignal("far")), ResetSignal("held").eq(kept)]
            m.d.held += taken.eq(self.j)
        elif self.kind == "memory":
            m.submodules.words = words = Memory(shape=1, depth=4, init=[])
            write, read = words.write_port(), words.read_port(domain="far")
            m.d.comb += [write.en.eq(1), write.data.eq(self.i), taken.eq(read.data)]
        elif self.kind == "pin":
            m.d.far += taken.eq(self.i)
        elif self.kind == "falling":
            m.domains.held = ClockDomain(local=True, clk_edge="neg", reset_less=True)
            m.d.comb += ClockSignal("held").eq(ClockSignal())
            m.d.held += taken.eq(kept)
        elif self.kind == "none":
            m.d.sync += taken.eq(kept & other)
        return m


KEPT = Waiver("kept", ".*", "", chain=True)


@pytest.mark.parametrize("kind,ends,safe", [
    ("synchroniser", {("kept", "sampled.stage0")}, True),
    ("logic before", {("kept", "sampled.stage0"), ("other", "sampled.stage0")}, False),
    ("logic between", {("kept", "stage")}, False),
    ("sampled twice", {("kept", "stage")}, False),
    ("enable", {("kept", "taken")}, False),
    ("reset", {("kept", "taken")}, False),
    ("memory", {("words", "words_r_data")}, False),
    ("pin", {("pin i", "taken")}, False),
    ("falling", set(), True),
    ("none", set(), True),
])
def test_paths_are_found(kind, ends, safe):
    found = crossings(netlist(Paths(kind)))
    assert {(each.source, each.destination) for each in found} == ends
    assert all(waiver is not None for _, waiver in explain(found, (KEPT,))) == safe


def test_clocks_in_step_are_one():
    assert crossings(netlist(Paths("logic before")), {"far_clk": "clk"}) == []


def test_a_pin_of_no_clock_needs_a_synchroniser():
    module = netlist(Paths("none"))
    assert crossings(module) == []
    found = crossings(module, pins={"i": None})
    assert {(each.source, each.source_clock, each.destination, each.direct) for each in found} == {
        ("pin i", "no clock", "kept", True), ("pin i", "no clock", "other", False)}
