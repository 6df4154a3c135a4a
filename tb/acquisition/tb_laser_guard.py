import random

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, ReadWrite, RisingEdge

from hdl.acquisition.laser_guard import LaserGuard as Block
from model.acquisition.laser_guard import CAUSES, LaserGuard, worst_window
from tb.acquisition.laser_driver import LaserDriver
from tb.harness import parameters, start_clock

LIMITS = ("pulse", "repetition", "window", "window_on", "pause")
PULSE, REPETITION, DUTY, NOT_ARMED, HEARTBEAT, UPSET = (1 << n for n in range(len(CAUSES)))
CHECKED = ("token", "silence", "since", "length", "spent", "flags")


class Guard:
    """Drives the guard clock by clock, beside the model, and watches the pin by itself."""

    def __init__(self, dut):
        self.dut = dut
        self.limits = {name: parameters()[name] for name in LIMITS}
        self.driver = LaserDriver()
        self.lights = []  # [first edge, edges], of the pin alone
        self.clock = self.pin = self.beat = 0
        self.inputs = {"request": 0, "tables_valid": 1, "capture": 0, "heartbeat": 0, "clear": 0}

    async def start(self):
        start_clock(self.dut.clk, 10, "ns")
        await self.reset()

    async def reset(self, clocks=2):
        self.dut.rst.value = 1
        for name, value in self.inputs.items():
            getattr(self.dut, name).value = value
        for n in range(clocks):
            await ReadOnly()
            if n:
                assert not self.dut.laser.value and not self.dut.armed.value
            if self.clock:  # the clock of the reset itself is the first one, and still has an edge
                self._watch()
            await RisingEdge(self.dut.clk)
        self.dut.rst.value = 0
        self.model = LaserGuard(**self.limits)
        self.inputs["heartbeat"] = self.beat = 0
        self.dut.heartbeat.value = 0

    def _watch(self):
        light = self.driver.step(int(self.dut.laser.value))
        if light:
            if self.lights and sum(self.lights[-1]) == self.clock:
                self.lights[-1][1] += 1
            else:
                self.lights.append([self.clock, 1])
        self.clock += 1
        return light

    async def step(self, clocks=1, **inputs):
        """Go on for some clocks with these inputs; others stay, but ``clear`` falls."""
        self.inputs["clear"] = 0
        self.inputs.update(inputs)
        for _ in range(clocks):
            for name, value in self.inputs.items():
                getattr(self.dut, name).value = value
            await ReadOnly()
            dut = self.dut
            got = tuple(int(port.value) for port in (dut.laser, dut.lit, dut.armed, dut.causes))
            wanted = self.model.step(**self.inputs)
            assert got == wanted, (
                f"clock {self.clock}: laser, lit, armed, causes are {got}, not {wanted}; "
                f"inputs {self.inputs}, pulses {self.model.pulses[-3:]}")
            assert self._watch() == got[1]
            await RisingEdge(self.dut.clk)
            self.inputs["clear"] = 0
        return got

    async def alive(self, clocks, **inputs):
        """The same, with a heartbeat that keeps changing in time."""
        for _ in range(clocks):
            self.count = getattr(self, "count", 0) + 1
            if self.count >= self.limits["pause"] // 2:
                self.count, self.beat = 0, (self.beat + 1) & 0xFF
            got = await self.step(heartbeat=self.beat, **inputs)
        return got

    async def upset(self, name, bit, clear=0):
        """A clock in which a bit of a register is another one, and the next, with nothing new."""
        dut, register = self.dut, getattr(self.dut, name)
        self.inputs["clear"] = clear
        dut.clear.value = clear
        await ReadWrite()
        register.value = int(register.value) ^ 1 << bit
        await ReadOnly()
        assert int(dut.laser.value) <= self.model.laser
        self._watch()
        self.model.upset(clear)
        await RisingEdge(dut.clk)
        self.inputs["clear"] = dut.clear.value = 0
        await ReadOnly()
        got = tuple(int(port.value) for port in (dut.laser, dut.lit, dut.armed, dut.causes))
        assert got == self.model.step(**self.inputs) and got[3] & UPSET
        self._watch()  # for the closing edge
        await RisingEdge(dut.clk)

    async def arm(self):
        """Two beats, then rest, so that nothing of before counts."""
        await self.step(request=0, heartbeat=self.beat ^ 1)
        self.beat ^= 1
        await self.alive(self.limits["window"] + self.limits["pause"] + 2)
        await self.step(clear=1)
        assert (await self.alive(1))[2]

    def check(self):
        """The ceilings, by what the pin did, the whole time long."""
        limits = self.limits
        assert all(edges <= limits["pulse"] for _, edges in self.lights), self.lights
        rises = [rise for rise, _ in self.lights]
        assert all(b - a >= limits["repetition"]
                   for a, b in zip(rises, rises[1:], strict=False)), self.lights
        assert worst_window(self.lights, limits["window"]) <= limits["window_on"], self.lights


