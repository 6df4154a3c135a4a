"""Camera, laser mesh and the float truth of their geometry.

Coordinates: the camera looks along +z from the origin, x to the right, y down, millimetres.
Image coordinates (u, v) are distorted pixels, (0, 0) being the centre of the first pixel.
Undistorted coordinates (x, y) are square pixels of the same focal length about the image centre
((W - 1) / 2, (H - 1) / 2): what OpenCV's ``undistortPoints(..., P=K)`` gives, less that centre.
All functions take and give float64 and are vectorised over leading axes.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Camera:
    """Pinhole camera with square pixels and Brown distortion (OpenCV's k1 k2 p1 p2, k3 = 0).

    ``bayer`` is the pattern of its colour filters, one of :data:`model.bayer.BAYER`, or None.
    """

    width: int
    height: int
    focal_px: float
    principal_px: tuple[float, float]
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    bayer: str | None = None

    @property
    def centre_px(self) -> tuple[float, float]:
        """The origin of undistorted coordinates."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    @property
    def matrix(self) -> np.ndarray:
        """Camera matrix in OpenCV's form."""
        u, v = self.principal_px
        return np.array([[self.focal_px, 0, u], [0, self.focal_px, v], [0, 0, 1.0]])

    @property
    def coefficients(self) -> np.ndarray:
        """Distortion coefficients in OpenCV's order: k1 k2 p1 p2."""
        return np.array([self.k1, self.k2, self.p1, self.p2])

    def distort(self, normalised: np.ndarray) -> np.ndarray:
        """Normalised pinhole coordinates (..., 2) to image coordinates in pixels."""
        x, y = normalised[..., 0], normalised[..., 1]
        square = x * x + y * y
        radial = 1 + square * (self.k1 + square * self.k2)
        u = x * radial + 2 * self.p1 * x * y + self.p2 * (square + 2 * x * x)
        v = y * radial + self.p1 * (square + 2 * y * y) + 2 * self.p2 * x * y
        return np.stack([u, v], axis=-1) * self.focal_px + np.asarray(self.principal_px)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Points in mm (..., 3), in front of the camera, to image coordinates (..., 2)."""
        points = np.asarray(points, dtype=float)
        return self.distort(points[..., :2] / points[..., 2:])

    def normalise(self, image: np.ndarray) -> np.ndarray:
        """Image coordinates (..., 2) to normalised pinhole coordinates: the inverse of `distort`.

        Newton's method with the exact Jacobian, to better than 1e-12; meant for lenses that are
        one-to-one over the image.
        """
        wanted = (np.asarray(image, dtype=float) - np.asarray(self.principal_px)) / self.focal_px
        x, y = wanted[..., 0].copy(), wanted[..., 1].copy()
        for _ in range(20):
            square = x * x + y * y
            radial = 1 + square * (self.k1 + square * self.k2)
            slope = 2 * self.k1 + 4 * square * self.k2
            u = x * radial + 2 * self.p1 * x * y + self.p2 * (square + 2 * x * x) - wanted[..., 0]
            v = y * radial + self.p1 * (square + 2 * y * y) + 2 * self.p2 * x * y - wanted[..., 1]
            ux = radial + x * x * slope + 2 * self.p1 * y + 6 * self.p2 * x
            uy = x * y * slope + 2 * self.p1 * x + 2 * self.p2 * y
            vy = radial + y * y * slope + 6 * self.p1 * y + 2 * self.p2 * x
            determinant = ux * vy - uy * uy
            step_x = (u * vy - v * uy) / determinant
            step_y = (v * ux - u * uy) / determinant
            x -= step_x
            y -= step_y
            if max(np.abs(step_x).max(initial=0), np.abs(step_y).max(initial=0)) < 1e-14:
                break
        return np.stack([x, y], axis=-1)

    def undistort(self, image: np.ndarray) -> np.ndarray:
        """Image coordinates (..., 2) to undistorted pixels about the image centre."""
        offset = np.asarray(self.principal_px) - np.asarray(self.centre_px)
        return self.normalise(image) * self.focal_px + offset

    def inside(self, image: np.ndarray, margin_px: float = 0.0) -> np.ndarray:
        """Whether image coordinates lie at least `margin_px` within the outermost pixel centres."""
        u, v = image[..., 0], image[..., 1]
        return (
            (u >= margin_px) & (u <= self.width - 1 - margin_px)
            & (v >= margin_px) & (v <= self.height - 1 - margin_px)
        )


@dataclass(frozen=True)
class Projector:
    """Laser and diffraction head: a mesh of rows x columns straight beams from one point.

    The mesh is regular in the tangents of the angles: before rotation, beam (row, column) has
    direction ((column - centre) tan pitch, (row - centre) tan pitch, 1). It is then turned by
    `rotation_deg` about its own axis (x towards y) and by `toe_in_deg` about y, positive towards
    the camera's axis, whichever side of it the projector stands on. `irregularity_deg` is the
    standard deviation of a fixed error of each beam.
    """

    rows: int
    columns: int
    pitch_deg: float
    rotation_deg: float
    toe_in_deg: float
    base_mm: tuple[float, float, float]
    irregularity_deg: float = 0.0

    @property
    def beams(self) -> int:
        """Number of beams; beam = row * columns + column."""
        return self.rows * self.columns

    def directions(self) -> np.ndarray:
        """Unit directions (beams, 3)."""
        row, column = np.divmod(np.arange(self.beams), self.columns)
        pitch = np.tan(np.radians(self.pitch_deg))
        x = (column - (self.columns - 1) / 2) * pitch
        y = (row - (self.rows - 1) / 2) * pitch
        if self.irregularity_deg:
            wobble = np.random.default_rng(self.beams).normal(size=(2, self.beams))
            wobble *= np.radians(self.irregularity_deg)
            x, y = x + wobble[0], y + wobble[1]
        cosine, sine = np.cos(np.radians(self.rotation_deg)), np.sin(np.radians(self.rotation_deg))
        x, y = cosine * x - sine * y, sine * x + cosine * y
        toe_in = np.radians(self.toe_in_deg) * (-1 if self.base_mm[0] > 0 else 1)
        directions = np.stack(
            [x * np.cos(toe_in) + np.sin(toe_in), y, np.cos(toe_in) - x * np.sin(toe_in)], axis=-1
        )
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def points_at(self, z_mm: float) -> np.ndarray:
        """Where each beam meets the plane z = `z_mm`: (beams, 3)."""
        directions = self.directions()
        base = np.asarray(self.base_mm, dtype=float)
        return base + directions * ((z_mm - base[2]) / directions[:, 2])[:, None]


@dataclass(frozen=True)
class BeamLines:
    """Per beam, in undistorted pixels: y = a x + b, 1 / z = alpha x + beta (mm and pixels)."""

    a: np.ndarray
    b: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray

    def inverse_z(self, x: np.ndarray) -> np.ndarray:
        """1 / z in 1/mm of every beam at undistorted column x (a scalar or one per beam)."""
        return self.alpha * x + self.beta

    def column_at(self, z_mm: float) -> np.ndarray:
        """Undistorted column x of every beam at distance z."""
        return (1 / z_mm - self.beta) / self.alpha


def beam_lines(camera: Camera, projector: Projector) -> BeamLines:
    """The exact epipolar lines and depth laws.

    A beam's point at distance z is base + (z - base_z) t with t its direction over the direction's
    z part, so the normalised column is t_x + (base_x - base_z t_x) / z: linear in 1 / z, and the
    row likewise.
    """
    directions = projector.directions()
    slope = directions[:, :2] / directions[:, 2:]
    base = np.asarray(projector.base_mm, dtype=float)
    travel = base[:2] - base[2] * slope
    offset = np.asarray(camera.principal_px) - np.asarray(camera.centre_px)
    vanishing = camera.focal_px * slope + offset
    a = travel[:, 1] / travel[:, 0]
    alpha = 1 / (camera.focal_px * travel[:, 0])
    return BeamLines(
        a=a, b=vanishing[:, 1] - a * vanishing[:, 0], alpha=alpha, beta=-alpha * vanishing[:, 0]
    )


def triangulate(camera: Camera, projector: Projector, image: np.ndarray, beam: np.ndarray):
    """Points in mm (..., 3) of spots at image coordinates (..., 2) of known beams."""
    lines = beam_lines(camera, projector)
    z = 1 / (lines.alpha[beam] * camera.undistort(image)[..., 0] + lines.beta[beam])
    return np.concatenate([camera.normalise(image), np.ones((*z.shape, 1))], axis=-1) * z[..., None]


def line_separation(
    camera: Camera, projector: Projector, z_min: float, z_max: float
) -> tuple[float, float]:
    """Smallest vertical distance in pixels between two beams' lines within z_min .. z_max.

    The first value is over the columns that both beams use, without margin: beams that u-windows
    separate do not count. The second is over the whole mesh, as if there were no u-windows.
    """
    lines = beam_lines(camera, projector)
    far, near = lines.column_at(z_max), lines.column_at(z_min)
    low, high = np.minimum(far, near), np.maximum(far, near)

    def separation(first, second):
        def at(x):
            return (lines.a[:, None] - lines.a) * x + lines.b[:, None] - lines.b

        one, two = at(first), at(second)
        distance = np.where(one * two < 0, 0, np.minimum(np.abs(one), np.abs(two)))
        np.fill_diagonal(distance, np.inf)
        return distance

    first, second = np.maximum(low[:, None], low), np.minimum(high[:, None], high)
    shared = separation(first, second)
    shared[first > second] = np.inf
    return float(shared.min()), float(separation(low.min(), high.max()).min())
