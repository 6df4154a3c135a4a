"""The sequencer with its laser guard at real times: start, faults, and the video rate."""

import cocotb
import numpy as np
from cocotb.simtime import get_sim_time
from cocotb.triggers import Edge, First, ReadOnly, RisingEdge, Timer

from hdl.payloads import FrameTag
from hdl.protocol import GUARD_CAUSES, Mode, registers
from tb.harness import Bench, parameters
from tb.native_block import unpack

WIDTH, HEIGHT, PIXEL_HZ, BLANKING = 352, 288, 8_000_000, 48
#: Microseconds from a frame's first pixel to its last, at the most line blanking.
READOUT_US = ((WIDTH + BLANKING) * HEIGHT - BLANKING) * 1_000_000 / PIXEL_HZ
PERIOD_US = 40_000


class GuardedBench(Bench):
    """An imager that reads out CIF frames, and a record of frames and light; microseconds."""

    def __init__(self, dut, **changes):
        self.clocks = parameters()["clocks"]
        self.registers = {register.name: register.reset for register in registers()
                          if register.name in ("mode", *(f"{name}_us" for name in (
                              "period", "pattern_reset", "pattern", "texture_reset", "texture")))}
        self.registers |= {"mode": Mode.CONTINUOUS, **changes}
        super().__init__(dut, inputs=(), outputs=(), plain={
            **self.registers, "enable": 1, "tables_valid": 1, "clear": 0, "frame_begun": 0,
            "frame_ended": 0, "frame_broken": 0, "sending": 0})
        self.works = True  # the imager
        self.frames = []  # (time of the first pixel, texture, laser, exposure)
        self.exposures = []  # times of integrations, with `texture`
        self.pulses = []  # [time of the first edge, time of the last edge]

    @property
    def now(self):
        return get_sim_time("ns") / 10 / self.clocks

    async def begin(self):
        await self.reset()
        for task in (self._imager(), self._light(), self._exposures()):
            cocotb.start_soon(task)

    async def _count(self):
        """Nobody needs the number of clocks, and counting takes longer than all the rest."""

    async def wait(self, microseconds):
        """So many microseconds' clocks; to be called right behind a clock's edge."""
        clocks = round(microseconds * self.clocks)
        if clocks > 1:
            await Timer(10 * clocks - 5, unit="ns")
        await RisingEdge(self.dut.clk)

    async def _pulse(self, name):
        getattr(self.dut, name).value = 1
        await RisingEdge(self.dut.clk)
        getattr(self.dut, name).value = 0

    async def _imager(self):
        while True:
            await RisingEdge(self.dut.sensor_read)
            if not self.works:
                continue
            await self.wait(1)
            tag = unpack(FrameTag, np.array([[
                self.dut.tag.value.to_unsigned() >> 32 * word & 0xFFFFFFFF for word in (0, 1)]],
                dtype=np.uint32))[0]
            self.dut.sending.value = 1
            await self._pulse("frame_begun")
            await self.wait(READOUT_US - 1 / self.clocks)
            if self.works:
                self.frames.append((self.now, *(
                    int(tag[name]) for name in ("texture", "laser", "exposure_us"))))
                await self._pulse("frame_ended")
            self.dut.sending.value = 0

    async def _exposures(self):
        while True:
            await RisingEdge(self.dut.sensor_integrate)
            self.exposures.append(self.now)

    async def _light(self):
        while True:
            await Edge(self.dut.laser)
            if not self.pulses or self.now - self.pulses[-1][1] > 1.5 / self.clocks:
                self.pulses.append([self.now, self.now])
            self.pulses[-1][1] = self.now

    async def rises(self, name, limit_us):
        """Time until the output rises; 0 if it is high."""
        return await self._until(name, 1, limit_us)

    async def falls(self, name, limit_us):
        return await self._until(name, 0, limit_us)

    async def _until(self, name, level, limit_us):
        begin, signal = self.now, getattr(self.dut, name)
        await ReadOnly()
        while signal.value != level:
            assert self.now - begin < limit_us, f"{name} is not {level} after {limit_us} us"
            await First(Edge(signal), Timer(round(limit_us * self.clocks * 10) + 10, unit="ns"))
            await ReadOnly()
        elapsed = self.now - begin
        await RisingEdge(self.dut.clk)
        return elapsed

    def causes(self):
        value = self.dut.causes.value.to_unsigned()
        return {name for bit, name in enumerate(GUARD_CAUSES) if value >> bit & 1}

    def check_light(self):
        """What the guard promises, as the pin shows it."""
        for rise, last in self.pulses:
            assert last - rise <= 1000
        rises = [rise for rise, _ in self.pulses]
        assert not rises or np.diff(rises).min(initial=np.inf) >= 20_000


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def dark_patterns_first(dut):
    """The guard has its heartbeats before the first request, and nothing to blame anyone for."""
    bench = GuardedBench(dut)
    await bench.begin()
    await bench.wait(190_000)
    kinds = "".join("T" if texture else "L" if laser else "D"
                    for _, texture, laser, _ in bench.frames)
    assert kinds == "DDDLTLTLTL", kinds
    assert not bench.causes() and len(bench.pulses) == 4
    assert all(abs(last - rise - 500) < 1 for rise, last in bench.pulses)
    bench.check_light()


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def dark_pairs_without_tables(dut):
    """Without tables pairs are dark, and the guard is not asked; with them there is light."""
    bench = GuardedBench(dut)
    dut.tables_valid.value = 0
    await bench.begin()
    await bench.wait(230_000)
    assert not any(laser for _, _, laser, _ in bench.frames) and not bench.pulses
    assert sum(texture for _, texture, _, _ in bench.frames) >= 2
    dut.tables_valid.value = 1
    await bench.wait(60_000)
    assert bench.frames[-1][2] or bench.frames[-2][2]
    assert not bench.causes()
    bench.check_light()


