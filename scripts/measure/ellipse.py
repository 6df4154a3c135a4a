"""The ellipse through points that somebody marked on a rim."""

from dataclasses import dataclass

import numpy as np

__all__ = ["Rim", "fit_rim"]

#: From so many points on an ellipse is fitted, and a circle through fewer.
_ELLIPSE = 6
#: A longer axis than this times the largest distance of two points is not believed.
_LONGEST = 1.15


@dataclass(frozen=True)
class Rim:
    """An ellipse in a plane.

    Parameters
    ----------
    centre : array (2,)
        Its middle.
    axes : array (2, 2)
        Its half axes as rows, the longer one first.
    misfit : :class:`float`
        Root mean square distance of the points from it.
    """

    centre: np.ndarray
    axes: np.ndarray
    misfit: float

    @property
    def longest(self):
        """Its longest diameter."""
        return 2 * float(np.linalg.norm(self.axes[0]))

    def radius(self, points):
        """Distance of points (n, 2) from the middle, 1 on the rim."""
        square = (self.axes**2).sum(axis=1)
        return np.linalg.norm((np.asarray(points) - self.centre) @ self.axes.T / square, axis=1)


def _circle(points):
    system = np.column_stack([2 * points, np.ones(len(points))])
    a, b, c = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
    radius = np.sqrt(max(c + a * a + b * b, 1e-12))
    return np.array([a, b]), radius * np.eye(2)


def _ellipse(points):
    """Middle and half axes by Fitzgibbon's direct fit; None if it fails."""
    import cv2
    spread = max(np.ptp(points, axis=0).max(), 1e-9)
    origin = points.mean(axis=0)
    centre, size, angle = cv2.fitEllipseDirect(((points - origin) / spread).astype(np.float32))
    axis = np.radians(angle)
    first = np.array([np.cos(axis), np.sin(axis)])
    axes = np.stack([first * size[0], np.array([-first[1], first[0]]) * size[1]]) / 2 * spread
    if not np.isfinite(axes).all() or min(size) <= 0:
        return None
    order = np.argsort(-np.linalg.norm(axes, axis=1))
    return np.array(centre) * spread + origin, axes[order]


def fit_rim(points):
    """The ellipse through points on a rim, or the circle through fewer than six.

    Parameters
    ----------
    points : array (n, 2)
        Three at least, not on a line.
    """
    points = np.asarray(points, float)
    widest = np.linalg.norm(points[:, None] - points[None], axis=-1).max()
    found = _ellipse(points) if len(points) >= _ELLIPSE else None
    if found is None or 2 * np.linalg.norm(found[1][0]) > _LONGEST * widest:
        found = _circle(points)
    centre, axes = found
    rim = Rim(centre, axes, 0.0)
    off = (rim.radius(points) - 1) * np.sqrt(np.prod(np.linalg.norm(axes, axis=1)))
    spare = max(len(points) - (5 if len(points) >= _ELLIPSE else 3), 1)
    return Rim(centre, axes, float(np.sqrt((off**2).sum() / spare)))
