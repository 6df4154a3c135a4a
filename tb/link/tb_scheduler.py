"""Bench of the scheduler: whole packets, in order of priority."""

import random

import cocotb
from cocotb.triggers import ClockCycles, RisingEdge

from tb.harness import Bench, parameters

SEED, SOURCES = parameters()["seed"], parameters()["sources"]
INPUTS = [f"i_{n}" for n in range(SOURCES)]


def packet(rng, source, size=None):
    size = rng.randrange(1, 12) if size is None else size
    octets = [source << 5 | rng.randrange(32) for _ in range(size)]
    return [*octets[:-1], octets[-1] | 0x100]


def make(dut, gap=0.0, stall=0.0):
    return Bench(dut, inputs=INPUTS, gap=gap, stall=stall, seed=SEED)


def split(words):
    """Packets of a run of octets."""
    packets = [[]]
    for word in words:
        packets[-1].append(word)
        if word & 0x100:
            packets.append([])
    assert not packets.pop()
    return packets


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.6], stall=[0.0, 0.6])
async def packets_stay_whole(dut, gap, stall):
    rng = random.Random(f"{SEED} {gap} {stall}")
    bench = make(dut, gap, stall)
    await bench.reset()
    sent = {source: [] for source in range(SOURCES)}
    for _ in range(30):
        source = rng.randrange(SOURCES)
        one = packet(rng, source)
        sent[source].append(one)
        getattr(bench, INPUTS[source]).append(one)
        if rng.random() < 0.3:
            await ClockCycles(dut.clk, rng.randrange(60))
    total = sum(len(one) for each in sent.values() for one in each)
    got = split(await bench.o.receive(total))
    for source in range(SOURCES):
        assert [one for one in got if one[0] >> 5 & 7 == source] == sent[source]


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def first_source_first(dut):
    """With all sources waiting, the first one's packets leave before the next one's."""
    rng = random.Random(SEED)
    bench = make(dut, stall=1.0)
    await bench.reset()
    sent = []
    for source in range(SOURCES):
        for _ in range(3):
            sent.append(packet(rng, source))
            getattr(bench, INPUTS[source]).append(sent[-1])
    # What is offered stays, though a better one comes: only the first packet may jump the queue.
    await ClockCycles(dut.clk, 30)
    bench.o.stall = 0.0
    got = split(await bench.o.receive(sum(map(len, sent))))
    assert got == sent


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def late_packets_wait_for_one_packet_at_most(dut):
    """A better source that comes late gets its turn after the packet under way."""
    if SOURCES < 2:
        return
    rng = random.Random(SEED)
    bench = make(dut)
    await bench.reset()
    slow = [packet(rng, SOURCES - 1, 40) for _ in range(3)]
    for one in slow:
        getattr(bench, INPUTS[-1]).append(one)
    while len(bench.o.words) < 5:
        await RisingEdge(dut.clk)
    late = packet(rng, 0, 40)
    bench.i_0.append(late)
    got = split(await bench.o.receive(160))
    assert got == [slow[0], late, *slow[1:]]


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(pause=[0, 10, 15])
async def a_source_that_goes_on_keeps_its_turn(dut, pause):
    """... if its next packet is there 15 clocks after the one before was over."""
    rng = random.Random(SEED)
    bench = make(dut)
    await bench.reset()
    one, two = packet(rng, 0, 9), packet(rng, 0, 9)
    bench.i_0.append(one)
    while not bench.o.words:
        await RisingEdge(dut.clk)
    others = [packet(rng, source, 5) for source in range(1, SOURCES)]
    for source, other in enumerate(others, 1):
        getattr(bench, INPUTS[source]).append(other)
    while len(bench.o.words) < 9:
        await RisingEdge(dut.clk)
    over = bench.o.words[-1][0]
    while bench.cycle < over + pause - 1:  # the source needs a clock to show it
        await RisingEdge(dut.clk)
    bench.i_0.append(two)
    got = split(await bench.o.receive(18 + 5 * len(others)))
    assert got == [one, two, *others]


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def octets_pass_every_clock(dut):
    rng = random.Random(SEED)
    bench = make(dut)
    await bench.reset()
    await ClockCycles(dut.clk, 20)
    for _ in range(3):
        bench.i_0.append(packet(rng, 0, 50))
    while len(bench.o.words) < 150:
        await RisingEdge(dut.clk)
    times = [clock for clock, _ in bench.o.words]
    steps = [b - a for a, b in zip(times, times[1:], strict=False)]
    assert steps.count(1) == 147 and sorted(steps)[-2:] == [18, 18], steps
