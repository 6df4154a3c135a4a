"""What stands out of its surroundings: each pixel less the mean of a window around it."""

import numpy as np

__all__ = ["DROPPED_BITS", "FRACTION_BITS", "RECIPROCAL_BITS", "background", "window_mean"]

#: Bits behind the binary point of a difference of grey values.
FRACTION_BITS = 4
#: Bits behind the binary point of the reciprocals of the number of pixels in a window.
RECIPROCAL_BITS = 20
#: Bits of a column's sum that are left out of the window's.
DROPPED_BITS = 2


def window_mean(image, window):
    """Mean grey value of the window around each pixel, unsigned Q8.4, rounded down.

    The sum of each column is rounded down to a multiple of four before.

    Where the window would reach beyond the left, the right or the bottom edge, the mean of the
    nearest pixel is taken whose window does not; at the top the part of the window is taken that
    lies inside. (Rows above the image could only be waited for by keeping as many more rows.)

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values; no side shorter than ``window``.
    window : :class:`int`
        Side of the window, odd.

    Returns
    -------
    array (height, width) of int64
    """
    height, width = image.shape
    half = window // 2
    middle = np.minimum(np.arange(height), height - 1 - half)
    first, last = np.maximum(middle - half, 0), middle + half + 1
    above = np.concatenate([np.zeros((1, width), np.int64), np.cumsum(image, 0, np.int64)])
    columns = above[last] - above[first] >> DROPPED_BITS
    before = np.concatenate([np.zeros((height, 1), np.int64), np.cumsum(columns, 1)], axis=1)
    middle = np.clip(np.arange(width), half, width - 1 - half)
    total = before[:, middle + half + 1] - before[:, middle - half]
    pixels = (last - first)[:, None] * window
    reciprocal = ((1 << RECIPROCAL_BITS) + pixels // 2) // pixels
    return total * reciprocal >> RECIPROCAL_BITS - FRACTION_BITS - DROPPED_BITS


def _shifted(values, rows, columns):
    """The values so many rows below and columns to the right, 0 outside of the image."""
    padded = np.pad(values, 2)
    height, width = values.shape
    return padded[2 + rows:2 + rows + height, 2 + columns:2 + columns + width]


def background(image, window, dent):
    """Contrast of each pixel to its surroundings, and the dents between spots.

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values.
    window : :class:`int`
        Side of the window, odd.
    dent : :class:`int`
        Quarters of a grey value; a pixel that lies by more below two others is a dent. 0 for no
        dents.

    Returns
    -------
    difference, smooth : arrays (height, width) of int64
        The pixel less the mean of its window and 1/16, signed Q8.4; and that of the image smoothed
        by (1 2 1) vertically and with the pixel to the right, less the mean and 1/8, signed Q8.3.
        In the outermost rows and the last column *smooth* has no meaning.
    dent : array of bool
        The pixel lies farther below both pixels two away from it in its column or in its row. Not
        in the two outermost rows and columns.
    """
    grey = image.astype(np.int64)
    mean = window_mean(image, window)
    vertical = _shifted(grey, -1, 0) + 2 * grey + _shifted(grey, 1, 0)
    smooth = vertical + _shifted(vertical, 0, 1)
    column = np.minimum(_shifted(grey, -2, 0), _shifted(grey, 2, 0)) - grey
    row = np.minimum(_shifted(grey, 0, -2), _shifted(grey, 0, 2)) - grey
    dents = (4 * np.maximum(column, row) > dent) & (dent > 0)
    dents[:2] = dents[-2:] = dents[:, :2] = dents[:, -2:] = False
    return (grey << FRACTION_BITS) + ~mean, smooth + ~(mean >> 1), dents
