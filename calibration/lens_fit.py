"""Least squares of a lens and the poses of chessboards, with the covariance of the lens."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares

from calibration.lens import Lens

__all__ = ["BROWN", "EQUIDISTANT", "LensFit", "fit_boards"]

#: Free parameters of the models, by their names in :class:`calibration.lens.Lens`.
BROWN = ("focal", "principal_u", "principal_v", "k1", "k2", "p1", "p2")
EQUIDISTANT = ("focal", "principal_u", "principal_v", "k1", "k2", "k3")
#: Evaluations of the residuals at the most, and what they are limited to, px: a lens that folds has
#: no image of some points.
_EVALUATIONS, _FARTHEST_PX = 60, 1e6


@dataclass(frozen=True)
class LensFit:
    """A lens fitted to boards.

    Parameters
    ----------
    lens : :class:`calibration.lens.Lens`
        The lens.
    names : tuple of :class:`str`
        Its parameters that were free.
    covariance : array (parameters, parameters)
        Theirs, by the distances of the corners that are left.
    view_rms_px : array (views,)
        RMS distance of each view's corners.
    rms_px : :class:`float`
        Of all.
    poses : array (views, 6)
        Rotation vector and position of each board.
    """

    lens: Lens
    names: tuple
    covariance: np.ndarray = field(repr=False)
    view_rms_px: np.ndarray = field(repr=False)
    rms_px: float
    poses: np.ndarray = field(repr=False)

    def sigma(self, name):
        """Standard deviation of a parameter."""
        number = self.names.index(name)
        return float(np.sqrt(self.covariance[number, number]))

    @property
    def focal_sigma(self):
        """Standard deviation of the focal length, a share of it."""
        return self.sigma("focal") / abs(self.lens.focal)

    @property
    def principal_sigma_px(self):
        """That of the principal point, px: the larger one of both ways."""
        return max(self.sigma("principal_u"), self.sigma("principal_v"))


def _rotated(vectors, points):
    """Points (n, 3) turned by each of some rotation vectors (views, 3): (views, n, 3)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    axis = vectors[:, None, :] / np.maximum(angle, 1e-12)
    along = np.sum(axis * points, axis=-1, keepdims=True)
    return (points * np.cos(angle) + np.cross(np.broadcast_to(axis, (len(vectors), *points.shape)),
                                              points) * np.sin(angle)
            + axis * along * (1 - np.cos(angle)))


def _projected(board, lens, poses):
    """Image coordinates (views, n, 2) of the board's corners."""
    space = _rotated(poses[:, :3], board) + poses[:, None, 3:]
    depth = np.where(np.abs(space[..., 2]) > 1e-6, space[..., 2], 1e-6)
    x = space[..., 0] / depth * lens.focal + lens.principal_x
    y = space[..., 1] / depth * lens.focal + lens.principal_y
    return np.stack(lens.distort(x, y), axis=-1)


class _Problem:
    """Residuals and their derivatives by a vector of the lens's free parameters and all poses.

    Every board's pose belongs to its own view only.
    """

    def __init__(self, board, corners, names, lens, nominal):
        self.board, self.corners = np.asarray(board, float), np.stack(corners).astype(float)
        self.names, self.start = names, lens
        # The focal length, which is the first parameter, is drawn to its nominal value.
        self.nominal = nominal[0] if nominal else 0.0
        self.pull = nominal[2] / nominal[1] if nominal else 0.0

    def split(self, vector):
        """The lens's values (p,) and the poses (views, 6)."""
        return vector[:len(self.names)], vector[len(self.names):].reshape(-1, 6)

    def lens(self, values):
        """The lens with other values of its free parameters."""
        return replace(self.start, **{
            name: float(value) for name, value in zip(self.names, values, strict=True)})

    def error(self, values, poses):
        """Projected less real corners: (views, 2 n)."""
        image = _projected(self.board, self.lens(values), poses)
        error = (image - self.corners).reshape(len(poses), -1)
        return np.nan_to_num(np.clip(error, -_FARTHEST_PX, _FARTHEST_PX), nan=_FARTHEST_PX)

    def residuals(self, vector):
        """What is minimised, by its squares."""
        values, poses = self.split(vector)
        error = self.error(values, poses).ravel()
        if not self.pull:
            return error
        return np.append(error, self.pull * (values[0] - self.nominal))

    def slopes(self, vector):
        """Derivatives of :meth:`residuals`, (residuals, p + 6 views)."""
        values, poses = self.split(vector)
        error = self.error(values, poses)
        views, points = error.shape
        slopes = np.zeros((error.size + bool(self.pull), len(vector)))
        for number, name in enumerate(self.names):
            step = 1e-3 if name in ("focal", "principal_u", "principal_v") else 1e-6
            moved = values.copy()
            moved[number] += step
            slopes[:error.size, number] = ((self.error(moved, poses) - error) / step).ravel()
        by_pose = slopes[:error.size, len(values):].reshape(views, points, views, 6)
        own = np.arange(views)
        for number in range(6):
            step = 1e-6 if number < 3 else 1e-6 * np.abs(poses[:, 5]).mean()
            moved = poses.copy()
            moved[:, number] += step
            by_pose[own, :, own, number] = (self.error(values, moved) - error) / step
        if self.pull:
            slopes[-1, 0] = self.pull
        return slopes


def fit_boards(board, corners, names, lens, poses, nominal=None):
    """Fit a lens and the poses of boards by least squares.

    Parameters
    ----------
    board : array (n, 3)
        Corners of the board, mm.
    corners : sequence of arrays (n, 2)
        Where each view has them.
    names : tuple of :class:`str`
        Parameters of the lens that are free: :data:`BROWN`, :data:`EQUIDISTANT`, or none.
    lens : :class:`calibration.lens.Lens`
        Where to start; the other parameters stay as they are.
    poses : array (views, 6)
        Where to start.
    nominal : three :class:`float` or None
        A focal length that is known already, its standard deviation, and that of the corners; px.

    Returns
    -------
    :class:`LensFit`
    """
    problem = _Problem(board, corners, names, lens, nominal)
    start = np.concatenate([[getattr(lens, name) for name in names], np.ravel(poses)])
    with np.errstate(all="ignore"):
        solution = least_squares(problem.residuals, start, problem.slopes, method="lm",
                                 x_scale="jac", max_nfev=_EVALUATIONS)
        values, poses = problem.split(solution.x)
        error = problem.error(values, poses)
    cost = np.sum(error**2)
    freedom = max(error.size - solution.x.size, 1)
    half = error.shape[1] / 2
    return LensFit(
        lens=problem.lens(values), names=names,
        covariance=_covariance(solution.jac, len(names)) * cost / freedom, poses=poses,
        view_rms_px=np.sqrt(np.sum(error**2, axis=1) / half),
        rms_px=float(np.sqrt(cost / (half * len(poses)))))


def _covariance(slopes, count):
    """That of the first ``count`` parameters, for residuals of unit variance."""
    scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    scaled = slopes / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-15, hermitian=True)
    return (inverse / np.outer(scale, scale))[:count, :count]
