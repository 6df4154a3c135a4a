"""Epipolar lines and depth laws of the beams, by robust regression over the planes.

The spot of a straight beam, seen by a pinhole camera, moves along a straight line as the plane
recedes, and its undistorted position is linear in w = 1/z: x = p + q w, y = r + s w. The centres
are noisy and the distances are not, so x and y are regressed on w, and the chip's forms follow
from the result:

    v = a u + b          a = s / q     b = r - a p
    1/z = alpha u + beta alpha = 1 / q beta = -p / q

All beams leave one point, which ties the slopes to the vanishing points: q = A - C p, s = B - C r
with A, B and C common to all beams. How strongly the fit is tied to that (fully, a little, not at
all) is chosen by cross-validation: each plane is predicted from the others, and the strength with
the smallest error is used.
"""

from dataclasses import dataclass, field

import numpy as np

from model.errors import UserError

__all__ = ["BeamLines", "Observations", "common_origin_sigma", "fit_lines"]

_HUBER = 1.5
_OUTLIER = 6.0
_STRENGTHS = (0.0, 0.3, 1.0, 3.0, 10.0, np.inf)


@dataclass(frozen=True)
class Observations:
    """Assigned spots of all planes, one row each: beam, plane, 1/z, undistorted position.

    ``numbers`` are the beams' numbers in the mesh; ``beam`` is an index into them.
    """

    numbers: np.ndarray
    beam: np.ndarray
    plane: np.ndarray
    inverse_z: np.ndarray
    x: np.ndarray
    y: np.ndarray

    @classmethod
    def of(cls, planes, identity, lens):
        """Gather from :class:`calibration.identity.PlaneSpots` and :class:`Identity`."""
        beam, plane, inverse_z, x, y = [], [], [], [], []
        distances = sorted({spots.z_mm for spots in planes})
        for spots, numbered in zip(planes, identity.beams, strict=True):
            used = (numbered >= 0) & np.isfinite(spots.x)
            beam.append(numbered[used])
            plane.append(np.full(used.sum(), distances.index(spots.z_mm)))
            inverse_z.append(np.full(used.sum(), 1 / spots.z_mm))
            x.append(spots.x[used] - lens.principal_x)
            y.append(spots.y[used] - lens.principal_y)
        return cls(np.arange(identity.projector.beams),
                   *(np.concatenate(part) for part in (beam, plane, inverse_z, x, y)))

    @property
    def beams(self):
        """Number of beams."""
        return len(self.numbers)

    def planes_of(self, beam):
        """Number of distances at which a beam was found."""
        return len(np.unique(self.plane[self.beam == beam]))

    def rows(self, kept):
        """Some of the spots, given by a flag each."""
        return Observations(self.numbers, self.beam[kept], self.plane[kept], self.inverse_z[kept],
                            self.x[kept], self.y[kept])

    def only(self, kept):
        """The observations of some of the beams, given by a flag each."""
        row = kept[self.beam]
        return Observations(
            self.numbers[kept], (np.cumsum(kept) - 1)[self.beam[row]], self.plane[row],
            self.inverse_z[row], self.x[row], self.y[row])


@dataclass(frozen=True)
class BeamLines:
    """Per beam, in undistorted pixels about the image centre and 1/mm.

    Parameters
    ----------
    numbers : array of :class:`int`
        The beams' numbers in the mesh, rising; beams that were left out have no line.
    a, b, alpha, beta : arrays of :class:`float`
        v = a u + b and 1/z = alpha u + beta.
    residual_u, residual_v : arrays of :class:`float`
        RMS distance of the spots used from the law, along the columns and along the rows, px.
    planes : array of :class:`int`
        Distances at which the beam was used.
    rms_px : :class:`float`
        RMS of residual_v over all spots: how straight the lines are.
    sigma_u, sigma_v : :class:`float`
        Robust standard deviations over all spots.
    held_out_px : :class:`dict`
        RMS error of a plane predicted from the others, for each strength of the common origin.
    strength : :class:`float`
        The strength used; 0 is every beam on its own, inf is one origin exactly.
    outliers : :class:`int`
        Spots left out.
    """

    numbers: np.ndarray = field(repr=False)
    a: np.ndarray
    b: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray
    residual_u: np.ndarray = field(repr=False)
    residual_v: np.ndarray = field(repr=False)
    planes: np.ndarray = field(repr=False)
    rms_px: float
    sigma_u: float
    sigma_v: float
    held_out_px: dict = field(repr=False)
    strength: float
    outliers: int

    def column_at(self, z_mm):
        """Undistorted column of every beam at distance z."""
        return (1 / z_mm - self.beta) / self.alpha


