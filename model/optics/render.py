"""Frames as the sensor delivers them, with the truth of every beam."""

import cv2
import numpy as np
from scipy.special import erf

from . import scenes
from .rigs import Rig

#: One row per beam: the place of the spot's axis in the image (distorted pixels) and in space (mm),
#: NaN where the beam meets nothing; whether the camera sees it; whether it counts (seen, within the
#: image by the rig's margin, within the rig's range); its peak in levels and its standard deviation
#: in pixels along the ellipse's axes.
TRUTH = np.dtype([
    ("beam", "i4"), ("u_px", "f8"), ("v_px", "f8"), ("x_mm", "f8"), ("y_mm", "f8"),
    ("z_mm", "f8"), ("seen", "?"), ("inside", "?"), ("peak", "f8"),
    ("sigma_major_px", "f8"), ("sigma_minor_px", "f8"),
])

# Gauss-Legendre nodes and weights on -1/2 .. 1/2.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_NODES, _WEIGHTS = _NODES / 2, _WEIGHTS / 2


def spots(rig: Rig, scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the beams fall and what they look like.

    Returns
    -------
    truth : :class:`numpy.ndarray` of `TRUTH`, (beams,)
    covariance : :class:`numpy.ndarray`, (beams, 2, 2)
        Of the spots in the image, in square pixels.
    light : :class:`numpy.ndarray`, (beams,)
        Sum over the spot, in levels.
    """
    camera, projector, look = rig.camera, rig.projector, rig.spots
    truth = np.zeros(projector.beams, dtype=TRUTH)
    truth["beam"] = np.arange(projector.beams)
    for name in ("u_px", "v_px", "x_mm", "y_mm", "z_mm"):
        truth[name] = np.nan
    covariance = np.tile(np.eye(2), (projector.beams, 1, 1))
    light = np.zeros(projector.beams)

    base, directions = np.asarray(projector.base_mm, dtype=float), projector.directions()
    longest, step = 2.5 * rig.range_mm[1], 0.4 * rig.scale
    distance = scenes.cast(scene, base, directions, longest, step)
    hit = np.flatnonzero(~np.isnan(distance))
    points = base + directions[hit] * distance[hit, None]
    hit, points = hit[points[:, 2] > 0], points[points[:, 2] > 0]
    if not len(hit):
        return truth, covariance, light
    image = camera.project(points)
    for name, values in zip(
        ("u_px", "v_px", "x_mm", "y_mm", "z_mm"), (*image.T, *points.T), strict=True
    ):
        truth[name][hit] = values

    # A spot is seen if the camera's own ray to it meets nothing before it.
    away = np.linalg.norm(points, axis=1)
    normal = scenes.normals(scene, points, 1e-4 * rig.scale)
    cosine = -(normal * points).sum(axis=1) / away
    first = scenes.cast(scene, np.zeros(3), points / away[:, None], longest, step)
    seen = (cosine > 0) & (np.abs(first - away) < 1e-3 * rig.scale)
    truth["seen"][hit] = seen

    # The footprint: move the beam sideways by a little, see where it meets the tangent plane.
    beam = directions[hit]
    side = np.cross(beam, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    little = 1e-4 * rig.scale
    columns = []
    for sideways in (side, np.cross(beam, side)):
        slip = (normal * sideways).sum(axis=1) / (normal * beam).sum(axis=1)
        slip = np.clip(slip, -20, 20)
        move = little * (sideways - beam * slip[:, None])
        columns.append((camera.project(points + move) - camera.project(points - move)) / 2 / little)
    jacobian = np.stack(columns, axis=-1)
    sigma_mm = np.hypot(look.waist_mm, look.divergence_mrad * 1e-3 * distance[hit])
    footprint = jacobian @ jacobian.transpose(0, 2, 1) * (sigma_mm**2)[:, None, None]
    covariance[hit] = footprint + np.eye(2) * look.blur_px**2

    # Exposure, in two steps: as if in the middle of the range, then within its span.
    received = np.maximum(cosine, look.least_cosine) / away**2
    area = 2 * np.pi * np.sqrt(np.linalg.det(covariance[hit]))
    brightest = received / area
    sigma = rig.camera.focal_px * np.hypot(
        look.waist_mm / rig.middle_mm, look.divergence_mrad * 1e-3
    )
    middle = 1 / rig.middle_mm**2 / (2 * np.pi * (sigma**2 + look.blur_px**2))
    wanted = np.quantile(brightest[seen], 0.9) if seen.any() else middle
    exposure = look.peak / np.clip(
        wanted, middle / look.exposure_span, middle * look.exposure_span
    )
    light[hit] = np.where(seen, received * exposure, 0)
    truth["peak"][hit] = np.where(seen, brightest * exposure, 0)
    axes = np.sqrt(np.linalg.eigvalsh(covariance))
    truth["sigma_minor_px"], truth["sigma_major_px"] = axes[:, 0], axes[:, 1]
    low, high = rig.range_mm
    truth["inside"] = truth["seen"] & (truth["z_mm"] >= low) & (truth["z_mm"] <= high)
    truth["inside"][hit] &= camera.inside(image, rig.margin_px)
    return truth, covariance, light


def draw_spots(
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


def background(rig: Rig, rng: np.random.Generator) -> np.ndarray:
    """What the sensor sees of the tissue without laser: levels, float64."""
    camera, noise = rig.camera, rig.noise
    shape = camera.height, camera.width
    coarse = rng.normal(size=(7, 9))
    smooth = cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)
    smooth += 0.5 * cv2.resize(
        rng.normal(size=(28, 36)), shape[::-1], interpolation=cv2.INTER_CUBIC
    )
    smooth /= max(smooth.std(), 1e-9)
    return np.maximum(noise.background * vignette(rig) * (1 + noise.texture * smooth), 0)


def vignette(rig: Rig) -> np.ndarray:
    """Part of the light that reaches each pixel: 1 at the principal point, least in a corner."""
    camera = rig.camera
    u, v = camera.principal_px
    square = (np.arange(camera.width) - u) ** 2 + (np.arange(camera.height)[:, None] - v) ** 2
    return 1 - rig.noise.vignetting * square / square.max()


def expose(rig: Rig, levels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Shot noise, read noise, saturation and 8 bits."""
    noise = rig.noise
    if noise.electrons > 0:
        levels = rng.poisson(np.maximum(levels, 0) * noise.electrons) / noise.electrons
    levels = levels + rng.normal(scale=noise.read, size=levels.shape) if noise.read else levels
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def pattern_levels(rig: Rig, scene) -> tuple[np.ndarray, np.ndarray]:
    """Laser spots alone, in levels (float64, without noise or limit), and the truth."""
    truth, covariance, light = spots(rig, scene)
    centres = np.stack([truth["u_px"], truth["v_px"]], axis=-1)
    shape = rig.camera.height, rig.camera.width
    return draw_spots(shape, centres, covariance, light), truth


def pattern_frame(
    rig: Rig, scene, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A pattern frame (uint8, height x width) and its truth (`TRUTH`, one row per beam)."""
    levels, truth = pattern_levels(rig, scene)
    return expose(rig, levels + background(rig, rng), rng), truth
