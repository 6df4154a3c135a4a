"""Connected components of a mask, in two passes with a limited number of labels."""

import numpy as np

from .labelling import AREA_LIMIT, SPOT_DTYPE

__all__ = ["label_in_two_passes", "labels_used"]


def label_in_two_passes(lit, core, labels):
    """The 8-connected components of a frame, in the order of their first pixels.

    A lit pixel asks for a label if none of its neighbours to the west, north-west, north and
    north-east is lit. The first ``labels`` pixels that ask get one. A component with a pixel that
    got no label is dropped whole.

    Parameters
    ----------
    lit, core : array of bool, shape (height, width)
        Pixels above the level, and those that survive the erosion.
    labels : :class:`int`
        Provisional labels of a frame.

    Returns
    -------
    spots : array of :data:`.labelling.SPOT_DTYPE`
        ``core`` is set if any pixel has it, ``border`` if any stands in an outermost row or
        column; ``saturated`` is False, and ``weight`` the area. ``area`` stops at
        :data:`.labelling.AREA_LIMIT`; then ``weight``, ``sum_u`` and ``sum_v`` are 0.
    dropped : :class:`int`
        Pixels that got no label, 65,535 at most.
    """
    height, width = lit.shape
    pixels = np.flatnonzero(lit)
    first = _first_pixels(lit)[pixels]
    asks = np.flatnonzero(_asks(lit))
    in_vain = asks[labels:]

    heads, component = np.unique(first, return_inverse=True)
    kept = np.ones(len(heads), dtype=bool)
    kept[component[np.searchsorted(pixels, in_vain)]] = False

    def total(values):
        return np.bincount(component, weights=values, minlength=len(heads)).astype(np.int64)

    area = total(np.ones(len(pixels)))
    fits = area < AREA_LIMIT
    spots = np.zeros(len(heads), dtype=SPOT_DTYPE)
    border = np.ones(lit.shape, bool)
    border[1:-1, 1:-1] = False
    spots["core"] = total(core.ravel()[pixels]) > 0
    spots["border"] = total(border.ravel()[pixels]) > 0
    spots["area"] = np.minimum(area, AREA_LIMIT)
    spots["weight"] = np.where(fits, area, 0)
    spots["sum_u"] = np.where(fits, total(pixels % width), 0)
    spots["sum_v"] = np.where(fits, total(pixels // width), 0)
    return spots[kept], min(len(in_vain), 0xFFFF)


def labels_used(lit, labels):
    """Provisional labels that a frame takes."""
    return min(int(np.count_nonzero(_asks(lit))), labels)


def _asks(lit):
    """Pixels that are lit, and none of their neighbours before them."""
    asks = lit.copy()
    asks[:, 1:] &= ~lit[:, :-1]
    asks[1:] &= ~lit[:-1]
    asks[1:, 1:] &= ~lit[:-1, :-1]
    asks[1:, :-1] &= ~lit[:-1, 1:]
    return asks


def _first_pixels(lit):
    """The number, in raster order, of the first pixel of each pixel's component."""
    height, width = lit.shape
    number = np.arange(height * width).reshape(height, width)
    edges = []
    for here, there in [
        (np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1]),
        (np.s_[1:, 1:], np.s_[:-1, :-1]), (np.s_[1:, :-1], np.s_[:-1, 1:]),
    ]:
        both = lit[here] & lit[there]
        edges.append((number[here][both], number[there][both]))
    one, other = (np.concatenate(side) for side in zip(*edges, strict=True))

    # Pixels lower each other's number along the edges; after each round every chain of numbers is
    # cut short. Edges within one component of numbers are done with.
    first = number.ravel()
    while len(one):
        low = np.minimum(first[one], first[other])
        np.minimum.at(first, first[one], low)
        np.minimum.at(first, first[other], low)
        while not np.array_equal(first, first[first]):
            first = first[first]
        apart = first[one] != first[other]
        one, other = one[apart], other[apart]
    return first
