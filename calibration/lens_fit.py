"""Least squares of a lens and the poses of chessboards, with the covariance of the lens."""

from dataclasses import dataclass, field, replace

import numpy as np

from calibration.lens import Lens

__all__ = ["BROWN", "EQUIDISTANT", "LensFit", "fit_boards"]

#: Free parameters of the models, by their names in :class:`calibration.lens.Lens`.
BROWN = ("focal", "principal_u", "principal_v", "k1", "k2", "p1", "p2")
EQUIDISTANT = ("focal", "principal_u", "principal_v", "k1", "k2", "k3")
_ROUNDS = 60


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
    """Residuals and normal equations; every board's pose belongs to its own view only."""

    def __init__(self, board, corners, names, lens, nominal):
        self.board, self.corners = np.asarray(board, float), np.stack(corners).astype(float)
        self.names, self.start = names, lens
        # The focal length, which is the first parameter, is drawn to its nominal value.
        self.nominal = nominal[0] if nominal else 0.0
        self.pull = (nominal[2] / nominal[1]) ** 2 if nominal else 0.0

    def cost(self, error, values):
        """What is minimised."""
        return np.sum(error**2) + (self.pull * (values[0] - self.nominal) ** 2 if self.pull else 0)

    def lens(self, values):
        """The lens with other values of its free parameters."""
        return replace(self.start, **{
            name: float(value) for name, value in zip(self.names, values, strict=True)})

    def error(self, values, poses):
        """Projected less real corners: (views, 2 n)."""
        image = _projected(self.board, self.lens(values), poses)
        return (image - self.corners).reshape(len(poses), -1)

    def system(self, values, poses):
        """Error, its derivatives by the lens (p, views, 2 n) and by the own pose (6, views, 2 n).
        """
        error = self.error(values, poses)
        by_lens, by_pose = [], []
        for number, name in enumerate(self.names):
            step = 1e-3 if name in ("focal", "principal_u", "principal_v") else 1e-6
            moved = np.array(values)
            moved[number] += step
            by_lens.append((self.error(moved, poses) - error) / step)
        for number in range(6):
            step = 1e-6 if number < 3 else 1e-6 * np.abs(poses[:, 5]).mean()
            moved = poses.copy()
            moved[:, number] += step
            by_pose.append((self.error(values, moved) - error) / step)
        return error, np.reshape(by_lens, (-1, *error.shape)), np.array(by_pose)

    def normal(self, values, error, by_lens, by_pose, damping=0.0):
        """The lens's normal matrix and right side without the poses, and what gives those back."""
        pose = np.einsum("pvi,qvi->vpq", by_pose, by_pose)
        pose = pose + damping * np.einsum("vpp,pq->vpq", pose, np.eye(6))
        cross = np.einsum("pvi,qvi->vpq", by_lens, by_pose)
        own = np.einsum("pvi,vi->vp", by_pose, error)
        inverse = np.linalg.pinv(pose, hermitian=True)
        lens = np.einsum("pvi,qvi->pq", by_lens, by_lens)
        lens = lens + damping * np.diag(np.diag(lens))
        matrix = lens - np.einsum("vpa,vab,vqb->pq", cross, inverse, cross)
        right = np.einsum("pvi,vi->p", by_lens, error) - np.einsum(
            "vpa,vab,vb->p", cross, inverse, own)
        if self.pull:
            matrix[0, 0] += self.pull
            right[0] += self.pull * (values[0] - self.nominal)
        return matrix, right, (inverse, cross, own)


def fit_boards(board, corners, names, lens, poses, nominal=None):
    """Fit a lens by Levenberg's and Marquardt's method.

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
    values, poses = np.array([getattr(lens, name) for name in names]), np.array(poses, float)
    cost, damping = np.inf, 1e-4
    with np.errstate(all="ignore"):
        system = problem.system(values, poses)
        cost = problem.cost(system[0], values)
        for _ in range(_ROUNDS):
            matrix, right, (inverse, cross, own) = problem.normal(values, *system, damping)
            step = -np.linalg.lstsq(matrix, right, rcond=1e-14)[0]
            turn = -np.einsum("vab,vb->va", inverse, own + np.einsum("vpa,p->va", cross, step))
            then = problem.error(values + step, poses + turn)
            gained = cost - problem.cost(then, values + step)
            if not gained >= 0:
                damping *= 10
                if damping > 1e8:
                    break
                continue
            values, poses, damping = values + step, poses + turn, max(damping / 10, 1e-9)
            system = problem.system(values, poses)
            cost = problem.cost(system[0], values)
            if gained < 1e-9 * cost:
                break
        matrix = problem.normal(values, *system)[0]
    error = system[0]
    cost = np.sum(error**2)
    freedom = max(error.size - len(names) - poses.size, 1)
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    covariance = np.zeros((0, 0))
    if names:
        covariance = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-15, hermitian=True)
        covariance = covariance / np.outer(scale, scale) * cost / freedom
    half = error.shape[1] / 2
    return LensFit(
        lens=problem.lens(values), names=names, covariance=covariance, poses=poses,
        view_rms_px=np.sqrt(np.sum(error**2, axis=1) / half),
        rms_px=float(np.sqrt(cost / (half * len(poses)))))
