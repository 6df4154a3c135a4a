"""Photographs of two cameras, or of one that was refocused, among those of one lens."""

import numpy as np

from calibration.lens_fit import BROWN, fit_boards
from model.errors import UserError

__all__ = ["other_camera"]

#: Photographs are looked at if the common lens leaves more than this, px.
_SUSPECT_PX = 0.1
#: Two lenses are believed if they leave so much less than one.
_GAIN = 0.6
#: A lens needs so many photographs.
_LEAST = 3
_ROUNDS, _STARTS = 6, 4


def _split(board, views, fit, near):
    """Group photographs by the lens that fits them better; flags, RMS, or None."""
    for _ in range(_ROUNDS):
        if min(near.sum(), (~near).sum()) < _LEAST:
            return None
        lenses = []
        for group in (near, ~near):
            own = [view for view, member in zip(views, group, strict=True) if member]
            lenses.append(fit_boards(board, own, BROWN, fit.lens, fit.poses[group]).lens)
        # Each photograph by each lens, which stays as it is: only the pose is free.
        rms = np.array([fit_boards(board, views, (), lens, fit.poses).view_rms_px
                        for lens in lenses])
        then = rms[0] <= rms[1]
        if np.array_equal(then, near):
            return near, float(np.sqrt(np.mean(rms.min(axis=0) ** 2)))
        near = then
    return None


def other_camera(board, views, names, fit):
    """Refuse photographs that two lenses fit much better than one.

    Parameters
    ----------
    board : array (n, 3)
        Corners of the board, mm.
    views : sequence of arrays (n, 2)
        Where each photograph has them.
    names : sequence of :class:`str`
        Names of the photographs.
    fit : :class:`calibration.lens_fit.LensFit`
        The common lens.
    """
    if fit.rms_px < _SUSPECT_PX or len(views) < 2 * _LEAST or fit.lens.model != "brown":
        return
    rng, best = np.random.default_rng(1), None
    halves = [np.arange(len(views)) < len(views) // 2, fit.view_rms_px < np.median(fit.view_rms_px)]
    halves += [rng.random(len(views)) < 0.5 for _ in range(_STARTS - len(halves))]
    for near in halves:
        found = _split(board, views, fit, near)
        if found and (best is None or found[1] < best[1]):
            best = found
    if best is None or best[1] > _GAIN * fit.rms_px:
        return
    few = best[0] if best[0].sum() <= len(views) / 2 else ~best[0]
    few = [name for name, member in zip(names, few, strict=True) if member]
    raise UserError(
        f"The chessboard photographs are of two cameras, or the lens was refocused between them "
        f"({fit.rms_px:.2f} px RMS together, {best[1]:.2f} px in two groups); the smaller group is "
        f"{', '.join(few)}: keep those of the camera that measures.")
