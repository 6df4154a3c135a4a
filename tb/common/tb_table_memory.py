"""Bench of the table memory: both readers see what was written, one clock after they ask."""

import random

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from hdl.common.table_memory import TableMemory
from tb.harness import Bench, parameters

SEED, BEAMS = parameters()["seed"], parameters()["beams"]
PORTS = ("bank", "a_address", "b_address", "write_bank", "write_enable", "read_enable",
         "write_address", "write_data")


def index(address, bank):
    """Which word an address stands for: below 256 there are two."""
    if address >= 256:
        return address
    return address % (128 if BEAMS <= 64 else 256), bank


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reads_what_was_written(dut):
    """Random traffic on all ports; first of all, every word reads as zero."""
    Bench(dut, inputs=(), outputs=(), plain=dict.fromkeys(PORTS, 0))
    dut.rst.value = 0
    rng = random.Random(SEED)
    words = {index(address, bank): 0 for address in range(512) for bank in (0, 1)}
    bank = 0
    due = [(None, None)] * TableMemory.latency
    for clock in range(12000):
        if clock < 1200:
            bank = clock // 600
            addresses, write, read = (clock % 512, 511 - clock % 512), False, False
        else:
            bank ^= rng.random() < 0.05
            addresses = rng.randrange(512), rng.randrange(512)
            write = rng.random() < (0.9 if clock < 3600 else 0.2)
            read = not write and rng.random() < 0.3
        host_bank = bank ^ (rng.random() < 0.9)
        address = (clock - 1200) % 512 if clock < 3600 else rng.choice(
            [rng.randrange(512), addresses[0], addresses[1], addresses[1] ^ 1])
        word = rng.getrandbits(36)
        dut.bank.value, dut.write_bank.value = bank, host_bank
        dut.a_address.value, dut.b_address.value = addresses
        dut.write_enable.value, dut.read_enable.value = write, read
        dut.write_address.value = address
        dut.write_data.value = word
        await ReadOnly()
        for name, want in zip(("a_data", "b_data"), due.pop(0), strict=True):
            if want is not None:
                got = int(getattr(dut, name).value)
                assert got == want, f"clock {clock}, {name}: got {got:#x}, not {want:#x}"
        host = index(address, host_bank)
        indices = [index(each, bank) for each in addresses]
        due.append((None if write else words[host if read else indices[0]],
                    None if write and host == indices[1] else words[indices[1]]))
        if write:
            words[host] = word
        # Reset must leave the words as they are.
        await RisingEdge(dut.clk)
        dut.rst.value = rng.random() < 0.05
