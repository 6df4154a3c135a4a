"""Bench of the serial receiver: it reports what its model receives, in the same clocks."""

import random

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from model.link.uart_rx import LATENCY, receive
from tb.harness import Bench, parameters

SEED = parameters()["seed"]


def characters(octets, bit, rng, pause=0.0, stop=1.0):
    """Levels of characters of ``bit`` clocks a bit (any number), at a random phase."""
    edges, now = [], 2 * bit + rng.random()
    for octet in octets:
        for level in [0, *(octet >> place & 1 for place in range(8))]:
            edges.append((now, level))
            now += bit
        edges.append((now, 1))
        now += bit * stop + rng.random() * pause * bit
    levels, level = [], 1
    for clock in range(int(now + 3 * bit) + 8):
        while edges and edges[0][0] <= clock:
            level = edges.pop(0)[1]
        levels.append(level)
    return levels


class Line(Bench):
    """Drives the line; what is received and when, the first level being in clock 0."""

    def __init__(self, dut, divisor):
        super().__init__(dut, inputs=(), outputs=(), plain={"rx": 1, "divisor": divisor})
        self.divisor = divisor

    async def receive(self, levels):
        received = []
        for clock, level in enumerate([*levels, *[1] * (LATENCY + 1)]):
            self.dut.rx.value = int(level)
            await ReadOnly()
            assert not (self.dut.o_valid.value and self.dut.framing.value)
            if self.dut.o_valid.value:
                received.append((clock, int(self.dut.o_payload.value)))
            if self.dut.framing.value:
                received.append((clock, None))
            await RisingEdge(self.dut.clk)
        return received

    async def compare(self, levels):
        """What the block receives, the same as its model; in the end the line rests."""
        levels = [*levels, *[1] * 12 * self.divisor]
        received = await self.receive(levels)
        assert received == receive(levels, self.divisor)
        return [octet for _, octet in received]


def some_octets(rng, number):
    return [0x00, 0xFF, 0x55, 0xAA, 0x01, 0x80, *(rng.getrandbits(8) for _ in range(number))]


@cocotb.test(timeout_time=20, timeout_unit="ms")
@cocotb.parametrize(divisor=[2, 3, 4, 5, 8, 13])
async def octets_arrive(dut, divisor):
    """Right after each other and with pauses, at the same rate."""
    bench = Line(dut, divisor)
    await bench.reset()
    rng = random.Random(f"{SEED} {divisor}")
    for pause in (0.0, 3.0):
        octets = some_octets(rng, 20)
        levels = characters(octets, divisor, rng, pause)
        assert await bench.compare(levels) == octets


@cocotb.test(timeout_time=50, timeout_unit="ms")
@cocotb.parametrize(divisor=[4, 8, 12, 20, 139])
async def other_rates(dut, divisor):
    """A sender up to 3 % too fast or slow, at any phase, without a pause."""
    bench = Line(dut, divisor)
    await bench.reset()
    rng = random.Random(f"{SEED} {divisor}")
    for error in ((-0.03, -0.02, 0.02, 0.03) if divisor >= 12 else (-0.01, 0.01)):
        for _ in range(4 if divisor < 100 else 1):
            octets = some_octets(rng, 10)
            levels = characters(octets, divisor * (1 + error), rng)
            assert await bench.compare(levels) == octets, f"error {error}"


@cocotb.test(timeout_time=20, timeout_unit="ms")
@cocotb.parametrize(divisor=[16, 25])
async def glitches_are_passed_over(dut, divisor):
    """Single clocks of the wrong level, anywhere; low pulses short of half a bit while idle."""
    bench = Line(dut, divisor)
    await bench.reset()
    rng = random.Random(f"{SEED} {divisor}")
    octets = some_octets(rng, 30)
    levels = characters(octets, divisor, rng, 2.0)
    at = 1
    while at < len(levels) - 1:
        # An edge may move by a clock, which the middles of bits do not mind.
        levels[at] ^= 1
        at += rng.randint(5, 2 * divisor)
    assert await bench.compare(levels) == octets
    for length in range(1, divisor // 2):
        assert await bench.compare([1] * 5 + [0] * length + [1] * divisor) == []
    pulse = [1] * 5 + [0] * (divisor // 3) + [1] * divisor
    assert await bench.compare(pulse + characters([0xA7], divisor, rng) + pulse) == [0xA7]


@cocotb.test(timeout_time=20, timeout_unit="ms")
@cocotb.parametrize(divisor=[4, 30])
async def breaks_and_missing_stop_bits(dut, divisor):
    """One pulse of ``framing`` each, however long; the character behind is right."""
    bench = Line(dut, divisor)
    await bench.reset()
    rng = random.Random(f"{SEED} {divisor}")
    for bits in (10, 11, 25, 100):
        levels = [1] * 9 + [0] * (bits * divisor) + [1] * 2 * divisor
        assert await bench.compare([*levels, *characters([0x3C], divisor, rng)]) == [None, 0x3C]
    # The stop bit of the first one is low, and the line then high for half a bit.
    first = characters([0x81], divisor, rng)
    begin = first.index(0)
    levels = first[:begin + 9 * divisor] + [0] * divisor + [1] * max(divisor // 2, 3)
    assert await bench.compare([*levels, *characters([0xC3], divisor, rng)[begin:]]) == [None, 0xC3]
    # A stop bit that is a little more than half as long as it should be will do.
    octets = some_octets(rng, 10)
    levels = characters(octets, divisor, rng, stop=0.5 + 3 / divisor if divisor > 9 else 1)
    assert await bench.compare(levels) == octets


@cocotb.test(timeout_time=20, timeout_unit="ms")
@cocotb.parametrize(divisor=[2, 5, 16])
async def noise(dut, divisor):
    """Levels of any length: what is received is the model's matter, and afterwards all is well."""
    bench = Line(dut, divisor)
    await bench.reset()
    rng = random.Random(f"{SEED} {divisor}")
    for _ in range(20):
        levels = []
        while len(levels) < 40 * divisor:
            levels += [rng.getrandbits(1)] * rng.randint(1, rng.choice([2, divisor, 4 * divisor]))
        await bench.compare(levels)
        assert await bench.compare(characters([0x96], divisor, rng)) == [0x96]


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def the_divisor_changes_between_characters(dut):
    bench = Line(dut, 16)
    await bench.reset()
    rng = random.Random(SEED)
    for divisor in (16, 5, 70, 2, 40):
        dut.divisor.value = bench.divisor = divisor
        await ClockCycles(dut.clk, 2)
        octets = some_octets(rng, 4)
        assert await bench.compare(characters(octets, divisor, rng)) == octets


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def reset_forgets(dut):
    """Reset in every bit of a character; the rest of it is noise, the next one is right."""
    bench = Line(dut, 6)
    await bench.reset()
    rng = random.Random(SEED)
    for clocks in range(1, 80):
        for level in characters([0x0F], 6, rng)[10:10 + clocks]:
            dut.rx.value = level
            await RisingEdge(dut.clk)
        dut.rx.value = 1
        await bench.reset(1 + 2 * (clocks % 2))
        assert await bench.compare([1] * 5) == []
        assert await bench.compare(characters([0x5A], 6, rng)) == [0x5A]
