"""The lens: square pixels, a radial model, and Brown's tangential terms."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.radial import Radial

__all__ = ["Lens"]


@dataclass(frozen=True)
class Lens:
    """Pinhole camera with one focal length, a radial model, and OpenCV's p1, p2.

    *Image* coordinates are pixels of the sensor's image, distorted, (0, 0) being the centre of the
    first pixel. *Undistorted* coordinates are pixels of the same focal length without distortion,
    relative to the image centre ((width - 1) / 2, (height - 1) / 2).

    Parameters
    ----------
    width, height : :class:`int`
        Size of the image.
    focal : :class:`float`
        Focal length in pixels.
    principal_u, principal_v : :class:`float`
        Principal point, image coordinates.
    k1, k2, p1, p2 : :class:`float`
        Distortion, OpenCV's names and signs.
    k3 : :class:`float`
        Third radial coefficient.
    model : :class:`str`
        What the radial coefficients are those of, see :data:`calibration.radial.MODELS`; the
        equidistant model has no p1 and p2.
    usable_px : :class:`float` or None
        Distance from the principal point in the image up to which the model is valid; None is
        everywhere.
    """

    width: int
    height: int
    focal: float
    principal_u: float
    principal_v: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    model: str = "brown"
    usable_px: float | None = None

    @property
    def radial(self):
        """The radial model."""
        return Radial(self.model, (self.k1, self.k2, self.k3))

    @property
    def centre(self):
        """Image centre (column, row), the origin of undistorted coordinates."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    @property
    def principal_x(self):
        """Principal point's column in undistorted coordinates."""
        return self.principal_u - self.centre[0]

    @property
    def principal_y(self):
        """Principal point's row in undistorted coordinates."""
        return self.principal_v - self.centre[1]

    @property
    def matrix(self):
        """OpenCV's camera matrix."""
        return np.array([[self.focal, 0, self.principal_u], [0, self.focal, self.principal_v],
                         [0, 0, 1.0]])

    @property
    def coefficients(self):
        """OpenCV's distortion coefficients, of the model ``brown``."""
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3])

    def _distorted(self, x, y):
        """Distort normalised coordinates; gives the result and the four partial derivatives."""
        r = np.hypot(x, y)
        radial = self.radial
        safe = np.maximum(r, 1e-9)
        scale = np.where(r > 1e-9, radial.distorted(safe) / safe, 1.0)
        # The scale's derivative by r, over r.
        slope = np.where(r > 1e-4, (radial.slope(safe) - scale) / np.maximum(safe, 1e-4)**2,
                         2 * self.k1 - (2 / 3 if self.model == "equidistant" else 0))
        u = x * scale + 2 * self.p1 * x * y + self.p2 * (r * r + 2 * x * x)
        v = y * scale + self.p1 * (r * r + 2 * y * y) + 2 * self.p2 * x * y
        uu = scale + x * x * slope + 2 * self.p1 * y + 6 * self.p2 * x
        uv = x * y * slope + 2 * self.p1 * x + 2 * self.p2 * y
        vv = scale + y * y * slope + 6 * self.p1 * y + 2 * self.p2 * x
        return u, v, uu, uv, uv, vv

    def distort(self, x, y):
        """Undistorted coordinates to image coordinates."""
        x = (np.asarray(x, float) - self.principal_x) / self.focal
        y = (np.asarray(y, float) - self.principal_y) / self.focal
        u, v = self._distorted(x, y)[:2]
        return u * self.focal + self.principal_u, v * self.focal + self.principal_v

    def undistort(self, u, v):
        """Image coordinates to undistorted ones, by Newton's method to 1e-9 px.

        Outside the usable region, and where the model folds before it reaches (u, v), there is no
        answer, and both are NaN.
        """
        u = (np.asarray(u, float) - self.principal_u) / self.focal
        v = (np.asarray(v, float) - self.principal_v) / self.focal
        # The radial part alone is inverted first, from a table, which cannot step over a fold;
        # Newton's method then settles the small tangential part.
        target = np.hypot(u, v)
        radius = self.radial.undistorted(target)
        radius = np.where(np.isnan(radius), min(self.fold_radius, 4.0), radius)
        scale = np.where(target > 0, radius / np.where(target > 0, target, 1), 1.0)
        x, y = u * scale, v * scale
        for _ in range(8):
            fu, fv, uu, uv, vu, vv = self._distorted(x, y)
            determinant = uu * vv - uv * vu
            determinant = np.where(np.abs(determinant) < 1e-6, 1e-6, determinant)
            eu, ev = u - fu, v - fv
            x = x + (vv * eu - uv * ev) / determinant
            y = y + (uu * ev - vu * eu) / determinant
        fu, fv, uu, uv, vu, vv = self._distorted(x, y)
        good = (np.hypot(fu - u, fv - v) * self.focal < 1e-6) & (uu * vv - uv * vu > 0)
        good &= np.hypot(x, y) <= self.fold_radius
        if self.usable_px is not None:
            good &= target * self.focal <= self.usable_px
        x = np.where(good, x * self.focal + self.principal_x, np.nan)
        y = np.where(good, y * self.focal + self.principal_y, np.nan)
        return x, y

    def gain(self, x, y):
        """Largest derivative of undistorted coordinates by image ones; inf where they are NaN."""
        x = (np.asarray(x, float) - self.principal_x) / self.focal
        y = (np.asarray(y, float) - self.principal_y) / self.focal
        _, _, uu, uv, _, vv = self._distorted(x, y)
        least = (uu + vv) / 2 - np.hypot((uu - vv) / 2, uv)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(least > 0, 1 / least, np.inf)

    @property
    def fold_radius(self):
        """Normalised undistorted radius where the radial part turns back; inf if it never does."""
        return self.radial.fold

    @property
    def reach(self):
        """Normalised undistorted radius up to which the model is valid; inf if it is anywhere."""
        if self.usable_px is None:
            return self.fold_radius
        reach = float(self.radial.undistorted(self.usable_px / self.focal))
        return self.fold_radius if np.isnan(reach) else reach

    def valid(self, x, y):
        """Whether undistorted coordinates are where the model is valid."""
        return np.hypot(np.asarray(x) - self.principal_x,
                        np.asarray(y) - self.principal_y) <= self.reach * self.focal

    def distance_px(self, u, v):
        """Distance of image coordinates from the principal point, px."""
        return np.hypot(u - self.principal_u, v - self.principal_v)

    @property
    def corner_px(self):
        """Distance of the farthest corner of the picture from the principal point, px."""
        return float(np.hypot(max(self.principal_u, self.width - 1 - self.principal_u),
                              max(self.principal_v, self.height - 1 - self.principal_v)))

    def folds(self):
        """Whether some usable pixel of the image is reached by no ray, or by several."""
        u = np.linspace(-0.5, self.width - 0.5, 89)
        v = np.linspace(-0.5, self.height - 0.5, 73)
        u, v = (grid.ravel() for grid in np.meshgrid(u, v))
        if self.usable_px is not None:
            # The tangential part moves the border by less than a pixel.
            usable = self.distance_px(u, v) <= self.usable_px - 1
            u, v = u[usable], v[usable]
        x, _ = replace(self, usable_px=None).undistort(u, v)
        return bool(np.isnan(x).any())

    def ray(self, x, y):
        """Slopes dx/dz and dy/dz of the rays through undistorted (x, y)."""
        return ((np.asarray(x, float) - self.principal_x) / self.focal,
                (np.asarray(y, float) - self.principal_y) / self.focal)
