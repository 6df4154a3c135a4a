"""Frames as the sensor delivers them, with the truth of every beam."""

from dataclasses import dataclass
from functools import lru_cache

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


def _shine(rig: Rig, scene, points: np.ndarray, beam: np.ndarray, sigma_mm: np.ndarray):
    """What the camera gets of rays of direction `beam` that end at `points` (n, 3).

    Returns whether it sees each, the covariance of its spot in the image, with the lens's blur,
    and the light received, in units of its own.
    """
    camera, look = rig.camera, rig.spots
    # A point is seen if the camera's own ray to it meets nothing before it.
    away = np.linalg.norm(points, axis=1)
    normal = scenes.normals(scene, points, 1e-4 * rig.scale)
    cosine = -(normal * points).sum(axis=1) / away
    first = scenes.cast(scene, np.zeros(3), points / away[:, None], *_reach(rig))
    seen = (cosine > 0) & (np.abs(first - away) < 1e-3 * rig.scale)

    # The footprint: move the beam sideways by a little, see where it meets the tangent plane.
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
    return seen, covariance, np.maximum(cosine, look.least_cosine) / away**2


def _reach(rig: Rig) -> tuple[float, float]:
    """How far rays are followed, and in what steps."""
    return 2.5 * rig.range_mm[1], 0.4 * rig.scale


