"""Grey pixels to mask pixels."""

import numpy as np

__all__ = ["binarise"]


def binarise(frame, level):
    """A pixel is lit when its grey value reaches the level.

    Parameters
    ----------
    frame : array (height, width) of uint8
        Grey values.
    level : :class:`int`
        Smallest grey value that is lit, 0 to 255.

    Returns
    -------
    tuple of arrays (height, width), bool and uint8
        Lit pixels, and the grey value above the level (zero where dark).
    """
    lit = frame >= level
    return lit, np.where(lit, frame - np.uint8(level), 0).astype(np.uint8)
