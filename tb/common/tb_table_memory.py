"""Bench of the table memory: both readers see what was written, one clock after they ask."""

import random

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from hdl.common.table_memory import TableMemory
from tb.harness import Bench, parameters

SEED, BEAMS = parameters()["seed"], parameters()["beams"]
PORTS = ("bank", "a_address", "b_address", "write_bank", "write_enable", "read_enable",
         "write_address", "write_data")


ADDRESSES = [*range(2 * BEAMS), *range(1024, 1280)]


def index(address, bank):
    """Which word an address stands for: below 1024 there are two."""
    return address if address >= 1024 else (address, bank)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reads_what_was_written(dut):
    """Random traffic on all ports; first of all, every word reads as zero."""
    Bench(dut, inputs=(), outputs=(), plain=dict.fromkeys(PORTS, 0))
    dut.rst.value = 0
    rng = random.Random(SEED)
    words = {index(address, bank): 0 for address in ADDRESSES for bank in (0, 1)}
    bank = 0
    due = [(None, None)] * TableMemory.latency
    count = len(ADDRESSES)
    for clock in range(8 * count + 4000):
        if clock < 2 * count:
            bank = clock // count
            addresses = ADDRESSES[clock % count], ADDRESSES[-1 - clock % count]
            write = read = False
        else:
            bank ^= rng.random() < 0.05
            addresses = rng.choice(ADDRESSES), rng.choice(ADDRESSES)
            write = rng.random() < (0.9 if clock < 6 * count else 0.2)
            read = not write and rng.random() < 0.3
        host_bank = bank ^ (rng.random() < 0.9)
        address = ADDRESSES[clock % count] if clock < 6 * count else rng.choice(
            [rng.choice(ADDRESSES), addresses[0], addresses[1],
             ADDRESSES[ADDRESSES.index(addresses[1]) ^ 1]])
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
