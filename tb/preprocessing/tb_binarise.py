import cocotb
import numpy as np
from cocotb.triggers import ClockCycles

from hdl.payloads import MaskPixel
from hdl.preprocessing.binarise import Binarise
from model.preprocessing.binarise import binarise
from tb.harness import Bench, parameters
from tb.native_block import pack
from tb.preprocessing.frames import BROKEN_GREY, BROKEN_MASK, grey_words, mask_words


def words_of(array):
    return [int(word[0]) for word in array]


def expected(image, level, enable):
    lit, excess = binarise(image, level)
    lit = lit & bool(enable)
    return words_of(mask_words(lit, lit, np.where(lit, excess, 0)))


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.4], stall=[0.0, 0.4], level=[0, 1, 77, 128, 254, 255])
async def pixels_match_model(dut, gap, stall, level):
    """Every grey value, and each twice about the level; broken beats are dark."""
    rng = np.random.default_rng([parameters()["seed"], level])
    bench = Bench(dut, gap=gap, stall=stall, seed=parameters()["seed"],
                  plain={"level": level, "enable": 1})
    await bench.reset()
    edge = np.clip([level - 1, level, level + 1, 0, 255, level], 0, 255)
    image = np.concatenate([edge, rng.permutation(256), edge, rng.integers(0, 256, 32)])
    image = image.reshape(20, 15).astype(np.uint8)
    words = words_of(grey_words(image))
    broken, dark = words_of(BROKEN_GREY)[0], words_of(BROKEN_MASK)[0]
    white = broken | 0xFF
    bench.i.append([*words, broken, white, *words[:7], white, *words])
    whole = expected(image, level, 1)
    got = await bench.o.receive(2 * len(words) + 10)
    for index, (mine, other) in enumerate(
            zip(got, [*whole, dark, dark, *whole[:7], dark, *whole], strict=True)):
        assert mine == other, f"beat {index}: {mine:#x}, not {other:#x}"


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def level_and_enable_go_with_the_pixel(dut):
    """A change between two frames that come back to back hits the second one's first pixel."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = Bench(dut, plain={"level": 5, "enable": 0})
    await bench.reset()
    wanted = []
    for level, enable in [(5, 0), (100, 1), (101, 1), (0, 0), (255, 1)]:
        dut.level.value, dut.enable.value = level, enable
        image = rng.integers(98, 104, (6, 8)).astype(np.uint8)
        wanted += expected(image, level, enable)
        await bench.i.send(words_of(grey_words(image)))
    assert await bench.o.receive(len(wanted)) == wanted


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def a_pixel_a_clock(dut):
    bench = Bench(dut, plain={"level": 3, "enable": 1})
    await bench.reset()
    await bench.i.send(range(200))
    await ClockCycles(dut.clk, 2)
    clocks = [clock for clock, _ in bench.o.words]
    assert clocks == [clock + Binarise.latency for clock in bench.i.taken]
    assert clocks[-1] - clocks[0] == 199


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def reset_empties_the_register(dut):
    bench = Bench(dut, stall=1.0, plain={"level": 3, "enable": 1})
    await bench.reset()
    await bench.i.send([200])
    await ClockCycles(dut.clk, 2)
    assert dut.o_valid.value == 1
    await bench.reset()
    bench.o.stall = 0.0
    await bench.i.send([3])
    assert await bench.o.receive(1) == [int(pack(MaskPixel, lit=1, core=1, excess=0)[0][0])]
