"""An imager in a clock of its own in front of the camera block."""

import cocotb
import numpy as np
from cocotb.simtime import get_sim_time
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.acquisition.camera import Camera
from model.acquisition.camera import BROKEN, FRAME_END, OVERRUN, camera
from tb.acquisition.pins import FAULTS, show
from tb.harness import Bench, parameters, start_clock

WIDTH, HEIGHT = 24, 6


class CameraBench(Bench):
    """``pixel_ps``: the imager's clock period, the system's being 10,000."""

    def __init__(self, dut, pixel_ps, stall=0.0, seed=1):
        super().__init__(dut, inputs=(), stall=stall, seed=seed)
        self.shown = []
        dut.pixel_rst.value = 1
        self.pins((0, 0, 0))
        start_clock(dut.pixel_clk, pixel_ps)

    def pins(self, sample):
        frame_valid, line_valid, data = (int(value) for value in sample)
        self.dut.frame_valid.value = frame_valid
        self.dut.line_valid.value = line_valid
        self.dut.data.value = data

    async def begin(self):
        await ClockCycles(self.dut.pixel_clk, 3)
        await self.reset()
        await RisingEdge(self.dut.pixel_clk)
        self.dut.pixel_rst.value = 0

    async def show(self, samples):
        for sample in samples:
            self.pins(sample)
            self.shown.append(tuple(sample))
            await RisingEdge(self.dut.pixel_clk)
        self.pins((0, 0, 0))

    async def settle(self):
        """Until nothing comes any more; what came, as grey values and markers."""
        before = -1
        while before != len(self.o.words):
            before = len(self.o.words)
            await ClockCycles(self.dut.clk, 64)
            await ClockCycles(self.dut.pixel_clk, 8)
        words = np.array([word for _, word in self.o.words])
        grey, marker = words & 0xFF, words >> 8
        return np.where(marker & BROKEN, grey & 3, grey), marker

    def expected(self):
        samples = np.array([(0, 0, 0)] + self.shown + [(0, 0, 0)])
        return camera(samples[:, 0], samples[:, 1], samples[:, 2], WIDTH, HEIGHT)

    async def check(self):
        got, wanted = await self.settle(), self.expected()
        for name, mine, other in zip(("grey", "marker"), got, wanted, strict=True):
            assert len(mine) == len(other), f"{len(mine)} beats, not {len(other)}"
            wrong = np.flatnonzero(mine != other)
            assert not wrong.size, f"{name} of beat {wrong[0]}: {mine[wrong[0]]}, " \
                                   f"not {other[wrong[0]]}"
        breaks = int(np.count_nonzero(wanted[1] & BROKEN))
        assert self.dut.bad_sync.value.to_unsigned() == min(255, breaks)
        assert self.dut.overrun.value.to_unsigned() == 0