@cocotb.test(timeout_time=100, timeout_unit="ms")
async def free_inputs(dut):
    """Whatever comes: as the model does, and below the ceilings; resets in between."""
    rng = random.Random(parameters()["seed"])
    guard = Guard(dut)
    await guard.start()
    limits = guard.limits
    interesting = sorted({max(1, value + delta) for value in limits.values()
                          for delta in (-2, -1, 0, 1, 2)} | {1, 2, 3})
    for _ in range(parameters()["rounds"]):
        if rng.random() < 0.02:
            await guard.reset(rng.randint(1, 3))
        calm = rng.random() < 0.8
        request = rng.randint(0, 1)
        for _ in range(rng.randint(1, 8)):
            clocks = rng.choice(interesting) if rng.random() < 0.7 else rng.randint(1, 5)
            request ^= 1
            inputs = {"request": request}
            if not calm:
                inputs |= {"tables_valid": rng.randint(0, 1), "capture": rng.randint(0, 1)}
            else:
                inputs |= {"tables_valid": 1}
            if rng.random() < 0.2:
                await guard.step(clocks, **inputs, clear=rng.randint(0, 1))
            else:
                await guard.alive(clocks, **inputs, clear=rng.randint(0, 1))
    assert len(guard.lights) > 20
    guard.check()


@cocotb.test(timeout_time=100, timeout_unit="ms")
async def latency(dut):
    """From the clock of a request to the one in which the pin has changed."""
    guard = Guard(dut)
    await guard.start()
    await guard.arm()
    asked = guard.clock
    await guard.alive(4, request=1)
    assert guard.lights[-1][0] - asked == Block.latency


@cocotb.test(timeout_time=100, timeout_unit="ms")
async def noise(dut):
    """Every input another one in every clock, densely and sparsely."""
    rng = random.Random(f"noise {parameters()['seed']}")
    guard = Guard(dut)
    await guard.start()
    for chance in (0.5, 0.9, 0.98, 0.02):
        for _ in range(2000 + 8 * guard.limits["window"]):
            if rng.random() < 0.05:
                guard.beat = rng.randrange(256)
            await guard.step(request=int(rng.random() < chance), heartbeat=guard.beat,
                             tables_valid=int(rng.random() < chance),
                             capture=int(rng.random() < 0.5), clear=int(rng.random() < 0.1))
    assert guard.lights
    guard.check()


