"""Threshold from a histogram: mean plus some standard deviations of the background."""

import numpy as np

__all__ = ["threshold"]

_FAINT = 4  # a mode ends where the histogram falls below one part in so many of its peak
_SIGNIFICANT = 64  # a mode's smoothed peak holds more than one pixel in so many


def _smooth(counts):
    """Each bin twice, plus its neighbours; beside the ends there is nothing."""
    padded = np.concatenate([[0], counts, [0]])
    return padded[:-2] + 2 * padded[1:-1] + padded[2:]


def _first_mode(smooth, reached, pixels):
    """Bin and height of the first mode's peak, None where there is none."""
    peak, peak_bin = pixels // _SIGNIFICANT, None
    for bin_number in range(1, 255):
        value = int(smooth[bin_number])
        if reached[bin_number] and value > peak:
            peak, peak_bin = value, bin_number
        elif peak_bin is not None and _FAINT * value < peak:
            break
    return peak_bin, peak


def threshold(counts, threshold_alpha):
    """T = mean + alpha sigma of the histogram's first mode (the paper's Section VI).

    What the paper leaves open is read thus. Black and white, 0 and 255, are where the imager
    clips, so they are no part of a mode; the histogram without them is smoothed by (1 2 1). The
    background is what most of the image is made of, but a round picture has black corners, and
    much of a tissue may lie in the dark: bins below which less than half of all pixels lie
    (themselves included, and black ones too) are passed over. From there on, the *first maximum*
    is the highest bin before the smoothed histogram has fallen below a quarter of it; it is
    higher than 1/64 of the counted pixels. Where there is none, T is 1, or 255 if more than half
    of the pixels are white.

    The mode are the bins about the peak without a gap, down to that quarter: a Gaussian is cut
    there at 1.665 sigma. Its mean absolute deviation about the peak is 0.662 sigma after that
    cut; so sigma is 3/2 of it, and

        T = 1 + floor(peak + mean(d) + threshold_alpha * 3/2 * mean(abs(d))),   d = bin - peak,

    which needs one sum and one division; no less than 1 + peak, and no more than 255.

    Parameters
    ----------
    counts : array of 256 :class:`int`
        Histogram.
    threshold_alpha : :class:`int`
        Standard deviations, unsigned Q4.4.

    Returns
    -------
    :class:`int`
        Smallest grey value that is lit.
    """
    counts = np.array(counts, dtype=np.int64)
    pixels = int(counts.sum())
    reached = 2 * np.cumsum(counts) >= pixels
    counts[[0, 255]] = 0
    smooth = _smooth(counts)
    peak_bin, peak = _first_mode(smooth, reached, pixels)
    if peak_bin is None:
        return 1 if reached[254] else 255
    scaled = threshold_alpha + (threshold_alpha >> 1)  # Q4.4
    pixels, total = int(counts[peak_bin]), 0
    for step, gain in ((1, scaled + 16), (-1, scaled - 16)):
        weight, at = 0, peak_bin + step
        while 0 < at < 255 and _FAINT * int(smooth[at]) >= peak:
            weight += gain
            total += weight * int(counts[at])
            pixels += int(counts[at])
            at += step
    offset = max(0, total) // (16 * pixels)
    return min(255, peak_bin + offset + 1)
