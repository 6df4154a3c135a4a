"""Packets on the serial pin: characters back to back, pauses between packets, ``cts``."""

import random

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from model.link.framer import frame
from tb.harness import Bench, parameters
from tb.link.tb_framer import CASES, random_content, words
from tb.link.tb_uart_tx import Line

SEED = parameters()["seed"]
GAP = 30  # bit times that the line rests between packets


async def sent(dut, bench, contents, divisor, cts=None):
    """Octets, the clocks at which they began, and ``cts`` in every clock."""
    packets, _ = frame(contents)
    for content in contents:
        bench.i.append(words(content))
    line, levels = Line(bench), []
    idle = 0
    while idle < 20:
        dut.cts.value = 1 if cts is None else cts()
        await ReadOnly()
        levels.append(int(dut.cts.value))
        await RisingEdge(dut.clk)
        idle = 0 if dut.busy.value or dut.i_valid.value else idle + 1
    octets, begins = line.octets(divisor)
    assert bytes(octets) == b"".join(packets)
    return packets, begins, levels


@cocotb.test(timeout_time=50, timeout_unit="ms")
@cocotb.parametrize(divisor=[1, 2, 5, 9])
async def three_characters_between_packets(dut, divisor):
    rng = random.Random(f"{SEED} {divisor}")
    bench = Bench(dut, outputs=(), seed=SEED, plain={"divisor": divisor, "cts": 1})
    await bench.reset()
    contents = CASES + [random_content(rng) for _ in range(5)]
    packets, begins, _ = await sent(dut, bench, contents, divisor)
    at, gaps = 0, []
    for packet in packets:
        own = begins[at:at + len(packet)]
        assert {b - a for a, b in zip(own, own[1:], strict=False)} == {10 * divisor}
        at += len(packet)
        if at < len(begins):
            gaps.append(begins[at] - (own[-1] + 10 * divisor))
    assert min(gaps) == GAP * divisor, gaps


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def clear_to_send(dut):
    """No start bit follows a clock in which ``cts`` is low; nothing is lost or sent twice."""
    rng = random.Random(SEED)
    divisor = 3
    bench = Bench(dut, outputs=(), seed=SEED, plain={"divisor": divisor, "cts": 1})
    await bench.reset()
    contents = [random_content(rng, 20) for _ in range(8)]
    state = {"left": 0, "level": 1}

    def cts():
        if not state["left"]:
            state["left"], state["level"] = rng.randrange(1, 200), 1 - state["level"]
        state["left"] -= 1
        return state["level"]

    packets, begins, levels = await sent(dut, bench, contents, divisor, cts)
    assert all(levels[begin - 1] for begin in begins)
    assert levels.count(0) > 1000
    at = 0
    for packet in packets[:-1]:
        at += len(packet)
        assert begins[at] - begins[at - 1] >= (10 + GAP) * divisor
