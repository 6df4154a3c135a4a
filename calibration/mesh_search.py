"""The search for the projector that predicts the spots of all plane frames best.

First coarsely, by distance maps over a grid of projectors around the nominal one; then by least
squares, with the spots assigned to beams anew in each round.
"""

import cv2
import numpy as np
from scipy.spatial import cKDTree

from calibration.projector import predict

__all__ = ["TOLERANCE_ANGLE_DEG", "TOLERANCE_RELATIVE", "MeshSearch"]

#: How far the fitted projector may lie from the nominal one. The nominal values are promised to
#: 3 % and 1 degree; a numbering that needs more than this is not believed.
TOLERANCE_ANGLE_DEG = 1.6
TOLERANCE_RELATIVE = 0.06
#: How far the photographs may put the principal point wrongly, px. It turns the mesh with it, by
#: an angle that counts where the focal length is short: 1.4 degrees at 80 px.
_PRINCIPAL_PX = 2.0

#: Standard deviations of the lens's scale that are allowed for.
_SCALE_SIGMAS = 2.5
#: Limit of the base along the axis, a share of its length.
_BASE_ALONG = 0.12

_HALF = 320          # distance maps cover +-320 px about the image centre
_REACH = 20.0        # a predicted spot farther than this from any real one is simply missing


