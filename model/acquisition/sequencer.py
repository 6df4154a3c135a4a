"""Which frames are taken and when, event by event from what imager, guard and host do.

Clocks are counted from the first one after reset. A microsecond ends with every clock that leaves
the remainder C - 1 when divided by C, the clocks of a microsecond.
"""

from dataclasses import dataclass, field

from .exposure import exposure

__all__ = ["CONTINUOUS", "PATTERN", "SINGLE", "STOP", "Frame", "Readout", "Registers",
           "Schedule", "pair_us"]

STOP, CONTINUOUS, SINGLE, PATTERN = range(4)


@dataclass(frozen=True)
class Registers:
    """What the host chooses."""

    mode: int = CONTINUOUS
    period_us: int = 40_000
    pattern_reset_us: int = 100
    pattern_us: int = 500
    texture_reset_us: int = 100
    texture_us: int = 10_000
    pattern_as_texture: int = 0


@dataclass(frozen=True)
class Readout:
    """What the imager does after an integration; clocks, None for what never happens.

    ``begun``: first pixel; ``over``: last pixel if ``whole``, else loss of synchronism;
    ``idle_from``: first clock in which it no longer says that it sends a frame.
    """

    begun: int | None = None
    over: int | None = None
    whole: bool = True
    idle_from: int = 0


@dataclass
class Frame:
    """A frame that was taken."""

    texture: bool
    start: int  # clock of `frame_start`
    pins: dict = field(default_factory=dict)  # see `exposure`
    laser_requested: bool = False
    as_texture: bool = False  # tagged as texture
    exposure_us: int = 0
    timestamp_us: int = 0
    outcome: str = ""  # whole, broken or missing
    over: int = 0  # clock in which the outcome is known


def pair_us(registers, readout_us):
    """Microseconds that a pair's frames need, with read-outs of ``readout_us`` each."""
    return (registers.pattern_reset_us + registers.pattern_us
            + registers.texture_reset_us + registers.texture_us + 2 * readout_us)


class Schedule:
    """The schedule up to a clock.

    Parameters
    ----------
    clock_hz : :class:`int`
        Clock.
    registers : list of (clock, :class:`Registers`)
        Values and the first clock of each, in order, from clock 0.
    sensor : callable
        Takes the number of the frame and the clock after its integration; returns a `Readout`.
    armed : callable
        Takes a clock; whether the laser guard is armed in it.
    until : :class:`int`
        No frame begins from this clock on.
    begin_us, frame_us, warm_up_us : :class:`int`
        Time limits.

    Attributes
    ----------
    frames : list of `Frame`
    starts : list of (clock, texture)
        Every ``frame_start``, also those that no frame follows because the mode has changed.
    late : list of :class:`int`
        Clocks from which a pair is counted as late.
    running : list of (clock, clock)
        First clock, and first one after.
    """

    def __init__(self, clock_hz, registers, sensor, armed, until, begin_us=5000,
                 frame_us=20_000, warm_up_us=100_000):
        self.clocks = clock_hz // 1_000_000
        self.clock_hz, self.registers = clock_hz, registers
        self.sensor, self.armed = sensor, armed
        self.begin_us, self.frame_us, self.warm_up_us = begin_us, frame_us, warm_up_us
        self.frames, self.starts, self.running, self.late = [], [], [], []
        self.single_pending = True
        self.pending_known = 0  # `single_pending` is up to date until this clock
        clock = 0
        while clock < until:
            clock = self._run(clock, until)

    def _now(self, clock):
        return [values for since, values in self.registers if since <= clock][-1]

    def _ticks(self, first, last):
        """Microseconds that end in these clocks, both included."""
        return max(0, (last + 1) // self.clocks - first // self.clocks)

    def _after(self, first, microseconds):
        """The clock after the end of so many microseconds, those from ``first`` on."""
        return (first // self.clocks + microseconds) * self.clocks

    def _stopped(self, clock, texture=False):
        for before in range(self.pending_known, clock):
            if self._now(before).mode != SINGLE:
                self.single_pending = True
        self.pending_known = max(self.pending_known, clock)
        mode = self._now(clock).mode
        return mode == STOP or mode == SINGLE and not self.single_pending and not texture

    def _run(self, idle, until):
        """From one stop to the next."""
        clock = idle
        while (clock + 1) % self.clocks or self._stopped(clock):
            clock += 1
            if clock >= until:
                return clock
        self.running.append([clock + 1, None])
        begin, texture, self.warm_since = clock + 1, False, clock + 1
        while begin < until:
            self.starts.append((begin, texture))
            take = begin + 1
            if self._stopped(take, texture):
                self.running[-1][1] = take + 1
                return take + 1
            values = self._now(take)
            warm_up_frame = False
            if texture and values.mode == PATTERN:
                wait = take + 1
            else:
                if not texture:
                    if self.armed(take):
                        self.warm_since = take + 1
                    warm_up_frame = (not self.armed(take)
                            and self._ticks(self.warm_since, take - 1) < self.warm_up_us)
                    pair, period_us = take + 1, values.period_us
                    self.pending_known = take
                    if not warm_up_frame:
                        self.single_pending = False
                wait = self._frame(texture, begin, take, values) + 2
                if not texture and not warm_up_frame and values.mode != PATTERN:
                    begin, texture = wait, True
                    continue
            clock, texture = wait, False
            while True:
                if self._stopped(clock):
                    self.running[-1][1] = clock + 1
                    return clock + 1
                left = max(0, period_us - self._ticks(pair, clock - 1))
                if (clock + 1) % self.clocks == 0 and (warm_up_frame or left <= 1):
                    if not warm_up_frame and not left:
                        self.late.append(clock + 1)
                    break
                clock += 1
                if clock >= until:
                    return clock
            begin = clock + 1
        return begin

    def _frame(self, texture, begin, take, values):
        """Take a frame; returns the clock in which it is known to be over."""
        frame = Frame(texture, begin)
        frame.laser_requested = not texture and bool(self.armed(take))
        times = (values.texture_reset_us, values.texture_us) if texture else (
            values.pattern_reset_us, values.pattern_us)
        frame.as_texture = bool(texture or values.pattern_as_texture and values.mode == PATTERN)
        frame.exposure_us = max(1, times[1])
        frame.pins = exposure(self.clock_hz, *times, frame.laser_requested, take)
        frame.timestamp_us = frame.pins["sensor_integrate"][0] // self.clocks
        read = frame.pins["integrated"] + 1
        readout = self.sensor(len(self.frames), read - 1)
        too_late, too_long = (
            self._after(read, limit) for limit in (self.begin_us, self.frame_us))
        if readout.begun is None or readout.begun > too_late:
            frame.outcome, frame.over = "missing", too_late
        elif readout.over is None or readout.over > too_long:
            frame.outcome, frame.over = "missing", too_long
        else:
            frame.outcome = "whole" if readout.whole else "broken"
            frame.over = max(readout.over + 1, frame.pins["done"],
                             min(readout.idle_from, max(too_long, readout.over + 1)))
        if frame.outcome != "whole":
            self.warm_since = 1 + (frame.over if frame.outcome == "missing" else readout.over)
        self.frames.append(frame)
        return frame.over
