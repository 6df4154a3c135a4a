"""Areas of spots in nine bits: exact up to 255 pixels, then in steps of two and of four."""

import numpy as np

__all__ = ["LARGEST_AREA", "area_code", "coded_area"]

#: Pixels of the largest spot.
LARGEST_AREA = 1023


def area_code(area):
    """Code of an area.

    Parameters
    ----------
    area : array of :class:`int`
        Pixels, up to :data:`LARGEST_AREA`.

    Returns
    -------
    array of :class:`int`
        9 bits: ``area`` below 256; ``256 + (area - 256) // 2`` below 512; ``384 + (area - 512) //
        4`` from there on.
    """
    area = np.asarray(area)
    return np.where(area < 256, area, np.where(area < 512, 128 + area // 2, 256 + area // 4))


def coded_area(code):
    """The smallest area that has this code."""
    code = np.asarray(code)
    return np.where(code < 256, code, np.where(code < 384, 2 * code - 256, 4 * code - 1024))
