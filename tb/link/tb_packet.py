"""Bench of the packet block: what it sends equals the model's bytes."""

import random

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, RisingEdge

from model.link.packet import POINT, Frame, encode, pack_points
from tb.harness import Bench, parameters
from tb.link.vectors import FIELDS, escaped_point, random_frame, vectors


def words(frame):
    """Payload words of the three streams."""
    points = [int.from_bytes(octets.tobytes(), "little") << 1 for octets in
              pack_points(frame.points)] + [1]
    counts = frame.spots | frame.rejected << 16 | frame.dropped << 32 | int(frame.broken) << 48
    info = frame.number | frame.level << 16 | int(frame.learning) << 24 | frame.skipped << 25
    return points, counts, info


def make(dut, gap, stall, seed):
    return Bench(dut, inputs=("i", "counts", "info"), gap=gap, stall=stall, seed=seed,
                 plain={"bad_sync": 0, "overrun": 0})


async def send(bench, frames):
    for frame in frames:
        points, counts, info = words(frame)
        bench.info.append([info])
        bench.i.append(points)
        bench.counts.append([counts])


async def check(bench, frames, sequence=0):
    for frame in frames:
        expected, sequence = encode(frame, sequence)
        got = bytes(await bench.o.receive(len(expected)))
        assert got == expected, f"frame {frame.number}: got {got.hex()}, not {expected.hex()}"
    return sequence


async def random_sizes(dut, gap, stall, seed):
    rng = random.Random(seed)
    bench = make(dut, gap, stall, seed)
    await bench.reset()
    sizes = [0, 1, 8, 9, 10, 0, 18, 19, 27, 28]
    frames = [random_frame(rng, 0xFFFC + n, size, escapes=n in (5, 7))
              for n, size in enumerate(sizes)]
    cocotb.start_soon(send(bench, frames))
    await check(bench, frames)
    await ClockCycles(dut.clk, 50)
    assert not bench.o.words


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.7], stall=[0.0, 0.6])
async def frames_match_model(dut, gap, stall):
    await random_sizes(dut, gap, stall, parameters()["seed"])


