"""The sequencer against its model: every edge of every output, whatever the imager does."""

import cocotb
import numpy as np
from cocotb.simtime import get_sim_time
from cocotb.triggers import ClockCycles, FallingEdge, ReadOnly, RisingEdge, Timer

from hdl.acquisition.sequencer import Sequencer
from model.acquisition.sequencer import (
    CONTINUOUS,
    PATTERN,
    SINGLE,
    STOP,
    Readout,
    Registers,
    Schedule,
)
from tb.harness import Bench, parameters

PINS = ("sensor_reset", "sensor_integrate", "sensor_read", "laser_request", "frame_start",
        "pattern_start", "running", "silent")
NUMBERS = ("heartbeat", "late", "timeouts", "pairs")
#: A schedule that takes few clocks.
QUICK = Registers(CONTINUOUS, 140, 3, 4, 2, 30)


class SequencerBench(Bench):
    """An imager and a guard that follow a plan, and a record of all outputs.

    ``plan``: for each frame (first pixel, end, whole, idle_from), in clocks after the integration,
    None for what never comes; the last entry is used for all further frames. ``lit``: which frames
    are lit, whatever was requested. ``armed`` and ``registers``: (clock, value) in order.
    """

    def __init__(self, dut, plan, registers, armed=((0, 1),), lit=None):
        self.plan, self.registers, self.armed = plan, registers, armed
        self.lit = lit
        self.clocks = parameters()["clocks"]
        super().__init__(dut, inputs=(), outputs=(), plain={
            **vars(registers[0][1]), "frame_begun": 0, "frame_ended": 0,
            "frame_broken": 0, "sending": 0, "laser_armed": armed[0][1], "lit": 0, "capture": 0})
        self.edges = {name: [] for name in (*PINS, *NUMBERS, "tag")}
        self.frames = self.sending = self.idle_from = 0
        self.zero = None

    @property
    def now(self):
        return round(get_sim_time("ns") - self.zero) // 10

    def entry(self, number):
        return self.plan[min(number, len(self.plan) - 1)]

    async def begin(self):
        await self.reset()
        await ReadOnly()
        self.zero = get_sim_time("ns") - 10  # the clock before was the first one out of reset
        for name in PINS:
            cocotb.start_soon(self._pin(name))
        for name in (*NUMBERS, "tag"):
            cocotb.start_soon(self._number(name))
        cocotb.start_soon(self._imager())
        for task in (self._host(), self._guard()):
            cocotb.start_soon(task)

    async def _count(self):
        """Nobody needs it, and it takes longer than all the rest."""

    async def until(self, clock):
        """Within the clock, early enough to set inputs."""
        clocks = clock - self.now
        if clocks > 1:
            await Timer(10 * clocks - 5, unit="ns")
        if clocks > 0:
            await RisingEdge(self.dut.clk)

    async def _pin(self, name):
        signal = getattr(self.dut, name)
        while True:
            await RisingEdge(signal)
            await ReadOnly()
            self.edges[name].append(self.now)
            await FallingEdge(signal)
            await ReadOnly()
            self.edges[name].append(self.now)

    async def _number(self, name):
        signal = getattr(self.dut, name)
        while True:
            await signal.value_change
            await ReadOnly()
            self.edges[name].append((self.now, signal.value.to_unsigned()))

    async def _host(self):
        for clock, values in self.registers[1:]:
            await self.until(clock)
            for name, value in vars(values).items():
                getattr(self.dut, name).value = value

    async def _guard(self):
        for clock, armed in self.armed[1:]:
            await self.until(clock)
            self.dut.laser_armed.value = armed

    async def _imager(self):
        while True:
            await RisingEdge(self.dut.sensor_integrate)
            await RisingEdge(self.dut.clk)
            self.dut.lit.value = self.lit is not None and self.lit(self.frames)
            self.dut.capture.value = self.frames % 3 == 1
            await RisingEdge(self.dut.sensor_read)
            cocotb.start_soon(self._frame(self.frames, self.now))
            self.frames += 1
            await RisingEdge(self.dut.clk)
            self.dut.lit.value, self.dut.capture.value = 0, 0

    async def _frame(self, number, end):
        dut, (begun, over, whole, idle_from) = self.dut, self.entry(number)
        events = []
        if begun is not None:
            events += [(begun, "frame_begun", 1), (begun + 1, "frame_begun", 0),
                       (begun, "sending", 1)]
            if over is not None:
                name = "frame_ended" if whole else "frame_broken"
                events += [(over, name, 1), (over + 1, name, 0)]
            events.append((idle_from, "sending", 0))
        for clock, name, value in sorted(events, key=lambda event: event[0]):
            await self.until(end + clock)
            if name == "sending":  # a frame that hangs outlasts the next ones
                self.sending += 1 if value else -1
                value = self.sending > 0
            getattr(dut, name).value = value

    def sensor(self, number, end):
        begun, over, whole, idle_from = self.entry(number)
        if begun is None:
            return Readout()
        self.idle_from = max(self.idle_from, end + idle_from)
        return Readout(end + begun, None if over is None else end + over, whole, self.idle_from)

    def schedule(self, until):
        return Schedule(
            self.clocks * 1_000_000, self.registers, self.sensor,
            lambda clock: [armed for since, armed in self.armed if since <= clock][-1], until,
            *(parameters()[name] for name in ("begin_us", "frame_us", "warm_up_us")))

    async def check(self, until):
        """Let it run, then compare everything up to that clock; the model's schedule."""
        await self.until(until)
        await ReadOnly()
        schedule = self.schedule(until)
        wanted = self.expected(schedule)
        for name, edges in self.edges.items():
            got = [edge for edge in edges if np.ravel(edge)[0] < until]
            other = [edge for edge in wanted[name] if np.ravel(edge)[0] < until]
            wrong = [place for place, (mine, his) in enumerate(zip(got, other, strict=False))
                     if mine != his] + [min(len(got), len(other))]
            part = slice(max(0, wrong[0] - 2), wrong[0] + 3)
            assert got == other, f"{name}: {got[part]} instead of {other[part]}"
        assert self.dut.timestamp_us.value == until // self.clocks
        for frame in schedule.frames:
            assert frame.pins["sensor_reset"][0] - frame.start == Sequencer.latency
        return schedule

    def expected(self, schedule):
        edges = {name: [] for name in self.edges}
        for clock, texture in schedule.starts:
            edges["frame_start"] += clock, clock + 1
            if not texture:
                edges["pattern_start"] += clock, clock + 1
        for begin, end in schedule.running:
            edges["running"] += [begin] if end is None else [begin, end]
        heartbeat, silent = 0, 0
        for number, frame in enumerate(schedule.frames):
            for name, times in frame.pins.items():
                if name in edges:
                    edges[name] += times
            lit = bool(self.lit and self.lit(number))
            tag = (frame.as_texture | lit << 1 | (number % 3 == 1) << 2 | frame.exposure_us << 3
                   | (frame.timestamp_us & 0xFFFFFF) << 19)
            edges["tag"].append((frame.pins["integrated"] + 1, tag))
            missing, known = int(frame.outcome == "missing"), frame.over + 1
            if frame.outcome == "whole":
                heartbeat += 1
                known = frame.pins["integrated"] + self.entry(number)[1] + 1
                edges["heartbeat"].append((known, heartbeat & 0xFF))
            if frame.outcome != "broken" and silent != missing:
                edges["silent"].append(known)
                silent = missing
        missing = [frame.over + 1 for frame in schedule.frames if frame.outcome == "missing"]
        edges["timeouts"] = [(at, number) for number, at in enumerate(missing, 1) if number < 256]
        pairs = [frame for frame in schedule.frames if not frame.texture]
        edges["pairs"] = [(frame.start + 2, n) for n, frame in enumerate(pairs, 1)]
        edges["late"] = [(clock, n) for n, clock in enumerate(schedule.late, 1) if n < 256]
        return edges


