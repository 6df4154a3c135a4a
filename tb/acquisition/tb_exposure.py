"""The reset and integration-time unit against its model, every clock of every pin."""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, FallingEdge, ReadOnly, RisingEdge

from hdl.acquisition.exposure import Exposure
from model.acquisition.exposure import exposure
from tb.harness import Bench, parameters

PINS = ("sensor_reset", "sensor_integrate", "sensor_read", "laser_request")
PULSES = ("integrated", "done")


class ExposureBench(Bench):
    """Records in which clocks outputs change; clock 0 is the first after reset."""

    def __init__(self, dut):
        self.clocks = parameters()["clocks"]
        super().__init__(dut, inputs=(), outputs=(), plain={
            "start": 0, "reset_us": 0, "exposure_us": 0, "laser": 0})
        self.edges = {name: [] for name in (*PINS, *PULSES)}
        for name in self.edges:
            cocotb.start_soon(self._watch(name))

    async def _watch(self, name):
        signal = getattr(self.dut, name)
        while True:
            await RisingEdge(signal)
            await ReadOnly()
            self.edges[name].append(self.cycle)
            await FallingEdge(signal)
            await ReadOnly()
            self.edges[name].append(self.cycle)

    def wanted(self, timelines):
        """The same of model timelines."""
        edges = {name: [] for name in self.edges}
        for timeline in timelines:
            for name, value in timeline.items():
                edges[name] += value if name not in PULSES else (value, value + 1)
        return edges

    async def start(self, reset_us, exposure_us, laser):
        """Starts an exposure, then changes what it was given; its timeline from the model."""
        dut = self.dut
        dut.reset_us.value, dut.exposure_us.value = reset_us, exposure_us
        dut.laser.value, dut.start.value = laser, 1
        await ReadOnly()
        timeline = exposure(self.clocks * 1_000_000, reset_us, exposure_us, laser, self.cycle)
        assert timeline["sensor_reset"][0] - self.cycle == Exposure.latency
        await RisingEdge(dut.clk)
        dut.start.value = 0
        dut.reset_us.value, dut.exposure_us.value = ~reset_us & 0xFFFF, 7
        dut.laser.value = 1 - laser
        await ReadOnly()
        assert dut.latched_us.value == max(1, exposure_us)
        return timeline

    async def done(self):
        await RisingEdge(self.dut.done)
        await ClockCycles(self.dut.clk, 2)


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def random_times(dut):
    """Exposures one after the other; what changes meanwhile, and further starts, do nothing."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = ExposureBench(dut)
    await bench.reset()
    timelines = []
    for _ in range(60):
        reset_us, exposure_us = (int(value) for value in rng.integers(1, (30, 60)))
        timelines.append(await bench.start(reset_us, exposure_us, int(rng.integers(2))))
        await ClockCycles(dut.clk, 2)
        dut.start.value = 1  # ignored
        await FallingEdge(dut.sensor_integrate)
        await RisingEdge(dut.clk)
        dut.start.value = 0
        await bench.done()
        for _ in range(int(rng.integers(0, 4))):
            await RisingEdge(dut.clk)
    assert bench.edges == bench.wanted(timelines)


@cocotb.test(timeout_time=20, timeout_unit="ms")
@cocotb.parametrize(
    times=[(0, 0), (0, 1), (1, 0), (1, 1), (1, 2), (2, 1), (256, 257), (1, 65_535), (65_535, 1)])
async def limits(dut, times):
    reset_us, exposure_us = times
    laser = exposure_us & 1
    bench = ExposureBench(dut)
    await bench.reset()
    timelines = [await bench.start(reset_us, exposure_us, laser)]
    await bench.done()
    timelines.append(await bench.start(1, 1, 1))
    await bench.done()
    assert bench.edges == bench.wanted(timelines)


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def back_to_back(dut):
    """Started in the clock of `done`, an exposure costs its microseconds and one clock."""
    bench = ExposureBench(dut)
    await bench.reset()
    timelines = []
    await RisingEdge(dut.clk)
    for _ in range(5):
        timelines.append(await bench.start(3, 5, 1))
        await RisingEdge(dut.done)
    assert bench.wanted(timelines)["sensor_reset"] == bench.edges["sensor_reset"]
    starts = [timeline["sensor_reset"][0] for timeline in timelines]
    assert np.all(np.diff(starts) == (3 + 5 + 1) * bench.clocks + 1)


@cocotb.test(timeout_time=20, timeout_unit="ms")
@cocotb.parametrize(after_us=[0, 4, 9])
async def reset_ends_everything(dut, after_us):
    """Reset lowers all pins in the next clock, and the next exposure is exact."""
    bench = ExposureBench(dut)
    await bench.reset()
    await bench.start(4, 5, 1)
    for _ in range(after_us * bench.clocks + 1):
        await RisingEdge(dut.clk)
    assert any(getattr(dut, name).value for name in PINS)
    dut.rst.value = 1
    await RisingEdge(dut.clk)
    await ReadOnly()
    assert not any(getattr(dut, name).value for name in (*PINS, *PULSES, "busy"))
    await RisingEdge(dut.clk)
    await bench.reset()
    for edges in bench.edges.values():
        edges.clear()
    timelines = [await bench.start(2, 3, 1)]
    await bench.done()
    assert bench.edges == bench.wanted(timelines)
