"""No more points of a frame than the line can carry."""

import numpy as np

__all__ = ["limit_points"]


def limit_points(points, limit, before=0):
    """The points that may be sent, and how many may not.

    If the frame before had more than ``limit`` ok points, those that may be sent are spread over
    the frame: the k-th ok point is one if ``floor(k limit / before)`` is more than for the point
    before it, with k from 1. Otherwise they are the first ones.

    Parameters
    ----------
    points : structured array
        With a field ``status``, 0 for ok, in the order of sending.
    limit : :class:`int`
        Ok points; 0 is no limit.
    before : :class:`int`
        Ok points of the frame before, those that were not sent included.
    """
    if not limit:
        return points, 0
    ok = points["status"] == 0
    chosen, before = ok.copy(), min(before, 511)
    if before > limit:
        chosen[ok] = np.diff(np.arange(np.count_nonzero(ok) + 1) * limit // before) > 0
    keep = ~ok | (chosen & (np.cumsum(chosen) <= limit))
    return points[keep], int(np.count_nonzero(~keep))
