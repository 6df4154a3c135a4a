"""A signal that stays high for some time after the last activity."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

__all__ = ["IDLE_TIMEOUT", "Activity"]

#: Clocks without activity after which a chain of blocks holds no work: none keeps any for longer
#: without showing it.
IDLE_TIMEOUT = 127


class Activity(wiring.Component):
    """Busy while something is active, and for so many clocks after.

    ``busy`` follows ``active`` in the same clock. Reset either forgets all activity, or counts as
    activity itself.

    Parameters
    ----------
    timeout : :class:`int`
        Clocks, 1 or more, for which ``busy`` stays high after the last one with ``active``.
    busy_after_reset : :class:`bool`
        Whether reset counts as activity.

    Members
    -------
    active : :py:`In(1)`
        Something is active in this clock.
    busy : :py:`Out(1)`
        Something is active, or was at most ``timeout`` clocks ago.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``active`` to ``busy``.
    """

    latency = 0

    def __init__(self, timeout=IDLE_TIMEOUT, busy_after_reset=False):
        if not isinstance(timeout, int) or timeout < 1:
            raise ValueError(f"Timeout must be a positive integer, not {timeout!r}")
        self.timeout, self.busy_after_reset = timeout, busy_after_reset
        super().__init__({"active": In(1), "busy": Out(1)})

    def elaborate(self, platform):
        m = Module()
        idle_timer = Signal(range(self.timeout + 1),
                            init=self.timeout if self.busy_after_reset else 0)
        m.d.comb += self.busy.eq(self.active | idle_timer.any())
        with m.If(self.active):
            m.d.sync += idle_timer.eq(self.timeout)
        with m.Elif(idle_timer.any()):
            m.d.sync += idle_timer.eq(idle_timer - 1)
        return m
