"""The wall that a polyp stands on, fitted to the surface around it."""

from dataclasses import dataclass

import numpy as np

from model.errors import UserError

__all__ = ["Wall", "fit_wall"]

#: Beams around that a wall needs, and those from which on it may be curved.
LEAST, _CURVED = 6, 14
#: A curved wall has to predict beams so much better than a flat one.
_BETTER = 0.8
_HUBER, _ROUNDS = 1.5, 8


@dataclass(frozen=True)
class Wall:
    """1/z of a wall over the rays: a polynomial of first or second degree.

    Parameters
    ----------
    origin : array (2,)
        x/z and y/z in the middle.
    coefficients : array (3,) or (6,)
        Of 1, x, y, x^2, x y, y^2, the rays counted from the origin.
    covariance : array
        Of the coefficients.
    """

    origin: np.ndarray
    coefficients: np.ndarray
    covariance: np.ndarray

    def terms(self, ray):
        """What the coefficients are multiplied with, for rays (n, 2)."""
        return _terms(ray - self.origin, len(self.coefficients) == 6)

    def points(self, ray):
        """Where rays (n, 2) meet the wall, mm."""
        depth = 1 / (self.terms(ray) @ self.coefficients)
        return np.column_stack([ray, np.ones(len(ray))]) * depth[:, None]

    def normal(self, ray):
        """Unit normal towards the camera, where a ray (2,) meets the wall."""
        c, (x, y) = self.coefficients, ray - self.origin
        slope = c[1:3].copy()
        if len(c) == 6:
            slope += [2 * c[3] * x + c[4] * y, c[4] * x + 2 * c[5] * y]
        inverse = float((self.terms(ray[None]) @ c)[0])
        # The tangent plane is g . P = 1 with 1/z = g1 x/z + g2 y/z + g3.
        plane = np.array([*slope, inverse - slope @ ray])
        return -plane / np.linalg.norm(plane)

    def depth_sigma(self, ray):
        """Standard deviation of z where a ray (2,) meets the wall, mm."""
        terms = self.terms(ray[None])[0]
        inverse = terms @ self.coefficients
        return float(np.sqrt(max(terms @ self.covariance @ terms, 0)) / inverse**2)


def _terms(offset, curved):
    x, y = offset.T
    terms = [np.ones(len(x)), x, y]
    return np.column_stack(terms + [x * x, x * y, y * y] if curved else terms)


def _fit(terms, inverse, sigma):
    """Coefficients, their covariance, and the error of each prediction without the point itself."""
    weight = 1 / sigma**2
    for _ in range(_ROUNDS):
        normal = np.linalg.pinv((terms.T * weight) @ terms, hermitian=True)
        coefficients = normal @ (terms.T @ (weight * inverse))
        off = (inverse - terms @ coefficients) / sigma
        scatter = max(1.0, 1.4826 * float(np.median(np.abs(off))))
        far = np.abs(off) / scatter
        weight = np.minimum(1, _HUBER / np.maximum(far, 1e-9)) / sigma**2
    leverage = np.einsum("ij,jk,ik->i", terms, normal, terms) * weight
    held = off / np.maximum(1 - leverage, 0.05)
    spread = max(1.0, float(np.mean(np.minimum(off**2, (3 * scatter)**2))))
    return coefficients, normal * spread, held


def fit_wall(ray, inverse, sigma, origin):
    """The wall through measured points around a polyp.

    It is curved if that predicts points, each without itself, clearly better.

    Parameters
    ----------
    ray : array (n, 2)
        x/z and y/z.
    inverse, sigma : array (n,)
        1/z, and its standard deviation.
    origin : array (2,)
        Middle of the polyp, as a ray.

    Raises
    ------
    UserError
        If there are fewer than six points, or all of them are on one side.
    """
    if len(ray) < LEAST:
        raise UserError(f"Only {len(ray)} measured points lie around the rim, and the wall needs "
                        f"{LEAST}: choose a frame with more wall in view.")
    angle = np.sort(np.arctan2(*(ray - origin).T))
    widest = np.diff(np.concatenate([angle, angle[:1] + 2 * np.pi])).max()
    if widest > np.radians(200):
        raise UserError("The measured points of the wall lie on one side of the polyp only: choose "
                        "a frame that shows the wall around it.")
    found = _fit(_terms(ray - origin, False), inverse, sigma)
    if len(ray) >= _CURVED:
        curved = _fit(_terms(ray - origin, True), inverse, sigma)
        if np.median(np.abs(curved[2])) < _BETTER * np.median(np.abs(found[2])):
            found = curved
    return Wall(origin, *found[:2])
