"""Bench of the packets of points: what it sends equals the model's octets."""

import cocotb
import numpy as np
from cocotb.triggers import RisingEdge

from hdl.link.points import Points
from hdl.payloads import Counts, Detection, FrameInfo, Point
from model.link.points import packets
from model.preprocessing.area import area_code
from tb.harness import Bench, clock_cycles, parameters
from tb.link.frames import EXTREMES, near_points, pattern_frame, random_points
from tb.native_block import pack

SEED = parameters()["seed"]
FULL = parameters().get("full_records", 0)


def word(shape, **fields):
    return sum(int(part) << 32 * n for n, part in enumerate(pack(shape, **fields)[0]))


def words(frame):
    """Payload words of the points, and of counts, detection and info."""
    points = [word(Point, **{name: int(point[name]) for name in point.dtype.names}
                   | {"area": int(area_code(point["area"]))})
              for point in frame.points] + [word(Point, end=1)]
    counts = word(Counts, spots=frame.spots, rejected=frame.rejected, dropped=frame.dropped,
                  broken=frame.broken)
    detection = word(Detection, learning=frame.learning, level=frame.level,
                     noise=frame.grey_noise, saturated=frame.saturated)
    info = word(FrameInfo, number=frame.number, skipped=frame.skipped,
                tag_exposure_us=frame.exposure_us, tag_timestamp_us=frame.timestamp_us,
                tag_laser=frame.laser, tag_capture=frame.capture, tripped=frame.tripped,
                tables_valid=frame.tables_valid, every=frame.every)
    return points, counts, detection, info


def make(dut, gap=0.0, stall=0.0, full=FULL):
    return Bench(dut, inputs=("i", "counts", "detection", "info"), gap=gap, stall=stall, seed=SEED,
                 plain={"full_records": full})


def send(bench, frames):
    for frame in frames:
        points, counts, detection, info = words(frame)
        bench.info.append([info])
        bench.i.append(points)
        bench.counts.append([counts])
        bench.detection.append([detection])


