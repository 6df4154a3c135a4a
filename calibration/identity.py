"""Which beam made which spot of the plane frames, before any epipolar line is known.

The nominal projector predicts every spot of every plane, some pixels off. All planes together are
searched for the projector that predicts them best, first coarsely by distance maps, then by least
squares with the spots assigned anew each time. The result is accepted only if no other numbering
of the mesh, a row or a column further, is as good within the tolerances of the nominal values.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial import cKDTree

from model.errors import UserError

__all__ = ["Identity", "PlaneSpots", "Projector", "identify"]

#: How far the fitted projector may lie from the nominal one. The nominal values are promised to
#: 3 % and 1 degree; a numbering that needs more than this is not believed.
TOLERANCE_ANGLE_DEG = 1.6
TOLERANCE_RELATIVE = 0.06

#: Any other numbering must leave so many spots more unexplained, and so large a share of all.
MARGIN_SPOTS = 8
MARGIN_SHARE = 0.01

_HALF = 320          # distance maps cover +-320 px about the image centre
_REACH = 20.0        # a predicted spot farther than this from any real one is simply missing


@dataclass(frozen=True)
class Projector:
    """Laser and diffraction head: a mesh of straight beams from one point, seen by the camera.

    Beam = row * columns + column. Before rotation its direction is ((column - middle) tan(pitch),
    (row - middle) tan(pitch), 1); the mesh is turned by ``rotation_deg`` about its own axis (x
    towards y), by ``tilt_deg`` about x and by ``toe_in_deg`` about y, towards the camera's axis.

    Parameters
    ----------
    rows, columns : :class:`int`
        Size of the mesh.
    pitch_deg, rotation_deg, toe_in_deg, tilt_deg : :class:`float`
        Angles in degrees.
    base_mm : tuple of three :class:`float`
        The common origin of the beams, from the camera's pinhole, in millimetres.
    """

    rows: int
    columns: int
    pitch_deg: float
    rotation_deg: float
    toe_in_deg: float
    base_mm: tuple
    tilt_deg: float = 0.0

    @property
    def beams(self):
        """How many beams there are."""
        return self.rows * self.columns

    def slopes(self):
        """dx/dz and dy/dz of every beam: array (beams, 2)."""
        row, column = np.divmod(np.arange(self.beams), self.columns)
        return _slopes(row - (self.rows - 1) / 2, column - (self.columns - 1) / 2,
                       self._vector())

    def _vector(self):
        side = -1 if self.base_mm[0] > 0 else 1
        return np.array([*self.base_mm, np.tan(np.radians(self.pitch_deg)),
                         *np.radians([self.rotation_deg, side * self.toe_in_deg, self.tilt_deg])])

    def _with(self, vector):
        side = -1 if self.base_mm[0] > 0 else 1
        rotation, toe_in, tilt = np.degrees(vector[4:7])
        return replace(self, base_mm=tuple(float(value) for value in vector[:3]),
                       pitch_deg=float(np.degrees(np.arctan(vector[3]))),
                       rotation_deg=float(rotation), toe_in_deg=float(side * toe_in),
                       tilt_deg=float(tilt))


def _slopes(row, column, vector):
    """Slopes of the beams of an array of parameter vectors (..., 7): (..., beams, 2)."""
    pitch, rotation, toe_in, tilt = np.moveaxis(np.asarray(vector)[..., 3:7, None], -2, 0)
    x, y = column * pitch, row * pitch
    x, y = np.cos(rotation) * x - np.sin(rotation) * y, np.sin(rotation) * x + np.cos(rotation) * y
    y, z = y * np.cos(tilt) + np.sin(tilt), np.cos(tilt) - y * np.sin(tilt)
    x, z = x * np.cos(toe_in) + z * np.sin(toe_in), z * np.cos(toe_in) - x * np.sin(toe_in)
    return np.stack([x / z, y / z], axis=-1)


def _predict(lens, row, column, vector, inverse_z):
    """Undistorted places of the beams at 1/z, one for all or one each: (..., beams, 2)."""
    slope = _slopes(row, column, vector)
    vector = np.asarray(vector)
    base, back = vector[..., None, :2], vector[..., None, 2:3]
    place = slope + (base - back * slope) * np.atleast_1d(inverse_z)[:, None]
    return place * lens.focal + np.array([lens.principal_x, lens.principal_y])


@dataclass(frozen=True)
class PlaneSpots:
    """Spots of one plane frame: its name, distance, image and undistorted centres, areas."""

    name: str
    z_mm: float
    u: np.ndarray
    v: np.ndarray
    x: np.ndarray
    y: np.ndarray
    area: np.ndarray
    level: int = 0


@dataclass(frozen=True)
class Identity:
    """Result of :func:`identify`.

    Parameters
    ----------
    projector : :class:`Projector`
        The fitted mesh.
    beams : tuple of arrays of :class:`int`
        For each plane the beam of each spot, -1 for none.
    rms_px : :class:`float`
        Distance of the assigned spots from the fitted mesh.
    matched : :class:`float`
        Share of the predicted spots inside the picture that were found.
    margin : :class:`float`
        How many spots more the next best numbering leaves unexplained; inf if there is none that
        the tolerances allow.
    """

    projector: Projector
    beams: tuple
    rms_px: float
    matched: float
    margin: float


class _Search:
    """The plane frames, ready to be compared with predicted meshes."""

    def __init__(self, planes, nominal, lens):
        self.planes, self.nominal, self.lens = planes, nominal, lens
        row, column = np.divmod(np.arange(nominal.beams), nominal.columns)
        self.row, self.column = row - (nominal.rows - 1) / 2, column - (nominal.columns - 1) / 2
        self.places = [np.stack([plane.x, plane.y], axis=-1) for plane in planes]
        self.trees = [cKDTree(place) for place in self.places]
        self.inverse_z = np.array([1 / plane.z_mm for plane in planes])
        self.all_places = np.concatenate(self.places)
        self.all_inverse_z = np.repeat(self.inverse_z, [len(place) for place in self.places])
        self.start = nominal._vector()
        base = float(np.linalg.norm(nominal.base_mm))
        angle = np.radians(TOLERANCE_ANGLE_DEG)
        self.limit = np.array([TOLERANCE_RELATIVE * base] * 3
                              + [TOLERANCE_RELATIVE * self.start[3], angle, angle, angle])

    def predict(self, vector, plane):
        return _predict(self.lens, self.row, self.column, vector, self.inverse_z[plane])

    def inside(self, place):
        u, v = self.lens.distort(place[..., 0], place[..., 1])
        return (u > 2) & (u < self.lens.width - 3) & (v > 2) & (v < self.lens.height - 3)

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
            spots = np.rint(self.places[plane]).astype(int) + _HALF
            spots = spots[((spots >= 0) & (spots < 2 * _HALF)).all(axis=1)]
            empty[spots[:, 1], spots[:, 0]] = 0
            distance = np.minimum(cv2.distanceTransform(empty, cv2.DIST_L2, 5), _REACH)
            place = self.predict(vectors, plane)
            seen = self.inside(place)
            pixel = np.clip(np.rint(place).astype(int) + _HALF, 0, 2 * _HALF - 1)
            cost += (distance[pixel[..., 1], pixel[..., 0]] * seen).sum(axis=1)
            count += seen.sum(axis=1)
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
        for plane, (place, tree) in enumerate(zip(self.places, self.trees, strict=True)):
            predicted = self.predict(vector, plane)
            beam = np.full(len(place), -1)
            if len(place):
                distance, spot = tree.query(predicted)
                back, nearest = cKDTree(predicted).query(place)
                mutual = (nearest[spot] == np.arange(len(predicted))) & (distance <= gate)
                beam[spot[mutual]] = np.flatnonzero(mutual)
            beams.append(beam)
        return beams

    def residuals(self, vector, beams):
        return self._residuals(vector, *self._gather(beams))

    def _gather(self, beams):
        beam = np.concatenate(beams)
        used = beam >= 0
        return (self.row[beam[used]], self.column[beam[used]], self.all_inverse_z[used],
                self.all_places[used])

    def _residuals(self, vector, row, column, inverse_z, place):
        return _predict(self.lens, row, column, vector, inverse_z) - place

    def solve(self, vector, beams, gate):
        """Robust least squares (Levenberg and Marquardt, in units of the limits).

        The nominal values weigh in weakly, for what the planes do not tell.
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
        """Assign and solve until nothing changes, with a narrowing gate."""
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
        """Unexplained spots, and how many are assigned and missing.

        A beam without its spot and a spot without a beam count one each, an assigned one by its
        squared distance, 3 px making one.
        """
        square = np.sum(self.residuals(vector, beams) ** 2)
        count = missing = 0
        for plane, beam in enumerate(beams):
            inside = self.inside(self.predict(vector, plane))
            missing += inside.sum() - inside[beam[beam >= 0]].sum() + (beam < 0).sum()
            count += (beam >= 0).sum()
        return float(square / 9 + missing), int(count), int(missing)

    def within(self, vector):
        return bool(np.all(np.abs(vector - self.start) <= self.limit))