@cocotb.test(timeout_time=100, timeout_unit="ms")
async def upsets(dut):
    """Each bit flips, in a pulse and after one: dark, reported, and light again after a window."""
    rng = random.Random(f"upsets {parameters()['seed']}")
    guard = Guard(dut)
    await guard.start()
    limits = guard.limits
    bits = [(name, bit) for name in CHECKED for bit in range(len(getattr(dut, name)))]
    bits += [(f"{name}_parity", 0) for name in CHECKED]
    rng.shuffle(bits)
    for name, bit in bits:
        await guard.arm()
        lights = len(guard.lights)
        await guard.alive(rng.randint(2, limits["pulse"]), request=1)
        assert len(guard.lights) == lights + 1
        if rng.random() < 0.5:
            await guard.alive(rng.randint(1, limits["repetition"]), request=0)
            await guard.alive(rng.randint(1, 3), request=1)
        await guard.upset(name, bit, clear=rng.randint(0, 1))
        lights = len(guard.lights)
        for _ in range(limits["window"] // 3):
            got = await guard.alive(3, request=rng.randint(0, 1))
            assert got[2] == 0 and got[3] & UPSET and len(guard.lights) == lights
    guard.check()


@cocotb.test(timeout_time=100, timeout_unit="ms")
async def every_limit_and_one_beside_it(dut):
    guard = Guard(dut)
    await guard.start()
    limits = guard.limits
    longest = min(limits["pulse"], limits["window_on"])

    # Length of a pulse.
    over = PULSE if limits["pulse"] <= limits["window_on"] else DUTY
    for length, causes in ((1, 0), (2, 0), (longest - 1, 0), (longest, 0), (longest + 1, over),
                           (longest + limits["window"] * 3, over)):
        await guard.arm()
        first = guard.clock + 1
        await guard.alive(length, request=1)
        got = await guard.alive(2, request=0)
        assert guard.lights[-1] == [first, min(longest, length + length % 2)]
        assert got[3] == causes

    # Time from pulse to pulse; a short one, so that the window does not matter.
    for distance, causes in ((limits["repetition"] - 1, REPETITION), (limits["repetition"], 0)):
        await guard.arm()
        await guard.alive(2, request=1)
        count = len(guard.lights)
        await guard.alive(distance - 2, request=0)
        got = await guard.alive(3, request=1)
        assert got[3] == causes and len(guard.lights) == count + (causes == 0)

    # Light in a window: the second pulse has what the first one left of it, or all.
    repetition, window = limits["repetition"], limits["window"]
    for distance in (repetition, max(repetition, window - 1), window):
        for length in (2, longest // 2 & ~1, longest):
            await guard.arm()
            await guard.alive(length, request=1)
            await guard.alive(distance - length, request=0)
            left = limits["window_on"] - (length if distance < limits["window"] else 0)
            allowed = min(left, limits["pulse"])
            count = len(guard.lights)
            if allowed:
                assert (await guard.alive(allowed, request=1))[3] == 0
            got = await guard.alive(2, request=1)
            assert got[3] == (PULSE if left >= limits["pulse"] else DUTY)
            assert guard.lights[count:] == ([[guard.clock - allowed - 1, allowed]] if allowed
                                            else [])
            # It stays dark until the request has gone low, however long that takes.
            await guard.alive(3 * limits["window"], request=1)
            assert len(guard.lights) == count + bool(allowed)

    # Heartbeat: one clock later than allowed disarms; two beats arm again, the cause stays.
    for silence, causes in ((limits["pause"], 0), (limits["pause"] + 1, HEARTBEAT)):
        await guard.arm()
        guard.beat ^= 1
        await guard.step(heartbeat=guard.beat)
        await guard.step(silence - 1)
        guard.beat ^= 1
        await guard.step(heartbeat=guard.beat)
        got = await guard.step(3)
        assert got[2] == (causes == 0) and got[3] == causes
        guard.beat ^= 1
        await guard.step(heartbeat=guard.beat)
        got = await guard.step()
        assert got[2] == 1 and got[3] == causes
        guard.count = 0
    guard.check()


@cocotb.test(timeout_time=100, timeout_unit="ms")
async def armed_or_dark(dut):
    """Each thing that arms, lost in the middle of a pulse: dark in the next clock but its edge."""
    guard = Guard(dut)
    await guard.start()
    got = await guard.step(3, request=1)
    assert not guard.lights and got[3] == NOT_ARMED | HEARTBEAT
    await guard.arm()
    # Right after a reset, the window before it is unknown.
    await guard.reset()
    got = await guard.step(1, request=0, heartbeat=1)
    got = await guard.step(1, heartbeat=2)
    guard.beat = 2
    await guard.alive(guard.limits["window"] - 2)
    got = await guard.alive(1)
    assert got[2] == 0
    got = await guard.alive(1)
    assert got[2] == 1

    for lost in ("tables_valid", "capture"):
        await guard.arm()
        on = {"tables_valid": int(lost == "tables_valid"), "capture": int(lost == "capture")}
        await guard.alive(3, request=1, **on)
        got = await guard.alive(1, **{lost: 0})
        assert got[0] == 1  # the third edge
        got = await guard.alive(1)
        assert got[:2] == (0, 1)  # the closing one
        got = await guard.alive(guard.limits["window"] * 2, **{lost: 1})
        assert got[3] == NOT_ARMED and guard.lights[-1][1] == 4
        got = await guard.alive(1, clear=1)  # held, it does not come back
        got = await guard.alive(2)
        assert got[3] == 0
        await guard.alive(1, request=0)
        got = await guard.alive(2, request=1)
        assert got[0] == 1
        await guard.alive(2, request=0, tables_valid=1)

    # A heartbeat that stops, beyond a pulse's length and in it.
    await guard.arm()
    guard.beat ^= 1
    await guard.step(heartbeat=guard.beat)
    await guard.step(guard.limits["pause"] - 3, request=0)
    got = await guard.step(8, request=1)
    assert got[2] == 0 and got[3] == HEARTBEAT and guard.lights[-1][1] == 4
    got = await guard.step(1, clear=1)
    got = await guard.step(1)
    assert got[3] == 0
    await guard.step(1, request=0)
    got = await guard.step(2, request=1)  # reported again, as the heartbeat is still missing
    assert got[3] == HEARTBEAT
    guard.check()


@cocotb.test(timeout_time=100, timeout_unit="ms")
async def glitches(dut):
    """A request that falls for one clock is another request, and too early."""
    guard = Guard(dut)
    await guard.start()
    await guard.arm()
    count = len(guard.lights)
    await guard.alive(3, request=1)
    await guard.alive(1, request=0)
    got = await guard.alive(guard.limits["window"] * 2, request=1)
    assert len(guard.lights) == count + 1 and guard.lights[-1][1] == 4
    assert got[3] == REPETITION
    await guard.arm()
    for _ in range(guard.limits["window"] * 4):  # as fast as it gets
        await guard.alive(1, request=1)
        await guard.alive(1, request=0)
    guard.check()


@cocotb.test(timeout_time=100, timeout_unit="ms")
async def clear_keeps_what_happens_now(dut):
    guard = Guard(dut)
    await guard.start()
    await guard.arm()
    await guard.alive(guard.limits["pulse"], request=1)
    if guard.limits["pulse"] <= guard.limits["window_on"]:
        await guard.alive(1, clear=1)
        got = await guard.alive(1, request=0)
        assert got[3] == PULSE
    got = await guard.alive(1, clear=1)
    got = await guard.alive(1)
    assert got[3] == 0


@cocotb.test(timeout_time=100, timeout_unit="ms")
async def a_stopped_clock_is_dark(dut):
    """The clock stops in each clock of a pulse: the driver, with time of its own, goes dark."""
    for stop_after in range(1, min(parameters()["pulse"], parameters()["window_on"])):
        for hold in (1, 5):
            if stop_after == 1 and hold == 1:
                guard = Guard(dut)
                await guard.start()
            await guard.arm()
            driver = LaserDriver(hold)
            for _ in range(stop_after + 1):
                pin = (await guard.alive(1, request=1))[0]
                driver.step(pin)
            assert pin == stop_after % 2
            light = [driver.step(pin) for _ in range(hold + 3)]
            assert light == [True] * (hold - 1) + [False] * 4
            await guard.alive(1, request=0)
    await ClockCycles(dut.clk, 2)
