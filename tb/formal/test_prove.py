# amaranth: UnusedElaboratable=no
"""The proofs of seconds, and that they find what is planted; `make prove` runs them all."""

from dataclasses import replace

import pytest
from amaranth.hdl import Elaboratable, Module, Signal

from tb.formal import prove
from tb.formal import symbiyosys as formal
from tb.formal.guard_faults import FAULTS, SCALED, Fault, guard_class


def test_guard_by_default_ceilings():
    """Without bound, at 16 MHz, all inputs free."""
    outcome = prove.guard_outcome(limit=1200)
    assert outcome.result == "proved", outcome.log[-3000:]


@pytest.mark.parametrize("limits", [
    *SCALED, (1_000_000, 6, 7, 14, 8, 5), (2_000_000, 3, 9, 9, 7, 4),
    (1_000_000, 7, 31, 31, 15, 62), (3_000_000, 5, 7, 13, 5, 11)])
def test_guard_by_other_ceilings(limits):
    """Among them those of the planted faults, all bits of the counters, and odd clocks."""
    outcome = prove.guard_outcome(*limits)
    assert outcome.result == "proved", outcome.log[-3000:]


def test_planted_faults_are_found():
    outcomes = prove.guard_fault_outcomes()
    missed = [fault.name for fault in FAULTS
              if outcomes[fault.name].result != "failed"
              or not set(outcomes[fault.name].failed) <= set(fault.breaks)]
    assert not missed, outcomes[missed[0]]


def test_no_fault_is_found_where_there_is_none():
    """Nor without flipped bits, where only their detection is at fault."""
    pin = next(fault for fault in FAULTS if fault.name == "the pin alone")
    none = Fault("none", (), pin.breaks)
    outcomes = prove.guard_fault_outcomes([none, replace(pin, upset=False)], "guard no faults")
    assert {name: outcome.result for name, outcome in outcomes.items()} == {
        "none": "held", "the pin alone": "held"}


def test_a_fault_that_is_nowhere_is_refused():
    with pytest.raises(LookupError, match="stands 0 times in laser_guard.py, not once"):
        guard_class(Fault("none", (("no such text", ""),), ()))


class Counter(Elaboratable):
    """Counts to 5, and is claimed never to."""

    ports = ()

    def __init__(self, most):
        self.most = most

    def elaborate(self, platform):
        m = Module()
        count = Signal(4)
        with m.If(count != 5):
            m.d.sync += count.eq(count + 1)
        formal.claim(m, "small", count <= self.most)
        return m


@pytest.mark.parametrize("most,mode,depth,result", [
    (5, "prove", 2, "proved"), (4, "prove", 2, "unknown"), (4, "prove", 8, "failed"),
    (4, "bmc", 3, "held"), (4, "bmc", 8, "failed"),
])
def test_outcomes_are_told_apart(most, mode, depth, result):
    outcome = formal.prove(f"counter {most} {mode} {depth}",
                           formal.to_rtlil(Counter(most)), mode, depth)
    assert outcome.result == result
    assert outcome.failed == (("small",) if result == "failed" else ())