def pause(pixel_ps):
    """Clocks between lines that a system slower than the imager needs to catch up."""
    return -(-WIDTH * max(0, 10_000 - pixel_ps) // pixel_ps) + 1 if pixel_ps < 9_900 else 0


def random_image(rng):
    return rng.integers(0, 256, (HEIGHT, WIDTH))


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(pixel_ps=[10_000, 9_980, 10_020, 7_300, 13_700, 41_000], blanking=[0, 12])
async def good_frames(dut, pixel_ps, blanking):
    """Slower, nearly equal and faster imagers; the fast one must pause for the slow system."""
    if pixel_ps < 9_000 and not blanking:
        return
    rng = np.random.default_rng([parameters()["seed"], pixel_ps, blanking])
    bench = CameraBench(dut, pixel_ps)
    await bench.begin()
    for _ in range(4):
        await bench.show(show(rng, random_image(rng), blanking=blanking, least=pause(pixel_ps)))
    await bench.check()


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(pixel_ps=[10_000, 9_998, 13_700, 41_000])
async def latency(dut, pixel_ps):
    """From the edge that samples a pixel to the end of the clock in which it is valid."""
    rng = np.random.default_rng(pixel_ps)
    bench = CameraBench(dut, pixel_ps)
    sampled, valid = [], []

    async def pixels():
        while True:
            await ReadOnly()
            brings = dut.frame_valid.value and dut.line_valid.value
            await RisingEdge(dut.pixel_clk)
            if brings:
                sampled.append(get_sim_time("ps"))

    async def words():
        while True:
            await ReadOnly()
            shows = dut.o_valid.value
            await RisingEdge(dut.clk)
            if shows:
                valid.append(get_sim_time("ps"))

    await bench.begin()
    cocotb.start_soon(pixels())
    cocotb.start_soon(words())
    await bench.show(show(rng, random_image(rng)))
    await bench.check()
    assert len(sampled) == len(valid) == WIDTH * HEIGHT
    clocks = (np.array(valid) - sampled - pixel_ps) / 10_000
    assert Camera.latency - 1 < clocks.max() <= Camera.latency


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def no_blanking_at_all(dut):
    """One clock without frame_valid between frames and none between lines, at the same clock."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = CameraBench(dut, 10_000)
    await bench.begin()
    for _ in range(3):
        pixels = random_image(rng).ravel()
        await bench.show([(0, 0, 0)] + [(1, 1, value) for value in pixels])
    await bench.check()
    clocks = np.diff([clock for clock, _ in bench.o.words])
    assert clocks.max() <= 2, "the stream stood still although a pixel came every clock"


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(pixel_ps=[10_000, 8_900, 23_000], stall=[0.0, 0.1])
async def faults(dut, pixel_ps, stall):
    """Every fault, then a good frame, then faults in a random order."""
    if pixel_ps < 10_000 and stall:
        return
    rng = np.random.default_rng([parameters()["seed"], pixel_ps])
    bench = CameraBench(dut, pixel_ps, stall if pixel_ps > 10_000 else 0.0)
    await bench.begin()
    order = [kind for fault in FAULTS for kind in (fault, None)]
    order += list(rng.choice(np.array(FAULTS), 12)) + [None]
    for fault in order:
        await bench.show(show(rng, random_image(rng), fault, least=pause(pixel_ps)))
    await bench.check()


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def random_pins(dut):
    """Pins that make no sense, then a good frame."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = CameraBench(dut, 17_000)
    await bench.begin()
    frame, line, samples = 0, 0, []
    for _ in range(3000):
        frame ^= rng.random() < 0.02
        line ^= rng.random() < 0.08
        samples.append((int(frame), int(line), int(rng.integers(256))))
    await bench.show(samples + [(0, 0, 0)])
    await bench.show(show(rng, random_image(rng)))
    await bench.check()


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def wakes_within_a_frame(dut):
    """Out of reset while the imager is in the middle of a frame: that frame does not exist."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = CameraBench(dut, 10_000)
    bench.pins((1, 1, 5))
    await bench.begin()
    await bench.show([(1, 1, 5)] * WIDTH + [(1, 0, 0)] * 3 + [(1, 1, 6)] * WIDTH)
    bench.shown.clear()
    await bench.show(show(rng, random_image(rng)))
    await bench.check()


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(pixel_ps=[10_000, 9_000, 26_000])
@cocotb.parametrize(hold=[30, 200, 900])
async def overrun(dut, pixel_ps, hold):
    """The reader stops for a while: frames break, none is wrong, the first after is whole."""
    rng = np.random.default_rng([parameters()["seed"], hold, pixel_ps])
    bench = CameraBench(dut, pixel_ps)
    await bench.begin()
    images = []
    for number in range(16):
        images.append(np.concatenate([[number], random_image(rng).ravel()[1:]]))
        samples = show(rng, images[-1].reshape(HEIGHT, WIDTH), least=pause(pixel_ps))
        if number == 3:
            at = int(rng.integers(len(samples)))
            await bench.show(samples[:at])
            bench.o.stall = 1.0

            async def release():
                await ClockCycles(dut.clk, hold)
                bench.o.stall = 0.0

            cocotb.start_soon(release())
            samples = samples[at:]
        await bench.show(samples)
    grey, marker = await bench.settle()
    ends = np.flatnonzero(marker & FRAME_END) + 1
    whole, broken = [], 0
    for pixels, markers in zip(np.split(grey, ends[:-1]), np.split(marker, ends[:-1]), strict=True):
        if markers[-1] & BROKEN:
            assert pixels[-1] == OVERRUN
            assert not len(pixels[:-1]) or np.array_equal(
                pixels[:-1], images[pixels[0]][:len(pixels) - 1])
            broken += 1
        else:
            assert np.array_equal(pixels, images[pixels[0]])
            whole.append(int(pixels[0]))
    assert whole[:3] == [0, 1, 2]
    lost = sorted(set(range(16)) - set(whole))
    period = (WIDTH + 6) * HEIGHT * pixel_ps / 10_000
    assert len(lost) <= hold / period + 3, f"frames {lost} are lost"
    assert lost == list(range(lost[0], lost[-1] + 1)) if lost else hold < 60
    assert bool(lost) <= broken <= len(lost)
    assert dut.overrun.value.to_unsigned() == broken
    assert dut.bad_sync.value.to_unsigned() == 0


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def overrun_ends_as_a_frame_begins(dut):
    """The queue has room again in every clock around a frame's first pixel."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = CameraBench(dut, 10_000)
    await bench.begin()
    number = 0
    for offset in range(-10, 6):
        images = []
        for _ in range(4):
            images.append(np.concatenate([[number], random_image(rng).ravel()[1:]]))
            number += 1
        for place, image in enumerate(images):
            samples = [(0, 0, 0)] * 20 + [(1, 1, int(value)) for value in image]
            bench.o.stall = 1.0 if place == 1 else bench.o.stall
            at = 20 + offset if place == 2 else 0
            await bench.show(samples[:at])
            bench.o.stall = 0.0 if place != 1 else 1.0
            await bench.show(samples[at:])
        grey, marker = await bench.settle()
        bench.o.words.clear()
        ends = np.flatnonzero(marker & FRAME_END) + 1
        frames = {}
        for pixels, markers in zip(np.split(grey, ends[:-1]), np.split(marker, ends[:-1]),
                                 strict=True):
            if not markers[-1] & BROKEN:
                frames[int(pixels[0])] = pixels
        first = number - 4
        assert first in frames and first + 1 not in frames and first + 3 in frames
        for name, pixels in frames.items():
            assert np.array_equal(pixels, images[name - first]), f"offset {offset}"


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def torn_while_the_queue_is_full(dut):
    """A frame ends early when it has just filled the queue: its end is reported all the same."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = CameraBench(dut, 10_000)
    await bench.begin()
    for pixels in range(13, 22):
        images = [random_image(rng), random_image(rng)]
        await bench.show([(0, 0, 0)] * 30)
        bench.o.stall = 1.0
        await bench.show([(1, 1, int(value)) for value in images[0].ravel()[:pixels]])
        await bench.show([(0, 0, 0)] * 12)
        bench.o.stall = 0.0
        await bench.show([(0, 0, 0)] * 30)
        await bench.show([(1, 1, int(value)) for value in images[1].ravel()])
        grey, marker = await bench.settle()
        bench.o.words.clear()
        lost = len(grey) - WIDTH * HEIGHT - 1
        assert np.array_equal(grey[:lost], images[0].ravel()[:lost])
        assert not marker[:lost].any() and marker[lost] & BROKEN
        assert np.array_equal(grey[lost + 1:], images[1].ravel()), f"after {pixels} pixels"
    counted = dut.bad_sync.value.to_unsigned() + dut.overrun.value.to_unsigned()
    assert counted == 9 and dut.bad_sync.value and dut.overrun.value


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def counters_stop_at_255(dut):
    rng = np.random.default_rng(parameters()["seed"])
    bench = CameraBench(dut, 10_000)
    await bench.begin()
    for _ in range(260):
        await bench.show(show(rng, random_image(rng), "single pixel", blanking=1))
    await bench.check()
