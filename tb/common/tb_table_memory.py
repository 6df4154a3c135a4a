"""Bench of the table memory: both readers see what was written, one clock after they ask."""

import random

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from tb.harness import Bench, parameters

SEED = parameters()["seed"]
PORTS = ("a_address", "b_address", "write_enable", "write_address", "write_data")


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reads_what_was_written(dut):
    """Random traffic on all ports; first of all, every word reads as zero."""
    Bench(dut, inputs=(), outputs=(), plain=dict.fromkeys(PORTS, 0))
    dut.rst.value = 0
    rng = random.Random(SEED)
    words, a, b = [0] * 512, None, None
    for clock in range(6000):
        if clock < 600:
            addresses, write = (clock % 512, 511 - clock % 512), False
        else:
            addresses = rng.randrange(512), rng.randrange(512)
            write = rng.random() < (0.9 if clock < 1600 else 0.2)
        place = (clock - 600) % 512 if clock < 1600 else rng.choice(
            [rng.randrange(512), addresses[0], addresses[1] ^ 1])
        word = rng.getrandbits(36)
        dut.a_address.value, dut.b_address.value = addresses
        dut.write_enable.value = write
        dut.write_address.value = place
        dut.write_data.value = word
        await ReadOnly()
        for name, want in (("a_data", a), ("b_data", b)):
            if want is not None:
                got = int(getattr(dut, name).value)
                assert got == want, f"clock {clock}, {name}: got {got:#x}, not {want:#x}"
        a = None if write else words[addresses[0]]
        b = None if write and place == addresses[1] else words[addresses[1]]
        if write:
            words[place] = word
        # Reset must leave the words as they are.
        await RisingEdge(dut.clk)
        dut.rst.value = rng.random() < 0.05