def _check_border(search, vector, beams):
    """Refuse spots that continue the mesh beyond a border: then it is numbered wrongly, or larger
    than it is said to be."""
    rows, columns = search.nominal.rows, search.nominal.columns
    row, column = np.arange(-1, rows + 1) - (rows - 1) / 2, np.arange(-1, columns + 1) - (
        columns - 1) / 2
    sides = {
        "above row 0": (np.full(columns, row[0]), column[1:-1]),
        f"below row {rows - 1}": (np.full(columns, row[-1]), column[1:-1]),
        "left of column 0": (row[1:-1], np.full(rows, column[0])),
        f"right of column {columns - 1}": (row[1:-1], np.full(rows, column[-1]))}
    for side, (side_row, side_column) in sides.items():
        seen = expected = 0
        for plane, (place, beam) in enumerate(zip(search.places, beams, strict=True)):
            virtual = _predict(search.lens, side_row, side_column, vector, search.inverse_z[plane])
            virtual = virtual[search.inside(virtual)]
            expected += len(virtual)
            if (beam < 0).any() and len(virtual):
                distance, _ = cKDTree(place[beam < 0]).query(virtual)
                seen += int((distance < 3.0).sum())
        if seen >= MARGIN_SPOTS and seen > 0.5 * expected:
            raise UserError(
                f"The spots of the plane frames continue the {rows} x {columns} mesh {side}: "
                "correct rows and columns, or toe_in_deg and the other nominal values, in "
                "capture.toml.")


