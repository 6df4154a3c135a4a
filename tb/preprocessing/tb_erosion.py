import cocotb
import numpy as np

from model.preprocessing.erosion import erode
from tb.harness import Bench, parameters
from tb.preprocessing.frames import mask_words


def words_of(array):
    return [int(word[0]) for word in array]


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.4], stall=[0.0, 0.4], mode=["off", "erode", "gate"])
async def frames_match_model(dut, gap, stall, mode):
    """Full, empty, hollow and random masks; the last frame leaves without further pixels."""
    width, height = parameters()["width"], 6
    rng = np.random.default_rng(parameters()["seed"])
    bench = Bench(dut, gap=gap, stall=stall, seed=parameters()["seed"],
                  plain={"mode": ("off", "erode", "gate").index(mode)})
    await bench.reset()
    full = np.ones((height, width), bool)
    hollow = full.copy()
    hollow[height // 2, width // 2] = False
    for lit in (full, hollow, ~full, rng.random(full.shape) < 0.8):
        excess = np.where(lit, rng.integers(0, 256, lit.shape), 0)
        bench.i.append(words_of(mask_words(lit, lit, excess)))
        out, core = erode(lit, mode)
        wanted = words_of(mask_words(out, core, np.where(out, excess, 0)))
        got = await bench.o.receive(len(wanted))
        for place, (mine, other) in enumerate(zip(got, wanted, strict=True)):
            assert mine == other, f"row {place // width}, column {place % width}"
