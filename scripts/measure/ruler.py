"""The distance between two points of the surface."""

from dataclasses import dataclass

import numpy as np

from model.errors import UserError
from scripts.measure.scale import scale_variance

__all__ = ["Length", "ruler"]


@dataclass(frozen=True)
class Length:
    """A distance in millimetres, straight from point to point.

    Parameters
    ----------
    value, uncertainty : :class:`float`
        The distance and its standard deviation.
    random : :class:`float`
        The part of the standard deviation that differs from frame to frame.
    ends : array (2, 3)
        The two points.
    """

    value: float
    uncertainty: float
    random: float
    ends: np.ndarray


def ruler(surface, image):
    """The distance between the points of the surface at two image coordinates.

    The uncertainty (68 %, one standard deviation) has the noise of the spots, what the surface may
    do between them, and the calibration of beams and lens. How well the two points were chosen is
    not in it.

    Parameters
    ----------
    surface : :class:`scripts.measure.surface.Surface`
        Of a frame.
    image : array (2, 2)
        u and v of both in pixels.

    Raises
    ------
    UserError
        If there is no surface at one of them, or they are the same.
    """
    image = np.asarray(image, float)
    if image.shape != (2, 2):
        raise UserError(f"The ruler takes two points, not {len(image)}.")
    if (image[0] == image[1]).all():
        raise UserError("The two points of the ruler are the same: choose another one.")
    picked = surface.pick(image)
    ends = picked.xyz
    step = ends[1] - ends[0]
    value = float(np.linalg.norm(step))
    # A point moves along its ray: dP = -P z d(1/z).
    gain = (ends @ (step / value)) * ends[:, 2] * [1, -1]
    variance = gain @ picked.inverse_covariance @ gain
    random = gain @ picked.noise_covariance @ gain
    variance += scale_variance(surface.calibration, ends.mean(axis=0), step / value) * value**2
    return Length(value, float(np.sqrt(max(variance, 0))), float(np.sqrt(max(random, 0))), ends)
