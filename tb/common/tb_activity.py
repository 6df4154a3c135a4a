"""Bench of the activity signal: every clock is the model's."""

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from model.common.activity import busy_clocks
from tb.harness import Bench, parameters


async def compare(bench, active):
    """Play ``active`` from reset on, and compare every clock with the model."""
    dut, choices = bench.dut, parameters()
    dut.active.value = int(active[0])
    await bench.reset()  # and one clock more
    expected = busy_clocks(
        [active[0], *active], choices["timeout"], choices["busy_after_reset"])[1:]
    for clock, (value, busy) in enumerate(zip(active, expected, strict=True)):
        dut.active.value = int(value)
        await ReadOnly()
        assert bool(dut.busy.value) == busy, f"clock {clock}: busy must be {busy}"
        await RisingEdge(dut.clk)


@cocotb.test(timeout_time=2, timeout_unit="ms")
async def random_activity(dut):
    """Bursts and pauses around the timeout, with a reset between two runs."""
    bench = Bench(dut, inputs=(), outputs=(), plain={"active": 0})
    timeout = parameters()["timeout"]
    for _ in range(3):
        active = []
        while len(active) < 20 * timeout:
            active += [False] * bench.rng.choice([0, 1, timeout - 1, timeout, timeout + 1])
            active += [True] * bench.rng.choice([1, 2])
        await compare(bench, active)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def nothing_active_after_reset(dut):
    bench = Bench(dut, inputs=(), outputs=(), plain={"active": 0})
    await compare(bench, [False] * (2 * parameters()["timeout"] + 2))