def _common(data, weight):
    """Least squares with one origin: A, B, C and the vanishing points p, r of every beam.

    Gauss-Newton on the bilinear model; the beams' own unknowns are eliminated first, each with a
    single division, which leaves a 3 x 3 system.
    """
    w, beams = data.inverse_z, data.beams

    def total(values):
        return np.bincount(data.beam, values, beams)

    origin = np.zeros(3)
    p, r = (total(weight * axis) / np.maximum(total(weight), 1e-12) for axis in (data.x, data.y))
    for step in range(12):
        A, B, C = origin
        shrink = 1 - C * w
        error_x = data.x - (p[data.beam] * shrink + A * w)
        error_y = data.y - (r[data.beam] * shrink + B * w)
        own = np.maximum(total(weight * shrink**2), 1e-12)
        # Derivatives by (A, B, C) of x and y.
        by_x = np.stack([w, 0 * w, -p[data.beam] * w])
        by_y = np.stack([0 * w, w, -r[data.beam] * w])
        if step == 0:       # C is started from zero: without it the problem is linear
            by_x[2] = by_y[2] = 0
        normal, right = np.eye(3) * 1e-18, np.zeros(3)
        cross_x = np.stack([total(weight * shrink * row) for row in by_x])
        cross_y = np.stack([total(weight * shrink * row) for row in by_y])
        own_x, own_y = total(weight * shrink * error_x), total(weight * shrink * error_y)
        for by, cross, rest, error in ((by_x, cross_x, own_x, error_x),
                                       (by_y, cross_y, own_y, error_y)):
            normal += (by * weight) @ by.T - (cross / own) @ cross.T
            right += by @ (weight * error) - cross @ (rest / own)
        if step == 0:
            normal[2, 2] += 1
        change = np.linalg.solve(normal, right)
        p += (own_x - change @ cross_x) / own
        r += (own_y - change @ cross_y) / own
        origin = origin + change
        if step and np.all(np.abs(change) < 1e-9 * (1 + np.abs(origin))):
            break
    return origin, p, r


def _solve(data, weight, strength):
    """p, q, r, s of every beam. ``strength`` weighs the slopes of the common origin as a prior.

    At a strength of 1 the prior is as wide as the uncertainty that a beam's own spots leave, on
    average over the beams; 0 is without prior, inf is the common origin exactly.
    """
    w, beams = data.inverse_z, data.beams

    def total(values):
        return np.bincount(data.beam, values, beams)

    if strength:
        (A, B, C), p, r = _common(data, weight)
        q, s = A - C * p, B - C * r
        if np.isinf(strength):
            return p, q, r, s
    else:
        q = s = np.zeros(beams)
    one = np.maximum(total(weight), 1e-12)
    mean = total(weight * w) / one
    spread = total(weight * (w - mean[data.beam]) ** 2)
    prior = strength * np.median(spread[spread > 0])
    result = []
    for position, slope in ((data.x, q), (data.y, s)):
        middle = total(weight * position) / one
        joint = total(weight * (w - mean[data.beam]) * (position - middle[data.beam]))
        slope = (joint + prior * slope) / np.maximum(spread + prior, 1e-30)
        result += [middle - slope * mean, slope]
    return tuple(result)


def _errors(data, solution):
    """Distances of all spots from the model along x and y, px."""
    p, q, r, s = solution
    return (data.x - p[data.beam] - q[data.beam] * data.inverse_z,
            data.y - r[data.beam] - s[data.beam] * data.inverse_z)


