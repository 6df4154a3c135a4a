"""Bench of the centre block: what leaves equals the model's centres."""

import random

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from calibration.reciprocal import reciprocal_table
from hdl.preprocessing.centre import Centring
from model.preprocessing.centre import centres
from tb.harness import Bench, parameters

SEED = parameters()["seed"]
TABLE = reciprocal_table()
SPOT = np.dtype([
    ("rejected", "i8"), ("area", "i8"), ("weight", "i8"), ("sum_u", "i8"), ("sum_v", "i8")])
END = None


def word(spot):
    if spot is END:
        return 1
    rejected, area, weight, sum_u, sum_v = spot  # the area's code and the two flags above it
    return rejected << 1 | area << 2 | weight << 13 | sum_u << 31 | sum_v << 59


def expected(spots):
    u, v = centres(np.array([spot for spot in spots if spot is not END], SPOT), TABLE)
    answers = iter(zip(u.tolist(), v.tolist(), strict=True))
    words = []
    for spot in spots:
        if spot is END:
            words.append(1)
        else:
            u, v = next(answers)
            words.append(spot[0] << 1 | spot[1] << 2 | u << 13 | v << 31)
    return words


def random_spot(rng, weight=None):
    weight = weight or rng.choice([
        rng.randint(1, 255), rng.randint(1, 261888), 1 << rng.randint(0, 17)])
    return (rng.randint(0, 1), rng.randrange(1 << 11), weight,
            rng.randint(0, 511 * weight), rng.randint(0, 511 * weight))


def directed_spots():
    spots = [END, END]
    for weight in (1, 2, 3, 127, 128, 255, 256, 32767, 32768, 32769, 65279, 65280, 131071, 131073,
                   261887, 261888):
        for u, v in ((0, 511), (511, 0), (256, 255)):
            spots.append((0, 255, weight, u * weight, v * weight))
        spots.append((1, 1, weight, 511 * weight - 1, weight // 2))
    return [*spots, END]


async def table(dut):
    """The reciprocal table beside the block: a word a clock after its address."""
    while True:
        await ReadOnly()
        address = int(dut.table_address.value)
        await RisingEdge(dut.clk)
        dut.table_data.value = TABLE[address]


class Rig(Bench):
    def __init__(self, dut, gap=0.0, stall=0.0):
        super().__init__(dut, gap=gap, stall=stall, seed=SEED, plain={"table_data": 0})
        cocotb.start_soon(table(dut))

    async def compare(self, spots):
        sending = cocotb.start_soon(self.i.send([word(spot) for spot in spots]))
        got = await self.o.receive(len(spots))
        for at, (mine, its) in enumerate(zip(got, expected(spots), strict=True)):
            assert mine == its, f"spot {at}, {spots[at]}: got {mine:#x}, not {its:#x}"
        await sending


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.9], stall=[0.0, 0.9])
async def spots_match_the_model(dut, gap, stall):
    bench = Rig(dut, gap, stall)
    await bench.reset()
    rng = random.Random(f"{SEED} {gap} {stall}")
    spots = directed_spots()
    spots += [END if rng.random() < 0.1 else random_spot(rng) for _ in range(150)]
    await bench.compare(spots)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def takes_its_time(dut):
    """Clocks from word to word by the weight, and from spot to centre."""
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    spots = [END] + [random_spot(rng, weight) for bits in range(1, 19)
                     for weight in (1 << (bits - 1), min((1 << bits) - 1, 261888))]
    await bench.i.send([word(spot) for spot in [*spots, END]])
    await ClockCycles(dut.clk, 5)
    periods = [4] + [22 - spot[2].bit_length() for spot in spots[1:]]
    assert np.diff(bench.i.taken).tolist() == [*periods[1:], 4]
    assert [clock - taken for (clock, _), taken in zip(
        bench.o.words, bench.i.taken, strict=True)] == [1] * (len(spots) + 1)
    # A spot of weight 1 becomes valid when the end marker before it has been taken.
    assert spots[1][2] == 1
    assert bench.o.words[1][0] - (bench.i.taken[0] + 1) == Centring.latency


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_forgets(dut):
    """Reset at every clock of a spot's way; the next spots are exact."""
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    for clocks in range(1, 26):
        dut.i_payload.value = word(random_spot(rng))
        dut.i_valid.value = 1
        await ClockCycles(dut.clk, clocks)
        dut.i_valid.value = 0
        await bench.reset(1)
        bench.o.words.clear()
        await bench.compare([random_spot(rng), END])
