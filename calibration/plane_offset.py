"""A constant error of the planes' distances, from the curvature of the depth laws.

z counts from the pinhole, which no ruler reaches. A spot's undistorted position is linear in 1/z;
where all z are off by the same amount it is not, and the bend shows along the epipolar lines. A
wrong scale of z leaves everything linear: planes cannot show it.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibration.lines import common_origin_sigma

__all__ = ["PlaneOffset", "corrected", "estimate_offset", "fit_each", "offset_by_lines"]

#: Fewer standard deviations than this are not corrected.
_SIGMAS = 3.0
_ROUNDS = 8
#: Distances from the law beyond so many standard deviations weigh less.
_HUBER = 3.0


@dataclass(frozen=True)
class PlaneOffset:
    """What has to be added to every distance of planes.csv.

    Parameters
    ----------
    mm, sigma_mm : :class:`float`
        The estimate and its standard deviation.
    """

    mm: float
    sigma_mm: float

    @property
    def correction_mm(self):
        """The estimate, or zero if it is too uncertain to be used."""
        return self.mm if abs(self.mm) > _SIGMAS * self.sigma_mm else 0.0


def corrected(observations, offset_mm):
    """Observations at distances that are greater by an offset."""
    return replace(observations, inverse_z=1 / (1 / observations.inverse_z + offset_mm))


def fit_each(beam, count, weight, w, values):
    """A weighted straight line over w through the values of each beam.

    Returns
    -------
    error : array (n,)
        Values less their line.
    start, slope : arrays (count,)
        The lines.
    """
    def total(some):
        return np.bincount(beam, weight * some, count)

    one = np.maximum(total(np.ones_like(w)), 1e-12)
    mean, middle = total(w) / one, total(values) / one
    centred, rest = w - mean[beam], values - middle[beam]
    slope = total(centred * rest) / np.maximum(total(centred**2), 1e-30)
    return rest - slope[beam] * centred, middle - slope * mean, slope


def estimate_offset(observations):
    """The offset of the distances, by robust Gauss-Newton steps with every beam on its own.

    The standard deviation is the largest one of three: from the noise of the spots, from how much
    the beams disagree, which contains what the lens model leaves, and from how much the planes do,
    which contains the errors of their distances.

    Parameters
    ----------
    observations : :class:`calibration.lines.Observations`
        Of usable beams.

    Returns
    -------
    :class:`PlaneOffset`
    """
    z, beam, count = 1 / observations.inverse_z, observations.beam, observations.beams
    weight, offset, nearest = np.ones(len(z)), 0.0, z.min()
    for _ in range(_ROUNDS):
        w = 1 / (z + offset)
        bend, _, _ = fit_each(beam, count, weight, w, -w * w)
        error_x, _, by_x = fit_each(beam, count, weight, w, observations.x)
        error_y, _, by_y = fit_each(beam, count, weight, w, observations.y)
        by_x, by_y = by_x[beam] * bend, by_y[beam] * bend
        score = weight * (by_x * error_x + by_y * error_y)
        information = max(np.sum(weight * (by_x**2 + by_y**2)), 1e-30)
        # Half of the nearest distance is left at the least: 1/z must stay finite.
        offset = max(offset + float(score.sum() / information), -0.5 * nearest)
        distance = np.hypot(error_x, error_y)
        sigma = max(float(np.median(distance)) / 1.1774, 1e-4)
        weight = np.minimum(1, _HUBER * sigma / np.maximum(distance, 1e-12))
    sigma *= np.sqrt(len(z) / max(len(z) - 2 * count, 1))
    planes = len(np.unique(observations.plane))
    by_beam = np.sum(np.bincount(beam, score) ** 2)
    # Two unknowns of each beam and the offset follow the planes' own errors.
    by_plane = np.sum(np.bincount(observations.plane, score) ** 2) * planes / max(planes - 3, 1)
    variance = max(sigma**2 * information, by_beam, by_plane)
    return PlaneOffset(offset, float(np.sqrt(variance) / information))


def offset_by_lines(observations):
    """As :func:`estimate_offset`, with a standard deviation that allows for a wrong lens.

    It grows by the factor by which lines through one origin miss the spots more than free lines.
    """
    offset = estimate_offset(observations)
    common, free = common_origin_sigma(corrected(observations, offset.mm))
    return replace(offset, sigma_mm=offset.sigma_mm * max(1.0, common / max(free, 1e-6)))
