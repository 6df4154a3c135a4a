"""Histogram of the part of a frame that the threshold is learnt from."""

import numpy as np

__all__ = ["BIN_LIMIT", "counted_rows", "histogram"]

#: The largest count that a bin can hold.
BIN_LIMIT = (1 << 17) - 1
#: Clocks in which the bins are cleared, and in which the threshold is found.
_CLEAR, _FIND = 260, 832


def counted_rows(width, height, whole=False):
    """First row that is counted, and the first one after it that is not.

    The bins are cleared while the first rows of the frame pass, and read while its last rows
    pass, so that the level is there for the next frame's first pixel, without any blanking. Of
    the rows between, those in the middle are counted, as many as a bin can hold pixels.

    With ``whole`` the frame waits in a memory for its own level, and there is time for the bins
    between frames: all rows may be counted.

    Raises
    ------
    ValueError
        If no row is left.
    """
    first, stop = (0, height) if whole else (-(-_CLEAR // width), height - -(-_FIND // width))
    if stop <= first:
        raise ValueError(f"A frame of {width} x {height} pixels is too small to learn a threshold "
                         f"from: it must have more than {first + height - stop} rows")
    rows = min(stop - first, BIN_LIMIT // width)
    first += (stop - first - rows) // 2
    return first, first + rows


def histogram(frame, whole=False):
    """Pixels of each grey value in the counted rows.

    Parameters
    ----------
    frame : array (height, width) of uint8
        Grey values.
    whole : :class:`bool`
        See :func:`counted_rows`.

    Returns
    -------
    array of 256 int64
        Counts.
    """
    first, stop = counted_rows(frame.shape[1], frame.shape[0], whole)
    return np.bincount(frame[first:stop].ravel(), minlength=256)
