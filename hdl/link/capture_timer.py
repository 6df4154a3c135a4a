"""How long a calibration capture lasts."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

__all__ = ["CaptureTimer"]


class CaptureTimer(wiring.Component):
    """Keeps ``capture`` high for a number of milliseconds, exact to the clock.

    It rises in the clock after ``start`` and stays for ``milliseconds`` times a thousandth of
    ``clock_hz``; with 0 it falls. A start before the end begins anew. Reset ends it.

    Parameters
    ----------
    clock_hz : :class:`int`
        System clock, a multiple of 1 kHz, 2 kHz or more.

    Members
    -------
    start, milliseconds : :py:`In(1)`, :py:`In(16)`
        Start in this clock, for so long.
    capture : :py:`Out(1)`
        The time is not over.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``start`` to ``capture``.
    """

    latency = 1

    def __init__(self, clock_hz=16_000_000):
        if not isinstance(clock_hz, int) or clock_hz < 2000 or clock_hz % 1000:
            raise ValueError("System clock must be a multiple of 1 kHz, 2 kHz or more, not "
                             f"{clock_hz!r}")
        self.clock_hz = clock_hz
        super().__init__({"start": In(1), "milliseconds": In(16), "capture": Out(1)})

    def elaborate(self, platform):
        m = Module()
        # Both counters are one ahead, so that their signs show their ends. Subtracting ~y adds
        # y + 1: a choice before a subtrahend costs nothing on a carry chain.
        clocks = self.clock_hz // 1000
        clock = Signal(signed(clocks.bit_length() + 1))
        left = Signal(signed(17), init=-1)
        m.d.comb += self.capture.eq(~left[16])
        m.d.sync += clock.eq(clock - 1)
        with m.If(self.start | clock[-1]):
            m.d.sync += clock.eq(clocks - 2)
        with m.If(self.start | (clock[-1] & self.capture)):
            m.d.sync += left.eq(-2 - ~Mux(self.start, Cat(self.milliseconds, C(0, 1)), left))
        return m
