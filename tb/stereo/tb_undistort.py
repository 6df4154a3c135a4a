"""Bench of the undistortion block: what leaves equals the model's places."""

import dataclasses
import random

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from model.stereo.undistort import undistort
from tb.harness import Bench, parameters
from tb.stereo.undistort_cases import lens_settings, random_settings

SEED, LENS = parameters()["seed"], parameters()["lens"]
LATENCY, ROUNDS = parameters()["latency"], parameters()["rounds"]
SETTINGS, (WIDTH, HEIGHT), _ = lens_settings(LENS)
END = None
PLAIN = ("principal_u", "principal_v", "tangential_1", "tangential_2", "bank", "write_bank",
         "radial_write_enable", "radial_write_address", "radial_write_data")


def word(spot):
    if spot is END:
        return 1
    rejected, area, u, v = spot  # the area's code and the two flags above it
    return rejected << 1 | area << 2 | u << 13 | v << 31


def expected(spots, settings):
    _, _, u, v = zip(*(spot for spot in spots if spot is not END), strict=True)
    x, y, ok = undistort(np.array(u), np.array(v), settings, WIDTH, HEIGHT, ROUNDS)
    answers = iter(zip(x.tolist(), y.tolist(), ok.tolist(), strict=True))
    words = []
    for spot in spots:
        if spot is END:
            words.append(1)
        else:
            x, y, ok = next(answers)
            words.append(word(spot) | (not ok) << 1 | (x & 0x3FFFF) << 49 | (y & 0x3FFFF) << 67)
    return words


def random_spot(rng, anywhere=0.1):
    limits = (1 << 18, 1 << 18) if rng.random() < anywhere else (WIDTH * 512, HEIGHT * 512)
    return (int(rng.random() < 0.2), rng.randrange(1 << 11),
            rng.randrange(limits[0]), rng.randrange(limits[1]))


class Rig(Bench):
    def __init__(self, dut, gap=0.0, stall=0.0):
        super().__init__(dut, gap=gap, stall=stall, seed=SEED, plain=dict.fromkeys(PLAIN, 0))

    async def load(self, settings):
        dut = self.dut
        self.settings = settings
        dut.principal_u.value = settings.principal_u
        dut.principal_v.value = settings.principal_v
        dut.tangential_1.value = settings.tangential_1 & 0x3FFFF
        dut.tangential_2.value = settings.tangential_2 & 0x3FFFF
        for address, value in enumerate(settings.radial):
            dut.radial_write_enable.value = 1
            dut.radial_write_address.value = address
            dut.radial_write_data.value = value
            await RisingEdge(dut.clk)
        dut.radial_write_enable.value = 0
        await RisingEdge(dut.clk)

    async def swap(self, radial):
        """Read the other bank back, write ``radial`` to it; the table's words until then."""
        dut, words = self.dut, []
        dut.write_bank.value = 1 - int(dut.bank.value)
        for address in range(1025):
            dut.radial_write_address.value = address % 1024
            await ReadOnly()
            if address:
                words.append(int(dut.radial_read_data.value))
            await RisingEdge(dut.clk)
        for address, value in enumerate(radial):
            dut.radial_write_enable.value = 1
            dut.radial_write_address.value = address
            dut.radial_write_data.value = value
            await RisingEdge(dut.clk)
        dut.radial_write_enable.value = 0
        return words

    async def compare(self, spots):
        sending = cocotb.start_soon(self.i.send([word(spot) for spot in spots]))
        got = await self.o.receive(len(spots))
        for at, (mine, its) in enumerate(zip(got, expected(spots, self.settings), strict=True)):
            assert mine == its, f"spot {at}, {spots[at]}: got {mine:#x}, not {its:#x}"
        await sending


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.9], stall=[0.0, 0.9])
async def spots_match_the_model(dut, gap, stall):
    bench = Rig(dut, gap, stall)
    await bench.reset()
    await bench.load(SETTINGS)
    rng = random.Random(f"{SEED} {gap} {stall}")
    right, bottom = (WIDTH - 1) * 512, (HEIGHT - 1) * 512
    at = SETTINGS.principal_u, SETTINGS.principal_v
    spots = [END, (0, 1, 0, 0), (0, 2, right, 0), (1, 3, 0, bottom), (0, 255, right, bottom), END,
             (0, 9, *at), END, END]
    spots += [END if rng.random() < 0.1 else random_spot(rng) for _ in range(100)]
    await bench.compare(spots)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def takes_its_time(dut):
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    await bench.i.send([word(spot) for spot in [random_spot(rng) for _ in range(20)] + [END] * 3])
    await ClockCycles(dut.clk, 3)
    clocks = [clock for clock, _ in bench.o.words]
    assert np.diff(clocks).tolist() == [LATENCY + 1] * 19 + [2] * 3
    assert clocks == bench.i.taken
    await ClockCycles(dut.clk, 5)
    bench.i.taken.clear()
    start = bench.cycle
    await bench.i.send([word(random_spot(rng))])
    # Offered after the edge that ends clock `start`, taken LATENCY clocks later.
    assert bench.i.taken[0] - start - 2 == LATENCY


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def settings_change_between_frames(dut):
    """Other registers and tables for each frame, such as no lens would ask for."""
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    for number in range(6):
        await bench.load(random_settings(SEED * 100 + number))
        await bench.compare([random_spot(rng, 0.5) for _ in range(40)] + [END])


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def banks_are_apart(dut):
    """While spots pass, the other bank is read back and written; then the two change places."""
    bench = Rig(dut)
    await bench.reset()
    rng = random.Random(SEED)
    await bench.load(SETTINGS)
    other = [0] * 1024
    for number in range(4):
        new = random_settings(SEED * 10 + number)
        swapping = cocotb.start_soon(bench.swap(new.radial))
        await bench.compare([random_spot(rng, 0.5) for _ in range(2050 // LATENCY)])
        assert await swapping == other
        other = list(bench.settings.radial)
        dut.bank.value = 1 - int(dut.bank.value)
        bench.settings = dataclasses.replace(bench.settings, radial=new.radial)
        await bench.compare([random_spot(rng, 0.5) for _ in range(20)])


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_forgets(dut):
    """Reset at every clock of a spot's way; the table stays and the next spots are exact."""
    bench = Rig(dut)
    await bench.reset()
    await bench.load(SETTINGS)
    rng = random.Random(SEED)
    for clocks in range(1, LATENCY + 3):
        bench.o.stall = clocks % 2
        dut.i_payload.value = word(random_spot(rng, 1))
        dut.i_valid.value = 1
        await ClockCycles(dut.clk, clocks)
        dut.i_valid.value = 0
        await bench.reset(1)
        bench.o.stall = 0.0
        bench.o.words.clear()
        await bench.compare([random_spot(rng), END])
