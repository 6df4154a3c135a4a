"""Bench of the block that makes places of centres: what leaves equals the model's places."""

import random

import cocotb
import numpy as np
from cocotb.triggers import RisingEdge

from model.stereo.recentre import recentre
from tb.harness import Bench, parameters

SEED, WIDTH, HEIGHT = parameters()["seed"], parameters()["width"], parameters()["height"]
END = 1


def word(spot):
    rejected, area, u, v = spot
    return rejected << 1 | area << 2 | u << 10 | v << 28


def expected(spots):
    words = []
    for spot in spots:
        if spot == END:
            words.append(END)
            continue
        x, y, ok = (int(value) for value in recentre(*np.array(spot[2:]), WIDTH, HEIGHT))
        words.append(word(spot) | (not ok) << 1 | (x & 0x3FFFF) << 46 | (y & 0x3FFFF) << 64)
    return words


def spots_of(rng):
    """The image's corners and centre, what lies about +-256 px from it, and random spots."""
    edges = []
    for size in (WIDTH, HEIGHT):
        centre = (size - 1) * 256
        edges.append([value for place in (0, centre, (size - 1) * 512, centre + (1 << 17))
                      for value in range(place - 2, place + 3) if 0 <= value < 1 << 18]
                     + [(1 << 18) - 1])
    spots = [(rng.randrange(2), rng.randint(1, 255), u, v) for u in edges[0] for v in edges[1]]
    spots += [(rng.randrange(2), rng.randint(1, 255), rng.getrandbits(18), rng.getrandbits(18))
              for _ in range(50)]
    for at in range(0, len(spots), 7):
        spots.insert(at, END)
    return spots


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.5], stall=[0.0, 0.5])
async def places_match_model(dut, gap, stall):
    bench = Bench(dut, gap=gap, stall=stall, seed=SEED)
    await bench.reset()
    spots = spots_of(random.Random(SEED))
    bench.i.append([END if spot == END else word(spot) for spot in spots])
    got = await bench.o.receive(len(spots))
    for spot, mine, other in zip(spots, got, expected(spots), strict=True):
        assert mine == other, f"{spot}: {mine:#x}, not {other:#x}"


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def a_spot_a_clock_a_clock_later(dut):
    bench = Bench(dut, seed=SEED)
    await bench.reset()
    bench.i.append([word((0, 9, 1, 1))] * 50)
    while len(bench.o.words) < 50:
        await RisingEdge(dut.clk)
    clocks = [clock for clock, _ in bench.o.words]
    assert clocks == [clock + 1 for clock in bench.i.taken] and clocks[-1] - clocks[0] == 49
