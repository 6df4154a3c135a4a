"""Roots of labels that were joined."""

import numpy as np

__all__ = ["join_labels"]


def join_labels(used, pairs):
    """The root of every label: the lowest of those that it was joined with, directly or not.

    Parameters
    ----------
    used : :class:`int`
        Labels that were given out, from 1 on; label 0 always exists.
    pairs : sequence of (label, label)
        Labels that were joined.

    Returns
    -------
    array of ``used + 1`` int64
    """
    root = np.arange(used + 1)
    for pair in pairs:
        low, high = sorted(root[list(pair)])
        root[root == high] = low
    return root
