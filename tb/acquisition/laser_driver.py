"""The laser's AC-coupled driver, and what it must be like."""

from math import log, pi

__all__ = ["HOLD_NS", "LaserDriver", "corner_hz"]

#: Longest light after an edge of the pin, in nanoseconds: what the README requires of a driver.
HOLD_NS = 125


def corner_hz(swing, hold_ns=HOLD_NS):
    """Least corner frequency of a high-pass whose output, an edge of the pin, decays in time.

    Parameters
    ----------
    swing : :class:`float`
        Height of an edge, in units of the level that lights the laser.
    """
    return log(swing) / (2 * pi * hold_ns * 1e-9)


class LaserDriver:
    """Lights the laser while its pin keeps changing, whatever level the pin stands at otherwise.

    Parameters
    ----------
    hold : :class:`int`
        Clocks for which one edge lights it, its own clock included.
    """

    def __init__(self, hold=1):
        if not isinstance(hold, int) or hold < 1:
            raise ValueError(f"An edge must light the driver for at least one clock, not {hold!r}")
        self.hold = hold
        self.pin = 0
        self.charge = 0

    def step(self, pin):
        """One clock with ``pin`` at that level; return whether there is light."""
        if pin != self.pin:
            self.charge = self.hold
        elif self.charge:
            self.charge -= 1
        self.pin = pin
        return self.charge > 0