class MeshSearch:
    """The plane frames, ready to be compared with predicted meshes.

    A *vector* is what :meth:`calibration.projector.Projector.parameters` gives; *beams* are, for
    each plane, the beam of each spot, -1 for none.

    Parameters
    ----------
    planes : sequence of :class:`calibration.identity.PlaneSpots`
        Spots of all plane frames.
    nominal : :class:`calibration.projector.Projector`
        Where the search starts.
    lens : :class:`calibration.lens.Lens`
        Lens already calibrated.
    scale_sigma : :class:`float`
        Standard deviation of its focal length, a share of it: pitch and base may be off as much.
    dead : iterable of :class:`int`
        Beams that have no spots.

    Attributes
    ----------
    alive : array (beams,) of :class:`bool`
        Whether a beam may have spots.
    start : array (7,)
        The nominal vector.
    limit : array (7,)
        How far a vector may be from it.
    relative : :class:`float`
        That limit for base and pitch, a share.
    turn_deg : :class:`float`
        That limit for toe-in and tilt, in degrees.
    """

    def __init__(self, planes, nominal, lens, scale_sigma=0.0, dead=()):
        self.planes, self.nominal, self.lens = planes, nominal, lens
        self.row, self.column = nominal.positions()
        self.alive = ~np.isin(np.arange(nominal.beams), list(dead))
        self.positions = [np.stack([plane.x, plane.y], axis=-1) for plane in planes]
        self.trees = [cKDTree(spots) for spots in self.positions]
        self.inverse_z = np.array([1 / plane.z_mm for plane in planes])
        self.all_positions = np.concatenate(self.positions)
        self.all_inverse_z = np.repeat(self.inverse_z, [len(spots) for spots in self.positions])
        self.start = nominal.parameters()
        base = float(np.linalg.norm(nominal.base_mm))
        self.turn_deg = max(
            TOLERANCE_ANGLE_DEG, 1 + float(np.degrees(np.arctan(_PRINCIPAL_PX / lens.focal))))
        turn = np.radians(self.turn_deg)
        self.relative = float(np.hypot(TOLERANCE_RELATIVE, _SCALE_SIGMAS * scale_sigma))
        # A wrong lens looks like a projector farther along the axis.
        along = max(self.relative, _BASE_ALONG)
        self.limit = np.array([
            self.relative * base, self.relative * base, along * base,
            self.relative * self.start[3], np.radians(TOLERANCE_ANGLE_DEG), turn, turn])

    def predict(self, vector, plane):
        """Undistorted positions of all beams in one plane, px: (..., beams, 2)."""
        return predict(self.lens, self.row, self.column, vector, self.inverse_z[plane])

    def inside(self, position):
        """Whether undistorted positions (..., 2) appear in the usable image, off its border."""
        u, v = self.lens.distort(position[..., 0], position[..., 1])
        valid = self.lens.valid(position[..., 0], position[..., 1])
        return valid & (u > 2) & (u < self.lens.width - 3) & (v > 2) & (v < self.lens.height - 3)

    def coarse(self):
        """Starting vectors, best first, by the mean distance of predictions to real spots."""
        angles = np.radians(np.linspace(-1.2, 1.2, 7))
        grid = np.meshgrid(angles, angles, np.radians([-0.8, 0, 0.8]),
                           [-0.04, -0.02, 0, 0.02, 0.04], [-0.03, 0, 0.03], indexing="ij")
        rotation, toe_in, tilt, pitch, base = (axis.ravel() for axis in grid)
        vectors = np.repeat(self.start[None], len(rotation), axis=0)
        vectors[:, :3] *= 1 + base[:, None]
        vectors[:, 3] *= 1 + pitch
        vectors[:, 4:7] += np.stack([rotation, toe_in, tilt], axis=-1)
        if self.nominal.beams * len(vectors) > 1_000_000:
            choice = np.random.default_rng(1).permutation(len(vectors))
            vectors = vectors[choice[:1_000_000 // self.nominal.beams]]

        # A few planes over the range are enough to start from.
        order = np.argsort(self.inverse_z)
        chosen = order[np.unique(np.linspace(0, len(order) - 1, 5).round().astype(int))]
        cost, count = np.zeros(len(vectors)), np.zeros(len(vectors))
        for plane in chosen:
            empty = np.full((2 * _HALF, 2 * _HALF), 255, np.uint8)
            spots = np.rint(self.positions[plane]).astype(int) + _HALF
            spots = spots[((spots >= 0) & (spots < 2 * _HALF)).all(axis=1)]
            empty[spots[:, 1], spots[:, 0]] = 0
            distance = np.minimum(cv2.distanceTransform(empty, cv2.DIST_L2, 5), _REACH)
            predicted = self.predict(vectors, plane)
            visible = self.inside(predicted) & self.alive
            pixel = np.clip(np.rint(predicted).astype(int) + _HALF, 0, 2 * _HALF - 1)
            cost += (distance[pixel[..., 1], pixel[..., 0]] * visible).sum(axis=1)
            count += visible.sum(axis=1)
        cost = np.where(count > 0, cost / np.maximum(count, 1), _REACH)
        best = vectors[np.argsort(cost, kind="stable")]
        starts = []
        for vector in best:
            if all(np.any(np.abs(vector - other) > 0.4 * self.limit) for other in starts):
                starts.append(vector)
            if len(starts) == 4:
                break
        return starts

    def assign(self, vector, gate):
        """Mutual nearest neighbours of prediction and spots within the gate, for each plane."""
        beams = []
        for plane, (spots, tree) in enumerate(zip(self.positions, self.trees, strict=True)):
            predicted = self.predict(vector, plane)
            beam = np.full(len(spots), -1)
            if len(spots):
                distance, spot = tree.query(predicted)
                back, nearest = cKDTree(predicted).query(spots)
                mutual = (nearest[spot] == np.arange(len(predicted))) & (distance <= gate)
                mutual &= self.alive
                beam[spot[mutual]] = np.flatnonzero(mutual)
            beams.append(beam)
        return beams

    def residuals(self, vector, beams):
        """Predicted less real positions of all assigned spots, px: (spots, 2)."""
        return self._residuals(vector, *self._gather(beams))

    def _gather(self, beams):
        beam = np.concatenate(beams)
        used = beam >= 0
        return (self.row[beam[used]], self.column[beam[used]], self.all_inverse_z[used],
                self.all_positions[used])

    def _residuals(self, vector, row, column, inverse_z, position):
        return predict(self.lens, row, column, vector, inverse_z) - position

    def solve(self, vector, beams, gate):
        """Robust least squares (Levenberg and Marquardt, in units of the limits).

        The nominal values have a small weight, for what the planes do not determine.
        """
        spots = self._gather(beams)
        reach = 0.5 * max(1.0, gate / 2)
        steps = np.concatenate([np.zeros((1, 7)), 1e-4 * np.eye(7)]) * self.limit

        def cost(vector):
            error = self._residuals(vector, *spots) / reach
            prior = 0.1 * (vector - self.start) / self.limit
            return reach**2 * 8 * np.sum(np.sqrt(1 + error**2) - 1) + np.sum(prior**2)

        now, damping = cost(vector), 1e-3
        for _ in range(30):
            error = self._residuals(vector + steps, *spots).reshape(8, -1)
            slope = (error[1:] - error[0]) * 1e4
            weight = 4 / np.sqrt(1 + (error[0] / reach) ** 2)
            normal = (slope * weight) @ slope.T + 0.01 * np.eye(7)
            right = (slope * weight) @ error[0] + 0.01 * (vector - self.start) / self.limit
            while True:
                step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), right)
                then = cost(vector + step * self.limit)
                if then < now or damping > 1e6:
                    break
                damping *= 10
            if then >= now:
                break
            vector, gained, now = vector + step * self.limit, now - then, then
            damping = max(damping / 10, 1e-9)
            if gained < 1e-7 * now or np.abs(step).max() < 1e-7:
                break
        return vector

    def refine(self, vector, gate=_REACH):
        """Assign and solve until nothing changes, with a narrowing gate; gives vector and beams."""
        before = None
        for _ in range(25):
            beams = self.assign(vector, gate)
            if sum((beam >= 0).sum() for beam in beams) < 8:
                break
            vector = self.solve(vector, beams, gate)
            now = np.concatenate(beams)
            if before is not None and np.array_equal(now, before) and gate <= 3.0:
                break
            before, gate = now, max(gate * 0.7, 3.0)
        return vector, self.assign(vector, 3.0)

    def cost(self, vector, beams):
        """Unexplained spots, and the numbers of assigned and missing ones.

        A beam without its spot and a spot without a beam count one each, an assigned one by its
        squared distance, 3 px making one.
        """
        square = np.sum(self.residuals(vector, beams) ** 2)
        count = missing = 0
        for plane, beam in enumerate(beams):
            inside = self.inside(self.predict(vector, plane)) & self.alive
            missing += inside.sum() - inside[beam[beam >= 0]].sum() + (beam < 0).sum()
            count += (beam >= 0).sum()
        return float(square / 9 + missing), int(count), int(missing)

    def within(self, vector):
        """Whether a vector is within the tolerances of the nominal values."""
        return bool(np.all(np.abs(vector - self.start) <= self.limit))
