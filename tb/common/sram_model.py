"""The external static RAM on the pins of a design under cocotb, with times in nanoseconds.

It takes nothing for granted about clocks: it follows every change of every pin. Times are the
worst of parts of 15 ns (CY7C161-15, IC61C256AH-15, GS78116B-15); ``SKEW`` is ours, for pins that
change with the same edge and yet not quite together.
"""

import random

import cocotb
from cocotb.triggers import First, ReadOnly, RisingEdge, Timer, ValueChange
from cocotb.utils import get_sim_time

__all__ = ["SRAM"]

ACCESS, ENABLE = 15.0, 10.0  # until data are valid, from the address and from output enable
RELEASE = 8.0  # until the memory lets go of the bus
PULSE, DATA = 15.0, 10.0  # of a write, and data before its end
LET_GO = 8.0  # until the controller's pins let go of the bus
SKEW = 4.0

_PINS = ("address", "data_out", "data_drive", "chip_enable_n", "write_enable_n",
         "output_enable_n", "lanes_n")


class SRAM:
    """A memory on the pins ``<prefix>_address`` and so on of ``dut``.

    Parameters
    ----------
    scale : :class:`float`
        Nanoseconds of the simulation for one of the memory: a bench whose clock is faster than
        16 MHz has it the shorter.
    strict : :class:`bool`
        Fail with the first violation; else only list them.
    answers : :class:`bool`
        Drive the data pins; else only watch.

    Attributes
    ----------
    words : :class:`dict`
        Bytes by ``(address, lane)``; what was never written is missing.
    faults : list of :class:`str`
        Violations, with their times.
    unwritten : :class:`int`
        Rising edges of ``dut.clk`` that met a word with bytes that were never written.
    """

    def __init__(self, dut, prefix="pins", scale=1.0, strict=True, answers=True, seed=1):
        self.pins = {name: getattr(dut, f"{prefix}_{name}") for name in _PINS}
        self.data_in = getattr(dut, f"{prefix}_data_in") if answers else None
        self.scale, self.strict = scale, strict
        self.words, self.faults, self.unwritten = {}, [], 0
        self.writes = 0
        self.rng = random.Random(f"sram {seed}")
        self._since = dict.fromkeys((*_PINS, "write", "show", "hide"), float("-inf"))
        if answers:
            self.data_in.value = self.rng.getrandbits(32)
        self._shown = 0
        self._missing = None  # when a word with bytes missing was shown, and until when
        cocotb.start_soon(self._follow())
        cocotb.start_soon(self._count(dut.clk))

    def _now(self):
        return get_sim_time("ns") / self.scale

    def _fault(self, text):
        self.faults.append(f"{self._now():.1f} ns: {text}")
        assert not self.strict, self.faults[-1]

    def _sample(self):
        pins = {name: int(signal.value) for name, signal in self.pins.items()}
        selected = not pins["chip_enable_n"]
        pins["write"] = selected and not pins["write_enable_n"]
        pins["show"] = selected and pins["write_enable_n"] and not pins["output_enable_n"]
        return pins

    async def _follow(self):
        await ReadOnly()
        old = self._sample()
        while True:
            await First(*(ValueChange(signal) for signal in self.pins.values()))
            await ReadOnly()
            new = self._sample()
            self._check(old, new)
            changed = {name for name in new if new[name] != old[name]}
            for name in changed:
                self._since[name] = self._now()
            if old["show"] and not new["show"]:
                self._since["hide"] = self._now()
            if self.data_in is not None and changed & {"address", "show", "lanes_n"}:
                self._shown += 1
                if self._missing:
                    self._missing[1] = min(self._missing[1], self._now())
                cocotb.start_soon(self._answer(self._shown, new))
            old = new

    def _check(self, old, new):
        since, now = self._since, self._now()
        places = ("address", "lanes_n", "chip_enable_n")
        for name in places:
            if new[name] != old[name]:
                if old["write"]:
                    self._fault(f"{name} changed in a write")
                if not new["write"] and now - since["write"] < SKEW:
                    self._fault(f"{name} changed too early behind a write")
        if new["write"] and not old["write"]:
            for name in places:
                if new[name] != old[name] or now - since[name] < SKEW:
                    self._fault(f"{name} changed too late before a write")
        if old["write"] and not new["write"]:
            if now - since["write"] < PULSE:
                self._fault("a write was too short")
            self._store(old)
        for name in ("data_out", "data_drive"):
            if new[name] != old[name] and old["data_drive"] and (
                    old["write"] and not new["write"]
                    or not new["write"] and now - since["write"] < SKEW):
                self._fault(f"{name} changed too early behind a write")
        if new["data_drive"] and not old["data_drive"] and (
                old["show"] or new["show"] or now - since["hide"] < RELEASE):
            self._fault("the controller drove the bus while the memory did")
        if new["show"] and not old["show"] and (
                old["data_drive"] or new["data_drive"] or now - since["data_drive"] < LET_GO):
            self._fault("the memory drove the bus while the controller did")

    def _store(self, pins):
        now = self._now()
        if not pins["data_drive"]:
            self._fault("a write ended with the bus not driven")
        elif now - max(self._since["data_out"], self._since["data_drive"]) < DATA:
            self._fault("data came too late before the end of a write")
        self.writes += 1
        for lane in range(4):
            if not pins["lanes_n"] >> lane & 1:
                self.words[pins["address"], lane] = pins["data_out"] >> 8 * lane & 0xFF

    async def _answer(self, number, pins):
        """Show noise, then the word when its time has come, unless something else is asked for."""
        noise = self.rng.getrandbits(32)
        await Timer(1, "ps")
        self.data_in.value = noise
        if not pins["show"]:
            return
        since = self._since
        ready = max(since["address"] + ACCESS, since["chip_enable_n"] + ACCESS,
                    since["output_enable_n"] + ENABLE)
        wait = max(1, round(1000 * (ready - self._now()) * self.scale))
        await Timer(wait, "ps")
        if self._shown != number:
            return
        word, missing = 0, False
        for lane in range(4):
            if not pins["lanes_n"] >> lane & 1:
                byte = self.words.get((pins["address"], lane))
                missing |= byte is None
                word |= (noise >> 8 * lane & 0xFF if byte is None else byte) << 8 * lane
        if missing:
            self._missing = [self._now(), float("inf")]
        self.data_in.value = word

    async def _count(self, clock):
        while True:
            await RisingEdge(clock)
            if self._missing and self._missing[0] < self._now() <= self._missing[1]:
                self.unwritten += 1
