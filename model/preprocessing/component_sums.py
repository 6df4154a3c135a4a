"""Sums of the components of a labelled image."""

import numpy as np

from .labelling import AREA_LIMIT, SPOT_DTYPE

__all__ = ["component_sums"]


def component_sums(labels, core, root):
    """Spots of a labelled image, in the order of their roots.

    Parameters
    ----------
    labels : array (height, width) of :class:`int`
        Label of each pixel, 0 for background.
    core : array of bool, shape (height, width)
        Pixels that survive the erosion.
    root : array of :class:`int`
        Root of each label. What has root 0 is dropped.

    Returns
    -------
    array of :data:`.labelling.SPOT_DTYPE`
        A spot for each label but 0 that is its own root, whether it has pixels or not. ``core`` is
        set if any of its pixels has it, ``border`` if any stands in an outermost row or column;
        ``saturated`` is False, and ``weight`` the area. ``area`` stops at
        :data:`.labelling.AREA_LIMIT`; then ``weight``, ``sum_u`` and ``sum_v`` are 0.
    """
    root = np.asarray(root)
    owner = root[labels]
    v, u = np.indices(owner.shape)

    def total(values):
        return np.bincount(owner.ravel(), values.ravel(), len(root)).astype(np.int64)

    area = total(np.ones(owner.shape))
    fits = area < AREA_LIMIT
    spots = np.zeros(len(root), SPOT_DTYPE)
    height, width = owner.shape
    spots["core"] = total(core) > 0
    spots["border"] = total((u == 0) | (u == width - 1) | (v == 0) | (v == height - 1)) > 0
    spots["area"] = np.minimum(area, AREA_LIMIT)
    for name, values in (("weight", np.ones(owner.shape)), ("sum_u", u), ("sum_v", v)):
        spots[name] = np.where(fits, total(values), 0)
    is_root = root == np.arange(len(root))
    is_root[0] = False
    return spots[is_root]
