"""The size of a polyp whose rim somebody marked in the picture."""

from dataclasses import dataclass

import numpy as np

from model.errors import UserError
from scripts.measure.ellipse import fit_rim
from scripts.measure.scale import scale_variance
from scripts.measure.wall import LEAST, fit_wall

__all__ = ["CLASSES", "Polyp", "circle", "polyp", "size_class"]

#: Names of the size classes, and the diameter below which each ends, in whole millimetres.
CLASSES = (("<= 5 mm", 6), ("6-9 mm", 10), ("10-19 mm", 20), (">= 20 mm", np.inf))
#: How well a hand marks a point of a rim, in px.
HAND_PX = 0.7
#: The wall begins and ends at these radii of the rim; it reaches farther where beams are few.
_BEGIN, _END, _FARTHEST = 1.25, 2.2, 4.0
#: What is expected of the rim's height over the wall, and of the polyp's over its rim, before
#: anything is measured, as parts of the diameter: mean and standard deviation.
_RIM, _DOME = (0.0, 0.15), (0.4, 0.3)
#: How far a polyp is from the half of an ellipsoid, as a part of the diameter.
_SHAPE = 0.04
_CIRCLE_POINTS = 24


@dataclass(frozen=True)
class Polyp:
    """Size of a polyp in millimetres.

    Parameters
    ----------
    diameter, diameter_uncertainty : :class:`float`
        Longest diameter of the rim, and its standard deviation.
    height, height_uncertainty : :class:`float`
        Of the top over the wall; NaN if no beam hits the polyp.
    random : :class:`float`
        The part of the diameter's standard deviation that differs from frame to frame.
    ends : array (2, 3)
        Ends of the longest diameter.
    rim : array (n, 3)
        The rim.
    beams : :class:`int`
        Measured points on the polyp.
    """

    diameter: float
    diameter_uncertainty: float
    height: float
    height_uncertainty: float
    random: float
    ends: np.ndarray
    rim: np.ndarray
    beams: int


def size_class(diameter):
    """Name of the size class of a diameter in mm, which is rounded to whole millimetres."""
    whole = np.floor(diameter + 0.5)
    return next(name for name, end in CLASSES if whole < end)


def circle(u, v, radius):
    """Points (n, 2) of a circle in the picture."""
    angle = np.arange(_CIRCLE_POINTS) * 2 * np.pi / _CIRCLE_POINTS
    return np.array([u, v]) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _ring(surface, rim):
    """Which points are the wall around a rim in the rays' plane."""
    radius = rim.radius(surface.ray)
    outside = radius > _BEGIN
    end = _END
    if np.count_nonzero(outside & (radius <= end)) < 2 * LEAST:
        ordered = np.sort(radius[outside])
        end = min(_FARTHEST, ordered[min(2 * LEAST, len(ordered)) - 1]) if len(ordered) else end
    return outside & (radius <= end)


class _Standing:
    """A rim that lies in a plane over the wall, parallel to it."""

    def __init__(self, wall, rays, centre):
        self._rays = np.column_stack([rays, np.ones(len(rays))])
        self._on_wall = wall.points(rays)
        self.foot = wall.points(centre[None])[0]
        self.normal = wall.normal(centre)
        helper = np.eye(3)[np.argmin(np.abs(self.normal))]
        first = np.cross(helper, self.normal)
        first /= np.linalg.norm(first)
        self._plane = np.stack([first, np.cross(self.normal, first)])

    def rim(self, height):
        """Points (n, 3) of the rim, so high over the wall."""
        rise = height / (self._rays @ self.normal)
        return self._on_wall + self._rays * rise[:, None]

    def flat(self, xyz):
        """Coordinates (n, 2) along the wall."""
        return (xyz - self.foot) @ self._plane.T

    def raised(self, flat, height):
        """Points (n, 3) from coordinates along the wall."""
        return self.foot + flat @ self._plane + height * self.normal


