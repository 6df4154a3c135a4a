"""Bench of the serial transmitter, for both twins; the line is read by a receiver of its own."""

import random

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from tb.harness import Bench, parameters


class Line:
    """Level of the line in every clock."""

    def __init__(self, bench):
        self.dut, self.levels = bench.dut, []
        cocotb.start_soon(self._watch())

    async def _watch(self):
        while True:
            await ReadOnly()
            self.levels.append(int(self.dut.tx.value))
            await RisingEdge(self.dut.clk)

    def octets(self, divisor):
        """Octets sent and the clocks at which their start bits began; every level is checked."""
        octets, begins, at, levels = [], [], 0, self.levels
        while at < len(levels):
            if levels[at]:
                at += 1
                continue
            bits = [levels[at + divisor * n:at + divisor * (n + 1)] for n in range(10)]
            if len(bits[-1]) < divisor:
                break
            assert all(len(set(bit)) == 1 for bit in bits), f"a bit changes, at clock {at}"
            assert bits[9][0], f"no stop bit, at clock {at}"
            octets.append(sum(bit[0] << n for n, bit in enumerate(bits[1:9])))
            begins.append(at)
            at += 10 * divisor
        return octets, begins


def make(dut, divisor, gap=0.0, seed=1):
    return Bench(dut, outputs=(), gap=gap, seed=seed, plain={"divisor": divisor})


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.9], divisor=[1, 2, 3, 9])
async def octets_arrive(dut, gap, divisor):
    seed = parameters()["seed"]
    rng = random.Random(f"{seed} {gap} {divisor}")
    bench = make(dut, divisor, gap, seed)
    await bench.reset()
    line = Line(bench)
    octets = [0x00, 0xFF, 0x55, 0xAA, 0x01, 0x80] + [rng.getrandbits(8) for _ in range(20)]
    await bench.i.send(octets)
    await ClockCycles(dut.clk, 10 * divisor + 5)
    assert line.octets(divisor)[0] == octets


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(divisor=[0, 1, 2, 7, 69])
async def no_pause_between_octets(dut, divisor):
    """Ten bit times from start bit to start bit, exactly; divisor 0 counts as 1."""
    bench = make(dut, divisor)
    await bench.reset()
    line = Line(bench)
    octets = [0x00, 0x7E, 0xFF, 0x00, 0x81]
    sending = cocotb.start_soon(bench.i.send(octets))
    clocks = max(divisor, 1)
    await ClockCycles(dut.clk, 50 * clocks + 10)
    await sending
    got, begins = line.octets(clocks)
    assert got == octets
    assert {b - a for a, b in zip(begins, begins[1:], strict=False)} == {10 * clocks}
    # The first one is taken at once, its start bit follows in the next clock.
    steps = [b - a for a, b in zip(bench.i.taken, bench.i.taken[1:], strict=False)]
    assert set(steps) == {10 * clocks}


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def start_bit_follows_at_once(dut):
    bench = make(dut, 5)
    await bench.reset()
    await ClockCycles(dut.clk, 23)
    await ReadOnly()
    assert dut.tx.value and dut.i_ready.value
    await RisingEdge(dut.clk)
    dut.i_valid.value = 1
    dut.i_payload.value = 0xFF
    await RisingEdge(dut.clk)
    dut.i_valid.value = 0
    for clock in range(60):
        await ReadOnly()
        assert int(dut.tx.value) == (clock >= 5), clock
        assert int(dut.i_ready.value) == (clock >= 49), clock
        await RisingEdge(dut.clk)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def longest_bit(dut):
    bench = make(dut, 0xFFFF)
    await bench.reset()
    dut.i_valid.value = 1
    dut.i_payload.value = 0xFF
    await RisingEdge(dut.clk)
    dut.i_valid.value = 0
    await ClockCycles(dut.clk, 0xFFFE)
    await ReadOnly()
    assert not dut.tx.value
    await ClockCycles(dut.clk, 1)
    await ReadOnly()
    assert dut.tx.value and not dut.i_ready.value


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_lets_go_of_the_line(dut):
    """High within a clock of reset, wherever the octet is, and whole octets after it."""
    bench = make(dut, 3)
    for clocks in (1, 2, 7, 15, 29):
        await bench.reset()
        dut.i_valid.value = 1
        dut.i_payload.value = 0
        await ClockCycles(dut.clk, 1 + clocks)
        dut.i_valid.value = 0
        dut.rst.value = 1
        await RisingEdge(dut.clk)
        await ReadOnly()
        assert dut.tx.value
        await RisingEdge(dut.clk)
        await bench.reset()
        line = Line(bench)
        await bench.i.send([0x3C])
        await ClockCycles(dut.clk, 35)
        assert line.octets(3)[0] == [0x3C]