def frame(begun=8, length=60, whole=True, tail=3):
    return begun, begun + length, whole, begun + max(1, length + tail)


def random_plan(rng, clocks, count=400):
    """Frames mostly whole, and everything that an imager may do wrong."""
    begin, limit = (parameters()[name] * clocks for name in ("begin_us", "frame_us"))
    plan = []
    for _ in range(count):
        kind = rng.choice(["whole"] * 4 + ["broken", "silent", "stops", "late", "slow", "hangs"])
        begun, length = int(rng.integers(1, 20)), int(rng.integers(1, 60))
        if kind == "silent":
            plan.append((None, None, True, 0))
        elif kind == "stops":
            plan.append((begun, None, True, limit + 2 * clocks))
        elif kind == "late":  # about the time limit; over before the next one could come
            plan.append(frame(begin + int(rng.integers(-2 * clocks, 1)), min(length, 6)))
        elif kind == "slow":
            plan.append(frame(begun, limit - begun - int(rng.integers(0, 2 * clocks))))
        elif kind == "hangs":  # frame_valid does not fall
            plan.append(frame(begun, length, bool(rng.integers(2)), 3 * limit))
        else:
            if rng.random() < 0.3:  # over before `sensor_read` is
                begun = length = 1
            plan.append(frame(begun, length, kind == "whole", int(rng.integers(-4, 40))))
    return plan