def _robust(data, strength, passes=24):
    """Iteratively reweighted least squares: Huber's weights, outliers left out.

    All planes weigh the same. To estimate each plane's noise from its residuals would favour the
    nearest and the farthest: there the fit follows the spots most, so that they look exact.
    """
    weight = np.ones(len(data.x))
    for step in range(passes):
        solution = _solve(data, weight, strength)
        distance = np.hypot(*_errors(data, solution))
        # The median of a Rayleigh distribution is 1.1774 sigma.
        sigma = max(np.median(distance) / 1.1774, 1e-4)
        # Nothing is left out before Huber's weights have settled: next to a large outlier the
        # first fit is wrong for the beam's good spots too.
        reach = max(_OUTLIER * sigma, 0.05) if step >= passes // 2 else np.inf
        keep = distance <= reach
        huber = np.minimum(1, _HUBER * 1.1774 * sigma / np.maximum(distance, 1e-12))
        weight = np.where(keep, huber, 1e-9)
    return solution, weight, keep


def common_origin_sigma(observations):
    """Robust residuals, px: of lines through one origin exactly, and of every line on its own."""
    result = []
    for strength, spent in ((np.inf, 1), (0.0, 2)):
        solution, _, _ = _robust(observations, strength)
        rows = len(observations.x)
        freedom = np.sqrt(rows / max(rows - spent * observations.beams, 1))
        distance = np.hypot(*_errors(observations, solution))
        result.append(float(freedom * np.median(distance) / 1.1774))
    return tuple(result)


def _held_out(data, weight, keep, strength):
    """RMS over planes of the columns' error (what makes depth) with that plane left out."""
    squares, count = 0.0, 0
    for plane in np.unique(data.plane):
        out = data.plane == plane
        solution = _solve(data, np.where(out, 1e-12, weight), strength)
        error = _errors(data, solution)[0][out & keep]
        squares, count = squares + np.sum(error**2), count + len(error)
    return float(np.sqrt(squares / max(count, 1)))


def fit_lines(observations, lens):
    """Lines and depth laws of every beam.

    Parameters
    ----------
    observations : :class:`Observations`
        Assigned spots of the beams that :func:`calibration.usable.usable_beams` leaves.
    lens : :class:`calibration.lens.Lens`
        The lens that undistorted them.

    Returns
    -------
    :class:`BeamLines`
    """
    data = observations
    _, weight, keep = _robust(data, 0.0)
    held_out = {strength: _held_out(data, weight, keep, strength) for strength in _STRENGTHS}
    strength = min(held_out, key=held_out.get)
    solution, weight, keep = _robust(data, strength)
    p, q, r, s = solution
    if np.any(np.abs(q) < 1e-9) or np.any(np.abs(s) >= np.abs(q)):
        raise UserError(
            "The spots move along the columns of the picture as the planes recede: the projector "
            "must stand beside the camera along the rows of the sensor.")
    error_x, error_y = _errors(data, solution)
    a = s / q
    # Distance from the line is what the chip compares; it contains the column's error too.
    off = error_y - a[data.beam] * error_x
    p, r = p + lens.principal_x, r + lens.principal_y

    def each(values):
        count = np.maximum(np.bincount(data.beam[keep], minlength=data.beams), 1)
        return np.sqrt(np.bincount(data.beam[keep], values[keep] ** 2, data.beams) / count)

    planes = np.array([len(np.unique(data.plane[keep & (data.beam == beam)]))
                       for beam in range(data.beams)])
    # A beam's spots spend two unknowns on each of the fits.
    freedom = np.sqrt(keep.sum() / max(keep.sum() - 2 * data.beams, 1))
    return BeamLines(
        numbers=data.numbers, a=a, b=r - a * p, alpha=1 / q, beta=-p / q,
        residual_u=each(error_x), residual_v=each(off),
        planes=planes, rms_px=float(np.sqrt(np.mean(off[keep] ** 2))),
        sigma_u=float(freedom * 1.4826 * np.median(np.abs(error_x[keep]))),
        sigma_v=float(freedom * 1.4826 * np.median(np.abs(off[keep]))),
        held_out_px=held_out, strength=float(strength), outliers=int((~keep).sum()))
