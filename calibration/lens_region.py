"""Where in the picture a fitted lens may be used."""

from dataclasses import replace

import numpy as np

from calibration.undistortion import GAIN_LIMIT

__all__ = ["bounded"]

#: Undistorted by distorted radius, at most: the chip's radial table holds less than 2.
_MOST_SCALE = 1.95
#: A gain near the limit at the border itself would be above it between two table segments.
_MOST_GAIN = 0.97 * GAIN_LIMIT
#: Radial standard deviation, px, beyond which a part of the picture without corners is left out.
_MOST_SIGMA_PX = 1.0
#: Corners of the boards vouch for the model a little beyond them.
_BEYOND = 1.05
_STEP_PX = 0.5


def _sigma_px(fit, radius):
    """Standard deviation of the distorted radius, px, of undistorted radii, the scale apart.

    A wrong focal length is a wrong scale, which the size of a picture does not make worse.
    """
    lens = fit.lens
    index = [fit.names.index(name) for name in ("k1", "k2", "k3") if name in fit.names]
    scale = fit.names.index("focal")
    covariance = fit.covariance
    own = covariance[np.ix_(index, index)] - np.outer(
        covariance[index, scale], covariance[index, scale]) / max(covariance[scale, scale], 1e-30)
    t = np.arctan(radius) if lens.model == "equidistant" else radius
    powers = np.stack([t**(2 * number + 3) for number in range(len(index))], axis=-1)
    return lens.focal * np.sqrt(np.maximum(np.einsum("rp,pq,rq->r", powers, own, powers), 0))


def bounded(fit, corners):
    """The lens of a fit, with its usable region.

    The region ends where the model folds, where it magnifies so much that the chip cannot undo it,
    or where no corner of a board was seen and the model is uncertain. A lens that may be used in
    the whole picture has no limit.

    Parameters
    ----------
    fit : :class:`calibration.lens_fit.LensFit`
        A lens and its covariance.
    corners : array (n, 2)
        All corners of all boards, image coordinates.

    Returns
    -------
    :class:`calibration.lens.Lens`
    """
    lens = fit.lens
    radius = np.arange(_STEP_PX, lens.corner_px + 2 * _STEP_PX, _STEP_PX)
    seen = _BEYOND * lens.distance_px(*np.asarray(corners).T).max()
    undistorted = lens.radial.undistorted(radius / lens.focal)
    good = np.isfinite(undistorted)
    undistorted = np.where(good, undistorted, 0)
    good &= undistorted * lens.focal <= _MOST_SCALE * radius
    good &= lens.radial.slope(undistorted) >= 1 / _MOST_GAIN
    good &= (radius <= seen) | (_sigma_px(fit, undistorted) <= _MOST_SIGMA_PX)
    if good.all():
        # The tangential part may fold, or magnify, what the radial one does not.
        u, v = np.meshgrid(np.linspace(0, lens.width - 1, 83), np.linspace(0, lens.height - 1, 71))
        gain = lens.gain(*lens.undistort(u, v))
        if gain.max() <= GAIN_LIMIT:
            return lens
        off = lens.distance_px(u, v)[gain > GAIN_LIMIT]
        return replace(lens, usable_px=float(off.min() - 1))
    return replace(lens, usable_px=float(radius[np.argmin(good)] - _STEP_PX))
