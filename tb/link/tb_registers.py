"""Bench of the registers: limits, hand-over and the end of a single pair, as the model has them."""

import random

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from hdl.protocol import Mode, Reason
from model.link.commands import CommandMachine, Refused
from tb.harness import Bench, parameters

SEED = parameters()["seed"]
PORTS = ("address", "value", "write", "hand_over", "single_done")


def make(dut):
    return Bench(dut, inputs=(), outputs=(), plain=dict.fromkeys(PORTS, 0))


def reason(model, address, value):
    """What the model says to a WRITE; it is carried out if that is OK."""
    try:
        model._write(bytes([address]) + value.to_bytes(4, "little"))
    except Refused as refused:
        return refused.args[0]
    return Reason.OK


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def addresses_and_limits(dut):
    """All addresses, all limits, all bits above a register's own."""
    bench = make(dut)
    await bench.reset()
    model = CommandMachine(64, 64, 4, 2)
    for address in range(256):
        register = model.registers.get(address)
        values = [0, 1, 0xFFFFFFFF]
        if register:
            half = 1 << register.bits - 1
            ends = [0, half, 2 * half, -half, register.low, register.high or 0]
            values += [end + step & 0xFFFFFFFF for end in ends for step in (-1, 0, 1)]
            values += [1 << bit for bit in range(32)]
            values += [0xFFFFFFFF ^ 1 << bit for bit in range(32)]
        for value in values:
            dut.address.value, dut.value.value = address, value
            await RisingEdge(dut.clk)
            await ReadOnly()
            want = reason(model, address, value)
            assert bool(dut.known.value) == (register is not None)
            if register:
                assert bool(dut.fits.value) == (want == Reason.OK), (register.name, value)
                assert bool(dut.only_stopped.value) == register.only_stopped
            await RisingEdge(dut.clk)


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def what_acts_is_what_the_model_says(dut):
    bench = make(dut)
    await bench.reset()
    model = CommandMachine(64, 64, 4, 2)
    rng = random.Random(SEED)
    for clock in range(6000):
        if clock == 3000:
            dut.write.value = 0
            await bench.reset()
            model = CommandMachine(64, 64, 4, 2)
        address = rng.choice([0, rng.choice(list(model.registers))])
        register = model.registers[address]
        value = rng.getrandbits(register.bits)
        if register.signed:
            value |= -(value >> register.bits - 1) << register.bits & 0xFFFFFFFF
        if address == 0:
            value = rng.choice([Mode.SINGLE, Mode.SINGLE, rng.randrange(4)])
        hand_over, single_done = rng.random() < 0.1, rng.random() < 0.2
        dut.write.value = 0
        dut.address.value, dut.value.value = address, value
        await RisingEdge(dut.clk)
        dut.hand_over.value, dut.single_done.value = hand_over, single_done
        await ReadOnly()
        for each in model.registers.values():
            mask = (1 << each.bits) - 1
            assert int(getattr(dut, each.name).value) == model.acting[each.name] & mask
        assert int(dut.read_data.value) == model.written[register.name] & 0xFFFFFFFF
        fits = bool(dut.fits.value)
        await RisingEdge(dut.clk)
        dut.hand_over.value = dut.single_done.value = 0
        # What is handed over or ends in a clock is what was written before it.
        if single_done:
            model.single_done()
        if hand_over:
            model.hand_over()
        if fits and (model.acting["mode"] == Mode.STOP or not register.only_stopped):
            dut.write.value = 1
            assert reason(model, address, value) == Reason.OK
            await RisingEdge(dut.clk)


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def writing_and_handing_over_in_one_clock(dut):
    """What is written in the clock of a hand-over acts from the next one on."""
    bench = make(dut)
    await bench.reset()
    await RisingEdge(dut.clk)
    for mode, single_done in [(1, 0), (2, 0), (3, 0), (2, 0), (2, 1), (1, 1), (2, 0), (0, 1)]:
        before = int(dut.mode.value)
        dut.address.value, dut.value.value, dut.write.value = 0, mode, 1
        dut.hand_over.value, dut.single_done.value = 1, single_done
        await RisingEdge(dut.clk)
        dut.write.value = dut.hand_over.value = dut.single_done.value = 0
        await ReadOnly()
        assert int(dut.read_data.value) == mode
        ended = single_done and before == Mode.SINGLE
        assert int(dut.mode.value) == (Mode.STOP if ended else before)
        await RisingEdge(dut.clk)
        dut.hand_over.value = 1
        await RisingEdge(dut.clk)
        dut.hand_over.value = 0
        await RisingEdge(dut.clk)
        assert int(dut.mode.value) == mode
