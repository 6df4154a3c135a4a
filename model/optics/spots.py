"""Spots of the laser beams: their true positions, their shape, and their light on the sensor."""

import numpy as np
from scipy.special import erf

from . import scenes
from .rigs import Rig

__all__ = ["TRUTH", "draw", "pattern_levels", "trace", "trace_rays"]

#: One row per beam: the position of the spot's axis in the image (distorted pixels) and in space
#: (mm), NaN where the beam meets nothing; whether it is visible to the camera; whether it counts
#: (visible, within the image by the rig's margin, within the rig's range); its peak in levels and
#: its standard deviation in pixels along the ellipse's axes; the factor on its light, 0 for a dead
#: beam, which has no position.
TRUTH = np.dtype([
    ("beam", "i4"), ("u_px", "f8"), ("v_px", "f8"), ("x_mm", "f8"), ("y_mm", "f8"),
    ("z_mm", "f8"), ("visible", "?"), ("inside", "?"), ("peak", "f8"),
    ("sigma_major_px", "f8"), ("sigma_minor_px", "f8"), ("light", "f8"),
])
_PLACE = ("u_px", "v_px", "x_mm", "y_mm", "z_mm")


# Gauss-Legendre nodes and weights on -1/2 .. 1/2.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_NODES, _WEIGHTS = _NODES / 2, _WEIGHTS / 2


def _shine(rig: Rig, scene, points: np.ndarray, beam: np.ndarray, sigma_mm: np.ndarray):
    """The spots of rays of direction `beam` that end at `points` (n, 3).

    Returns whether each is visible, the covariance of its spot in the image, with the lens's
    blur, and the light that the camera receives, in arbitrary units.
    """
    camera, look = rig.camera, rig.spots
    # A point is visible if the camera's own ray to it meets nothing before it.
    away = np.linalg.norm(points, axis=1)
    normal = scenes.normals(scene, points, 1e-4 * rig.scale)
    cosine = -(normal * points).sum(axis=1) / away
    first = scenes.cast(scene, np.zeros(3), points / away[:, None], *_reach(rig))
    visible = (cosine > 0) & (np.abs(first - away) < 1e-3 * rig.scale)

    # The footprint: shift the beam sideways a little and intersect it with the tangent plane.
    side, other = _across(beam)
    little = 1e-4 * rig.scale
    columns = []
    for sideways in (side, other):
        slip = (normal * sideways).sum(axis=1) / (normal * beam).sum(axis=1)
        move = little * (sideways - beam * np.clip(slip, -20, 20)[:, None])
        columns.append((camera.project(points + move) - camera.project(points - move)) / 2 / little)
    jacobian = np.stack(columns, axis=-1)
    footprint = jacobian @ jacobian.transpose(0, 2, 1) * (sigma_mm**2)[:, None, None]
    covariance = footprint + np.eye(2) * look.blur_px**2
    return visible, covariance, np.maximum(cosine, look.least_cosine) / away**2


def _reach(rig: Rig) -> tuple[float, float]:
    """Length of the rays that are traced, and their step, mm."""
    return 2.5 * rig.range_mm[1], 0.4 * rig.scale