def _profile(standing, wall, surface, inside, ellipse, diameter):
    """Heights of rim, and of the dome over it: mean (2,) and covariance (2, 2).

    The polyp is half an ellipsoid on its rim, or nearly so; what is expected before counts as much
    as its uncertainty says.
    """
    prior = np.array([_RIM, _DOME]) * diameter
    weight = np.diag(1 / prior[:, 1]**2)
    right = weight @ prior[:, 0]
    if inside.any():
        xyz = surface.xyz[inside]
        height = ((xyz - wall.points(surface.ray[inside])) @ standing.normal)
        radius = np.minimum(ellipse.radius(standing.flat(xyz)), 1)
        terms = np.column_stack([np.ones(len(xyz)), np.sqrt(1 - radius**2)])
        noise, own = surface.inverse_variance()
        sigma = np.sqrt((noise + own)[inside]) * xyz[:, 2]**2
        variance = sigma**2 + (_SHAPE * diameter)**2
        weight = weight + (terms.T / variance) @ terms
        right = right + terms.T @ (height / variance)
    covariance = np.linalg.inv(weight)
    found = covariance @ right
    if found[0] < 0:  # a rim is not in the wall
        dome = right[1] / weight[1, 1]
        found = np.array([0.0, dome])
    return found, covariance


def polyp(surface, image):
    """Longest diameter and height of the polyp with this rim.

    The wall around it is fitted, and the rim is seen against it; how high the rim stands over the
    wall follows from the points on the polyp. The uncertainty (68 %) has the noise of the spots,
    the fit of the wall, the shape of the polyp, the hand that marked the rim, and the calibration.

    Parameters
    ----------
    surface : :class:`scripts.measure.surface.Surface`
        Of a frame.
    image : array (n, 2)
        Points of the rim in the picture in px, three at least.

    Raises
    ------
    UserError
        If these are too few, or on a line, or if too little of the wall was measured.
    """
    image = np.asarray(image, float).reshape(-1, 2)
    if len(image) < 3:
        raise UserError(f"A rim needs three points or more, not {len(image)}.")
    rays = surface.rays(image)
    if not np.isfinite(rays).all():
        raise UserError("A point of the rim is outside of the lens's usable region.")
    spread = np.linalg.svd(rays - rays.mean(axis=0), compute_uv=False)
    if spread[1] < 0.05 * max(spread[0], 1e-9):
        raise UserError("The points of the rim are on a line: mark it all around.")
    seen = fit_rim(rays)
    ring = _ring(surface, seen)
    noise, own = surface.inverse_variance()
    wall = fit_wall(surface.ray[ring], surface.inverse[ring], np.sqrt(noise + own)[ring],
                    seen.centre)
    standing = _Standing(wall, rays, seen.centre)
    inside = seen.radius(surface.ray) < 1
    height, found = 0.0, np.zeros(2)
    for _ in range(4):
        ellipse = fit_rim(standing.flat(standing.rim(height)))
        found, covariance = _profile(standing, wall, surface, inside, ellipse, ellipse.longest)
        height = found[0]
    ellipse = fit_rim(standing.flat(standing.rim(height)))
    diameter, place = ellipse.longest, standing.raised(ellipse.centre[None], height)[0]
    depth = wall.depth_sigma(seen.centre)
    scale = (depth**2 + covariance[0, 0]) / place[2]**2
    hand = max(ellipse.misfit, HAND_PX * place[2] / surface.calibration.lens.focal)
    # Each of the two half axes is that of a circle and of its second harmonic.
    marked = 4 * 3 * hand**2 / len(rays)
    along = ellipse.axes[0] / np.linalg.norm(ellipse.axes[0])
    ends = standing.raised(ellipse.centre + np.outer([-1, 1], ellipse.axes[0]), height)
    direction = standing.raised(along[None], 0)[0] - standing.foot
    scale += scale_variance(surface.calibration, place, direction)
    share = float(np.mean(noise / (noise + own)))
    top = float(found.sum())
    top_sigma = float(np.sqrt(covariance.sum() + depth**2))
    hit = int(np.count_nonzero(inside))
    return Polyp(
        diameter, float(np.sqrt(scale * diameter**2 + marked)),
        top if hit else np.nan, top_sigma if hit else np.nan,
        float(np.sqrt(share) * depth / place[2] * diameter), ends, standing.rim(height), hit)
