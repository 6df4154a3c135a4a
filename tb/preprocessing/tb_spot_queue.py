"""Bench of the spot queue: what it keeps, what it counts, and that it never stalls."""

import random
from types import SimpleNamespace

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.preprocessing.spot_queue import SpotQueue
from model.preprocessing.area import area_code
from model.preprocessing.labelling import SPOT_DTYPE
from model.preprocessing.spot_queue import filter_spots
from tb.harness import Bench, parameters

SEED, DEPTH = parameters()["seed"], parameters()["depth"]
END = 1
REPORT = SimpleNamespace(area_min=3, area_max=40, report_rejected=True)


def spot(rng, area=None, core=None):
    if area is None:
        area = rng.choice([1, 2, 3, 4, 30, 40, 41, 255, 256, 257, 511, 512, 1023, 1024])
    weight = 0 if area == 1024 else rng.randint(area, 256 * area)
    return (rng.random() < 0.8 if core is None else core, rng.random() < 0.5, rng.random() < 0.5,
            area, weight,
            rng.randint(0, 511 * weight), rng.randint(0, 511 * weight))


def word(spot):
    core, saturated, border, area, weight, sum_u, sum_v = spot
    return (int(core) << 2 | saturated << 3 | border << 4 | area << 5 | weight << 16
            | sum_u << 34 | sum_v << 62)


def kept(spots, settings):
    """Words that a queue that is never full would send of a frame, and its counts."""
    queued, counts = filter_spots(np.array(spots, SPOT_DTYPE), settings)
    return [int(s["rejected"]) << 1 | int(area_code(s["area"])) << 2 | int(s["saturated"]) << 11
            | int(s["border"]) << 12 | int(s["weight"]) << 13 | int(s["sum_u"]) << 31
            | int(s["sum_v"]) << 59 for s in queued], counts


def counts_word(counts, dropped=0, broken=0):
    return counts["spots"] | counts["rejected"] << 16 | dropped << 32 | broken << 48


