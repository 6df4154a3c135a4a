"""Components as OpenCV finds them."""

import cv2
import numpy as np

__all__ = ["components", "last_pixels"]


def components(lit, core, excess, saturated, weighted):
    """Spots of a frame as a list of tuples (core, saturated, border, area, weight, sum_u, sum_v).

    Same arguments, limits and order as :func:`model.preprocessing.labelling.label`.
    """
    spots = []
    height, width = lit.shape
    for v, u in _members(lit):
        weight = excess[v, u].astype(int) + 1 if weighted else np.ones(len(u), int)
        at_border = 0 in (*v, *u) or height - 1 in v or width - 1 in u
        spot = [core[v, u].any(), saturated[v, u].any(), at_border,
                len(u), weight.sum(), weight @ u, weight @ v]
        if len(u) > 1023:
            spot[3:] = 1024, 0, 0, 0
        spots.append(tuple(int(value) for value in spot))
    return spots


def last_pixels(lit):
    """Place of every component's last pixel in raster order, in the order of the spots."""
    return np.array([v[-1] * lit.shape[1] + u[-1] for v, u in _members(lit)], dtype=int)


def _members(lit):
    """(rows, columns) of every component, in raster order; components by their last pixel."""
    count, labels = cv2.connectedComponents(lit.astype(np.uint8), connectivity=8)
    rows, columns = np.nonzero(labels)
    label = labels[rows, columns]
    members = np.argsort(label, kind="stable")
    ends = np.cumsum(np.bincount(label, minlength=count)[1:])
    parts = np.split(members, ends[:-1]) if count > 1 else []
    return [(rows[part], columns[part]) for part in sorted(parts, key=lambda part: part[-1])]