def random_registers(rng, clocks, until):
    changes, clock = [(0, QUICK)], 0
    while clock < until:
        clock += int(rng.integers(1, 600 * clocks))
        mode = int(rng.choice([STOP, CONTINUOUS, CONTINUOUS, SINGLE, SINGLE, PATTERN]))
        changes.append((clock, Registers(mode, int(rng.integers(0, 200)), *(
            int(value) for value in rng.integers(0, (6, 20, 6, 40))), int(rng.integers(2)))))
    return changes


def random_switch(rng, until, longest):
    changes, clock = [(0, 0)], 0
    while clock < until:
        clock += int(rng.integers(1, longest))
        changes.append((clock, 1 - changes[-1][1]))
    return changes


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def random_world(dut):
    """Registers, guard and imager change at any clock."""
    rng = np.random.default_rng(parameters()["seed"])
    clocks = parameters()["clocks"]
    until = 12_000 * clocks
    lit = rng.random(1000) < 0.5
    bench = SequencerBench(
        dut, random_plan(rng, clocks), random_registers(rng, clocks, until),
        random_switch(rng, until, 1200 * clocks), lambda number: bool(lit[number]))
    await bench.begin()
    schedule = await bench.check(until)
    outcomes = {frame.outcome for frame in schedule.frames}
    assert outcomes == {"whole", "broken", "missing"} and schedule.late
    assert len(schedule.frames) > 100 and len(schedule.running) > 5


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def pairs_come_in_time(dut):
    """Patterns a period apart to the clock; a frame costs its microseconds and a few clocks."""
    clocks = parameters()["clocks"]
    bench = SequencerBench(dut, [frame()], [(0, QUICK)], lit=lambda number: number % 2 == 0)
    await bench.begin()
    schedule = await bench.check(1600 * clocks)
    patterns = [taken for taken in schedule.frames if not taken.texture]
    starts = [taken.pins["sensor_integrate"][0] for taken in patterns]
    assert len(starts) > 10 and set(np.diff(starts)) == {140 * clocks} and not schedule.late
    assert all(taken.laser_requested != taken.texture for taken in schedule.frames)
    frames = schedule.frames
    assert [taken.texture for taken in frames] == [n % 2 == 1 for n in range(len(frames))]
    assert frames[1].start == frames[0].start + (3 + 4) * clocks + 2 + (8 + 60) + 3 + 2


