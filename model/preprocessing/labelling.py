"""Connected components of a mask, with what their pixels add up to."""

import numpy as np

__all__ = ["AREA_LIMIT", "SPOT_DTYPE", "label"]

#: An area stops here; the sums of such a component read zero.
AREA_LIMIT = 1024

SPOT_DTYPE = np.dtype([
    ("core", "?"), ("saturated", "?"), ("border", "?"), ("area", "i4"), ("weight", "i4"),
    ("sum_u", "i4"), ("sum_v", "i4")])


def label(lit, core, excess, saturated, weighted):
    """The 8-connected components of a frame, in the order in which they end.

    A component ends where the next row has passed the right end of its last run: components are
    sorted by their last row, then by the right end of their last run there.

    Parameters
    ----------
    lit, core : array of bool, shape (height, width)
        Pixels above the level, and those that survive the erosion.
    excess : array of uint8, shape (height, width)
        Grey value above the level where lit.
    saturated : array of bool, shape (height, width)
        Pixels at the sensor's maximum.
    weighted : :class:`bool`
        A lit pixel weighs ``excess + 1``; else 1.

    Returns
    -------
    array of :data:`SPOT_DTYPE`
        ``core`` and ``saturated`` are set if any pixel has them, ``border`` if any pixel stands in
        an outermost row or column. ``area`` stops at :data:`AREA_LIMIT`; then ``weight``,
        ``sum_u`` (weight times column) and ``sum_v`` (weight times row) are 0.
    """
    height, width = lit.shape
    # A dark column after each row keeps runs apart, so that rows may follow each other in one line.
    stride = width + 1
    line = np.zeros(height * stride + 1, dtype=bool)
    line[1:].reshape(height, stride)[:, :width] = lit
    edges = np.flatnonzero(line[1:] != line[:-1])
    starts, stops = edges[0::2], edges[1::2]
    if not len(starts):
        return np.zeros(0, dtype=SPOT_DTYPE)

    # Sums over each run.
    areas = stops - starts
    first = np.cumsum(areas) - areas
    pixels = np.flatnonzero(lit)
    weights = excess.ravel()[pixels].astype(np.int64) + 1 if weighted else np.ones_like(pixels)
    weight = np.add.reduceat(weights, first)
    sum_u = np.add.reduceat(weights * (pixels % width), first)
    border = np.ones(lit.shape, bool)
    border[1:-1, 1:-1] = False
    flags = {name: np.logical_or.reduceat(of_pixel.ravel()[pixels], first) for name, of_pixel in (
        ("core", core), ("saturated", saturated), ("border", border))}

    # Sums over each component. A component's last run has the highest number.
    roots = _joined(starts, stops, stride)
    runs = np.arange(len(roots))
    last = np.zeros_like(runs)
    np.maximum.at(last, roots, runs)
    own = np.flatnonzero(roots == runs)
    order = own[np.argsort(last[own])]
    index = np.empty_like(runs)
    index[order] = np.arange(len(order))
    group = index[roots]

    def total(values):
        return np.bincount(group, weights=values, minlength=len(order)).astype(np.int64)

    area = total(areas)
    fits = area < AREA_LIMIT
    spots = np.zeros(len(order), dtype=SPOT_DTYPE)
    for name, of_run in flags.items():
        spots[name] = total(of_run) > 0
    spots["area"] = np.minimum(area, AREA_LIMIT)
    spots["weight"] = np.where(fits, total(weight), 0)
    spots["sum_u"] = np.where(fits, total(sum_u), 0)
    spots["sum_v"] = np.where(fits, total(weight * (starts // stride)), 0)
    return spots


def _joined(starts, stops, stride):
    """The lowest number of a run in the same component, for every run."""
    # Below a run its neighbours stand side by side, from the first that does not end before it
    # starts to the last that does not start after it has ended.
    low = np.searchsorted(stops, starts + stride, side="left")
    high = np.searchsorted(starts, stops + stride, side="right")
    count = high - low
    upper = np.repeat(np.arange(len(starts)), count)
    lower = np.arange(len(upper)) - np.repeat(np.cumsum(count) - count - low, count)

    # Every root takes the lowest of its neighbours for its parent, all chains are shortened to
    # their roots, and what still joins two roots is tried again.
    parent = np.arange(len(starts))
    one, other = upper, lower
    while len(one):
        np.minimum.at(parent, np.maximum(one, other), np.minimum(one, other))
        while not np.array_equal(parent, above := parent[parent]):
            parent = above
        one, other = parent[upper], parent[lower]
        apart = one != other
        upper, lower, one, other = upper[apart], lower[apart], one[apart], other[apart]
    return parent
