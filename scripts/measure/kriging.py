"""Interpolation of 1/z between the rays of measured points, with its uncertainty.

Universal kriging: a plane (which is linear in 1/z over the rays) plus a smooth field, whose
amplitude varies over the picture. It is learnt from the points themselves: each is predicted from
all others, and where that fails, the surface bends.
"""

import numpy as np

__all__ = ["Kriging"]

#: Length of correlation, and reach over which amplitudes are smoothed, in steps of the mesh.
LENGTH, REACH = 2.5, 1.5
#: Least amplitude as a part of 1/z, and of the amplitude over the whole surface.
_LEAST, _LEAST_PART = 2e-4, 0.1
#: Amplitude with which the points are predicted from one another at first.
_TYPICAL = 0.01
#: Length in steps, and amplitude, of what bends the surface as a whole.
_LONG, _LONG_AMPLITUDE = 8.0, 0.05


def _matern(distance):
    """Matern's correlation of smoothness 5/2 at distances in correlation lengths."""
    scaled = np.sqrt(5) * distance
    return (1 + scaled + scaled**2 / 3) * np.exp(-scaled)


def _distances(one, two):
    return np.hypot(one[:, None, 0] - two[None, :, 0], one[:, None, 1] - two[None, :, 1])


class Kriging:
    """A field of 1/z over rays.

    Parameters
    ----------
    ray : array (n, 2)
        x/z and y/z of measured points, three at least.
    inverse : array (n,)
        Their 1/z.
    noise, own : array (n,)
        Variance of each by spot noise, and by the calibration of its beam, the same in all frames.
    """

    def __init__(self, ray, inverse, noise, own):
        self._ray, self._noise = ray, noise
        self._mean = inverse.mean()
        self._inverse = inverse / self._mean
        apart = _distances(ray, ray)
        nearest = apart + np.diag(np.full(len(ray), np.inf))
        self.step = max(float(np.median(nearest.min(axis=1))), 1e-6)
        self._origin = ray.mean(axis=0)
        variance = (noise + own) / self._mean**2
        typical = np.full(len(ray), _TYPICAL)
        self._learn(self._covariance(apart, typical, typical), variance)
        self._amplitude = self._amplitudes(apart)
        covariance = self._covariance(apart, self._amplitude, self._amplitude) + np.diag(variance)
        self._inverted = np.linalg.inv(covariance)
        self._plane = self._terms(ray)
        self._tied = self._inverted @ self._plane
        self._level = np.linalg.pinv(self._plane.T @ self._tied, hermitian=True)
        coefficients = self._level @ (self._tied.T @ self._inverse)
        self._coefficients = coefficients
        self._weights = self._inverted @ (self._inverse - self._plane @ coefficients)

    def _terms(self, ray):
        return np.column_stack([np.ones(len(ray)), (ray - self._origin) / self.step])

    def _covariance(self, apart, one, two):
        """Of the field at distances (m, n), with its amplitudes there (m,) and (n,)."""
        return _matern(apart / (LENGTH * self.step)) * np.outer(one, two) + (
            _LONG_AMPLITUDE**2 * _matern(apart / (_LONG * self.step)))

    def _learn(self, covariance, variance):
        """How well each point is predicted by all others."""
        terms, count = self._terms(self._ray), len(self._inverse)
        inverse = np.linalg.inv(covariance + np.diag(variance + 1e-12))
        tied = inverse @ terms
        inverse -= tied @ np.linalg.pinv(terms.T @ tied, hermitian=True) @ tied.T
        own = np.maximum(np.diag(inverse), 1e-12)
        error = (inverse @ self._inverse) / own
        if count < 5:  # a plane goes through them, or nearly so
            error, own = np.full((2, count), _TYPICAL)
        # The error of a prediction with amplitude 1, and what spot noise adds to it.
        self._unit = np.maximum(1 / own - variance, 1e-12) / _TYPICAL**2
        self._square = error**2 - variance
        self._least = max(float(self._square.sum() / self._unit.sum()) * _LEAST_PART**2,
                          _LEAST**2)

    def _amplitudes(self, apart):
        """How much the surface bends, as a part of 1/z, at distances (m, n) from the points."""
        near = np.exp(-0.5 * (apart / (REACH * self.step))**2) + 1e-9
        return np.sqrt(np.maximum(near @ self._square / (near @ self._unit), self._least))

    def predict(self, ray):
        """1/z at rays (m, 2), its covariance (m, m), and the part of that by spot noise."""
        apart = _distances(ray, self._ray)
        amplitude = self._amplitudes(apart)
        cross = self._covariance(apart, amplitude, self._amplitude)
        terms = self._terms(ray)
        left = terms - cross @ self._tied  # what the field does not explain of the plane
        among = self._covariance(_distances(ray, ray), amplitude, amplitude)
        weights = cross @ self._inverted + left @ self._level @ self._tied.T
        covariance = among - cross @ self._inverted @ cross.T + left @ self._level @ left.T
        covariance = (covariance + covariance.T) / 2
        np.fill_diagonal(covariance, np.maximum(np.diag(covariance), 0))
        noise = (weights * self._noise) @ weights.T
        inverse = terms @ self._coefficients + cross @ self._weights
        return inverse * self._mean, covariance * self._mean**2, noise
