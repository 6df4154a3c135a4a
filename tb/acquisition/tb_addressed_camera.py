"""The camera for addressed pixels, with a converter that gives each result for one clock only."""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.acquisition.addressed_camera import AddressedCamera
from model.acquisition.addressed_camera import addressed_camera, conversions
from tb.acquisition.addressed_pins import AddressedPins
from tb.harness import Bench, parameters


class AddressedBench(Bench):
    """Frames on demand; ``reads`` are the conversions that were made when each one began."""

    def __init__(self, dut, stall=0.0):
        self.choices = parameters()
        super().__init__(dut, inputs=(), stall=stall, seed=self.choices["seed"],
                         plain={"sensor_read": 0, "data": 0})
        self.rng = np.random.default_rng(self.choices["seed"])
        self.images, self.reads, self.image = [], [], None
        self.pins = AddressedPins(dut, lambda: self.image, self.choices["latency"],
                                  self.choices["interval"], self.choices["seed"])

    @property
    def pixels(self):
        return self.choices["width"] * self.choices["height"]

    async def read(self, clocks=1):
        """A rise of ``sensor_read``; from the clock in which it is seen, a new picture."""
        self.dut.sensor_read.value = 1
        await RisingEdge(self.dut.clk)
        self.image = self.rng.integers(0, 256, (self.choices["height"], self.choices["width"]))
        self.image = self.image.astype(np.uint8)
        self.images.append(self.image)
        self.reads.append(len(self.pins.converted))
        await ClockCycles(self.dut.clk, clocks)
        self.dut.sensor_read.value = 0

    async def finish(self, limit=20_000):
        """Until everything has come out."""
        for _ in range(limit):
            await RisingEdge(self.dut.clk)
            await ReadOnly()
            if not self.dut.sending.value:
                await RisingEdge(self.dut.clk)
                return
        raise AssertionError("the frame does not end")

    def check(self):
        counts = np.diff([*self.reads, len(self.pins.converted)])
        grey, marker = addressed_camera(list(zip(self.images, counts, strict=True)))
        words = np.array([word for _, word in self.o.words])
        assert np.array_equal(words & 0xFF, grey)
        assert np.array_equal(words >> 8, marker)
        places = [divmod(place, self.choices["width"]) for count in counts
                  for place in range(count)]
        assert [tuple(entry[1:]) for entry in self.pins.converted] == places


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(stall=[0.0, 0.3, 0.8])
async def frames(dut, stall):
    """Whole frames, one after the other or with pauses."""
    bench = AddressedBench(dut, stall)
    await bench.reset()
    for pause in (1, 1, 20):
        await bench.read()
        await bench.finish()
        await ClockCycles(dut.clk, pause)
    bench.check()
    assert len(bench.o.words) == 3 * bench.pixels


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def clocks_of_a_frame(dut):
    """A pixel every `interval` clocks, to the clock."""
    bench = AddressedBench(dut)
    await bench.reset()
    interval = bench.choices["interval"]
    converted, taken = [], []
    cocotb.start_soon(watch(dut, converted, taken))
    await bench.read()
    await bench.finish()
    bench.check()
    latency = AddressedCamera(8, 8, bench.choices["latency"], interval).latency
    assert np.array_equal(np.array(taken) - converted, np.full(bench.pixels, latency))
    clocks = np.array([clock for clock, *_ in bench.pins.converted])
    width, height = bench.choices["width"], bench.choices["height"]
    wanted = conversions(width, height, interval, 0)
    assert np.array_equal(clocks - clocks[0], wanted - wanted[0])
    arrived = np.array([clock for clock, _ in bench.o.words])
    assert set(np.diff(arrived)) == {interval}
    assert arrived[-1] - arrived[0] == (bench.pixels - 1) * interval


async def watch(dut, converted, taken):
    """Clocks with a conversion, and those in which a pixel is taken."""
    clock = 0
    while True:
        await ReadOnly()
        if dut.convert.value:
            converted.append(clock)
        if dut.o_valid.value and dut.o_ready.value:
            taken.append(clock)
        await RisingEdge(dut.clk)
        clock += 1


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def a_reader_that_stops(dut):
    """Conversions wait while nobody takes pixels; none is lost, and none converted twice."""
    bench = AddressedBench(dut)
    await bench.reset()
    await bench.read()
    for _ in range(4):
        await ClockCycles(dut.clk, int(bench.rng.integers(5, 40)))
        bench.o.stall = 1.0
        await ClockCycles(dut.clk, 100 + 2 * bench.choices["latency"])
        converted = len(bench.pins.converted)
        await ClockCycles(dut.clk, 50)
        assert len(bench.pins.converted) == converted
        bench.o.stall = 0.0
    await bench.finish()
    bench.check()


@cocotb.test(timeout_time=50, timeout_unit="ms")
@cocotb.parametrize(stall=[0.0, 0.4])
async def read_again(dut, stall):
    """A read-out that is begun again at any place: a broken beat, then the whole frame."""
    bench = AddressedBench(dut, stall)
    await bench.reset()
    length = bench.pixels * bench.choices["interval"]
    for after in (25, 26, 27, length // 2, *range(length - 4, length + 4)):
        await bench.read()
        await ClockCycles(dut.clk, after)
        await bench.read(int(bench.rng.integers(1, 20)))
        await bench.finish()
    bench.check()


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def read_again_while_nobody_takes_pixels(dut):
    """The broken beat waits for room, once, however often the read-out is begun again."""
    bench = AddressedBench(dut)
    await bench.reset()
    bench.o.stall = 1.0
    await bench.read()
    first = bench.image
    await ClockCycles(dut.clk, 60 + 12 * bench.choices["interval"])
    converted = len(bench.pins.converted)
    for _ in range(3):
        await bench.read()
        await ClockCycles(dut.clk, 30)
    assert len(bench.pins.converted) == converted
    bench.o.stall = 0.0
    await bench.finish()
    grey, marker = addressed_camera([(first, converted), (bench.image, bench.pixels)])
    words = np.array([word for _, word in bench.o.words])
    assert np.array_equal(words & 0xFF, grey) and np.array_equal(words >> 8, marker)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def reset_within_a_frame(dut):
    """Nothing more of it comes, not even its end; the next frame is whole."""
    bench = AddressedBench(dut)
    await bench.reset()
    await bench.read()
    await ClockCycles(dut.clk, 40)
    await bench.reset()
    bench.o.words.clear()
    bench.pins.converted.clear()
    bench.images.clear()
    bench.reads.clear()
    await ClockCycles(dut.clk, 40)
    assert not bench.o.words and not dut.sending.value
    await bench.read()
    await bench.finish()
    bench.check()