@cocotb.test(timeout_time=50, timeout_unit="ms")
@cocotb.parametrize(times=[
    (1, 1, 1, 1, 1), (0, 0, 0, 0, 0), (65_535, 1, 1, 1, 1), (1, 65_535, 1, 1, 65_535),
    (65_535, 1, 65_535, 65_535, 1)])
async def limits(dut, times):
    """The shortest and the longest times; what does not fit in its period follows at once."""
    clocks = parameters()["clocks"]
    bench = SequencerBench(dut, [frame()], [(0, Registers(CONTINUOUS, *times))])
    await bench.begin()
    schedule = await bench.check((max(times[0], sum(times[1:])) + 200) * clocks)
    assert len(schedule.frames) >= 3
    assert bool(schedule.late) == (times[0] <= sum(times[1:]))


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def values_are_taken_after_the_start(dut):
    """A change in each clock around `frame_start`; it counts only up to the clock after it."""
    clocks = parameters()["clocks"]
    changes, counted = [(0, QUICK)], []
    for place, offset in enumerate(range(-4, 6), 1):
        start = clocks + 140 * clocks * place
        changes.append((start + offset, Registers(CONTINUOUS, 140, 3, 10 + place, 2, 30)))
        counted.append(10 + place if offset <= 1 else 9 + place)
    bench = SequencerBench(dut, [frame()], changes)
    await bench.begin()
    schedule = await bench.check(140 * clocks * 11)
    patterns = [taken for taken in schedule.frames if not taken.texture]
    assert [taken.exposure_us for taken in patterns[1:11]] == counted


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def stop_at_any_time(dut):
    """A frame that has begun is finished, and nothing follows it."""
    clocks = parameters()["clocks"]
    changes = [(0, QUICK)]
    for part in range(1, 16):
        changes += [(part * 500 * clocks, Registers(STOP)),
                    (part * 500 * clocks + 200 * clocks + part * 17, QUICK)]
    changes = [(clock + number * 29, values) if number else (0, values)
               for number, (clock, values) in enumerate(changes)]
    bench = SequencerBench(dut, [frame()], changes)
    await bench.begin()
    schedule = await bench.check(8000 * clocks)
    assert len(schedule.running) > 15
    ends = {next(taken.texture for taken in reversed(schedule.frames) if taken.start < end)
            for _, end in schedule.running if end}
    assert ends == {False, True}, "stops behind patterns and behind textures"


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def single_pairs_wait_for_the_laser(dut):
    """Dark patterns until the guard is armed, one pair, silence; another one when asked."""
    clocks = parameters()["clocks"]
    single = Registers(SINGLE, 140, 3, 4, 2, 30)
    armed = [(0, 0), (130 * clocks, 1), (700 * clocks, 0), (1300 * clocks, 1)]
    bench = SequencerBench(
        dut, [frame()], [(0, Registers(STOP)), (5 * clocks, single),
                         (900 * clocks - 1, Registers(STOP)), (900 * clocks, single)], armed)
    await bench.begin()
    schedule = await bench.check(1800 * clocks)
    kinds = "".join("T" if taken.texture else "L" if taken.laser_requested else "D"
                    for taken in schedule.frames)
    assert kinds.count("LT") == 2 and kinds.replace("D", "") == "LTLT"
    assert kinds.startswith("DDDD") and "TDDDD" in kinds
    assert len(schedule.running) == 2 and not schedule.late


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def single_pair_without_laser(dut):
    """A guard that stays disarmed holds up the pair for `warm_up_us`, no longer."""
    clocks, warm_up_us = parameters()["clocks"], parameters()["warm_up_us"]
    bench = SequencerBench(dut, [frame()], [(0, Registers(SINGLE, 140, 3, 4, 2, 30))], [(0, 0)])
    await bench.begin()
    schedule = await bench.check((warm_up_us + 500) * clocks)
    assert not any(taken.laser_requested for taken in schedule.frames)
    assert [taken.texture for taken in schedule.frames].count(True) == 1
    first, last = schedule.frames[0], schedule.frames[-2]
    assert 0 <= last.start - first.start - warm_up_us * clocks < 40 * clocks
    assert schedule.running[0][1] is not None


