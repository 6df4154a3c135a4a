"""Bench of the remap: a table and an image beside it, and the corrected image."""

import random

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.preprocessing.remap import Remap
from model.preprocessing.remap import OUTSIDE, pack_remap, remap
from tb.harness import Bench, parameters
from tb.preprocessing.frames import BROKEN_GREY, grey_words

WIDTH, HEIGHT = parameters()["width"], parameters()["height"]
PIXELS = WIDTH * HEIGHT
WHOLE, BROKEN = 0, 1


class Rig(Bench):
    """The block with a table that answers after ``delay`` clocks or more, and an image.

    What is read of the image while its frame is not at ``start`` is garbage.
    """

    def __init__(self, dut, gap=0.0, stall=0.0, seed=1, delay=2):
        super().__init__(dut, inputs=("start",), outputs=("o", "ask"), gap=gap, stall=stall,
                         seed=seed, plain={"answer_valid": 0, "answer_payload": 0, "grey": 0})
        self.draw, self.delay, self.late = random.Random(f"remap {seed}"), delay, stall
        self.table, self.images = [0] * PIXELS, []
        self.words = []
        self.asked = []
        cocotb.start_soon(self._memories())

    async def _memories(self):
        dut, waiting, frame = self.dut, [], 0
        while True:
            await RisingEdge(dut.clk)
            if not dut.rst.value.is_resolvable or dut.rst.value:
                waiting.clear()
                dut.answer_valid.value = 0
                continue
            if dut.read.value:
                address = dut.address.value.to_unsigned()
                shown = dut.start_valid.value and not dut.start_payload.value and address < PIXELS
                dut.grey.value = int(self.images[frame].flat[address]) if shown else 77
            if dut.start_valid.value and dut.start_ready.value and not dut.start_payload.value:
                frame += 1
            answers = waiting and self.cycle - waiting[0][0] >= self.delay - 1 and (
                self.draw.random() >= self.late)
            dut.answer_valid.value = int(bool(answers))
            if answers:
                dut.answer_payload.value = int(self.words[waiting.pop(0)[1]])
            if dut.ask_valid.value and dut.ask_ready.value:
                word = dut.ask_payload.value.to_unsigned()
                self.asked.append(word)
                waiting.append((self.cycle, word))

    async def compare(self, frames):
        """Frames (None is a broken one) against the model."""
        self.words = pack_remap(self.table)
        self.images[:] += [frame for frame in frames if frame is not None]
        self.start.append([BROKEN if frame is None else WHOLE for frame in frames])
        for number, frame in enumerate(frames):
            words = BROKEN_GREY if frame is None else grey_words(remap(frame, self.table))
            got = await self.o.receive(len(words))
            for index, (mine, other) in enumerate(zip(got, words[:, 0], strict=True)):
                assert mine == other, (
                    f"frame {number}, row {index // WIDTH}, column {index % WIDTH}: "
                    f"{mine:#x}, not {other:#x}")


def random_table(rng):
    """Any pixels, and some that show nothing; sizes are so small that all differences fit."""
    table = rng.integers(0, PIXELS, PIXELS)
    table[rng.random(PIXELS) < 0.2] = OUTSIDE
    table[:4], table[-3:] = (PIXELS - 1, 0, 0, PIXELS - 1), (0, PIXELS - 1, OUTSIDE)
    return table


def random_images(rng, count):
    return [rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8) for _ in range(count)]


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def latency(dut):
    """From a frame's first word to its first pixel."""
    bench = Rig(dut)
    await bench.reset()
    clocks = {}

    async def watch():
        while True:
            await ReadOnly()
            for name in ("answer_valid", "o_valid"):
                if getattr(dut, name).value:
                    clocks.setdefault(name, bench.cycle)
            await RisingEdge(dut.clk)

    cocotb.start_soon(watch())
    await bench.compare(random_images(np.random.default_rng(1), 1))
    assert clocks["o_valid"] - clocks["answer_valid"] == Remap.latency


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.4], stall=[0.0, 0.4], delay=[1, 2, 30])
async def frames_match_model(dut, gap, stall, delay):
    rng = np.random.default_rng([parameters()["seed"], delay])
    bench = Rig(dut, gap, stall, parameters()["seed"], delay)
    await bench.reset()
    bench.table = random_table(rng)
    one, two, three = random_images(rng, 3)
    await bench.compare([None, one, two, None, None, three, None])
    assert bench.asked == 3 * list(range((PIXELS + 1) // 2))


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def a_pixel_a_clock(dut):
    """Frames back to back at full rate, answers 2 to 12 clocks late."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = Rig(dut)
    await bench.reset()
    bench.table = random_table(rng)
    bench.words = pack_remap(bench.table)
    for delay in (1, 2, 12):
        bench.delay = delay
        bench.images += random_images(rng, 2)
        bench.o.words.clear()
        bench.start.taken.clear()
        bench.start.append([WHOLE, WHOLE])
        while len(bench.o.words) < 2 * PIXELS:
            await RisingEdge(dut.clk)
        clocks = np.array([clock for clock, _ in bench.o.words])
        for frame in clocks[:PIXELS], clocks[PIXELS:]:
            assert frame[-1] - frame[0] == PIXELS - 1, f"answers after {delay} clocks"
        assert clocks[PIXELS] - clocks[PIXELS - 1] <= delay + 6
        # The frame is let go before its last pixels have left.
        assert bench.start.taken[0] <= clocks[PIXELS - 1] + 1


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def asks_for_no_more_than_there_is_room_for(dut):
    bench = Rig(dut, stall=1.0)
    bench.ask.stall = bench.late = 0.0
    await bench.reset()
    bench.table, bench.images = list(range(PIXELS)), random_images(np.random.default_rng(1), 1)
    bench.words = pack_remap(bench.table)
    bench.start.append([WHOLE])
    await ClockCycles(dut.clk, 60)
    assert len(bench.asked) == 9 and not bench.start.taken
    bench.o.stall = 0.0
    assert [int(word) for word in await bench.o.receive(PIXELS)] == [
        int(word) for word in grey_words(bench.images[0])[:, 0]]


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(clocks=[1, 2, 5, 6, 40, 150])
async def reset_forgets(dut, clocks):
    rng = np.random.default_rng([parameters()["seed"], clocks])
    bench = Rig(dut, stall=0.2, seed=clocks)
    await bench.reset()
    bench.table, bench.images = random_table(rng), random_images(rng, 1)
    bench.words = pack_remap(bench.table)
    dut.start_valid.value, dut.start_payload.value = 1, WHOLE
    await ClockCycles(dut.clk, clocks)
    dut.start_valid.value = 0
    await bench.reset()
    bench.o.words.clear()
    bench.images = []
    # The memories of the bench count frames from the first one that was taken.
    await bench.compare(random_images(rng, 2))
