"""cocotb half of the labelling bench: the stream protocol, clock by clock."""

import random

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles

from hdl.preprocessing.labelling import Labelling
from model.oracles.labelling_oracle import components
from tb.harness import Bench, parameters
from tb.preprocessing.frames import BROKEN_MASK, mask_words, spot_tuples

P = parameters()
WIDTH, HEIGHT = P["width"], P["height"]


BROKEN = int(BROKEN_MASK[0, 0])


def words_of(lit, core, excess, saturated):
    return mask_words(lit, core, excess, saturated)[:, 0].tolist()


def random_frame(rng, weighted):
    lit = rng.random((HEIGHT, WIDTH)) < rng.uniform(0.1, 0.8)
    core = lit & (rng.random(lit.shape) < 0.2)
    excess = np.where(lit, rng.integers(0, 256, lit.shape), 0).astype(np.uint8)
    saturated = lit & (rng.random(lit.shape) < 0.1)
    pixels = lit, core, excess, saturated
    return words_of(*pixels), components(*pixels, weighted)


async def bench_of(dut, weighted, gap=None, stall=None):
    bench = Bench(dut, gap=P["gap"] if gap is None else gap,
                  stall=P["stall"] if stall is None else stall, seed=P["seed"],
                  plain={"weighted": int(weighted)})
    await bench.reset()
    return bench


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(weighted=[True, False])
async def frames_match_oracle(dut, weighted):
    rng = np.random.default_rng(P["seed"])
    bench = await bench_of(dut, weighted)
    stream, want = [], []
    for _ in range(15):
        words, spots = random_frame(rng, weighted)
        stream += words
        want += [*spots, "end"]
    await bench.i.send(stream)
    assert spot_tuples(await bench.o.receive(len(want))) == want, f"seed {P['seed']}"


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def broken_and_reset(dut):
    rng, odd = np.random.default_rng(P["seed"]), random.Random(P["seed"])
    bench = await bench_of(dut, True)
    for _ in range(6):
        cut = odd.randrange(WIDTH * HEIGHT)
        first, spots = random_frame(rng, True)
        lost, _ = random_frame(rng, True)
        last, after = random_frame(rng, True)
        await bench.i.send(first + lost[:cut] + [BROKEN] + last)
        got = spot_tuples(await bench.o.receive(len(spots) + 1))
        assert got == [*spots, "end"], f"seed {P['seed']}, before a break at {cut}"
        while "broken" not in got:
            got = spot_tuples(await bench.o.receive(1))
        got = spot_tuples(await bench.o.receive(len(after) + 1))
        assert got == [*after, "end"], f"seed {P['seed']}, after a break at {cut}"
        await bench.i.send(lost[:cut])
        await bench.reset(1)
        bench.o.words.clear()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def full_speed(dut):
    """One pixel a clock, and the end beat as late after the last pixel as the contract says."""
    rng = np.random.default_rng(P["seed"])
    bench = await bench_of(dut, True, gap=0, stall=0)
    stream = sum((random_frame(rng, True)[0] for _ in range(5)), [])
    await bench.i.send(stream)
    assert bench.i.taken == list(range(bench.i.taken[0], bench.i.taken[0] + len(stream)))
    await ClockCycles(dut.clk, WIDTH + 8)
    clock, word = bench.o.words[-1]
    assert spot_tuples([word]) == ["end"]
    assert clock - bench.i.taken[-1] == WIDTH + 1 + Labelling.latency


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def waits_with_the_pixels(dut):
    """With a spot that nobody takes, the block stops taking pixels, and loses nothing."""
    bench = await bench_of(dut, True, gap=0, stall=1.0)
    lit = np.zeros((HEIGHT, WIDTH), bool)
    lit[::2, ::2] = True
    excess = np.where(lit, np.arange(lit.size).reshape(lit.shape), 0).astype(np.uint8)
    words, spots = words_of(lit, lit, excess, lit), components(lit, lit, excess, lit, True)
    sending = cocotb.start_soon(bench.i.send(words))
    await ClockCycles(dut.clk, 3 * WIDTH * HEIGHT)
    assert dut.o_valid.value == 1 and dut.i_ready.value == 0 and not sending.done()
    bench.o.stall = 0.0
    await sending
    assert spot_tuples(await bench.o.receive(len(spots) + 1)) == [*spots, "end"]
