"""Bench of the point FIFO: what goes in comes out, and no more than it has slots for."""

import random

import cocotb
from cocotb.triggers import ClockCycles

from hdl.common.point_fifo import PointFIFO
from hdl.payloads import Point
from tb.harness import Bench, parameters

SEED, DEPTH = parameters()["seed"], parameters()["depth"]
BITS = Point.as_shape().size


def words(rng, count):
    return [rng.getrandbits(BITS) for _ in range(count)]


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.5, 0.95], stall=[0.0, 0.5, 0.95])
async def keeps_order(dut, gap, stall):
    bench = Bench(dut, gap=gap, stall=stall, seed=SEED)
    await bench.reset()
    sent = [0, (1 << BITS) - 1, 1 << 26, (1 << 26) - 1]
    sent += words(random.Random(SEED), 700 if max(gap, stall) < 0.9 else 300)
    sending = cocotb.start_soon(bench.i.send(sent))
    got = await bench.o.receive(len(sent))
    assert got == sent
    await sending


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def fills_and_empties(dut):
    """While nothing is taken, all slots fill, a point in three clocks; then one leaves in four."""
    bench = Bench(dut, stall=1.0, seed=SEED)
    await bench.reset()
    sent = words(random.Random(SEED), DEPTH + 5)
    bench.i.append(sent)
    await ClockCycles(dut.clk, 4 * DEPTH)
    assert len(bench.i.taken) == DEPTH
    assert bench.i.taken[-1] - bench.i.taken[0] == 3 * (DEPTH - 1)
    bench.o.stall = 0.0
    await ClockCycles(dut.clk, 6 * DEPTH)
    clocks, got = zip(*bench.o.words, strict=True)
    assert list(got) == sent
    assert clocks[-1] - clocks[0] == 4 * (len(sent) - 1)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def latency(dut):
    bench = Bench(dut, seed=SEED)
    await bench.reset()
    for word in words(random.Random(SEED), 5):
        await bench.i.send([word])
        await ClockCycles(dut.clk, 8)
    # A point is taken two clocks after it came.
    assert [out - into for (out, _), into in zip(bench.o.words, bench.i.taken, strict=True)] == (
        [PointFIFO.latency - 2] * 5)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_empties(dut):
    bench = Bench(dut, stall=1.0, seed=SEED)
    await bench.reset()
    rng = random.Random(SEED)
    await bench.i.send(words(rng, 20))
    await bench.reset()
    bench.o.stall = 0.0
    sent = words(rng, 20)
    await bench.i.send(sent)
    assert await bench.o.receive(20) == sent
    await ClockCycles(dut.clk, 30)
    assert not bench.o.words
