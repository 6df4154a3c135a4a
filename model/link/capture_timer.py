"""How long a calibration capture lasts."""

import numpy as np

__all__ = ["capture_clocks"]


def capture_clocks(starts, clocks_per_ms, length):
    """Whether the capture is on in each of ``length`` clocks.

    Parameters
    ----------
    starts : list of (clock, milliseconds)
        Starts in rising order; each replaces the one before.
    clocks_per_ms : :class:`int`
        Clocks of a millisecond.
    length : :class:`int`
        Clocks.
    """
    on = np.zeros(length, bool)
    for clock, milliseconds in starts:
        on[clock + 1:] = False
        on[clock + 1:clock + 1 + milliseconds * clocks_per_ms] = True
    return on
