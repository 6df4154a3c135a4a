import cocotb
import numpy as np
from cocotb.triggers import RisingEdge

from hdl.payloads import GreyPixel
from hdl.preprocessing.histogram import Histogram
from model.preprocessing.histogram import counted_rows, histogram
from tb.harness import Bench, parameters
from tb.native_block import pack
from tb.preprocessing.frames import BROKEN_GREY, grey_words


class HistogramBench(Bench):
    """Shows words to the block, which takes each in its clock, and reads the bins it closed."""

    def __init__(self, dut):
        super().__init__(dut, inputs=(), outputs=(),
                         plain={"i_valid": 0, "i_payload": 0, "address": 0})
        self.read, self.ends = [], []
        cocotb.start_soon(self._read())

    async def show(self, words, gap=0.0, rng=None):
        dut = self.dut
        for word in np.asarray(words).ravel():
            while gap and rng.random() < gap:
                dut.i_valid.value = 0
                dut.i_payload.value = int(rng.integers(1 << 11))  # nobody may look at it
                await RisingEdge(dut.clk)
            dut.i_valid.value, dut.i_payload.value = 1, int(word)
            await RisingEdge(dut.clk)
        dut.i_valid.value = 0

    async def _read(self):
        """From the clock after `closed`, an address a clock; what `done` and `lost` say."""
        dut = self.dut
        while True:
            await RisingEdge(dut.clk)
            if dut.closed.value != 1:
                continue
            counts = []
            for clock in range(256 + Histogram.latency):
                dut.address.value = clock % 256
                await RisingEdge(dut.clk)
                if clock >= Histogram.latency:
                    counts.append(dut.count.value.to_unsigned())
            self.read.append(counts)


def images(rng, height, width):
    """Whatever makes the same bin come again at once, soon, or never."""
    yield rng.integers(0, 256, (height, width))
    for grey in (0, 255, 77):
        yield np.full((height, width), grey)
    yield np.indices((height, width)).sum(0) % 2 * 200
    yield np.indices((height, width)).sum(0) // 2 % 2
    yield rng.choice([3, 4], (height, width))
    yield rng.choice([0, 255, 128], (height, width), p=[0.9, 0.05, 0.05])


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.3])
async def bins_match_model(dut, gap):
    """Frames without a clock between, and with random gaps."""
    width, height = parameters()["width"], parameters()["height"]
    rng = np.random.default_rng(parameters()["seed"])
    bench = HistogramBench(dut)
    await bench.reset()
    wanted = []
    for image in images(rng, height, width):
        image = image.astype(np.uint8)
        wanted.append(histogram(image).tolist())
        await bench.show(grey_words(image), gap, rng)
    assert len(bench.read) == len(wanted)
    for number, (mine, other) in enumerate(zip(bench.read, wanted, strict=True)):
        assert mine == other, f"frame {number}"


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.3])
async def a_broken_frame_leaves_nothing(dut, gap):
    """Broken before, within, and after the rows that count; the next frame begins at once."""
    width, height = parameters()["width"], parameters()["height"]
    rng = np.random.default_rng(parameters()["seed"])
    bench = HistogramBench(dut)
    await bench.reset()
    first, stop = counted_rows(width, height)
    cuts = [0, 1, first * width - 1, first * width, first * width + 1, stop * width - 1,
            stop * width + 300, width * height - 1]
    wanted = []
    for cut in cuts:
        image = rng.choice([7, 8], (height, width)).astype(np.uint8)
        await bench.show(np.concatenate([grey_words(image)[:cut], BROKEN_GREY | 7]), gap, rng)
        if cut >= stop * width:
            wanted.append(histogram(image).tolist())
        image = rng.integers(5, 12, (height, width)).astype(np.uint8)
        wanted.append(histogram(image).tolist())
        await bench.show(grey_words(image), gap, rng)
    assert bench.read == wanted


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def ends_are_reported(dut):
    """``done`` and ``lost`` come in the very clock of the frame's last beat, never else."""
    bench = HistogramBench(dut)
    await bench.reset()
    ended = {(0, 0): 0, (1, 0): 0, (0, 1): 0, (1, 1): 0}

    async def watch():
        while True:
            await RisingEdge(dut.clk)
            valid = bool(dut.i_valid.value)
            payload = dut.i_payload.value.to_unsigned()
            lost = valid and payload >> 10 == 1
            done = valid and not lost and payload >> 9 & 1 == 1
            assert (bool(dut.done.value), bool(dut.lost.value)) == (done, lost)
            ended[int(done), int(lost)] += 1

    cocotb.start_soon(watch())
    end = pack(GreyPixel, grey=[9], marker_line_end=[1], marker_frame_end=[1])
    rng = np.random.default_rng(1)
    for _ in range(20):
        await bench.show(np.concatenate([pack(GreyPixel, grey=[1, 2]), end, BROKEN_GREY, end]),
                         0.3, rng)
    await RisingEdge(dut.clk)
    assert (ended[1, 0], ended[0, 1], ended[1, 1]) == (40, 20, 0)
