"""cocotb half of the two-pass labelling bench: the streams, and the memory's pins in time."""

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles

from model.oracles.two_pass_labelling_oracle import components_in_two_passes
from tb.common.sram_model import SRAM
from tb.harness import Bench, parameters
from tb.preprocessing.frames import BROKEN_MASK, mask_words, spot_tuples

P = parameters()
WIDTH, HEIGHT, LABELS = P["width"], P["height"], P["labels"]
BROKEN = int(BROKEN_MASK[0, 0])


def random_frame(rng):
    lit = rng.random((HEIGHT, WIDTH)) < rng.uniform(0.05, 0.8)
    core = lit & (rng.random(lit.shape) < 0.2)
    words = mask_words(lit, core, np.zeros_like(lit))[:, 0].tolist()
    return words, *components_in_two_passes(lit, core, LABELS)


async def bench_of(dut):
    bench = Bench(dut, gap=P["gap"], stall=P["stall"], seed=P["seed"])
    bench.memory = SRAM(dut, scale=10 / 62.5, seed=P["seed"])  # the bench's clock is 10 ns
    await bench.reset()
    return bench


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def frames_match_oracle(dut):
    rng = np.random.default_rng(P["seed"])
    bench = await bench_of(dut)
    counts = []
    for _ in range(12):
        words, spots, dropped = random_frame(rng)
        await bench.i.send(words)
        got = spot_tuples(await bench.o.receive(len(spots) + 1))
        assert got == [*spots, "end"], f"seed {P['seed']}"
        assert int(dut.dropped.value) == dropped
        counts.append(dropped)
    assert min(counts) == 0 < max(counts)
    assert bench.memory.writes == 12 * WIDTH * HEIGHT // 2 and bench.memory.unwritten == 0


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def broken_and_reset(dut):
    rng = np.random.default_rng(P["seed"])
    bench = await bench_of(dut)
    for _ in range(4):
        lost, _, _ = random_frame(rng)
        words, spots, dropped = random_frame(rng)
        await bench.i.send(lost[:int(rng.integers(WIDTH * HEIGHT))] + [BROKEN] + words)
        got = spot_tuples(await bench.o.receive(len(spots) + 2))
        assert got == ["broken", *spots, "end"], f"seed {P['seed']}"
        assert int(dut.dropped.value) == dropped

        await bench.i.send(lost)
        await ClockCycles(dut.clk, int(rng.integers(3 * WIDTH * HEIGHT // 2)))
        await bench.reset(1)
        bench.o.words.clear()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def nothing_happens_without_pixels(dut):
    bench = await bench_of(dut)
    await ClockCycles(dut.clk, 200)
    assert not bench.o.words and bench.memory.writes == 0
    assert int(dut.pins_chip_enable_n.value) == 1
