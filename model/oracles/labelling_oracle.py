"""Components as OpenCV finds them."""

import cv2
import numpy as np

__all__ = ["components"]


def components(lit, core, excess, weighted):
    """Spots of a frame as a list of tuples (core, area, weight, sum_u, sum_v).

    Same arguments, limits and order as :func:`model.preprocessing.labelling.label`.
    """
    count, labels = cv2.connectedComponents(lit.astype(np.uint8), connectivity=8)
    rows, columns = np.nonzero(labels)
    members = np.argsort(labels[rows, columns], kind="stable")
    ends = np.cumsum(np.bincount(labels[rows, columns], minlength=count)[1:])
    spots = []
    for pixels in np.split(members, ends[:-1]) if count > 1 else []:
        v, u = rows[pixels], columns[pixels]
        weight = excess[v, u].astype(int) + 1 if weighted else np.ones(len(u), int)
        spot = [bool(core[v, u].any()), len(u), weight.sum(), weight @ u, weight @ v]
        if len(u) > 255:
            spot[1:] = 256, 0, 0, 0
        spots.append(((v[-1], u[-1]), tuple(int(value) for value in spot)))
    return [spot for _, spot in sorted(spots)]