def _across(beam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across each beam (n, 3)."""
    side = np.cross(beam, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return side, np.cross(beam, side)


def _sigma_mm(rig: Rig, distance: np.ndarray) -> np.ndarray:
    """Standard deviation of a beam across itself, at a distance from the projector."""
    return np.hypot(rig.spots.waist_mm, rig.spots.divergence_mrad * 1e-3 * distance)


def _spots(rig: Rig, scene, share):
    """As `trace`, and the exposure: levels per unit of received light."""
    camera, projector, look = rig.camera, rig.projector, rig.spots
    truth = np.zeros(projector.beams, dtype=TRUTH)
    truth["beam"] = np.arange(projector.beams)
    truth["light"] = share
    for name in _PLACE:
        truth[name] = np.nan
    covariance = np.tile(np.eye(2), (projector.beams, 1, 1))
    light = np.zeros(projector.beams)

    base, directions = np.asarray(projector.base_mm, dtype=float), projector.directions()
    distance = scenes.cast(scene, base, directions, *_reach(rig))
    points = base + directions * distance[:, None]
    hit = np.flatnonzero(points[:, 2] > 0)
    # The reference: a plane square to the axis, in the middle of the range.
    sigma = camera.focal_px * _sigma_mm(rig, rig.middle_mm) / rig.middle_mm
    middle = 1 / rig.middle_mm**2 / (2 * np.pi * (sigma**2 + look.blur_px**2))
    if not len(hit):
        return truth, covariance, light, look.peak / middle
    points = points[hit]
    image = camera.project(points)
    for name, values in zip(_PLACE, (*image.T, *points.T), strict=True):
        truth[name][hit] = values
    visible, covariance[hit], received = _shine(
        rig, scene, points, directions[hit], _sigma_mm(rig, distance[hit]))
    truth["visible"][hit] = visible

    # The exposure follows the scene, within its span.
    brightest = received / (2 * np.pi * np.sqrt(np.linalg.det(covariance[hit])))
    wanted = np.quantile(brightest[visible], 0.9) if visible.any() else middle
    exposure = look.peak / np.clip(
        wanted, middle / look.exposure_span, middle * look.exposure_span
    )
    light[hit] = np.where(visible, received * exposure, 0)
    truth["peak"][hit] = np.where(visible, brightest * exposure, 0)
    axes = np.sqrt(np.linalg.eigvalsh(covariance))
    truth["sigma_minor_px"], truth["sigma_major_px"] = axes[:, 0], axes[:, 1]
    low, high = rig.range_mm
    truth["inside"] = truth["visible"] & (truth["z_mm"] >= low) & (truth["z_mm"] <= high)
    truth["inside"][hit] &= camera.inside(image, rig.margin_px)
    # The light of single beams does not change the exposure.
    light *= truth["light"]
    truth["peak"] *= truth["light"]
    dead = truth["light"] == 0
    for name in _PLACE:
        truth[name][dead] = np.nan
    truth["visible"][dead] = truth["inside"][dead] = False
    return truth, covariance, light, exposure


def trace(rig: Rig, scene, share=1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the beams fall, and their spots, each on the plane tangent to the surface there.

    Parameters
    ----------
    share : :class:`float` or array (beams,)
        Factor on the light of each beam; 0 is a dead one.

    Returns
    -------
    truth : :class:`numpy.ndarray` of `TRUTH`, (beams,)
    covariance : :class:`numpy.ndarray`, (beams, 2, 2)
        Of the spots in the image, in square pixels.
    light : :class:`numpy.ndarray`, (beams,)
        Sum over the spot, in levels.
    """
    return _spots(rig, scene, share)[:3]


#: Rays of a beam: their positions across it, in its standard deviations, and their shares of its
#: light. Each is a Gaussian itself, of half the beam's width; together they form the beam.
_GRID = np.stack(np.meshgrid(*2 * [np.linspace(-2.4, 2.4, 9)]), axis=-1).reshape(-1, 2)
_GRID = _GRID[(_GRID**2).sum(axis=1) < 2.5**2]
_SHARE = np.exp(-0.5 * (_GRID**2).sum(axis=1) / 0.75)
_SHARE /= _SHARE.sum()


def trace_rays(
    rig: Rig, scene, share=1.0
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The truth, and centres, covariances and light of the Gaussians to draw, several for a beam.

    Every beam is divided into rays that are traced separately: a spot on a curved surface is no
    longer an ellipse around its axis, and one across an edge falls into parts, as in reality.
    """
    truth, _, _, exposure = _spots(rig, scene, share)
    base, axes = np.asarray(rig.projector.base_mm, dtype=float), rig.projector.directions()
    hit = np.flatnonzero(np.isfinite(truth["z_mm"]))
    axis = np.stack([truth[name][hit] for name in ("x_mm", "y_mm", "z_mm")], axis=-1)
    sigma = _sigma_mm(rig, np.linalg.norm(axis - base, axis=1))[:, None, None]
    side, other = _across(axes[hit])
    ends = axis[:, None] + sigma * (
        _GRID[:, :1] * side[:, None] + _GRID[:, 1:] * other[:, None])
    rays = (ends - base).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    distance = scenes.cast(scene, base, rays, *_reach(rig))
    points = base + rays * distance[:, None]
    good = points[:, 2] > 0
    points, rays = points[good], rays[good]
    visible, covariance, received = _shine(
        rig, scene, points, rays, 0.5 * _sigma_mm(rig, distance[good]))
    light = np.outer(truth["light"][hit], _SHARE).ravel()[good] * received * exposure
    return truth, (rig.camera.project(points)[visible], covariance[visible], light[visible])


def draw(
    shape: tuple[int, int], centres: np.ndarray, covariance: np.ndarray, light: np.ndarray
) -> np.ndarray:
    """Image (float64, height x width) of elliptical Gaussians, each integrated over the pixels.

    Along u the integral is exact (erf of the Gaussian given v), along v by four Gauss-Legendre
    nodes; together good to better than 1e-4 of the peak for standard deviations from 0.7 px. Spots
    are cut off at six standard deviations and at the image's border.
    """
    height, width = shape
    image = np.zeros(shape)
    for (u, v), matrix, total in zip(centres, covariance, light, strict=True):
        if not total > 0:
            continue
        reach_u, reach_v = 6 * np.sqrt(np.diag(matrix)) + 1
        left, right = max(0, int(u - reach_u)), min(width, int(u + reach_u) + 2)
        top, bottom = max(0, int(v - reach_v)), min(height, int(v + reach_v) + 2)
        if left >= right or top >= bottom:
            continue
        rows = (np.arange(top, bottom)[:, None] + _NODES).ravel() - v
        density = np.exp(-0.5 * rows**2 / matrix[1, 1]) / np.sqrt(2 * np.pi * matrix[1, 1])
        sigma = np.sqrt(matrix[0, 0] - matrix[0, 1] ** 2 / matrix[1, 1])
        edges = np.arange(left, right + 1) - 0.5 - u
        edges = edges - (matrix[0, 1] / matrix[1, 1] * rows)[:, None]
        part = np.diff(erf(edges / (np.sqrt(2) * sigma)), axis=1) / 2
        part = (part * density[:, None]).reshape(bottom - top, len(_NODES), right - left)
        image[top:bottom, left:right] += total * np.einsum("vnu,n->vu", part, _WEIGHTS)
    return image


def pattern_levels(rig: Rig, scene, share=1.0) -> tuple[np.ndarray, np.ndarray]:
    """Laser spots alone, in levels (float64, without noise or limit), and the truth.

    `share` is the factor on the light of each beam, as in :func:`trace`.
    """
    if rig.spots.split:
        truth, gaussians = trace_rays(rig, scene, share)
    else:
        truth, covariance, light = trace(rig, scene, share)
        gaussians = np.stack([truth["u_px"], truth["v_px"]], axis=-1), covariance, light
    return draw((rig.camera.height, rig.camera.width), *gaussians), truth