async def settled(bench):
    """A pair with light has begun; 0 is the start of its pattern's reset."""
    await bench.begin()
    await bench.rises("armed", 100_000)
    await bench.wait(30_000)
    await bench.rises("pattern_start", PERIOD_US)
    assert not bench.causes()


def lit_frames(bench, since):
    return [time for time, _, laser, _ in bench.frames if laser and time >= since]


@cocotb.test(timeout_time=50, timeout_unit="ms")
@cocotb.parametrize(at_us=[50, 350, 601, 14_500, 20_000, 38_000])
async def hang(dut, at_us):
    """The clock enable sticks at any place: the pulse ends, the guard disarms and says why."""
    bench = GuardedBench(dut)
    await settled(bench)
    await bench.wait(at_us)
    dut.enable.value = 0
    assert await bench.falls("armed", 2 * PERIOD_US) <= 2 * PERIOD_US
    await RisingEdge(dut.clk)
    assert "heartbeat" in bench.causes()
    assert ("pulse" in bench.causes()) == (100 < at_us < 600)
    await bench.wait(PERIOD_US)
    hung = bench.now
    dut.enable.value = 1
    await bench.wait(2 * PERIOD_US)
    assert lit_frames(bench, hung), "no frame with light within two periods"
    bench.check_light()


@cocotb.test(timeout_time=50, timeout_unit="ms")
@cocotb.parametrize(at_us=[50, 350, 5000, 14_500, 38_000])
async def imager_stops(dut, at_us):
    """It stops before, during and after a read-out: disarmed in time, and light soon again."""
    bench = GuardedBench(dut)
    await settled(bench)
    await bench.wait(at_us)
    bench.works = False
    assert await bench.falls("armed", 2 * PERIOD_US) <= 2 * PERIOD_US
    await RisingEdge(dut.clk)
    assert "heartbeat" in bench.causes() and dut.silent.value and dut.timeouts.value
    await bench.wait(PERIOD_US + at_us)
    back = bench.now
    bench.works = True
    await bench.wait(2 * PERIOD_US)
    assert lit_frames(bench, back), "no frame with light within two periods"
    assert not dut.silent.value
    bench.check_light()


@cocotb.test(timeout_time=80, timeout_unit="ms")
async def video_rate(dut):
    """25 pairs a second at CIF, 8 MHz and 48 clocks of line blanking, with the longest pulse.

    All that the 40 ms leave beside two read-outs goes to the texture's exposure; a microsecond
    more and the pairs are late.
    """
    pattern_us, resets_us = 1000, 200
    frames_us = 2 * (1 + READOUT_US)  # the imager begins a microsecond after `sensor_read` rose
    clocks_us = 2 * 6 / parameters()["clocks"]  # of the schedule, between the frames
    texture_us = int(PERIOD_US - frames_us - clocks_us - pattern_us - resets_us)
    assert texture_us >= 10_000
    bench = GuardedBench(dut, pattern_us=pattern_us, texture_us=texture_us)
    await settled(bench)
    first = len(bench.exposures)
    await bench.wait(3 * PERIOD_US)
    patterns = bench.exposures[first::2]
    dut._log.info("texture exposure of %d us fits", texture_us)
    assert len(patterns) >= 3 and np.allclose(np.diff(patterns), PERIOD_US, rtol=0, atol=1e-6)
    assert dut.late.value == 0 and not bench.causes()
    dut.texture_us.value = texture_us + 1
    await bench.wait(2 * PERIOD_US)
    assert dut.late.value.to_unsigned() >= 1
    bench.check_light()
