"""Bench of the capture timer: every clock is the model's."""

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from model.link.capture_timer import capture_clocks
from tb.harness import Bench, parameters

CLOCKS_PER_MS, SEED = (parameters()[name] for name in ("clocks_per_ms", "seed"))


def make(dut):
    return Bench(dut, inputs=(), outputs=(), seed=SEED, plain={"start": 0, "milliseconds": 0})


async def compare(bench, starts, length):
    """Play starts (clock, milliseconds) from reset on, and compare every clock."""
    dut, starts = bench.dut, sorted(starts)
    await bench.reset()
    at = dict(starts)
    for clock, on in enumerate(capture_clocks(starts, CLOCKS_PER_MS, length)):
        dut.start.value = int(clock in at)
        dut.milliseconds.value = at.get(clock, bench.rng.getrandbits(16))
        await ReadOnly()
        assert bool(dut.capture.value) == on, f"clock {clock}: capture must be {on}"
        await RisingEdge(dut.clk)
    dut.start.value = 0


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def lengths_are_exact(dut):
    bench = make(dut)
    for milliseconds in (0, 1, 2, 7):
        await compare(bench, [(3, milliseconds)], (milliseconds + 1) * CLOCKS_PER_MS + 10)


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def starts_replace_each_other(dut):
    """At any distance: before the end, in the clocks around it, and long after; with 0 too."""
    bench = make(dut)
    starts, clock = [], 0
    for _ in range(60):
        milliseconds = bench.rng.choice([0, 1, 2, 3])
        starts.append((clock, milliseconds))
        end = milliseconds * CLOCKS_PER_MS
        clock += max(1, bench.rng.choice([1, 2, end - 1, end, end + 1, end + 2, end // 2 + 1]))
    await compare(bench, starts, clock + 4 * CLOCKS_PER_MS)


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def the_longest_time_lasts(dut):
    """Its upper bits count too; a reset ends it."""
    bench = make(dut)
    await compare(bench, [(0, 0xFFFF)], 5 * CLOCKS_PER_MS)
    await compare(bench, [], 3 * CLOCKS_PER_MS)