class Rig(Bench):
    def __init__(self, dut, gap=0.0, stall=0.0, **settings):
        self.settings = SimpleNamespace(
            **{"area_min": 3, "area_max": 40, "report_rejected": False, **settings})
        super().__init__(dut, outputs=("o", "counts"), gap=gap, stall=stall, seed=SEED, plain={
            key: int(value) for key, value in vars(self.settings).items()})
        self.random = random.Random(f"{SEED} {gap} {stall}")
        cocotb.start_soon(self._never_waits())

    async def _never_waits(self):
        while True:
            await ReadOnly()
            assert self.dut.i_ready.value == 1
            await RisingEdge(self.dut.clk)

    async def frame(self, spots, broken=0):
        await self.i.send([word(each) for each in spots] + [END | broken << 1])

    async def exact(self, spots, broken=0):
        """Send a frame; what a queue that is never full would keep comes out, and its counts."""
        cocotb.start_soon(self.frame(spots, broken))
        want, counts = kept(spots, self.settings)
        got = await self.o.receive(len(want) + 1)
        for at, (mine, its) in enumerate(zip(got, [*want, END], strict=True)):
            assert mine == its, f"word {at}: got {mine:#x}, not {its:#x}"
        assert await self.counts.receive(1) == [counts_word(counts, broken=broken)]


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.6], stall=[0.0, 0.6], report_rejected=[False, True])
async def frames_that_fit(dut, gap, stall, report_rejected):
    """Frames of less than half the slots, the next one as soon as the last one has gone."""
    bench = Rig(dut, gap, stall, report_rejected=report_rejected)
    await bench.reset()
    for number in range(24):
        count = bench.random.choice([0, 1, 2, DEPTH // 2 - 2])
        await bench.exact([spot(bench.random) for _ in range(count)], broken=number % 5 == 3)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def area_limits(dut):
    """Every area, with and without core, on both sides of both limits."""
    for area_min, area_max in [(1, 1023), (3, 40), (300, 700), (200, 100)]:
        bench = Rig(dut, gap=0.6, area_min=area_min, area_max=area_max)
        await bench.reset()
        areas = sorted({1, 2, 255, 256, 511, 512, 1023, 1024, *(
            limit + step for limit in (area_min, area_max) for step in (-1, 0, 1)
            if 0 < limit + step < 1024)})
        await bench.exact([spot(bench.random, area, core) for area in areas for core in (0, 1)])
        await bench.reset(1)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def a_word_a_clock(dut):
    """All unreserved slots fill in as many clocks; then a spot leaves in each clock."""
    bench = Rig(dut)
    await bench.reset()
    spots = [spot(bench.random, 10, True) for _ in range(DEPTH - 4)]
    await bench.frame(spots)
    assert bench.i.taken[-1] - bench.i.taken[0] == DEPTH - 4
    await ClockCycles(dut.clk, DEPTH + 5)
    clocks, got = zip(*bench.o.words, strict=True)
    assert list(got) == [*kept(spots, bench.settings)[0], END]
    # The end marker waits a clock for its counts.
    assert np.diff(clocks).tolist() == [1] * (DEPTH - 5) + [2]


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def latency(dut):
    bench = Rig(dut)
    await bench.reset()
    for _ in range(4):
        await bench.i.send([word(spot(bench.random, 10, True))])
        await ClockCycles(dut.clk, 5)
    assert [out - into for (out, _), into in zip(bench.o.words, bench.i.taken, strict=True)] == (
        [SpotQueue.latency] * 4)


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(report_rejected=[False, True], gap=[0.0, 0.5])
async def overflow_while_stalled(dut, report_rejected, gap):
    """Nothing is taken: a reckoning of the places says what is kept, clock by clock."""
    bench = Rig(dut, gap=gap, report_rejected=report_rejected)
    await bench.reset()
    bench.o.stall = 1.0
    spots = [spot(bench.random, bench.random.choice([2, 3, 30, 40])) for _ in range(3 * DEPTH)]
    await bench.frame(spots)
    level, shown, want, dropped, rejected = 0, False, [], 0, 0
    arrivals = dict(zip(bench.i.taken, spots, strict=False))
    for clock in range(bench.i.taken[0], bench.i.taken[-1]):
        pushed = False
        if clock in arrivals:
            (word_of,), _ = kept([arrivals[clock]], REPORT)
            is_rejected = bool(word_of & 2)
            room = report_rejected and level < DEPTH // 2 if is_rejected else level < DEPTH - 4
            pushed = room
            rejected += is_rejected and not room
            dropped += not is_rejected and not room
            want += [word_of] if pushed else []
        if pushed:
            level += 1
        elif level and not shown:  # the first one leaves the memory in a clock without writing
            level, shown = level - 1, True
    assert dropped and rejected
    counts = {"spots": len(spots), "rejected": rejected}
    bench.o.stall = 0.0
    got = await bench.o.receive(len(want) + 1)
    assert got == [*want, END]
    assert await bench.counts.receive(1) == [counts_word(counts, dropped)]
    # The next frame is exact.
    await bench.exact([spot(bench.random) for _ in range(DEPTH // 2 - 2)])


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.7], stall=[0.9, 0.97], report_rejected=[False, True])
async def lossy_frames_balance(dut, gap, stall, report_rejected):
    """Under load: spots come out whole and in order, counters balance, the next frame is exact."""
    bench = Rig(dut, gap, stall, report_rejected=report_rejected)
    await bench.reset()
    for count in (2 * DEPTH, 5, DEPTH, 0):
        spots = [spot(bench.random) for _ in range(count)]
        cocotb.start_soon(bench.frame(spots, broken=count == DEPTH))
        want, counts = kept(spots, bench.settings)
        got = []
        while not got or got[-1] != END:
            got += await bench.o.receive(1)
        left = iter(want)
        assert all(each in left for each in got[:-1]), "not a part of the model's spots, in order"
        total, = await bench.counts.receive(1)
        components, rejected, dropped = (total >> place & 0xFFFF for place in (0, 16, 32))
        assert total >> 48 == (count == DEPTH)
        assert components == len(got) - 1 + rejected + dropped == counts["spots"]
        lost = [each & 2 for each in want].count(0) - [each & 2 for each in got[:-1]].count(0)
        assert dropped == lost
        bench.o.stall = 0.0
        await bench.exact([spot(bench.random) for _ in range(DEPTH // 2 - 2)])
        bench.o.stall = stall


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def end_markers_find_room(dut):
    """Four end markers fit behind a full queue, and each keeps its own counts."""
    bench = Rig(dut)
    await bench.reset()
    bench.o.stall = 1.0
    frames = [[spot(bench.random, 9, True) for _ in range(count)] for count in (DEPTH + 9, 2, 0, 1)]
    for number, spots in enumerate(frames):
        await bench.frame(spots, broken=number == 2)
    bench.o.stall = 0.0
    # The first spot that is dropped leaves a clock for the first one that was kept to go, and so
    # its place to the next.
    fits = frames[0][:DEPTH - 4] + [frames[0][DEPTH - 3]]
    want = kept(fits, bench.settings)[0] + [END] * 4
    assert await bench.o.receive(len(want)) == want
    dropped = (len(frames[0]) - len(fits), 2, 0, 1)
    got = await bench.counts.receive(4)
    assert got == [counts_word({"spots": len(spots), "rejected": 0}, lost, number == 2)
                   for number, (spots, lost) in enumerate(zip(frames, dropped, strict=True))]


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def counts_come_first(dut):
    """Counts are valid when the end marker is; the next end marker waits until they are taken."""
    bench = Rig(dut)
    await bench.reset()
    bench.counts.stall = 1.0
    for _ in range(2):
        await bench.frame([spot(bench.random, 9, True)])
    while dut.o_valid.value == 0 or not int(dut.o_payload.value) & END:
        await RisingEdge(dut.clk)
        await ReadOnly()
    assert dut.counts_valid.value == 1
    await ClockCycles(dut.clk, 20)
    assert [each & END for _, each in bench.o.words] == [0, 1, 0]
    bench.counts.stall = 0.0
    assert len(await bench.counts.receive(2)) == 2
    await ClockCycles(dut.clk, 5)
    assert [each & END for _, each in bench.o.words] == [0, 1, 0, 1]


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_empties(dut):
    bench = Rig(dut)
    await bench.reset()
    bench.o.stall = bench.counts.stall = 1.0
    await bench.frame([spot(bench.random) for _ in range(DEPTH // 2)])
    await bench.i.send([word(spot(bench.random))])
    await ClockCycles(dut.clk, 4)
    await bench.reset()
    bench.o.stall = bench.counts.stall = 0.0
    await bench.exact([spot(bench.random) for _ in range(DEPTH // 2 - 2)])
    await ClockCycles(dut.clk, 20)
    assert not bench.o.words and not bench.counts.words
