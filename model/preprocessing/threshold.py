"""Threshold from a histogram: mean plus some standard deviations of the background."""

import numpy as np

__all__ = ["threshold"]

_FAINT = 4  # a mode ends where the histogram falls below one part in so many of its peak
_SIGNIFICANT = 64  # a mode's smoothed peak holds at least one pixel in so many


def _smooth(counts):
    """Each bin twice, plus its neighbours; beside the ends there is nothing."""
    padded = np.concatenate([[0], counts, [0]])
    return padded[:-2] + 2 * padded[1:-1] + padded[2:]


def _first_mode(smooth, pixels):
    """Peak of the first mode: the highest bin before the histogram falls below a quarter of it.

    Going up from black, peaks that hold less than 1/64 of the pixels are passed over; if there is
    none above, the mode is black.
    """
    peak = place = 0
    for bin_number in range(1, 255):
        value = int(smooth[bin_number])
        if value > peak:
            peak, place = value, bin_number
        elif peak * _SIGNIFICANT >= pixels and _FAINT * value < peak:
            break
    return (place, peak) if peak * _SIGNIFICANT >= pixels else (0, 0)


def threshold(counts, alpha, pixels=None):
    """T = mean + alpha sigma of the histogram's first mode (the paper's Section VI).

    What the paper leaves open is read thus. Black and white, 0 and 255, are where the imager
    clips, so they are no part of a mode; and a lens may leave black corners. The histogram
    without them is smoothed by (1 2 1). The *first maximum* is the highest bin before the
    smoothed histogram has fallen below a quarter of it; it holds 1/64 of the counted pixels or
    more. Where there is none, the background is black and T is 1. The mode are the bins about it
    without a gap, down to that quarter: a Gaussian is cut there at 1.665 sigma. Its mean absolute
    deviation about the peak is 0.662 sigma after that cut; so sigma is 3/2 of it, and

        T = 1 + floor(peak + mean(d) + alpha * 3/2 * mean(abs(d))),   d = bin - peak,

    which needs one sum and one division. T is at most 255.

    Parameters
    ----------
    counts : array of 256 :class:`int`
        Histogram.
    alpha : :class:`int`
        Standard deviations, unsigned Q4.4.
    pixels : :class:`int`, optional
        Pixels that were counted; given, where a bin may have stopped at its limit.

    Returns
    -------
    :class:`int`
        Smallest grey value that is lit.
    """
    counts = np.array(counts, dtype=np.int64)
    pixels = int(counts.sum()) if pixels is None else pixels
    counts[[0, 255]] = 0
    smooth = _smooth(counts)
    place, peak = _first_mode(smooth, pixels)
    if not peak:
        return 1
    scaled = alpha + (alpha >> 1)  # Q4.4
    pixels, total = int(counts[place]), 0
    for step, gain in ((1, scaled + 16), (-1, scaled - 16)):
        weight, at = 0, place + step
        while 0 < at < 255 and _FAINT * int(smooth[at]) >= peak:
            weight += gain
            total += weight * int(counts[at])
            pixels += int(counts[at])
            at += step
    offset = max(0, total) // (16 * pixels)
    return min(255, place + offset + 1)
