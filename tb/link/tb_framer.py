"""Bench of the framer: numbers, checks, zeros, pauses; its octets equal the model's."""

import random
import zlib

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.link.framer import Framer
from model.link.framer import frame
from tb.harness import Bench, parameters

SEED = parameters()["seed"]
CASES = [
    b"\x50", b"\x50\0", b"\x50\0\0", b"\x50\1\0", b"\x50\0\1", b"\x50" + bytes(91),
    b"\x50" + bytes(range(1, 92)), b"\x50" + b"\xff" * 91, b"\x50" + bytes(45) + b"\1" * 46,
    b"\x50" + b"\1" * 46 + bytes(45),
]


def words(content):
    return [*content[:-1], content[-1] | 0x100]


def random_content(rng, size=None):
    size = rng.randrange(92) if size is None else size
    octets = rng.choice([range(256), range(2), range(1, 4)])
    return bytes([rng.randrange(1, 256), *(rng.choice(octets) for _ in range(size))])


def make(dut, gap=0.0, stall=0.0, divisor=1):
    return Bench(dut, gap=gap, stall=stall, seed=SEED, plain={"divisor": divisor, "cts": 1})


async def check(bench, contents, sequence=0):
    packets, sequence = frame(contents, sequence)
    for content, packet in zip(contents, packets, strict=True):
        got = bytes(await bench.o.receive(len(packet)))
        assert got == packet, f"{content.hex()}: got {got.hex()}, not {packet.hex()}"
    return sequence


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.9], stall=[0.0, 0.9])
async def packets_match_model(dut, gap, stall):
    rng = random.Random(f"{SEED} {gap} {stall}")
    bench = make(dut, gap, stall)
    await bench.reset()
    contents = CASES + [random_content(rng) for _ in range(15)]
    for content in contents:
        bench.i.append(words(content))
    await check(bench, contents)
    await ClockCycles(dut.clk, 200)
    assert not bench.o.words and not dut.busy.value
    assert dut.packets.value == len(contents)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def checks_with_zeros(dut):
    """A check may hold zeros, which COBS takes away: in each of its octets, and in several."""
    rng = random.Random(f"{SEED} zeros")
    bench = make(dut)
    await bench.reset()
    contents = []
    for zeros in ((0,), (1,), (2,), (3,), (2, 3), (0, 3)):
        while True:
            content = random_content(rng, 9)
            numbered = content[:1] + bytes([len(contents)]) + content[1:]
            octets = zlib.crc32(numbered).to_bytes(4, "little")
            if not any(octets[at] for at in zeros):
                break
        contents.append(content)
        bench.i.append(words(content))
    await check(bench, contents)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def all_sequence_numbers(dut):
    bench = make(dut)
    await bench.reset()
    contents = [bytes([1 + n % 255]) for n in range(260)]
    for content in contents:
        bench.i.append(words(content))
    assert await check(bench, contents) == 4


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def one_is_assembled_while_one_is_sent(dut):
    """Nothing is sent before it is whole; two packets are taken while none leaves, not three."""
    bench = make(dut, stall=1.0)
    await bench.reset()
    contents = [random_content(random.Random(SEED), size) for size in (50, 60, 70)]
    await bench.i.send(words(contents[0])[:-1])
    await ClockCycles(dut.clk, 100)
    assert not dut.o_valid.value and dut.busy.value
    bench.i.append(words(contents[0])[-1:] + words(contents[1]) + words(contents[2]))
    await ClockCycles(dut.clk, 3000)
    assert dut.o_valid.value and len(bench.i.taken) == 51 + 61
    bench.o.stall = 0.0
    await check(bench, contents)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def clocks_of_assembly(dut):
    """Nine for each octet, the number and the check; 2 more for the packet."""
    bench = make(dut)
    await bench.reset()
    content = random_content(random.Random(SEED), 40)
    bench.i.append(words(content) + words(b"\x50"))
    while not bench.o.words:
        await RisingEdge(dut.clk)
    taken = bench.i.taken
    assert [b - a for a, b in zip(taken[:41], taken[1:41], strict=False)] == [18] + [9] * 39
    first, first_out = taken[0] - 7, bench.o.words[0][0]
    assert first_out - first == 9 * (41 + 1 + 4) + 1, first_out - first
    assert first_out - taken[40] == Framer.latency


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(divisor=[0, 1, 2, 7])
async def pace(dut, divisor):
    """Ten bit times from octet to octet, forty from packet to packet, neither more nor less."""
    bench = make(dut, divisor=divisor)
    await bench.reset()
    # Short enough for the next one to be there in time.
    contents = [random_content(random.Random(SEED), size) for size in (91, 70, 50, 20)]
    for content in contents:
        bench.i.append(words(content))
    packets, _ = frame(contents)
    while len(bench.o.words) < sum(map(len, packets)):
        await RisingEdge(dut.clk)
    times, bit, at = [clock for clock, _ in bench.o.words], max(1, divisor), 0
    for packet in packets:
        own = times[at:at + len(packet)]
        assert {b - a for a, b in zip(own, own[1:], strict=False)} == {10 * bit}
        at += len(packet)
        if at < len(times):
            assert times[at] - own[-1] == 40 * bit
    while True:
        await ReadOnly()
        if not dut.busy.value:
            break
        await RisingEdge(dut.clk)
    # An edge ends the clock in which an octet is taken; `busy` is that of the clock to come.
    assert bench.cycle + 1 - times[-1] == 40 * bit


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def clear_to_send(dut):
    """An octet is offered only in a clock in which ``cts`` is high; nothing is lost."""
    rng = random.Random(SEED)
    bench = make(dut, stall=0.3)
    await bench.reset()
    contents = [random_content(rng, 20) for _ in range(6)]
    for content in contents:
        bench.i.append(words(content))
    refused = 0
    offered = False
    while len(bench.o.words) < sum(len(packet) for packet in frame(contents)[0]):
        cts = int(rng.random() < 0.3)
        dut.cts.value = cts
        await ReadOnly()
        assert cts or offered or not dut.o_valid.value
        offered = dut.o_valid.value and not dut.o_ready.value
        refused += not cts
        await RisingEdge(dut.clk)
    assert refused > 100
    await check(bench, contents)


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(clocks=[3, 30, 150, 400, 700, 1000])
async def reset_forgets(dut, clocks):
    rng = random.Random(SEED)
    bench = make(dut)
    await bench.reset()
    dut.i_payload.value = 0x33
    dut.i_valid.value = 1
    await ClockCycles(dut.clk, clocks)
    dut.i_payload.value = 0x133
    await ClockCycles(dut.clk, clocks)
    dut.i_valid.value = 0
    await bench.reset()
    bench.o.words.clear()
    contents = [random_content(rng) for _ in range(3)]
    for content in contents:
        bench.i.append(words(content))
    await check(bench, contents)