def _across(beam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across each beam (n, 3)."""
    side = np.cross(beam, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return side, np.cross(beam, side)


def _sigma_mm(rig: Rig, distance: np.ndarray) -> np.ndarray:
    """Standard deviation of a beam across itself, at a distance from the projector."""
    return np.hypot(rig.spots.waist_mm, rig.spots.divergence_mrad * 1e-3 * distance)


def _spots(rig: Rig, scene):
    """As `spots`, and the exposure: levels per unit of received light."""
    camera, projector, look = rig.camera, rig.projector, rig.spots
    truth = np.zeros(projector.beams, dtype=TRUTH)
    truth["beam"] = np.arange(projector.beams)
    for name in ("u_px", "v_px", "x_mm", "y_mm", "z_mm"):
        truth[name] = np.nan
    covariance = np.tile(np.eye(2), (projector.beams, 1, 1))
    light = np.zeros(projector.beams)

    base, directions = np.asarray(projector.base_mm, dtype=float), projector.directions()
    distance = scenes.cast(scene, base, directions, *_reach(rig))
    points = base + directions * distance[:, None]
    hit = np.flatnonzero(points[:, 2] > 0)
    # As if in the middle of the range, square to the axis.
    sigma = camera.focal_px * _sigma_mm(rig, rig.middle_mm) / rig.middle_mm
    middle = 1 / rig.middle_mm**2 / (2 * np.pi * (sigma**2 + look.blur_px**2))
    if not len(hit):
        return truth, covariance, light, look.peak / middle
    points = points[hit]
    image = camera.project(points)
    for name, values in zip(
        ("u_px", "v_px", "x_mm", "y_mm", "z_mm"), (*image.T, *points.T), strict=True
    ):
        truth[name][hit] = values
    seen, covariance[hit], received = _shine(
        rig, scene, points, directions[hit], _sigma_mm(rig, distance[hit]))
    truth["seen"][hit] = seen

    # The exposure suits the scene, within its span.
    brightest = received / (2 * np.pi * np.sqrt(np.linalg.det(covariance[hit])))
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
    return truth, covariance, light, exposure


def spots(rig: Rig, scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the beams fall and what they look like on the plane that touches the surface there.

    Returns
    -------
    truth : :class:`numpy.ndarray` of `TRUTH`, (beams,)
    covariance : :class:`numpy.ndarray`, (beams, 2, 2)
        Of the spots in the image, in square pixels.
    light : :class:`numpy.ndarray`, (beams,)
        Sum over the spot, in levels.
    """
    return _spots(rig, scene)[:3]


#: Rays of a beam: their places across it, in its standard deviations, and their shares of its
#: light. Each is a Gaussian itself, of half the beam's width; together they are the beam.
_GRID = np.stack(np.meshgrid(*2 * [np.linspace(-2.4, 2.4, 9)]), axis=-1).reshape(-1, 2)
_GRID = _GRID[(_GRID**2).sum(axis=1) < 2.5**2]
_SHARE = np.exp(-0.5 * (_GRID**2).sum(axis=1) / 0.75)
_SHARE /= _SHARE.sum()


def parts(
    rig: Rig, scene
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The truth, and the spots in parts: centres, covariances and light of Gaussians to draw.

    Every beam is cut into rays that each go their own way: a spot on a curved surface is no longer
    an ellipse around its axis, and one that straddles an edge falls apart, as in the world.
    """
    truth, _, _, exposure = _spots(rig, scene)
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
    seen, covariance, received = _shine(
        rig, scene, points, rays, 0.5 * _sigma_mm(rig, distance[good]))
    light = np.tile(_SHARE, len(hit))[good] * received * exposure
    return truth, (rig.camera.project(points)[seen], covariance[seen], light[seen])


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
    if rig.spots.split:
        truth, gaussians = parts(rig, scene)
    else:
        truth, covariance, light = spots(rig, scene)
        gaussians = np.stack([truth["u_px"], truth["v_px"]], axis=-1), covariance, light
    return draw_spots((rig.camera.height, rig.camera.width), *gaussians), truth


def pattern_frame(
    rig: Rig, scene, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A pattern frame (uint8, height x width) and its truth (`TRUTH`, one row per beam)."""
    levels, truth = pattern_levels(rig, scene)
    return expose(rig, levels + background(rig, rng), rng), truth


def surface(rig: Rig, scene) -> tuple[np.ndarray, np.ndarray]:
    """Where the rays of every second pixel in u and v meet the scene, by sphere tracing.

    For pictures, not for truth: good to about a thousandth of the distance.

    Returns
    -------
    points : :class:`numpy.ndarray`, (ceil(height / 2), ceil(width / 2), 3)
        Millimetres, NaN where the ray meets nothing.
    directions : :class:`numpy.ndarray`, of the same shape
        Unit vectors of the rays.
    """
    directions = _directions(rig.camera)
    rays = directions.reshape(-1, 3)
    distance = np.full(len(rays), 1e-3)
    active = np.arange(len(rays))
    close = 5e-4 * rig.middle_mm
    for _ in range(120):
        clearance = scene.clearance(rays[active] * distance[active, None])
        distance[active] += np.maximum(clearance, close / 4)
        active = active[(clearance > close) & (distance[active] < 4 * rig.range_mm[1])]
        if not len(active):
            break
    distance[distance >= 4 * rig.range_mm[1]] = np.nan
    return (rays * distance[:, None]).reshape(directions.shape), directions


def texture_levels(rig: Rig, scene, rng: np.random.Generator) -> np.ndarray:
    """What the sensor sees without laser, long exposed and lit from beside the camera.

    In levels (float64), without noise.
    """
    camera = rig.camera
    points, directions = surface(rig, scene)
    known = ~np.isnan(points[..., 0])
    normal = scenes.normals(scene, np.nan_to_num(points, nan=1.0), 0.05 * rig.scale)
    cosine = np.maximum(-(normal * directions).sum(axis=-1), 0)
    square = (points**2).sum(axis=-1) / rig.middle_mm**2
    # Tissue: blotches and thin dark vessels, fixed to the surface.
    waves = rng.normal(size=(6, 3)) / rig.scale * np.array([0.15, 0.2, 0.3, 0.4, 0.6, 0.8])[:, None]
    phase = rng.uniform(0, 2 * np.pi, 6)
    ripple = np.sin(points @ waves.T + phase)
    blotches = ripple.mean(axis=-1)
    vessels = np.exp(-((ripple[..., 0] + ripple[..., 2] + 0.6 * ripple[..., 4]) / 0.12) ** 2)
    bright = (0.15 + 0.85 * cosine) / square * (1 + 0.25 * blotches) * (1 - 0.35 * vessels)
    bright = np.where(known, bright, 0)
    bright *= 150 / max(np.quantile(bright, 0.9), 1e-9)
    bright = cv2.resize(bright, (2 * bright.shape[1], 2 * bright.shape[0]),
                        interpolation=cv2.INTER_LINEAR)[:camera.height, :camera.width]
    # Long exposures are gently limited, as an imager's knee does.
    return 250 * (1 - np.exp(-bright / 170)) * vignette(rig)


def texture_frame(rig: Rig, scene, rng: np.random.Generator) -> np.ndarray:
    """A texture frame (uint8, height x width)."""
    return expose(rig, texture_levels(rig, scene, rng), rng)


@lru_cache(maxsize=2)
def _rays(camera, fine: int) -> np.ndarray:
    """Normalised coordinates (float32) of fine x fine samples in each pixel."""
    v = (np.arange(camera.height * fine) + 0.5) / fine - 0.5
    u = (np.arange(camera.width * fine) + 0.5) / fine - 0.5
    return camera.normalise(np.stack(np.meshgrid(u, v), axis=-1)).astype(np.float32)


@lru_cache(maxsize=4)
def _directions(camera) -> np.ndarray:
    """Unit vectors of the rays between the pixels of each 2 x 2."""
    v, u = np.mgrid[0.5:camera.height:2, 0.5:camera.width:2]
    directions = camera.normalise(np.stack([u, v], axis=-1))
    directions = np.concatenate([directions, np.ones((*u.shape, 1))], axis=-1)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


@dataclass(frozen=True)
class BoardPose:
    """The board's first outer corner (mm, camera coordinates) and its directions (columns of a
    rotation matrix): along the columns' index, along the rows' index, away from the camera."""

    corner_mm: np.ndarray
    rotation: np.ndarray

    def points(self, board, squares: np.ndarray) -> np.ndarray:
        """Places (..., 2) on the board, in squares from its outer corner, in space."""
        return self.corner_mm + board.square_mm * (
            np.asarray(squares, dtype=float) @ self.rotation[:, :2].T)

    def corners(self, rig: Rig) -> np.ndarray:
        """Image coordinates of the inner corners (rows * columns, 2), row by row."""
        row, column = np.divmod(np.arange(rig.board.rows * rig.board.columns), rig.board.columns)
        squares = np.stack([column + 1, row + 1], axis=-1)
        return rig.camera.project(self.points(rig.board, squares))


def chessboard(rig: Rig, pose: BoardPose, rng: np.random.Generator, fine: int = 4) -> np.ndarray:
    """Photograph of the chessboard (uint8): fine x fine samples a pixel, blurred by the lens."""
    camera, board = rig.camera, rig.board
    columns, rows = board.columns + 1, board.rows + 1
    # Only the rectangle of pixels that the paper may cover is looked at: its outline, a square
    # around the board, is convex in space and nearly so in the image.
    side = np.linspace(0, 1, 9)
    outline = np.concatenate([
        np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 2) for x, y in (
            (side * (columns + 2) - 1, -1), (side * (columns + 2) - 1, rows + 1),
            (-1, side * (rows + 2) - 1), (columns + 1, side * (rows + 2) - 1))])
    image = camera.project(pose.points(board, outline))
    limits = np.array([camera.width, camera.height])
    left, top = np.clip(np.floor(image.min(axis=0)).astype(int) - 2, 0, limits)
    right, bottom = np.clip(np.ceil(image.max(axis=0)).astype(int) + 3, 0, limits)
    rays = _rays(camera, fine)[top * fine:bottom * fine, left * fine:right * fine]
    # The plane's points are corner + R (x, y, 0): the homography's inverse takes rays to squares.
    plane = np.column_stack([pose.rotation[:, :2] * board.square_mm, pose.corner_mm])
    inverse = np.linalg.inv(plane).astype(np.float32)
    x, y = rays[..., 0], rays[..., 1]
    scale = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
    column = np.floor((inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / scale)
    row = np.floor((inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / scale)
    paper = (column >= -1) & (column <= columns) & (row >= -1) & (row <= rows)
    black = (column >= 0) & (column < columns) & (row >= 0) & (row < rows) & (
        (column + row) % 2 == 0)
    part = np.where(paper, np.where(black, np.float32(35), np.float32(205)), np.float32(120))
    levels = np.full((camera.height, camera.width), 120.0)
    levels[top:bottom, left:right] = part.reshape(
        bottom - top, fine, right - left, fine).mean(axis=(1, 3))
    levels = cv2.GaussianBlur(levels, (0, 0), 0.8 * rig.spots.blur_px)
    slope = rng.uniform(-0.15, 0.15, 2)
    u = np.linspace(-1, 1, camera.width)
    v = np.linspace(-1, 1, camera.height)[:, None]
    light = (1 + slope[0] * u + slope[1] * v) * (1 - 0.5 * (1 - vignette(rig)))
    return expose(rig, levels * light, rng)


#: Where the boards are pushed to, in turn, so that together they fill the image.
_TOWARDS = ((0, 0), (-1, -1), (1, 1), (1, -1), (-1, 1), (-1, 0), (1, 0), (0, -1), (0, 1))


def board_pose(rig: Rig, number: int, rng: np.random.Generator) -> BoardPose:
    """A pose for photograph `number`: tilted, and pushed to one side until it meets the border."""
    camera, board = rig.camera, rig.board
    columns, rows = board.columns + 1, board.rows + 1
    outline = np.array([[x, y] for x in (-0.4, columns / 2, columns + 0.4)
                        for y in (-0.4, rows / 2, rows + 0.4)])
    tilt = 0.6 if camera.width > 128 else 0.45
    towards = np.array(_TOWARDS[number % len(_TOWARDS)])
    while True:
        turn, _ = cv2.Rodrigues(np.array([*rng.uniform(-tilt, tilt, 2), rng.uniform(-0.25, 0.25)]))
        share = rng.uniform(0.55, 0.9) if camera.width > 128 else rng.uniform(0.78, 0.95)
        distance = camera.focal_px * board.square_mm * max(
            columns / camera.width, rows / camera.height) / share
        middle = turn[:, :2] @ (np.array([columns, rows]) / 2 * board.square_mm)

        def pose(push, turn=turn, middle=middle, distance=distance):
            aside = np.array([*(push * towards * distance), 0])
            return BoardPose(np.array([0, 0, distance]) + aside - middle, turn)

        def fits(push, pose=pose):
            points = pose(push).points(board, outline)
            return (points[:, 2] > 0.2 * distance).all() and camera.inside(  # noqa: B023
                camera.project(points), 1.5).all()

        if not fits(0.0):
            continue
        low, high = 0.0, 1.0
        for _ in range(12):
            half = (low + high) / 2
            low, high = (half, high) if fits(half) else (low, half)
        return pose(low)


def board_photograph(
    rig: Rig, number: int, rng: np.random.Generator
) -> tuple[np.ndarray, BoardPose]:
    """A photograph on which OpenCV finds every inner corner, and the board's pose."""
    size = rig.board.columns, rig.board.rows
    while True:
        pose = board_pose(rig, number, rng)
        image = chessboard(rig, pose, rng)
        if cv2.findChessboardCorners(image, size)[0]:
            return image, pose
