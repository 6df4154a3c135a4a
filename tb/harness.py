"""What every bench needs: stream sources and sinks with gaps and stalls, clock and reset."""

import json
import os
import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, Event, ReadOnly, RisingEdge
from cocotb_bus.drivers import BusDriver
from cocotb_bus.monitors import BusMonitor

__all__ = ["Bench", "StreamSink", "StreamSource", "parameters"]


def parameters():
    """What the pytest half handed to the bench (a dictionary)."""
    return json.loads(os.environ.get("CYCLOPE_BENCH", "{}"))


class StreamSource(BusDriver):
    """Drives payload words into a stream, with seeded gaps.

    ``await source.send(words)`` returns when the last word was taken; ``source.append(words)``
    queues them. ``taken`` holds the clock count at which each word was taken.
    """

    _signals = ["valid", "ready", "payload"]

    def __init__(self, bench, name, gap=0.0, seed=1):
        self.bench, self.gap, self.rng = bench, gap, random.Random(f"source {name} {seed}")
        self.taken = []
        super().__init__(bench.dut, name, bench.dut.clk)
        self.bus.valid.value = 0
        self.bus.payload.value = 0

    async def _driver_send(self, transaction, sync=True):
        if sync:
            await RisingEdge(self.clock)
        for word in transaction:
            while self.gap and self.rng.random() < self.gap:
                self.bus.valid.value = 0
                await RisingEdge(self.clock)
            self.bus.valid.value = 1
            self.bus.payload.value = int(word)
            while True:
                await ReadOnly()
                ready = int(self.bus.ready.value)
                await RisingEdge(self.clock)
                if ready:
                    break
            self.taken.append(self.bench.cycle)
        self.bus.valid.value = 0


class StreamSink(BusMonitor):
    """Takes words from a stream, with seeded stalls, and checks that the producer keeps the rules.

    A word once valid must stay, unchanged, until it is taken. ``words`` holds (clock count, word).
    Set ``stall`` to 1.0 to take nothing.
    """

    _signals = ["valid", "ready", "payload"]

    def __init__(self, bench, name, stall=0.0, seed=1):
        self.bench, self.stall, self.rng = bench, stall, random.Random(f"sink {name} {seed}")
        self.words = []
        self._arrived = Event()
        super().__init__(bench.dut, name, bench.dut.clk)
        self.bus.ready.value = 0

    async def _monitor_recv(self):
        waiting = None
        while True:
            ready = int(not self.stall or self.rng.random() >= self.stall)
            self.bus.ready.value = ready
            await ReadOnly()
            valid = int(self.bus.valid.value)
            word = self.bus.payload.value.to_unsigned() if valid else None
            if waiting is not None and not self.in_reset:
                assert valid, f"{self.name}: valid fell before the word {waiting:#x} was taken"
                assert word == waiting, f"{self.name}: {waiting:#x} became {word:#x} while waiting"
            waiting = word if valid and not ready else None
            await RisingEdge(self.clock)
            if self.in_reset:
                waiting = None
            elif valid and ready:
                self.words.append((self.bench.cycle, word))
                self._arrived.set()
                self._recv(word)

    @property
    def in_reset(self):
        return bool(self.bench.dut.rst.value)

    async def receive(self, count):
        """The next ``count`` words, waiting for them."""
        while len(self.words) < count:
            self._arrived.clear()
            await self._arrived.wait()
        words, self.words = self.words[:count], self.words[count:]
        return [word for _, word in words]


class Bench:
    """Clock, reset, sources and sinks of a block with the ports ``clk`` and ``rst``.

    ``inputs`` and ``outputs`` name streams; they become attributes. ``plain`` sets plain inputs
    before reset.
    """

    def __init__(self, dut, inputs=("i",), outputs=("o",), gap=0.0, stall=0.0, seed=1, plain=None):
        self.dut, self.cycle = dut, 0
        self.rng = random.Random(f"bench {seed}")
        dut.rst.value = 1
        for name, value in (plain or {}).items():
            getattr(dut, name).value = value
        for name in inputs:
            setattr(self, name, StreamSource(self, name, gap, seed))
        for name in outputs:
            setattr(self, name, StreamSink(self, name, stall, seed))
        cocotb.start_soon(Clock(dut.clk, 10, unit="ns").start())
        cocotb.start_soon(self._count())

    async def _count(self):
        while True:
            await RisingEdge(self.dut.clk)
            self.cycle += 1

    async def reset(self, clocks=3):
        """Hold ``rst`` for some clocks."""
        self.dut.rst.value = 1
        await ClockCycles(self.dut.clk, clocks)
        self.dut.rst.value = 0
        await RisingEdge(self.dut.clk)
