"""Lit and core pixels by two levels."""

import numpy as np

__all__ = ["hysteresis"]


def hysteresis(difference, smooth, dent, levels):
    """Lit pixels, core pixels, and what a lit one exceeds the level by.

    Parameters
    ----------
    difference, smooth : arrays (height, width) of int
        Signed Q8.4 and Q8.3, see :func:`model.preprocessing.background.background`.
    dent : array of bool
        Pixels that part two spots: they stay dark.
    levels : :class:`model.preprocessing.noise.Levels`
        Levels.

    Returns
    -------
    lit, core : arrays of bool
        A pixel is core if it is lit, not in an outermost row or the last column, and the difference
        of the smoothed image reaches the core level.
    excess : array of uint8
        Whole grey values above the lit level; 0 where not lit.
    """
    lit = (difference >= levels.lit) & ~dent
    inner = np.zeros(lit.shape, bool)
    inner[1:-1, :-1] = True
    core = lit & (smooth >= levels.core >> 1) & inner
    return lit, core, np.where(lit, difference - levels.lit >> 4, 0).astype(np.uint8)
