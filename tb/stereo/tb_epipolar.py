"""Bench of the epipolar block, for both twins: what leaves equals the model's matches."""

import random

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from model.stereo.epipolar import match, pack_line, pack_window
from tb.harness import Bench, parameters

BEAMS, LANES = parameters()["beams"], parameters()["lanes"]
GROUPS = -(-BEAMS // LANES)
LATENCY = parameters()["latency"]
END = 1


def undistorted(x, y, u=0, v=0, area=1, rejected=0):
    """Payload word of an undistorted spot; ``area`` is the code and the two flags above it."""
    return (rejected << 1 | area << 2 | u << 13 | v << 31 | (x & 0x3FFFF) << 49
            | (y & 0x3FFFF) << 67)


def expected(spots, line, window):
    """Payload words of the matches of ``spots``, tuples (x, y, u, v, area, rejected) or END."""
    real = [spot for spot in spots if spot != END]
    if not real:
        return [END for _ in spots]
    x, y, _, _, _, rejected = (np.array(column) for column in zip(*real, strict=True))
    answers = iter(zip(*match(x, y, rejected, line, window), real, strict=True))
    words = []
    for spot in spots:
        if spot == END:
            words.append(END)
            continue
        status, beam, (x, _, u, v, area, _) = next(answers)
        words.append(int(status) << 1 | int(beam) << 3 | area << 12 | u << 23 | v << 41
                     | (x & 0x3FFFF) << 59)
    return words


def make(dut, gap=0.0, stall=0.0, seed=1):
    return Bench(dut, gap=gap, stall=stall, seed=seed, plain={
        "bank": 0, "write_bank": 0, "write_enable": 0, "read_enable": 0, "write_address": 0,
        "write_line": 0, "write_window": 0})


async def load(bench, line, window, bank=0):
    """Write the words of all beams, and what must not matter beyond them."""
    dut = bench.dut
    dut.write_bank.value = bank
    full = [(beam, int(line[beam]), int(window[beam])) for beam in range(BEAMS)]
    full += [(beam, 0, (1 << 9) - 1 | 0x1000 << 9 | 0xFFF << 22)
             for beam in range(BEAMS, 1 << (BEAMS - 1).bit_length())]
    for address, first, second in full:
        dut.write_enable.value = 1
        dut.write_address.value = address
        dut.write_line.value = first
        dut.write_window.value = second
        await RisingEdge(dut.clk)
    dut.write_enable.value = 0
    await RisingEdge(dut.clk)


async def compare(bench, spots, line, window):
    wanted = expected(spots, line, window)
    words = [END if spot == END else undistorted(*spot) for spot in spots]
    sending = cocotb.start_soon(bench.i.send(words))
    for at, (got, want) in enumerate(zip(
            await bench.o.receive(len(words)), wanted, strict=True)):
        assert got == want, f"spot {at}, {spots[at]}: got {got:#x}, not {want:#x}"
    await sending


def random_spot(rng, x=None, y=None):
    return (rng.randint(-1 << 17, (1 << 17) - 1) if x is None else x,
            rng.randint(-1 << 17, (1 << 17) - 1) if y is None else y,
            rng.getrandbits(18), rng.getrandbits(18), rng.randint(1, 255),
            int(rng.random() < 0.1))


def random_tables(rng, spread):
    """Lines a few pixels apart, with windows that most columns pass."""
    slope = [rng.randint(-8000, 8000) for _ in range(BEAMS)]
    offset = [round((beam - BEAMS / 2) * spread) + rng.randint(-40, 40) for beam in range(BEAMS)]
    tolerance = [rng.choice([0, 1, 64, 200, 511]) for _ in range(BEAMS)]
    u_min = [rng.randint(-4096, 500) for _ in range(BEAMS)]
    u_max = [rng.randint(-500, 4095) for _ in range(BEAMS)]
    return pack_line(slope, offset), pack_window(tolerance, u_min, u_max)


def near_a_line(rng, line, window):
    """A spot about a line's tolerance away from it, near one of its window's limits."""
    beam = rng.randrange(BEAMS)
    slope = int(line[beam]) & 0x3FFFF
    slope -= slope >> 17 << 18
    offset = int(line[beam]) >> 18
    offset -= offset >> 17 << 18
    tolerance = (int(window[beam]) & 0x1FF) << 4
    limit = int(window[beam]) >> rng.choice([9, 22]) & 0x1FFF
    limit -= limit >> 12 << 13
    x = rng.choice([rng.randint(-1 << 17, (1 << 17) - 1),
                    limit * 32 + rng.choice([-1, 0, 31, 32])])
    x = min(max(x, -1 << 17), (1 << 17) - 1)
    y = ((slope * x + (1 << 16)) >> 17) + offset
    y += rng.choice([-1, 1]) * (tolerance + rng.choice([-17, -16, -15, -1, 0, 1]))
    return random_spot(rng, x, min(max(y, -1 << 17), (1 << 17) - 1))


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def disabled_until_written(dut):
    """The first test of a run: no word has been written yet, and nothing hits."""
    bench = make(dut)
    await bench.reset()
    nothing = [0] * BEAMS
    await compare(bench, [(0, 0, 3, 4, 5, 0), END, (9, 0, 0, 0, 1, 1)], nothing, nothing)


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.6], stall=[0.0, 0.6])
async def spots_match_model(dut, gap, stall):
    seed = parameters()["seed"]
    rng = random.Random(f"{seed} {gap} {stall}")
    bench = make(dut, gap, stall, seed)
    await bench.reset()
    for spread in (2900, 300):
        line, window = random_tables(rng, spread)
        await load(bench, line, window)
        spots = [near_a_line(rng, line, window) if rng.random() < 0.7 else random_spot(rng)
                 for _ in range(60)]
        for at in (0, 1, 20, 59):
            spots[at] = END
        await compare(bench, spots, line, window)


