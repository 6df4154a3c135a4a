"""What every bench needs: stream sources and sinks with gaps and stalls, clock and reset."""

import gc
import json
import os
import random

from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, Event, First, RisingEdge, Timer, ValueChange
from cocotb.types import Logic
from cocotb.utils import get_sim_steps, get_sim_time
from cocotb_bus.drivers import BusDriver
from cocotb_bus.monitors import BusMonitor

gc.set_threshold(100_000, 20, 100)  # as in conftest.py

__all__ = ["Bench", "StreamSink", "StreamSource", "clock_cycles", "is_high", "parameters",
           "start_clock"]


_HIGH = Logic(1)
#: Of the clock of a :class:`Bench`.
_PERIOD_NS = 10


def is_high(signal):
    """Whether a signal of one bit is 1."""
    return signal.value == _HIGH


def parameters():
    """What the pytest half handed to the bench (a dictionary)."""
    return json.loads(os.environ.get("CYCLOPE_BENCH", "{}"))


def start_clock(signal, period, unit="ps"):
    """Start a clock with a rising edge; the simulator makes it, which takes no Python."""
    Clock(signal, period, unit=unit, impl="gpi").start()


async def clock_cycles(clock, count):
    """Wait for ``count`` rising edges of a :class:`Bench`'s clock, and wake for the last one only.

    :class:`cocotb.triggers.ClockCycles` wakes for all of them. To be called at an edge.
    """
    if count > 2:
        await Timer(_PERIOD_NS * count - _PERIOD_NS // 2, unit="ns")
        count = 1
    for _ in range(count):
        await RisingEdge(clock)


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
        valid, ready, payload = self.bus.valid, self.bus.ready, self.bus.payload
        edge, risen = RisingEdge(self.clock), RisingEdge(ready)
        offers = None
        if sync:
            await edge
        for word in transaction:
            while self.gap and self.rng.random() < self.gap:
                if offers is not False:
                    valid.value, offers = 0, False
                await edge
            if not offers:
                valid.value, offers = 1, True
            payload.value = int(word)
            await edge
            while not is_high(ready):
                await risen
                await edge
            self.taken.append(self.bench.cycle)
        valid.value = 0


class StreamSink(BusMonitor):
    """Takes words from a stream, with seeded stalls, and checks that the producer keeps the rules.

    A word once valid must stay, unchanged, until it is taken. ``words`` holds (clock count, word).
    Set ``stall`` to 1.0 to take nothing.
    """

    _signals = ["valid", "ready", "payload"]

    def __init__(self, bench, name, stall=0.0, seed=1):
        self.bench, self._stall, self.rng = bench, stall, random.Random(f"sink {name} {seed}")
        self.words = []
        self._arrived, self._stall_set = Event(), Event()
        super().__init__(bench.dut, name, bench.dut.clk)
        self.bus.ready.value = 0

    @property
    def stall(self):
        """Chance in each clock that nothing is taken."""
        return self._stall

    @stall.setter
    def stall(self, chance):
        self._stall = chance
        self._stall_set.set()

    async def _monitor_recv(self):
        valid, ready, payload = self.bus.valid, self.bus.ready, self.bus.payload
        edge, offered = RisingEdge(self.clock), RisingEdge(valid)
        changed = ValueChange(valid), ValueChange(payload), ValueChange(self.bench.dut.rst)
        takes, word, held = 0, None, None
        while True:
            taking = int(not self._stall or self.rng.random() >= self._stall)
            if taking != takes:
                ready.value = takes = taking
            if self._stall in (0.0, 1.0):
                if word is None:
                    await self._sleep(offered)
                elif held is not None and not takes:
                    await self._sleep(*changed)
            await edge  # what is read now is what the edge sees
            word = payload.value.to_unsigned() if is_high(valid) else None
            if word is None and held is None:
                continue
            in_reset = is_high(self.bench.dut.rst)
            if held is not None and not in_reset:
                assert word is not None, (
                    f"{self.name}: valid fell before the word {held:#x} was taken")
                assert word == held, f"{self.name}: {held:#x} became {word:#x} while waiting"
            held = None if takes or in_reset else word
            if takes and word is not None and not in_reset:
                self.words.append((self.bench.cycle, word))
                self._arrived.set()

    async def _sleep(self, *triggers):
        """Wait for one of them, or for another ``stall``."""
        self._stall_set.clear()
        await First(*triggers, self._stall_set.wait())

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
        self.dut = dut
        self._begin, self._period = get_sim_time("step"), get_sim_steps(_PERIOD_NS, "ns")
        self.rng = random.Random(f"bench {seed}")
        dut.rst.value = 1
        for name, value in (plain or {}).items():
            getattr(dut, name).value = value
        for name in inputs:
            setattr(self, name, StreamSource(self, name, gap, seed))
        for name in outputs:
            setattr(self, name, StreamSink(self, name, stall, seed))
        start_clock(dut.clk, _PERIOD_NS, "ns")

    @property
    def cycle(self):
        """Rising edges of the clock so far."""
        return (get_sim_time("step") - self._begin) // self._period + 1

    async def reset(self, clocks=3):
        """Hold ``rst`` for some clocks."""
        self.dut.rst.value = 1
        await ClockCycles(self.dut.clk, clocks)
        self.dut.rst.value = 0
        await RisingEdge(self.dut.clk)
