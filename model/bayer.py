"""Colour filter arrays: which colour a pixel of a sensor sees."""

import numpy as np

__all__ = ["BAYER", "channels"]

#: Bayer patterns, by the colours of the first two pixels of the first and the second row.
BAYER = ("RGGB", "GRBG", "GBRG", "BGGR")


def channels(bayer, height, width):
    """The colour of each pixel: an array (height, width) of 0 for red, 1 for green, 2 for blue.

    Parameters
    ----------
    bayer : :class:`str`
        One of :data:`BAYER`.
    height, width : :class:`int`
        Of the sensor, in pixels.
    """
    cell = np.array(["RGB".index(colour) for colour in bayer], np.uint8).reshape(2, 2)
    return np.tile(cell, (-(-height // 2), -(-width // 2)))[:height, :width]
