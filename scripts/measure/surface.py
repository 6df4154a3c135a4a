"""The measured surface: where a ray through the picture meets it, and how well that is known."""

from dataclasses import dataclass, field

import numpy as np

from model.errors import UserError
from scripts.measure.kriging import Kriging
from scripts.measure.mesh import triangles
from scripts.results.drift import beam_lines, line_distance
from scripts.results.points import OK

__all__ = ["Picked", "Surface"]

#: Spot noise in px where nothing is known of it, and the least that is believed.
_NOISE_PX, _LEAST_PX = 0.05, 0.01
#: Spots whose noise in the calibration weighs as much as what the frame's own spots show.
_PRIOR_SPOTS = 10


@dataclass(frozen=True)
class Picked:
    """Points on the surface.

    Parameters
    ----------
    xyz : array (n, 3)
        Millimetres.
    inverse_covariance : array (n, n)
        Of their 1/z: spot noise, calibration of the beams, and what lies between them.
    noise_covariance : array (n, n)
        The part of it that differs from frame to frame.
    """

    xyz: np.ndarray
    inverse_covariance: np.ndarray = field(repr=False)
    noise_covariance: np.ndarray = field(repr=False)


class Surface:
    """The ok points of a frame and the triangles between them.

    Between the points 1/z is interpolated so that a plane stays a plane, by kriging: each beam
    says, from how well its neighbours predict it, how much the surface may bend between beams.

    Parameters
    ----------
    points : array of :data:`scripts.results.points.POINT`
        Spots of one frame.
    calibration : :class:`calibration.file.Calibration`
        Of the rig.

    Attributes
    ----------
    frame : :class:`int` or None
        The frame's number, None if it has no spots.
    points : array of :data:`scripts.results.points.POINT`
        Those used: ok, with coordinates.
    xyz : array (n, 3)
        Their coordinates in mm.
    ray : array (n, 2)
        x/z and y/z.
    inverse : array (n,)
        1/z in 1/mm.
    triangle : array (m, 3) of :class:`int`
        See :func:`scripts.measure.mesh.triangles`.
    noise_px : :class:`float`
        Standard deviation of a spot's place along its line, from the spots' distances across.
    """

    def __init__(self, points, calibration):
        self.frame = int(points["frame"][0]) if len(points) else None
        located = points[np.isfinite(points["z"]) & (points["status"] == OK)]
        self.points = located[np.unique(located["beam"], return_index=True)[1]]
        self.calibration = calibration
        self.xyz = np.stack([self.points[name] for name in "xyz"], axis=-1)
        self.inverse = 1 / self.xyz[:, 2]
        self.ray = self.xyz[:, :2] * self.inverse[:, None]
        self.triangle = triangles(self.points["beam"], self.ray, self.inverse, calibration.columns)
        self.noise_px = self._spot_noise()
        self._parts = self._connected()
        self._kriging = {}

    def rays(self, image):
        """x/z and y/z of image coordinates (n, 2); NaN where the lens has no ray."""
        lens = self.calibration.lens
        image = np.asarray(image, float).reshape(-1, 2)
        return np.stack(lens.ray(*lens.undistort(image[:, 0], image[:, 1])), axis=-1)

    def image(self, xyz):
        """Image coordinates (n, 2) of points in mm."""
        lens = self.calibration.lens
        xyz = np.asarray(xyz, float).reshape(-1, 3)
        ray = xyz[:, :2] / xyz[:, 2:]
        return np.stack(lens.distort(ray[:, 0] * lens.focal + lens.principal_x,
                                     ray[:, 1] * lens.focal + lens.principal_y), axis=-1)

    def pick(self, image):
        """The surface at image coordinates.

        Parameters
        ----------
        image : array (n, 2)
            u and v in pixels.

        Returns
        -------
        :class:`Picked`

        Raises
        ------
        UserError
            If there is no surface at one of them.
        """
        image = np.asarray(image, float).reshape(-1, 2)
        ray = self.rays(image)
        triangle = self._triangle_at(ray)
        if (triangle < 0).any():
            u, v = image[np.argmax(triangle < 0)]
            where = "" if self.frame is None else f" in frame {self.frame}"
            raise UserError(f"There is no measured surface at {u:.1f},{v:.1f}{where}: choose a "
                            "point between measured spots.")
        part = self._parts[self.triangle[triangle, 0]]
        inverse = np.zeros(len(ray))
        total, noise = np.zeros((2, len(ray), len(ray)))
        for number in np.unique(part):
            mine = np.flatnonzero(part == number)
            inverse[mine], total[np.ix_(mine, mine)], noise[np.ix_(mine, mine)] = (
                self._field(number).predict(ray[mine]))
        # Kriging may leave the range of the three points around by little only.
        depth = 1 / inverse
        return Picked(np.column_stack([ray, np.ones(len(ray))]) * depth[:, None], total, noise)

    def inverse_variance(self):
        """Variance of each point's 1/z: by spot noise, and by the calibration of its beam."""
        beams = self.calibration.beams
        mine = [beams[beam] for beam in self.points["beam"]]
        alpha = np.array([beam.alpha for beam in mine])
        own = np.array([beam.residual_u**2 / max(beam.planes, 1) for beam in mine])
        # A line over the planes' 1/z: twice the variance of a mean, on average.
        return (alpha * self.noise_px) ** 2, alpha**2 * 2 * own

    def _spot_noise(self):
        budget = self.calibration.budget
        along, across = (budget.get(f"sigma_{axis}_px", _NOISE_PX) for axis in "uv")
        off = line_distance(self.points, self.calibration.lens, beam_lines(self.calibration))
        off = np.abs(off[np.isfinite(off)])
        own = 1.4826 * float(np.median(off)) if len(off) else across
        here = np.sqrt((len(off) * own**2 + _PRIOR_SPOTS * across**2) / (len(off) + _PRIOR_SPOTS))
        ratio = np.clip(along / across, 0.5, 2) if across > 0 else 1.0
        return max(float(here * ratio), _LEAST_PX)

    def _connected(self):
        """A number for each point: equal where triangles connect points."""
        part = np.arange(len(self.points))
        while True:
            least = part[self.triangle].min(axis=1, initial=len(part)) if len(
                self.triangle) else np.zeros(0, int)
            new = part.copy()
            for corner in range(3):
                np.minimum.at(new, self.triangle[:, corner], least)
            new = new[new]
            if (new == part).all():
                return part
            part = new

    def _field(self, number):
        if number not in self._kriging:
            mine = np.flatnonzero(self._parts == number)
            noise, own = self.inverse_variance()
            self._kriging[number] = Kriging(
                self.ray[mine], self.inverse[mine], noise[mine], own[mine])
        return self._kriging[number]

    def _triangle_at(self, ray):
        """The triangle that each ray (n, 2) meets first; -1 where there is none."""
        found = np.full(len(ray), -1)
        if not len(self.triangle):
            return found
        corner = self.ray[self.triangle]  # (m, 3, 2)
        side = corner[:, 1:] - corner[:, :1]
        area = side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0]
        flat = np.abs(area) < 1e-12
        safe = np.where(flat, 1, area)
        off = ray[:, None] - corner[None, :, 0]
        one = (off[..., 0] * side[:, 1, 1] - off[..., 1] * side[:, 1, 0]) / safe
        two = (off[..., 1] * side[:, 0, 0] - off[..., 0] * side[:, 0, 1]) / safe
        inside = (one >= -1e-9) & (two >= -1e-9) & (one + two <= 1 + 1e-9) & ~flat
        inverse = self.inverse[self.triangle]
        here = inverse[:, 0] + one * (inverse[:, 1] - inverse[:, 0]) + two * (
            inverse[:, 2] - inverse[:, 0])
        nearest = np.where(inside, here, -np.inf)
        hit = inside.any(axis=1)
        found[hit] = np.argmax(nearest[hit], axis=1)
        return found
