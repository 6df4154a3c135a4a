"""Bench of the depth block, for both twins: what leaves equals the model's points."""

import random

import cocotb
from cocotb.triggers import ClockCycles, RisingEdge

from model.stereo.depth import inverse_depth, pack_depth
from tb.harness import Bench, parameters

END = 1
LATENCY = parameters()["latency"]
ALPHA_LIMIT, BETA_LIMIT, X_LIMIT = 1 << 17, 1 << 35, 1 << 17


class Rig(Bench):
    """The block, with a table that answers a clock after it was asked."""

    def __init__(self, dut, table, gap=0.0, stall=0.0, seed=1):
        super().__init__(dut, gap=gap, stall=stall, seed=seed, plain={"table_data": 0})
        self.table = [int(word) for word in table]
        cocotb.start_soon(self._answer())

    async def _answer(self):
        while True:
            await RisingEdge(self.dut.clk)
            address = self.dut.table_address.value
            word = self.table[address.to_unsigned()] if address.is_resolvable else 0
            self.dut.table_data.value = word

    async def compare(self, matches):
        """Send tuples (x, beam, status, area, u, v) or END, compare what comes."""
        sending = cocotb.start_soon(self.i.send([pack(match) for match in matches]))
        got = await self.o.receive(len(matches))
        for at, (word, match) in enumerate(zip(got, matches, strict=True)):
            wanted = expected(match, self.table)
            assert word == wanted, f"spot {at}, {match}: got {word:#x}, not {wanted:#x}"
        await sending


def pack(match):
    if match == END:
        return END
    x, beam, status, area, u, v = match
    return status << 1 | beam << 3 | area << 12 | u << 23 | v << 41 | (x & 0x3FFFF) << 59


def expected(match, table):
    if match == END:
        return END
    x, beam, status, area, u, v = match
    status, beam, inverse_z = (int(value[0]) for value in inverse_depth(x, beam, status, table))
    return status << 1 | beam << 3 | area << 12 | u << 23 | v << 41 | inverse_z << 59


def random_match(rng, beam=None, status=0):
    return (rng.randint(-X_LIMIT, X_LIMIT - 1), rng.randrange(512) if beam is None else beam,
            status, rng.getrandbits(11), rng.getrandbits(18), rng.getrandbits(18))


def usual_table(rng):
    """Alpha and beta that give inverse depths in range, and some that do not."""
    alpha = [rng.randint(-5000, 5000) for _ in range(512)]
    beta = [rng.randint(0, 1 << 30) for _ in range(512)]
    return pack_depth(alpha, beta)


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.6], stall=[0.0, 0.6])
async def spots_match_model(dut, gap, stall):
    seed = parameters()["seed"]
    rng = random.Random(f"{seed} {gap} {stall}")
    bench = Rig(dut, usual_table(rng), gap, stall, seed)
    await bench.reset()
    matches = [random_match(rng) for _ in range(150)]
    for at in range(0, 150, 5):
        matches[at] = rng.choice([END, random_match(rng, 0, rng.choice([1, 2, 3]))])
    await bench.compare(matches)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def limits_of_the_range(dut):
    """1 and 2**18 - 1 are kept, 0 and 2**18 are rejected, to the bit of the fraction; and each
    bit alone decides, within the range and above it."""
    steps = (-2049, -2048, -2047, -1, 0, 1, 2047, 2048, 2049)
    values = [0, 1, 2, (1 << 18) - 2, (1 << 18) - 1, 1 << 18, (1 << 18) + 1, -1]
    beta = [(value << 12) + step for value in values for step in steps]
    beta += [1 << 12 << bit for bit in range(23)]
    bench = Rig(dut, pack_depth([0] * 512, beta + [0] * (512 - len(beta))))
    await bench.reset()
    matches = [(77, beam, 0, 1, 2, 3) for beam in range(len(beta))]
    await bench.compare(matches)
    statuses = [expected(match, bench.table) >> 1 & 3 for match in matches]
    assert statuses.count(0) == 36 + 18 and statuses.count(3) == 36 + 5


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def largest_values(dut):
    """The extremes of x, alpha and beta, which must not wrap."""
    beta = [-BETA_LIMIT, -BETA_LIMIT + 1, -(1 << 34), -1, 0, 1 << 34, BETA_LIMIT - 1]
    alpha = [-ALPHA_LIMIT, -1, 0, 1, ALPHA_LIMIT - 1]
    pairs = [(a, b) for a in alpha for b in beta]
    # Sums that are in range although both terms are not.
    pairs += [(-ALPHA_LIMIT, -(1 << 34) + (7 << 12)), (ALPHA_LIMIT - 1, (1 << 34) - (1 << 17))]
    table = [(0, 0)] * 512
    table[:len(pairs)] = pairs
    bench = Rig(dut, pack_depth(*zip(*table, strict=True)))
    await bench.reset()
    matches = [(x, beam, 0, 255, 0x3FFFF, 0) for beam in range(len(pairs))
               for x in (-X_LIMIT, -1, 0, 1, X_LIMIT - 1)]
    await bench.compare(matches)
    assert any(expected(match, bench.table) >> 59 for match in matches[-10:])


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(value=[0, 5 << 12, BETA_LIMIT - 1, -BETA_LIMIT])
async def other_statuses_pass(dut, value):
    """Noise, ambiguous and rejected spots, and end markers, whatever the table says."""
    bench = Rig(dut, pack_depth([0] * 512, [value] * 512))
    await bench.reset()
    rng = random.Random(3)
    matches = [END]
    for status in (1, 2, 3, 0, 1):
        matches += [random_match(rng, 0, status), END]
    await bench.compare(matches)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def throughput_and_latency(dut):
    """A spot every ``latency + 1`` clocks; the point is there after the latency."""
    rng = random.Random(2)
    bench = Rig(dut, usual_table(rng))
    await bench.reset()
    matches = [random_match(rng, status=rng.choice([0, 0, 1])) for _ in range(20)]
    bench.i.append([pack(match) for match in matches])
    while len(bench.o.words) < len(matches):
        await RisingEdge(dut.clk)
    clocks = [clock for clock, _ in bench.o.words]
    assert {b - a for a, b in zip(clocks, clocks[1:], strict=False)} == {LATENCY + 1}
    assert bench.i.taken == clocks


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def a_point_waits(dut):
    """A stalled point stays, with the table and everything else changing about it."""
    rng = random.Random(4)
    bench = Rig(dut, usual_table(rng), stall=1.0)
    await bench.reset()
    match = random_match(rng, 5)
    wanted = expected(match, bench.table)
    sending = cocotb.start_soon(bench.i.send([pack(match)]))
    await ClockCycles(dut.clk, LATENCY + 2)
    bench.table = [0] * 1024
    await ClockCycles(dut.clk, 20)
    assert dut.o_valid.value
    bench.o.stall = 0.0
    assert await bench.o.receive(1) == [wanted]
    await sending


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(clocks=[1, 2, 3, 4, 5, 6, 7])
async def reset_forgets(dut, clocks):
    rng = random.Random(6)
    bench = Rig(dut, usual_table(rng), stall=1.0)
    await bench.reset()
    dut.i_payload.value = pack(random_match(rng))
    dut.i_valid.value = 1
    await ClockCycles(dut.clk, clocks)
    dut.i_valid.value = 0
    await bench.reset()
    assert not dut.o_valid.value
    bench.o.stall = 0.0
    await bench.compare([random_match(rng) for _ in range(4)])