@cocotb.test(timeout_time=1, timeout_unit="ms", skip="gap" not in parameters())
async def random_frames(dut):
    await random_sizes(dut, parameters()["gap"], parameters()["stall"], parameters()["seed"])


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def vectors_are_sent(dut):
    """Octet for octet what the file of vectors says."""
    bench = make(dut, 0.0, 0.0, 1)
    await bench.reset()
    for name, frames, sequence, octets in vectors():
        got = b""
        for frame in frames:
            dut.bad_sync.value = frame.bad_sync
            dut.overrun.value = frame.overrun
            await send(bench, [frame])
            expected, sequence = encode(frame, sequence)
            got += bytes(await bench.o.receive(len(expected)))
        assert got == octets, f"{name}: got {got.hex()}, not {octets.hex()}"


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def boundary_values(dut):
    """All zeros and all ones."""
    bench = make(dut, 0.0, 0.0, parameters()["seed"])
    await bench.reset()
    frames = []
    for value in (0, 1):
        table = np.zeros(20, POINT)
        for name, _, bits in FIELDS:
            table[name] = ((1 << bits) - 1) * value
        full = 0xFFFF * value
        frames.append(Frame(
            points=table, number=full, level=full & 0xFF, learning=bool(value),
            skipped=full & 0xFF, spots=full, rejected=full - 20 * value, dropped=full,
            broken=bool(value)))
    cocotb.start_soon(send(bench, frames))
    await check(bench, frames)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def fullest_packets(dut):
    """A packet takes one more point at 77 octets, not at 78, and stays within 100."""
    rng = random.Random(5)
    bench = make(dut, 0.0, 0.0, 1)
    await bench.reset()
    frames = []
    for escapes in (6, 7, 8, 7, 7, 7):
        table = np.zeros(9, POINT)  # 7 octets, with the escapes of the frame's number; 9 a point
        for at, octets in [(6, escapes), (7, 9)]:
            for name, value in escaped_point(rng, octets).items():
                table[name][at] = value
        frames.append(Frame(points=table, number=0x7E7D))
    cocotb.start_soon(send(bench, frames))
    await check(bench, frames)
    lengths = [len(encode(frame)[0].split(b"\x7e")[1]) + 2 for frame in frames]
    assert lengths[2] < 84 and 98 <= max(lengths) <= 100, lengths


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def all_packet_numbers(dut):
    """The packet number wraps; so does nothing else."""
    bench = make(dut, 0.0, 0.0, 1)
    await bench.reset()
    frames = [Frame(number=n) for n in range(260)]
    cocotb.start_soon(send(bench, frames))
    assert await check(bench, frames) == 4


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def camera_counters(dut):
    bench = make(dut, 0.0, 0.0, 1)
    await bench.reset()
    sequence = 0
    for bad_sync, overrun in [(1, 2), (255, 254), (0x7E, 0x7D)]:
        dut.bad_sync.value = bad_sync
        dut.overrun.value = overrun
        await RisingEdge(dut.clk)
        frame = Frame(number=3, bad_sync=bad_sync, overrun=overrun)
        expected, sequence = encode(frame, sequence)
        await send(bench, [frame])
        got = bytes(await bench.o.receive(3))
        # What changes later is for the next packet.
        dut.bad_sync.value = bad_sync ^ 0xFF
        dut.overrun.value = overrun ^ 0xFF
        got += bytes(await bench.o.receive(len(expected) - 3))
        assert got == expected


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def waits_for_all_it_needs(dut):
    """Without info, or without counts at the end, nothing opens; valid never waits for ready."""
    bench = make(dut, 0.0, 1.0, 1)
    await bench.reset()
    frame = random_frame(random.Random(1), 5, 2)
    points, counts, info = words(frame)
    bench.i.append(points)
    await ClockCycles(dut.clk, 30)
    assert not dut.o_valid.value
    bench.info.append([info])
    await ClockCycles(dut.clk, 5)
    assert dut.o_valid.value
    bench.o.stall = 0.0
    await ClockCycles(dut.clk, 600)
    assert not dut.o_valid.value
    taken = len(bench.o.words)
    bench.counts.append([counts])
    expected, _ = encode(frame)
    got = bytes(await bench.o.receive(len(expected)))
    assert got == expected
    assert taken == expected.index(b"\x7e\x7e") + 1


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def octets_keep_up_with_the_line(dut):
    """Ten clocks or fewer from octet to octet, so that a line of one clock a bit never idles."""
    bench = make(dut, 0.0, 0.0, 1)
    await bench.reset()
    frames = [random_frame(random.Random(3), n, 30, escapes=n == 1) for n in range(3)]
    await send(bench, frames)
    size = sum(len(encode(frame)[0]) for frame in frames)
    while len(bench.o.words) < size:
        await RisingEdge(dut.clk)
    clocks = [clock for clock, _ in bench.o.words]
    steps = [b - a for a, b in zip(clocks, clocks[1:], strict=False)]
    assert max(steps) <= 10, steps


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(clocks=[3, 40, 150, 700, 1100])
async def reset_forgets(dut, clocks):
    """After a reset in the middle of a packet counts and numbers start again."""
    rng = random.Random(9)
    bench = make(dut, 0.0, 0.0, 1)
    await bench.reset()
    points, counts, info = words(random_frame(rng, 1, 12))
    for name, word in [("i", points[3]), ("counts", counts), ("info", info)]:
        getattr(dut, f"{name}_payload").value = word
        getattr(dut, f"{name}_valid").value = 1
    await ClockCycles(dut.clk, clocks)
    for name in ("i", "counts", "info"):
        getattr(dut, f"{name}_valid").value = 0
    await bench.reset()
    bench.o.words.clear()
    other = random_frame(rng, 2, 3)
    cocotb.start_soon(send(bench, [other]))
    await check(bench, [other])