@cocotb.test(timeout_time=50, timeout_unit="ms")
@cocotb.parametrize(fault=["silent", "stops", "hangs broken"])
async def imager_fails_and_comes_back(dut, fault):
    """No heartbeat meanwhile; the first frame afterwards is whole, and gives one."""
    clocks = parameters()["clocks"]
    bad = {"silent": (None, None, True, 0), "stops": (8, None, True, 400),
           "hangs broken": (8, 30, False, 300 * clocks)}[fault]
    bench = SequencerBench(dut, [frame()] * 5 + [bad] * 9 + [frame()], [(0, QUICK)])
    await bench.begin()
    schedule = await bench.check(3000 * clocks)
    outcomes = [taken.outcome for taken in schedule.frames]
    assert outcomes[:5] == ["whole"] * 5 and set(outcomes[14:]) == {"whole"}
    assert set(outcomes[5:14]) == {"broken" if fault == "hangs broken" else "missing"}
    beats = [clock for clock, _ in bench.edges["heartbeat"]]
    assert not [clock for clock in beats if schedule.frames[5].start < clock
                < schedule.frames[14].pins["sensor_read"][0]]


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def early_frames_do_not_count(dut):
    """A frame that nobody asked for, during the exposure, is none; the one asked for is."""
    clocks = parameters()["clocks"]
    bench = SequencerBench(dut, [(None, None, True, 0)] * 4 + [frame()], [
        (0, Registers(CONTINUOUS, 140, 3, 30, 2, 30))])
    cocotb.start_soon(early(bench, 4))
    await bench.begin()
    schedule = await bench.check(1200 * clocks)
    outcomes = [taken.outcome for taken in schedule.frames]
    assert outcomes[:4] == ["missing"] * 4 and set(outcomes[4:]) == {"whole"}


async def early(bench, count):
    """Frames of which the end comes when one could be expected, but not the beginning."""
    for _ in range(count):
        await RisingEdge(bench.dut.sensor_integrate)
        await ClockCycles(bench.dut.clk, 4)
        bench.dut.frame_begun.value = 1
        await RisingEdge(bench.dut.clk)
        bench.dut.frame_begun.value = 0
        await RisingEdge(bench.dut.sensor_read)
        await ClockCycles(bench.dut.clk, 6)
        bench.dut.frame_ended.value = 1
        await RisingEdge(bench.dut.clk)
        bench.dut.frame_ended.value = 0


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def counters_stop_at_255(dut):
    """So many frames missing, each pair late for it."""
    clocks = parameters()["clocks"]
    bench = SequencerBench(dut, [(None, None, True, 0)], [(0, Registers(CONTINUOUS, *[1] * 5))])
    await bench.begin()
    await bench.check(300 * 2 * 25 * clocks)
    for name in ("timeouts", "late"):
        assert bench.edges[name][-1][1] == 255
        assert getattr(dut, name).value.to_unsigned() == 255


@cocotb.test(timeout_time=50, timeout_unit="ms")
@cocotb.parametrize(after_us=[2, 5, 20, 35])
async def reset_ends_everything(dut, after_us):
    clocks = parameters()["clocks"]
    bench = SequencerBench(dut, [frame()], [(0, QUICK)])
    await bench.begin()
    await bench.until(after_us * clocks)
    dut.rst.value = 1
    await RisingEdge(dut.clk)
    await ReadOnly()
    assert not any(getattr(dut, name).value for name in (*PINS, *NUMBERS, "tag"))
    await ClockCycles(dut.clk, 400)
    assert not dut.sensor_reset.value and not dut.running.value
