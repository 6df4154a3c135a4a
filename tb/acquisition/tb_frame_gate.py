import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.payloads import FrameInfo, GreyPixel
from model.acquisition.frame_gate import gate
from tb.harness import Bench, parameters
from tb.native_block import pack, unpack
from tb.preprocessing.frames import BROKEN_GREY, grey_words


def words_of(array):
    return [int(word[0]) for word in array]


class Reader:
    """The queue behind ``info``: takes at once or not at all, ready only between frames' ends."""

    def __init__(self, bench):
        self.bench, self.taken = bench, []
        bench.dut.info_ready.value = 1
        cocotb.start_soon(self._run())

    async def _run(self):
        dut = self.bench.dut
        while True:
            await ReadOnly()
            if not dut.rst.value and dut.info_valid.value and dut.info_ready.value:
                self.taken.append(dut.info_payload.value.to_unsigned())
            await RisingEdge(dut.clk)


def info(number, skipped, level, learning):
    word = pack(FrameInfo, number=number & 0xFFFF, skipped=skipped, level=level,
                learning=learning)[0]
    return int(word[0]) | int(word[1]) << 32


def info_words(taken):
    return unpack(FrameInfo, np.array([[word & 0xFFFFFFFF, word >> 32] for word in taken],
                                      dtype=np.uint32).reshape(-1, 2))


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.4], stall=[0.0, 0.4])
async def whole_frames_or_none(dut, gap, stall):
    """Frames whole, broken, and broken before they began; room for the announcement or not."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = Bench(dut, gap=gap, stall=stall, seed=parameters()["seed"],
                  plain={"level": 0, "learnt": 0, "info_ready": 1})
    reader = Reader(bench)
    await bench.reset()
    room, kinds, wanted, levels = [], [], [], []
    for _ in range(60):
        image = rng.integers(0, 256, (3, 4)).astype(np.uint8)
        words = words_of(grey_words(image))
        broken = words_of(BROKEN_GREY)
        kind = rng.choice(["whole", "whole", "broken", "nothing"])
        if kind == "broken":
            words = words[:int(rng.integers(1, 12))] + broken
        elif kind == "nothing":
            words = broken
        kinds.append(kind)
        ready, level = bool(rng.random() < 0.6), int(rng.integers(256))
        dut.info_ready.value = ready
        dut.level.value = level
        dut.learnt.value = level & 1
        if kind != "nothing":
            room.append(ready)
            levels.append(level)
            if ready:
                wanted += words
        await bench.i.send(words)
        if gap or stall:  # the frame's own pixels must not hurt later ones
            await ClockCycles(dut.clk, int(rng.integers(0, 3)))
    got = await bench.o.receive(len(wanted))
    assert got == wanted
    await ClockCycles(dut.clk, 20)
    assert not bench.o.words
    announced = [(*entry, level, 1 - (level & 1))
                 for entry, level in zip(gate(room), levels, strict=True) if entry is not None]
    fields = info_words(reader.taken)
    assert [tuple(int(entry[name]) for name in ("number", "skipped", "level", "learning"))
            for entry in fields] == announced


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def a_pixel_a_clock(dut):
    """Nothing waits, passing or not; a whole frame costs as many clocks as it has pixels."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = Bench(dut, plain={"level": 9, "learnt": 1, "info_ready": 1})
    await bench.reset()
    words = words_of(grey_words(rng.integers(0, 256, (8, 16)).astype(np.uint8))) * 3
    await bench.i.send(words)
    assert bench.i.taken[-1] - bench.i.taken[0] == len(words) - 1
    await ClockCycles(dut.clk, 2)
    assert [clock for clock, _ in bench.o.words] == bench.i.taken
    dut.info_ready.value = 0
    first = len(bench.i.taken)
    bench.o.stall = 1.0  # what is thrown away does not wait for the reader either
    await ClockCycles(dut.clk, 2)
    await bench.i.send(words)
    assert bench.i.taken[-1] - bench.i.taken[first] == len(words) - 1


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def skipped_stops_at_255(dut):
    bench = Bench(dut, plain={"level": 9, "learnt": 1, "info_ready": 0})
    reader = Reader(bench)
    await bench.reset()
    dut.info_ready.value = 0
    pixel = int(pack(GreyPixel, mark_line_end=[1], mark_frame_end=[1])[0][0])
    await bench.i.send([pixel] * 300)
    dut.info_ready.value = 1
    await bench.i.send([pixel] * 2)
    assert reader.taken == [info(300, 255, 9, 0), info(301, 0, 9, 0)]
