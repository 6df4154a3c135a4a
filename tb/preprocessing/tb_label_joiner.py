"""Labels to the joiner's own ports, clock by clock; ``labels`` is that of the block."""

import cocotb
import numpy as np
from cocotb.triggers import ReadOnly, RisingEdge

from hdl.preprocessing.label_joiner import LabelJoiner
from model.preprocessing.label_joiner import join_labels
from tb.harness import Bench, parameters

LABELS = parameters().get("labels", 3)
BITS = LABELS.bit_length()


class Joiner(Bench):
    def __init__(self, dut, gap=0.0):
        super().__init__(dut, ("pairs",), (), gap=gap, plain=dict.fromkeys(
            ("clear", "allocate", "resolve", "lookup", "read"), 0))

    async def pulse(self, name):
        getattr(self.dut, name).value = 1
        await RisingEdge(self.dut.clk)
        getattr(self.dut, name).value = 0

    async def allocate(self):
        """The label that was given out."""
        self.dut.allocate.value = 1
        await ReadOnly()
        assert not self.dut.full.value
        label = int(self.dut.next_label.value)
        await RisingEdge(self.dut.clk)
        self.dut.allocate.value = 0
        return label

    async def settle(self):
        while True:
            await ReadOnly()
            if self.dut.settled.value:
                break
            await RisingEdge(self.dut.clk)
        await RisingEdge(self.dut.clk)

    async def resolve(self):
        """Clocks that it took."""
        self.dut.resolve.value = 1
        begin = self.cycle
        while True:
            await ReadOnly()
            done = int(self.dut.resolved.value)
            await RisingEdge(self.dut.clk)
            if done:
                self.dut.resolve.value = 0
                return self.cycle - begin

    async def roots(self, labels):
        """Roots of ``labels``, one asked for in each clock; the clock between stays with one."""
        answers = []
        for label in [*labels, *[0] * LabelJoiner.latency]:
            self.dut.read.value, self.dut.lookup.value = 1, int(label)
            await ReadOnly()
            answers.append(int(self.dut.root.value))
            await RisingEdge(self.dut.clk)
        self.dut.read.value = 0
        return answers[LabelJoiner.latency:]


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def labels_and_pairs_at_once(dut):
    """Labels are given out in the very clocks in which others are being joined."""
    rng = np.random.default_rng(LABELS)
    bench = Joiner(dut)
    await bench.reset()
    for frame in range(12):
        await bench.pulse("clear")
        pairs, used = [], 0
        for label in range(1, LABELS + 1 if frame % 2 else LABELS // 2 + 1):
            assert await bench.allocate() == label
            used = label
            for _ in range(int(rng.integers(0, 3))):
                one, other = (int(each) for each in rng.integers(max(0, label - 4), label + 1, 2))
                pairs.append((one, other))
                bench.pairs.append([one | other << BITS])
            for _ in range(int(rng.integers(0, 2))):
                await RisingEdge(dut.clk)
        while len(bench.pairs.taken) < len(pairs):
            await RisingEdge(dut.clk)
        bench.pairs.taken.clear()
        await bench.settle()
        assert int(dut.used.value) == used and int(dut.full.value) == (used == LABELS)
        assert await bench.resolve() == 2 * used + 1
        order = rng.permutation(used + 1)
        wanted = join_labels(used, pairs)[order].tolist()
        assert await bench.roots(order) == wanted, f"frame {frame}"


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def root_stays_without_read(dut):
    bench = Joiner(dut)
    await bench.reset()
    await bench.pulse("clear")
    await bench.allocate()
    await bench.resolve()
    assert await bench.roots([1]) == [1]
    dut.read.value, dut.lookup.value = 1, 1
    await RisingEdge(dut.clk)
    dut.read.value, dut.lookup.value = 0, 0
    for _ in range(4):
        await ReadOnly()
        assert int(dut.root.value) == 1
        await RisingEdge(dut.clk)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_and_clear_forget(dut):
    """Whatever it is doing."""
    rng = np.random.default_rng(3)
    bench = Joiner(dut)
    await bench.reset()
    for _ in range(20):
        await bench.pulse("clear")
        for _ in range(min(3, LABELS)):
            await bench.allocate()
        bench.pairs.append([1 | 2 << BITS])
        for _ in range(int(rng.integers(0, 12))):
            await RisingEdge(dut.clk)
        if rng.random() < 0.5:
            await bench.settle()
            cocotb.start_soon(bench.resolve())
            for _ in range(int(rng.integers(0, 7))):
                await RisingEdge(dut.clk)
        dut.resolve.value = 0
        await bench.reset(1)
        await bench.pulse("clear")
        assert int(dut.used.value) == 0
        assert [await bench.allocate() for _ in range(min(3, LABELS))] == [1, 2, 3][:LABELS]
        await bench.settle()
        await bench.resolve()
        assert await bench.roots(range(min(3, LABELS) + 1)) == list(range(min(3, LABELS) + 1))