async def read_back(bench, bank):
    """Words of all beams as the host reads them, one after the other."""
    dut = bench.dut
    dut.write_bank.value = bank
    line, window = [], []
    for beam in range(BEAMS + 1):
        dut.read_enable.value = beam < BEAMS
        dut.write_address.value = beam % BEAMS
        await ReadOnly()
        if beam:
            line.append(int(dut.read_line.value))
            window.append(int(dut.read_window.value))
        await RisingEdge(dut.clk)
    return line, window


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def banks_are_apart(dut):
    """What is tried is one bank's, what is written and read back the other's."""
    bench = make(dut)
    await bench.reset()
    rng = random.Random(3)
    tables = [random_tables(rng, spread) for spread in (2900, 1500)]
    for bank in (0, 1):
        await load(bench, *tables[bank], bank)
    for bank in (1, 0, 1, 0):
        dut.bank.value = bank
        for _ in range(2):
            spots = [near_a_line(rng, *tables[bank]) for _ in range(30)]
            await compare(bench, spots, *tables[bank])
            # The other bank, new before the second round.
            line, window = await read_back(bench, 1 - bank)
            assert line == [int(word) for word in tables[1 - bank][0]]
            assert window == [int(word) for word in tables[1 - bank][1]]
            tables[1 - bank] = random_tables(rng, 2900)
            await load(bench, *tables[1 - bank], 1 - bank)
    # A result that waits to be taken holds the pipeline, not the host.
    bench.o.stall = 1.0
    await bench.i.send([undistorted(*random_spot(rng))])
    await ClockCycles(dut.clk, 2 * GROUPS + 9)
    line, window = await read_back(bench, 1)
    assert line == [int(word) for word in tables[1][0]]
    assert window == [int(word) for word in tables[1][1]]


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def tolerance_limits(dut):
    """Exactly the tolerance is no hit, one LSB less is, on both sides; zero disables."""
    bench = make(dut)
    await bench.reset()
    for tolerance in (0, 1, 2, 255, 256, 511):
        line = pack_line([0] * BEAMS, [100] + [-131072] * (BEAMS - 1))
        window = pack_window([tolerance] + [0] * (BEAMS - 1), [-4096] * BEAMS, [4095] * BEAMS)
        await load(bench, line, window)
        spots = [(0, 100 + sign * (16 * tolerance + step), 1, 2, 3, 0)
                 for sign in (-1, 1) for step in range(-17, 18)]
        await compare(bench, spots, line, window)
        statuses = [word >> 1 & 3 for word in expected(spots, line, window)]
        assert sum(status == 0 for status in statuses) == (
            {0: 0, 1: 34, 2: 34}.get(tolerance, 34))


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def rounding_of_the_estimate(dut):
    """Slopes and columns about a half, and the largest there are."""
    bench = make(dut)
    await bench.reset()
    rng = random.Random(5)
    big = [-131072, -131071, -1, 0, 1, 65535, 65536, 65537, 131070, 131071]
    for slope in big:
        for offset in (-131072, 0, 131071):
            line = pack_line([slope] + [0] * (BEAMS - 1), [offset] * BEAMS)
            window = pack_window([1] + [0] * (BEAMS - 1), [-4096] * BEAMS, [4095] * BEAMS)
            await load_first(bench, line, window)
            spots = []
            for x in big:
                y = ((slope * x + (1 << 16)) >> 17) + offset + rng.choice([-16, -15, 15, 16])
                spots.append((x, min(max(y, -131072), 131071), 0, 0, 1, 0))
            await compare(bench, spots, line, window)


