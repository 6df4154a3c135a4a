"""Bench of the benches' own streams: what they take, and when."""

import cocotb
from cocotb.triggers import ClockCycles

from tb.harness import Bench

WORDS = list(range(10, 40))


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.6], stall=[0.0, 0.6, 0.95])
async def words_pass(dut, gap, stall):
    bench = Bench(dut, gap=gap, stall=stall, seed=1)
    await bench.reset()
    bench.i.append(WORDS[:20])
    bench.i.append(WORDS[20:])
    assert await bench.o.receive(len(WORDS)) == WORDS


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def clocks(dut):
    """A word a clock, in and out, counted alike on both sides."""
    bench = Bench(dut)
    await bench.reset()
    await bench.i.send(WORDS)
    await ClockCycles(dut.clk, 3)
    assert [word for _, word in bench.o.words] == WORDS
    taken = [clock for clock, _ in bench.o.words]
    assert taken == list(range(taken[0], taken[0] + len(WORDS)))
    assert [clock + 1 for clock in bench.i.taken] == taken
    before = bench.cycle
    await ClockCycles(dut.clk, 7)
    assert bench.cycle == before + 7


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def nothing_is_taken_until_it_is_asked_for(dut):
    """``stall`` may be set at any time, also while nothing, or the same word, is offered."""
    bench = Bench(dut)
    await bench.reset()
    await ClockCycles(dut.clk, 40)
    bench.o.stall = 1.0
    bench.i.append(WORDS)
    await ClockCycles(dut.clk, 40)
    assert not bench.o.words and len(bench.i.taken) == 1
    bench.o.stall = 0.0
    assert await bench.o.receive(len(WORDS)) == WORDS
    await ClockCycles(dut.clk, 10)
    assert not bench.o.words
    bench.o.stall = 0.5
    bench.i.append(WORDS)
    assert await bench.o.receive(len(WORDS)) == WORDS


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def words_of_a_reset_do_not_count(dut):
    """A word that waits may go in a reset; what is offered to a block in reset is lost."""
    bench = Bench(dut)
    await bench.reset()
    bench.o.stall = 1.0
    bench.i.append(WORDS)
    await ClockCycles(dut.clk, 20)
    await bench.reset()
    bench.o.stall = 0.0
    await ClockCycles(dut.clk, 60)
    words = [word for _, word in bench.o.words]
    assert words == WORDS[-len(words):] and len(WORDS) - 5 <= len(words) < len(WORDS)
