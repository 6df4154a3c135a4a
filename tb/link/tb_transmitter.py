"""Bench of the whole transmitting link, from points, pixels and replies to the serial pin."""

import random
import zlib

import cocotb
import numpy as np
from cobs import cobs
from cocotb.triggers import RisingEdge

from model.link.points import UNMATCHED, packets
from model.link.texture_code import pack
from tb.harness import Bench, clock_cycles, is_high, parameters
from tb.link.frames import near_points, pattern_frame
from tb.link.tb_points import words
from tb.link.tb_uart_tx import Line
from tb.preprocessing.frames import grey_words

SEED, WIDTH, HEIGHT = (parameters()[name] for name in ("seed", "width", "height"))
DIVISOR = parameters()["divisor"]
INPUTS = ("pixels", "points", "counts", "detection", "info", "replies")


def reply(rng):
    body = bytes(rng.randrange(256) for _ in range(rng.randrange(2, 40)))
    content = b"\x5a" + body
    return content, [*content[:-1], content[-1] | 0x100]


async def watch_cts(dut, seed):
    rng = random.Random(f"cts {seed}")
    while True:
        dut.cts.value = 1
        await clock_cycles(dut.clk, rng.randrange(1, 3000) * DIVISOR)
        dut.cts.value = 0
        await clock_cycles(dut.clk, rng.randrange(1, 400) * DIVISOR)


def contents_of(octets, begins):
    """Contents of the packets, sequence numbers taken out, and the clocks at which they begin.

    Cut at zeros, decoded by the package, checked by zlib: nothing of the design's models.
    """
    found, at = [], 0
    while at < len(octets):
        assert octets[at] == 0, "no delimiter in front"
        end = octets.index(0, at + 1)
        assert end + 1 - at <= 100
        if at:
            assert begins[at] - begins[at - 1] >= 40 * DIVISOR, "the pause is too short"
        decoded = cobs.decode(bytes(octets[at + 1:end]))
        assert zlib.crc32(decoded[:-4]).to_bytes(4, "little") == decoded[-4:]
        assert decoded[1] == len(found) & 0xFF
        found.append((begins[at], decoded[:1] + decoded[2:-4]))
        at = end + 1
    return found


async def all_sent(bench):
    """Nothing is under way for 1000 clocks; octets take longer than the clocks between looks."""
    signals = [bench.dut.busy, *(getattr(bench.dut, f"{name}_valid") for name in INPUTS)]
    idle = 0
    while idle < 1000:
        await clock_cycles(bench.dut.clk, 5)
        idle = 0 if any(map(is_high, signals)) else idle + 5


@cocotb.test(timeout_time=20, timeout_unit="ms")
@cocotb.parametrize((("gap", "full_records", "flow"),
                     [(0.0, 0, 0), (0.0, 1, 0), (0.6, 0, 1), (0.0, 1, 1)]))
async def everything_at_once(dut, gap, full_records, flow):
    """Each source's packets come whole and in order; points first, others at once behind them."""
    rng, np_rng = random.Random(SEED), np.random.default_rng(SEED)
    bench = Bench(dut, inputs=INPUTS, outputs=(), gap=gap, seed=SEED, plain={
        "tag": 1, "full_records": full_records, "divisor": DIVISOR, "cts": 1})
    await bench.reset()
    line = Line(bench)
    if flow:
        cocotb.start_soon(watch_cts(dut, SEED))
    frames, replies, images = [], [], []
    for _ in range(6):
        image = np_rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
        images.append(image)
        bench.pixels.append([int(word[0]) for word in grey_words(image)])
        frame = pattern_frame(np_rng, near_points(np_rng, int(np_rng.integers(0, 50)), 0.8))
        frames.append(frame)
        points, counts, detection, info = words(frame)
        bench.info.append([info])
        bench.detection.append([detection])
        bench.points.append(points)
        bench.counts.append([counts])
        if rng.random() < 0.6:
            content, octets = reply(rng)
            replies.append(content)
            bench.replies.append(octets)
        await clock_cycles(dut.clk, rng.randrange(1000, 6000) * DIVISOR)
    await all_sent(bench)
    sent = contents_of(*line.octets(DIVISOR))
    kinds = [content[0] for _, content in sent]
    of_points = [content for _, content in sent if content[0] < 0x58]
    assert of_points == [each for frame in frames for each in packets(frame, bool(full_records))]
    assert [content for _, content in sent if content[0] == 0x5A] == replies
    for index, kind in enumerate(kinds):
        if kind == UNMATCHED:
            assert kinds[index - 1] == 0x51, "something came between"
    stands = (0, 0)
    for _, content in sent:
        if content[0] == 0x58:
            rows = images[content[1]].tolist()
            expected, stands, _ = pack(rows.__getitem__, HEIGHT, *stands, content[1])
            assert content[1:] == expected
    assert kinds.count(0x58) > 5 and kinds.count(0x59) > 1


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def points_wait_for_one_packet_at_most(dut):
    """With texture waiting all the time, points go behind the packet that is already taken."""
    np_rng = np.random.default_rng(SEED)
    bench = Bench(dut, inputs=INPUTS, outputs=(), seed=SEED, plain={
        "tag": 1, "full_records": 0, "divisor": DIVISOR, "cts": 1})
    await bench.reset()
    line = Line(bench)
    for _ in range(2):
        await bench.pixels.send([int(word[0]) for word in grey_words(
            np_rng.integers(1, 256, (HEIGHT, WIDTH)).astype(np.uint8))])
    points, counts, detection, info = words(pattern_frame(np_rng, near_points(np_rng, 5)))
    bench.info.append([info])
    bench.detection.append([detection])
    bench.counts.append([counts])
    bench.points.append(points)
    while len(bench.points.taken) < 5:
        await RisingEdge(dut.clk)
    ready = len(line.levels)
    await all_sent(bench)
    sent = contents_of(*line.octets(DIVISOR))
    at = next(n for n, (_, content) in enumerate(sent) if content[0] == 0x51)
    later = [clock for clock, _ in sent[:at] if clock >= ready]
    assert len(later) <= 2, (ready, later)  # one assembled, one chosen
    assert at and sent[at - 1][1][0] == 0x58 == sent[at + 1][1][0]


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def texture_waits_while_points_are_due(dut):
    """With ``more`` high no texture packet begins, though no point is there yet."""
    np_rng = np.random.default_rng(SEED)
    bench = Bench(dut, inputs=INPUTS, outputs=(), seed=SEED, plain={
        "tag": 1, "full_records": 0, "divisor": DIVISOR, "cts": 1, "more": 1})
    await bench.reset()
    line = Line(bench)
    for _ in range(2):
        await bench.pixels.send([int(word[0]) for word in grey_words(
            np_rng.integers(1, 256, (HEIGHT, WIDTH)).astype(np.uint8))])
    await clock_cycles(dut.clk, 3000 * DIVISOR)
    assert 0x58 not in [content[0] for _, content in contents_of(*line.octets(DIVISOR))]
    dut.more.value = 0
    await all_sent(bench)
    assert 0x58 in [content[0] for _, content in contents_of(*line.octets(DIVISOR))]