def _shifted(beams, rows, columns, by_row, by_column):
    row, column = np.divmod(beams, columns)
    row, column = row + by_row, column + by_column
    good = (beams >= 0) & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    return np.where(good, row * columns + column, -1)


def identify(planes, nominal, lens):
    """Assign every spot of the plane frames to its beam.

    Raises :class:`UserError` if no projector near the nominal one explains the spots, or if the
    mesh could as well be numbered a row or a column further.

    Parameters
    ----------
    planes : sequence of :class:`PlaneSpots`
        Spots of all plane frames.
    nominal : :class:`Projector`
        Nominal projector; right to about 3 % and 1 degree.
    lens : :class:`calibration.lens.Lens`
        Lens already calibrated.

    Returns
    -------
    :class:`Identity`
    """
    search = _Search(planes, nominal, lens)
    found = {}

    def keep(vector, beams):
        key = np.concatenate(beams).tobytes()
        cost = search.cost(vector, beams)
        if key not in found or cost < found[key][0]:
            found[key] = (cost, vector, beams)

    for start in search.coarse():
        keep(*search.refine(start))
    (cost, count, _), vector, beams = min(found.values(), key=lambda item: item[0])
    predicted = sum(int(search.inside(search.predict(vector, plane)).sum())
                    for plane in range(len(planes)))
    matched = min(count / max(predicted, 1), 1.0)
    rms = float(np.sqrt(np.mean(np.sum(search.residuals(vector, beams) ** 2, axis=1)))
                ) if count else float("inf")
    if count < 8 or matched < 0.6:
        raise UserError(
            f"The spots of the plane frames do not form the nominal {nominal.rows} x "
            f"{nominal.columns} mesh (only {count} of {predicted} expected spots are where a "
            "projector like that puts them): check [projector] in capture.toml and z_mm in "
            "planes.csv, or set another threshold.")
    _check_border(search, vector, beams)
    fitted = nominal._with(vector)
    if not search.within(vector):
        raise UserError(
            f"The spots of the plane frames fit only a projector too far from the nominal one "
            f"({_differences(search, vector)}; at most {TOLERANCE_ANGLE_DEG} degrees and "
            f"{TOLERANCE_RELATIVE:.0%} are believed): correct [projector] in capture.toml.")

    # The same spots, numbered a row or a column further: does a believable projector fit?
    others = []
    steps = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]
    for step in steps:
        moved = [_shifted(beam, nominal.rows, nominal.columns, *step) for beam in beams]
        if sum((beam >= 0).sum() for beam in moved) < 0.5 * count:
            continue
        shifted = search.solve(vector, moved, 3.0)
        again = search.assign(shifted, 3.0)
        keep(search.solve(shifted, again, 3.0), again)
    for (other, *_), candidate, numbered in found.values():
        same = np.concatenate(numbered) == np.concatenate(beams)
        if same.mean() < 0.5 and search.within(candidate):
            others.append(other)
    margin = min(others, default=float("inf")) - cost
    if margin < max(MARGIN_SPOTS, MARGIN_SHARE * count):
        raise UserError(
            "The beams of the plane frames cannot be told from their neighbours: numbered a row or "
            "a column further they fit the nominal projector as well. Give its angles in "
            "capture.toml more exactly, or show a border of the mesh in the picture.")
    return Identity(projector=fitted, beams=tuple(beams), rms_px=rms, matched=matched,
                    margin=margin)


def _differences(search, vector):
    """The parameters beyond their limits, in words."""
    words = []
    names = ("base x", "base y", "base z", "pitch", "rotation", "toe-in", "tilt")
    for name, value, start, limit in zip(names, vector, search.start, search.limit, strict=True):
        if abs(value - start) > limit:
            if name in names[4:]:
                words.append(f"{name} {np.degrees(value - start):+.1f} degrees")
            elif name == "pitch":
                words.append(f"pitch {value / start - 1:+.1%}")
            else:
                words.append(f"{name} {value - start:+.2f} mm")
    return ", ".join(words)