async def check(bench, names, frames, full=FULL):
    for name, frame in zip(names, frames, strict=True):
        for content in packets(frame, bool(full)):
            expected = [*content[:-1], content[-1] | 0x100]
            got = await bench.o.receive(len(expected))
            assert got == expected, (
                f"{name}, seed {SEED}: got {bytes(octet & 255 for octet in got).hex()}, not "
                f"{content.hex()}")
    await clock_cycles(bench.dut.clk, 200)
    assert not bench.o.words


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def extremes(dut):
    bench = make(dut)
    await bench.reset()
    send(bench, [frame for _, frame in EXTREMES])
    await check(bench, *zip(*EXTREMES, strict=True))


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.7], stall=[0.0, 0.6])
async def random_frames(dut, gap, stall):
    rng = np.random.default_rng(SEED)
    bench = make(dut, gap, stall)
    await bench.reset()
    frames = []
    for _ in range(8):
        points = rng.choice([near_points, random_points])(
            rng, int(rng.integers(0, 60)), rng.choice([0.0, 0.5, 0.9, 1.0]))
        frames.append(pattern_frame(rng, points))
    send(bench, frames)
    await check(bench, range(8), frames)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def the_form_is_that_of_the_first_point(dut):
    """It may change at any time; a frame has the form that it began with."""
    rng = np.random.default_rng(SEED)
    bench = make(dut, stall=0.5)
    await bench.reset()
    form = FULL
    for number, clocks in enumerate([3, 80, 1500, 4000, 9000, 12_000]):
        frame = pattern_frame(rng, random_points(rng, 25, 0.8))
        send(bench, [frame])
        taken = len(bench.i.taken)
        while len(bench.i.taken) == taken and not int(dut.i_valid.value):
            await RisingEdge(dut.clk)
        await clock_cycles(dut.clk, clocks)
        dut.full_records.value = 1 - form
        await check(bench, [number], [frame], form)
        form = 1 - form


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def waits_for_all_it_needs(dut):
    """Nothing is offered before it is whole, or without info, counts and detection."""
    bench = make(dut)
    await bench.reset()
    frame = pattern_frame(np.random.default_rng(SEED), random_points(
        np.random.default_rng(SEED), 30, 1.0))
    points, counts, detection, info = words(frame)
    bench.i.append(points[:5])
    await clock_cycles(dut.clk, 2000)
    assert len(bench.i.taken) == 5 and not bench.o.words
    bench.i.append(points[5:])
    await clock_cycles(dut.clk, 3000)
    assert not bench.o.words
    bench.info.append([info])
    await clock_cycles(dut.clk, 9000)
    assert len(bench.i.taken) == 30 and bench.o.words
    words_before = len(bench.o.words)
    bench.counts.append([counts])
    await clock_cycles(dut.clk, 3000)
    assert len(bench.o.words) == words_before
    bench.detection.append([detection])
    await check(bench, ["frame"], [frame])


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def clocks(dut):
    """What the contract says of a point's clocks, of a packet's and of the packet of others."""
    rng = np.random.default_rng(SEED)
    bench = make(dut)
    await bench.reset()
    points = near_points(rng, 40)
    points["status"][20:30] = 1
    points["beam"][20:30] = points["inverse_z"][20:30] = 0
    frame = pattern_frame(rng, points)
    send(bench, [frame])
    contents = packets(frame, bool(FULL))
    while len(bench.o.words) < sum(map(len, contents)):
        await RisingEdge(dut.clk)
    steps = np.diff(bench.i.taken[:9])
    assert (steps == 81).all() if FULL else (steps >= 83 + 37).all() and (steps <= 83 + 48).all()
    if not FULL:
        assert (np.diff(bench.i.taken[21:30]) == 81).all()
    at = before = 0
    for index, content in enumerate(contents):
        times = [clock for clock, _ in bench.o.words[at:at + len(content)]]
        # The upper halves of counts that have none are passed over.
        assert max(np.diff(times)) <= 18 and np.median(np.diff(times)) <= 10
        if index and contents[index][0] == 0x54:
            assert times[0] - before <= 14
        at, before = at + len(content), times[-1]


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def latency(dut):
    """From a frame's end marker to its last packet; bits fill up the octet before."""
    rng = np.random.default_rng(SEED)
    bench = make(dut)
    await bench.reset()
    waits = []
    for count in range(1, 8):
        frame = pattern_frame(rng, near_points(rng, count))
        send(bench, [frame])
        while not bench.o.words:
            await RisingEdge(dut.clk)
        # The end marker is there in the clock after the last point was taken.
        waits.append(bench.o.words[0][0] - bench.i.taken[-1] - 1)
        await check(bench, ["latency"], [frame])
    # Five short or long points leave seven bits, records none.
    assert max(waits) == Points.latency - (7 if FULL else 0), waits


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(clocks=[5, 90, 700, 2400, 3000, 4100, 5000])
async def reset_forgets(dut, clocks):
    """After a reset in the middle counts and points start again."""
    rng = np.random.default_rng(SEED)
    bench = make(dut)
    await bench.reset()
    points, counts, detection, info = words(pattern_frame(rng, random_points(rng, 20, 0.7)))
    for name, value in [("i", points[3]), ("counts", counts),
                        ("detection", detection), ("info", info)]:
        getattr(dut, f"{name}_payload").value = value
        getattr(dut, f"{name}_valid").value = 1
    await clock_cycles(dut.clk, clocks)
    for name in ("i", "counts", "detection", "info"):
        getattr(dut, f"{name}_valid").value = 0
    await bench.reset()
    bench.o.words.clear()
    frame = pattern_frame(rng, random_points(rng, 15))
    send(bench, [frame])
    await check(bench, ["after reset"], [frame])
