"""Noise of a frame from its pixels below the local mean, and the levels that follow from it."""

from dataclasses import dataclass
from math import isqrt

import numpy as np

__all__ = ["Levels", "frame_noise", "learning_rows", "levels"]

_LARGEST = 511  # eighths of a grey value
_LEAST_NOISE = 8
#: Pixels that must follow those that teach the noise, before the frame ends.
_FOLLOWING_PIXELS = 48


@dataclass(frozen=True)
class Levels:
    """What a pixel's contrast is compared to.

    Parameters
    ----------
    lit, core : :class:`int`
        Differences from which on a pixel is lit, and core: unsigned Q8.4.
    dent : :class:`int`
        Depth of a dent, unsigned Q8.2; see :func:`model.preprocessing.background.background`.
    """

    lit: int
    core: int
    dent: int


def learning_rows(width, height):
    """First row and number of rows that teach the noise, and the logarithm of their samples.

    They stand in the middle of the frame; the pixels of their odd columns are samples. Their number
    is such that the samples are as nearly as possible a power of two, and that at least 48 pixels
    follow them.
    """
    following = -(-_FOLLOWING_PIXELS // width)
    samples = width // 2
    bits = (samples * (height - 2 * following + 1)).bit_length() - 1
    rows = round((1 << bits) / samples)
    return (height - rows) // 2, rows, bits


def frame_noise(difference):
    """Noise of a frame in eighths of a grey value, 8 (one grey value) at least.

    Spots and highlights stand above their surroundings, never below. So what lies below is noise,
    texture, and the shade that strong spots cast on the mean around them. Half of all pixels would
    lie below zero if there were no spots; the noise is the root of their mean square.

    Parameters
    ----------
    difference : array (height, width) of int
        Signed Q8.4.

    Returns
    -------
    :class:`int`
        Rounded down, 511 at most.
    """
    first, rows, bits = learning_rows(*difference.shape[::-1])
    band = difference[first:first + rows, 1::2]
    below = (~band[band < 0] >> 1).astype(np.int64)
    root = isqrt(int((below ** 2).sum()) >> bits - 1)
    return min(max(root, _LEAST_NOISE), _LARGEST)


def levels(noise, lit_gain, core_gain, dent_gain):
    """Levels that follow from the noise.

    Parameters
    ----------
    noise : :class:`int`
        Eighths of a grey value, up to 511.
    lit_gain, core_gain, dent_gain : :class:`int`
        Multiples of the noise, unsigned Q2.4.

    Returns
    -------
    :class:`Levels`
        Rounded down.
    """
    return Levels(noise * lit_gain >> 3, noise * core_gain >> 3, noise * dent_gain >> 5)
