import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, RisingEdge

from hdl.preprocessing.threshold import Threshold
from model.preprocessing.threshold import threshold
from tb.harness import Bench, parameters
from tb.preprocessing.histograms import directed, random_counts


class ThresholdBench(Bench):
    """The block with bins that hold whatever the bench likes."""

    def __init__(self, dut, counts=None, **plain):
        super().__init__(dut, inputs=(), outputs=(), plain={
            "closed": 0, "done": 0, "lost": 0, "count": 0, "threshold_alpha": 80, "fixed": 0,
            "fixed_level": 0, **plain})
        self.counts = counts
        cocotb.start_soon(self._bins())

    async def _bins(self):
        dut, address = self.dut, 0
        while True:
            await RisingEdge(dut.clk)
            if self.counts is not None and not dut.rst.value:
                dut.count.value = int(self.counts[address])
                address = dut.address.value.to_unsigned()
                dut.count.value = int(self.counts[address])

    async def pulse(self, name):
        getattr(self.dut, name).value = 1
        await RisingEdge(self.dut.clk)
        getattr(self.dut, name).value = 0

    async def learn(self, counts, clocks=Threshold.latency, end="done"):
        self.counts = counts
        await self.pulse("closed")
        await ClockCycles(self.dut.clk, clocks - 1)
        await self.pulse(end)
        self.counts = None
        await RisingEdge(self.dut.clk)
        return self.dut.level.value.to_unsigned()


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def levels_match_model(dut):
    """Directed histograms with their ties, then random ones, every alpha."""
    pixels, rng = parameters()["pixels"], np.random.default_rng(parameters()["seed"])
    bench = ThresholdBench(dut)
    await bench.reset()
    cases = [(name, counts, alpha) for name, counts in directed(pixels).items()
             for alpha in (0, 80, 255)]
    cases += [(f"random {number}", random_counts(rng, pixels), int(alpha)) for number, alpha in
              enumerate(rng.choice([0, 1, 15, 16, 48, 80, 128, 255], 40))]
    for name, counts, alpha in cases:
        dut.threshold_alpha.value = alpha
        got, wanted = await bench.learn(counts), threshold(counts, alpha)
        assert got == wanted, f"{name}, alpha {alpha / 16}: {got}, not {wanted}"


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def only_a_whole_frame_teaches(dut):
    """Lost at any time, or ended before the bins were closed: the old level stays."""
    pixels, rng = parameters()["pixels"], np.random.default_rng(parameters()["seed"])
    bench = ThresholdBench(dut)
    await bench.reset()
    await RisingEdge(dut.clk)
    assert not dut.threshold_valid.value
    await bench.learn(random_counts(rng, pixels), 400, "lost")
    assert not dut.threshold_valid.value
    await bench.pulse("done")
    await RisingEdge(dut.clk)
    assert not dut.threshold_valid.value
    counts = random_counts(rng, pixels)
    level = await bench.learn(counts)
    assert level == threshold(counts, 80) and dut.threshold_valid.value
    for clocks in (1, 2, 3, 5, 100, 261, 262, 263, 300, 500, 520, 600, Threshold.latency):
        other = random_counts(rng, pixels)
        assert await bench.learn(other, clocks, "lost") == level
        if clocks % 2:
            await bench.pulse("lost")
        other = random_counts(rng, pixels)
        level = await bench.learn(other)
        assert level == threshold(other, 80), f"after a frame that was lost {clocks} clocks in"


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def level_changes_with_done_alone(dut):
    pixels, rng = parameters()["pixels"], np.random.default_rng(parameters()["seed"])
    bench = ThresholdBench(dut)
    await bench.reset()
    old = await bench.learn(directed(pixels)["grey 77"])
    assert old == 78
    bench.counts = random_counts(rng, pixels)
    new = threshold(bench.counts, 80)
    assert new != old
    await bench.pulse("closed")
    for _ in range(Threshold.latency + 500):
        await RisingEdge(dut.clk)
        assert dut.level.value == old
    await bench.pulse("done")
    await RisingEdge(dut.clk)
    assert dut.level.value == new


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def fixed_level(dut):
    bench = ThresholdBench(dut, fixed=1, fixed_level=123)
    await bench.reset()
    await RisingEdge(dut.clk)
    assert dut.level.value == 123 and dut.threshold_valid.value
    await bench.learn(directed(parameters()["pixels"])["grey 77"])
    assert dut.level.value == 123
    dut.fixed.value = 0
    await RisingEdge(dut.clk)
    await RisingEdge(dut.clk)
    assert dut.level.value == 78 and dut.threshold_valid.value
