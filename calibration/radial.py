"""Radial models of a lens: distorted by undistorted radius, both in focal lengths."""

from dataclasses import dataclass

import numpy as np

__all__ = ["MODELS", "Radial"]

#: ``brown`` is r (1 + k1 r^2 + k2 r^4 + k3 r^6), the usual polynomial; ``equidistant`` is the same
#: polynomial of the angle to the axis, atan r, in place of r: that of capsule and fisheye optics.
MODELS = ("brown", "equidistant")
#: Undistorted radii of tables reach this far: 83 degrees from the axis.
_FAR = 8.0
_NODES = 20001


@dataclass(frozen=True)
class Radial:
    """A radial model.

    Parameters
    ----------
    model : :class:`str`
        One of :data:`MODELS`.
    k : tuple of three :class:`float`
        Coefficients.
    """

    model: str = "brown"
    k: tuple = (0.0, 0.0, 0.0)

    @property
    def _fisheye(self):
        return self.model == "equidistant"

    def distorted(self, radius):
        """Distorted radius of undistorted ones."""
        k1, k2, k3 = self.k
        t = np.arctan(radius) if self._fisheye else np.asarray(radius, float)
        s = t * t
        return t * (1 + s * (k1 + s * (k2 + s * k3)))

    def slope(self, radius):
        """Derivative of :meth:`distorted`."""
        k1, k2, k3 = self.k
        r2 = np.square(radius)
        s = np.square(np.arctan(radius)) if self._fisheye else r2
        slope = 1 + s * (3 * k1 + s * (5 * k2 + 7 * s * k3))
        return slope / (1 + r2) if self._fisheye else slope

    @property
    def fold(self):
        """Undistorted radius at which the distorted one turns back; inf if it never does."""
        k1, k2, k3 = self.k
        roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
        roots = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
        first = float(np.sqrt(roots.min())) if len(roots) else np.inf
        if not self._fisheye:
            return first
        return float(np.tan(first)) if first < np.pi / 2 else np.inf

    def nodes(self, farthest=_FAR):
        """Undistorted radii, dense, from 0 to the fold or to ``farthest``."""
        end = min(self.fold, farthest)
        if self._fisheye:
            return np.tan(np.linspace(0, np.arctan(end), _NODES))
        return np.linspace(0, end, _NODES)

    def undistorted(self, radius):
        """Inverse of :meth:`distorted` on the branch from the centre; NaN beyond its end."""
        nodes = self.nodes()
        values = self.distorted(nodes)
        found = np.interp(radius, values, nodes, right=np.nan)
        for _ in range(4):
            error = self.distorted(found) - radius
            found = found - error / np.maximum(self.slope(found), 1e-3)
        return found
