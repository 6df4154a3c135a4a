"""A signal that stays high for some time after the last activity."""

import numpy as np

__all__ = ["busy_clocks"]


def busy_clocks(active, timeout, busy_after_reset=False):
    """Whether the block is busy in each clock after reset.

    Parameters
    ----------
    active : sequence of :class:`bool`
        What is active in each clock.
    timeout : :class:`int`
        Clocks for which it stays busy after the last activity.
    busy_after_reset : :class:`bool`
        Whether the clock before the first one counts as active.
    """
    clocks = np.arange(len(active))
    last = np.maximum.accumulate(np.where(active, clocks, -1 if busy_after_reset else -np.inf))
    return clocks - last <= timeout