async def load_first(bench, line, window):
    """Write the first beam; the others stay disabled."""
    dut = bench.dut
    dut.write_enable.value = 1
    dut.write_address.value = 0
    dut.write_line.value = int(line[0])
    dut.write_window.value = int(window[0])
    await RisingEdge(dut.clk)
    dut.write_enable.value = 0
    await RisingEdge(dut.clk)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def window_limits(dut):
    """Both limits are inside; outside but on the line is rejected; the rest is noise."""
    bench = make(dut)
    await bench.reset()
    for u_min, u_max in [(-4096, 4095), (-3, 5), (0, 0), (4095, 4095), (-4096, -4096), (5, 4)]:
        line = pack_line([0] * BEAMS, [0] * BEAMS)
        window = pack_window([8] + [0] * (BEAMS - 1), [u_min] * BEAMS, [u_max] * BEAMS)
        await load_first(bench, line, window)
        columns = [limit * 32 + step for limit in (u_min, u_max) for step in (-1, 0, 31, 32)]
        columns = [min(max(x, -131072), 131071) for x in [*columns, -131072, 131071]]
        spots = [(x, y, 9, 8, 7, 0) for x in columns for y in (0, 127, 128)]
        await compare(bench, spots, line, window)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def every_beam_and_every_pair(dut):
    """One hit in each place gives its beam; two hits anywhere, and all at once, are ambiguous."""
    bench = make(dut)
    await bench.reset()
    rng = random.Random(8)
    # Beam k has its line at 32 k, a spot hits all lines within reach.
    line = pack_line([0] * BEAMS, [32 * beam for beam in range(BEAMS)])
    for tolerance in (1, 2, 3, 511):
        window = pack_window([tolerance] * BEAMS, [-4096] * BEAMS, [4095] * BEAMS)
        await load(bench, line, window)
        spots = [(rng.randint(-131072, 131071), 32 * beam, beam, beam, 1, 0)
                 for beam in range(-2, BEAMS + 2)]
        if BEAMS > 60 and tolerance > 1:
            spots = rng.sample(spots, 30) + spots[-3:]
        spots += [spot[:5] + (1,) for spot in spots[:3]] + [END]
        spots = [spot if spot == END else
                 (spot[0], spot[1], spot[2] & 0x3FFFF, spot[3] & 0x3FFFF, *spot[4:])
                 for spot in spots]
        await compare(bench, spots, line, window)
    # Windows decide between two lines at the same place.
    pairs = [(a, b) for a in {0, BEAMS // 2, BEAMS - 1} for b in {0, 1 % BEAMS, BEAMS - 1}
             if a != b]
    for first, second in pairs:
        tolerance = [0] * BEAMS
        u_min, u_max = [-4096] * BEAMS, [4095] * BEAMS
        tolerance[first] = tolerance[second] = 4
        u_max[first], u_min[second] = 10, 10
        line = pack_line([0] * BEAMS, [0] * BEAMS)
        window = pack_window(tolerance, u_min, u_max)
        await load(bench, line, window)
        await compare(bench, [(x, 0, 0, 0, 1, 0) for x in (319, 320, 351, 352)], line, window)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def throughput_and_latency(dut):
    """A spot every ``ceil(K / P)`` clocks, the first one after the stated latency."""
    bench = make(dut)
    await bench.reset()
    rng = random.Random(2)
    line, window = random_tables(rng, 2900)
    await load(bench, line, window)
    spots = [random_spot(rng) for _ in range(20)]
    bench.i.append([undistorted(*spot) for spot in spots])
    while len(bench.o.words) < len(spots):
        await RisingEdge(dut.clk)
    clocks = [clock for clock, _ in bench.o.words]
    assert [word for _, word in bench.o.words] == expected(spots, line, window)
    assert {b - a for a, b in zip(clocks, clocks[1:], strict=False)} == {GROUPS}
    # It is taken in the last of its clocks.
    assert clocks[0] - bench.i.taken[0] == LATENCY - (GROUPS - 1)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def a_stall_loses_nothing(dut):
    """The sink stops for long, again and again; the pipeline is full each time."""
    bench = make(dut)
    await bench.reset()
    rng = random.Random(4)
    line, window = random_tables(rng, 1500)
    await load(bench, line, window)
    spots = [near_a_line(rng, line, window) for _ in range(40)]
    bench.i.append([undistorted(*spot) for spot in spots])
    got = []
    while len(got) < len(spots):
        bench.o.stall = 1.0
        await ClockCycles(dut.clk, rng.choice([1, 2, 3, GROUPS, 2 * GROUPS + 7]))
        bench.o.stall = 0.0
        await ClockCycles(dut.clk, rng.choice([1, 2, GROUPS + 1]))
        got = [word for _, word in bench.o.words]
    assert got == expected(spots, line, window)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_forgets(dut):
    """A reset in the middle of spots leaves nothing of them; the tables stay."""
    bench = make(dut)
    await bench.reset()
    rng = random.Random(6)
    line, window = random_tables(rng, 2900)
    await load(bench, line, window)
    for clocks in range(1, 2 * GROUPS + 9, max(1, GROUPS // 4)):
        dut.i_payload.value = undistorted(*random_spot(rng))
        dut.i_valid.value = 1
        await ClockCycles(dut.clk, clocks)
        dut.i_valid.value = 0
        await bench.reset()
        bench.o.words.clear()
        await compare(bench, [near_a_line(rng, line, window) for _ in range(3)], line, window)
