"""Bench of the image bank: what is read is what was stored, and nobody's frame but its own."""

import random

import cocotb
import numpy as np
from cocotb.triggers import RisingEdge

from hdl.acquisition.image_bank import ImageBank
from tb.harness import Bench, parameters
from tb.preprocessing.frames import BROKEN_GREY, grey_words

SEED, WIDTH, HEIGHT = parameters()["seed"], parameters()["width"], parameters()["height"]
PIXELS = WIDTH * HEIGHT
BROKEN = int(BROKEN_GREY[0][0])


class Rig(Bench):
    def __init__(self, dut, gap=0.0):
        super().__init__(dut, inputs=(), outputs=(), seed=SEED, plain={
            "i_valid": 0, "i_payload": 0, "stored_ready": 0, "address": 0, "read": 0})
        self.gap = gap

    async def show(self, words):
        """Pixels at the pins, which wait for nobody."""
        dut = self.dut
        for word in words:
            while self.gap and self.rng.random() < self.gap:
                dut.i_valid.value, dut.i_payload.value = 0, self.rng.getrandbits(11)
                await RisingEdge(dut.clk)
            dut.i_valid.value, dut.i_payload.value = 1, int(word)
            await RisingEdge(dut.clk)
        dut.i_valid.value, dut.i_payload.value = 0, self.rng.getrandbits(11)

    async def compare(self, image, addresses):
        """Read pixels, one a clock with pauses, and compare them with the image."""
        dut, waiting = self.dut, [None] * ImageBank.latency
        for address in [*addresses, None]:
            reads = address is not None and self.rng.random() < 0.8
            dut.read.value = int(reads)
            dut.address.value = address if reads else self.rng.getrandbits(18)
            await RisingEdge(dut.clk)
            if waiting[0] is not None:
                grey = dut.grey.value.to_unsigned()
                assert grey == image.flat[waiting[0]], (
                    f"row {waiting[0] // WIDTH}, column {waiting[0] % WIDTH}: {grey}, "
                    f"not {image.flat[waiting[0]]}")
            waiting = [*waiting[1:], address if reads else waiting[-1]]
        dut.read.value = 0

    async def taken(self):
        """Let go of the frame; gives what was shown of it."""
        dut = self.dut
        dut.stored_ready.value = 1
        await RisingEdge(dut.clk)
        assert dut.stored_valid.value and not dut.free.value
        broken = int(dut.stored_payload.value)
        dut.stored_ready.value = 0
        await RisingEdge(dut.clk)
        assert not dut.stored_valid.value and dut.free.value
        return broken


def words_of(image):
    return grey_words(image)[:, 0].tolist()


@cocotb.test(timeout_time=100, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.3])
async def frames_come_back(dut, gap):
    rng = np.random.default_rng([SEED, int(10 * gap)])
    bench = Rig(dut, gap)
    await bench.reset()
    edges = [0, PIXELS - 1, WIDTH - 1, min(1 << 14, PIXELS) - 1, min(1 << 14, PIXELS - 1), 1]
    for number in range(3):
        image = rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
        assert dut.free.value and not dut.stored_valid.value
        await bench.show(words_of(image)[:1])
        await RisingEdge(dut.clk)
        assert not dut.free.value
        await bench.show(words_of(image)[1:])
        await RisingEdge(dut.clk)
        assert dut.stored_valid.value and not dut.free.value
        if number == 0:
            await bench.compare(image, range(PIXELS))
        await bench.compare(image, [*edges, *rng.integers(0, PIXELS, 300).tolist(), *edges])
        assert await bench.taken() == 0


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(cut=[1, 7, PIXELS // 2, PIXELS - 1])
async def broken_frames_are_told_of_and_leave_no_trace(dut, cut):
    rng = np.random.default_rng([SEED, cut])
    bench = Rig(dut)
    await bench.reset()
    for _ in range(2):
        one, other = rng.integers(0, 256, (2, HEIGHT, WIDTH)).astype(np.uint8)
        await bench.show([*words_of(one)[:cut], BROKEN])
        await RisingEdge(dut.clk)
        assert dut.stored_valid.value and not dut.free.value
        assert await bench.taken() == 1
        assert dut.free.value
        await bench.show(words_of(other))
        await bench.compare(other, rng.integers(0, PIXELS, 300).tolist())
        assert await bench.taken() == 0


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def reset_empties_the_bank(dut):
    bench = Rig(dut)
    await bench.reset()
    image = random.Random(SEED).randbytes(PIXELS)
    image = np.frombuffer(image, np.uint8).reshape(HEIGHT, WIDTH)
    for length in (5, PIXELS):
        await bench.show(words_of(image)[:length])
        await bench.reset()
        assert dut.free.value and not dut.stored_valid.value
    await bench.show(words_of(image))
    await bench.compare(image, range(0, PIXELS, 7))
