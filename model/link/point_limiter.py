"""No more points of a frame than the line can carry."""

import numpy as np

__all__ = ["limit_points"]


def limit_points(points, limit):
    """The points that may be sent, and how many may not.

    Parameters
    ----------
    points : structured array
        With a field ``status``, 0 for ok, in the order of sending.
    limit : :class:`int`
        Ok points, the first ones; 0 is no limit.
    """
    ok = points["status"] == 0
    keep = ~ok | (np.cumsum(ok) <= limit) if limit else np.ones(len(points), bool)
    return points[keep], int(np.count_nonzero(~keep))
