"""Which beam made which spot of the plane frames, before any epipolar line is known.

The nominal projector predicts every spot of every plane, some pixels off.
:class:`calibration.mesh_search.MeshSearch` looks for the projector that predicts all of them best.
The result is accepted only if no other numbering of the mesh, a row or a column further, is as
good within the tolerances of the nominal values.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from calibration.lines import Observations
from calibration.mesh_search import MeshSearch
from calibration.plane_check import check_plane_distances
from calibration.plane_offset import offset_by_lines
from calibration.projector import Projector, predict
from model.errors import UserError

__all__ = ["Candidates", "Identity", "MeshError", "PlaneSpots", "identify"]

#: Any other numbering must leave so many spots more unexplained, and so large a share of all.
MARGIN_SPOTS = 8
MARGIN_SHARE = 0.01
#: A mesh with a smaller share of usable beams is not the one that was described.
USABLE_SHARE = 0.5
#: A beam found in no more than this share of the planes that should show it may be dead.
_DEAD_SHARE = 1 / 3


class MeshError(UserError):
    """The spots are not those of the nominal mesh."""


@dataclass(frozen=True)
class PlaneSpots:
    """Spots of one plane frame.

    Parameters
    ----------
    name : :class:`str`
        The frame, for messages.
    z_mm : :class:`float`
        Distance of the plane.
    u, v, x, y : arrays of :class:`float`
        Centres in image coordinates and undistorted, px.
    area : array of :class:`int`
        Areas in pixels.
    level : :class:`float`
        Grey values from which on a pixel was lit: above the local mean, or in the preset ``paper``
        above 0.
    """

    name: str
    z_mm: float
    u: np.ndarray
    v: np.ndarray
    x: np.ndarray
    y: np.ndarray
    area: np.ndarray
    level: float = 0


@dataclass(frozen=True)
class Identity:
    """Result of :func:`identify`.

    Parameters
    ----------
    projector : :class:`calibration.projector.Projector`
        The fitted mesh.
    beams : tuple of arrays of :class:`int`
        For each plane the beam of each spot, -1 for none.
    rms_px : :class:`float`
        Distance of the assigned spots from the fitted mesh.
    matched : :class:`float`
        Share of the predicted spots inside the picture that were found.
    margin : :class:`float`
        Number of spots that the next best numbering leaves unexplained in addition; inf if the
        tolerances allow no other.
    expected : array (beams,) of :class:`int`
        Number of distances at which the fitted mesh has each beam's spot inside the picture; 0 for
        dead beams.
    offset_mm : :class:`float`
        What was added to the distances.
    """

    projector: Projector
    beams: tuple
    rms_px: float
    matched: float
    margin: float
    expected: np.ndarray
    offset_mm: float


def _check_border(search, vector, beams):
    """Refuse spots that continue the mesh beyond a border.

    The mesh is then numbered wrongly, or larger than capture.toml says.
    """
    rows, columns = search.nominal.rows, search.nominal.columns
    row, column = np.arange(-1, rows + 1) - (rows - 1) / 2, np.arange(-1, columns + 1) - (
        columns - 1) / 2
    sides = {
        "above row 0": (np.full(columns, row[0]), column[1:-1]),
        f"below row {rows - 1}": (np.full(columns, row[-1]), column[1:-1]),
        "left of column 0": (row[1:-1], np.full(rows, column[0])),
        f"right of column {columns - 1}": (row[1:-1], np.full(rows, column[-1]))}
    for side, (side_row, side_column) in sides.items():
        found = expected = 0
        for plane, (spots, beam) in enumerate(zip(search.positions, beams, strict=True)):
            virtual = predict(search.lens, side_row, side_column, vector, search.inverse_z[plane])
            virtual = virtual[search.inside(virtual)]
            expected += len(virtual)
            if (beam < 0).any() and len(virtual):
                distance, _ = cKDTree(spots[beam < 0]).query(virtual)
                found += int((distance < 3.0).sum())
        if found >= MARGIN_SPOTS and found > 0.5 * expected:
            raise UserError(
                f"The spots of the plane frames continue the {rows} x {columns} mesh {side}: "
                "correct rows and columns, or toe_in_deg and the other nominal values, in "
                "capture.toml.")


def _shifted(beams, rows, columns, by_row, by_column):
    """Beams numbered some rows and columns further, -1 where that leaves the mesh."""
    row, column = np.divmod(beams, columns)
    row, column = row + by_row, column + by_column
    good = (beams >= 0) & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    return np.where(good, row * columns + column, -1)


class Candidates:
    """Projectors that a :class:`MeshSearch` has found, each with its numbering and cost."""

    def __init__(self, search):
        self.search, self.found = search, {}
        for start in search.coarse():
            self.keep(*search.refine(start))

    def keep(self, vector, beams):
        """Remember a projector, the best one of those with the same numbering."""
        key = np.concatenate(beams).tobytes()
        cost = self.search.cost(vector, beams)
        if key not in self.found or cost < self.found[key][0]:
            self.found[key] = (cost, vector, beams)

    def best(self):
        """Cost, vector and beams with the smallest cost."""
        return min(self.found.values(), key=lambda item: item[0])

    def offset(self):
        """Constant error of the distances in mm, for the best numbering; zero if uncertain.

        Raises :class:`UserError` if a single distance is wrong.
        """
        search, ((_, count, missing), _, beams) = self.search, self.best()
        beam = np.concatenate(beams)
        own = beam >= 0
        if count < max(missing, 3 * search.nominal.beams):
            return 0.0
        distances = np.unique([plane.z_mm for plane in search.planes])
        plane = np.repeat(np.searchsorted(distances, [plane.z_mm for plane in search.planes]),
                          [len(each) for each in beams])
        observations = Observations(
            np.arange(search.nominal.beams), beam[own], plane[own], search.all_inverse_z[own],
            *search.all_positions[own].T)
        check_plane_distances(observations, search.planes)
        return offset_by_lines(observations).correction_mm


def identify(planes, nominal, lens, scale_sigma=0.0, dead=()):
    """Assign every spot of the plane frames to its beam.

    Raises :class:`UserError` if no projector near the nominal one explains the spots, or if the
    mesh could as well be numbered a row or a column further. A constant error of the distances is
    taken out first.

    Parameters
    ----------
    planes : sequence of :class:`PlaneSpots`
        Spots of all plane frames.
    nominal : :class:`calibration.projector.Projector`
        Nominal projector; right to about 3 % and 1 degree.
    lens : :class:`calibration.lens.Lens`
        Lens already calibrated.
    scale_sigma : :class:`float`
        Standard deviation of its focal length, a share of it.
    dead : iterable of :class:`int`
        Beams that have no spots.

    Returns
    -------
    :class:`Identity`
    """
    candidates = Candidates(MeshSearch(planes, nominal, lens, scale_sigma, dead))
    offset = candidates.offset()
    if offset:
        # Of distances that are wrong by a constant, a projector too far away makes the best.
        candidates = Candidates(MeshSearch(
            [replace(plane, z_mm=plane.z_mm + offset) for plane in planes], nominal, lens,
            scale_sigma, dead))
    search, found, keep = candidates.search, candidates.found, candidates.keep
    (cost, count, _), vector, beams = candidates.best()
    rms, matched, expected = _fit(search, vector, beams, count)
    _check_border(search, vector, beams)
    if not search.within(vector):
        raise MeshError(
            f"The spots of the plane frames fit only a projector too far from the nominal one "
            f"({_differences(search, vector)}; at most {search.turn_deg:.1f} degrees and "
            f"{search.relative:.0%} are believed): correct [projector] in capture.toml.")

    # The same spots, numbered a row or a column further: does a believable projector fit?
    steps = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]
    for step in steps:
        moved = [_shifted(beam, nominal.rows, nominal.columns, *step) for beam in beams]
        if sum((beam >= 0).sum() for beam in moved) < 0.5 * count:
            continue
        shifted = search.solve(vector, moved, 3.0)
        again = search.assign(shifted, 3.0)
        keep(search.solve(shifted, again, 3.0), again)
    others = [
        other for (other, *_), candidate, numbered in found.values()
        if search.within(candidate)
        and np.mean(np.concatenate(numbered) == np.concatenate(beams)) < 0.5]
    margin = min(others, default=float("inf")) - cost
    if margin < max(MARGIN_SPOTS, MARGIN_SHARE * count):
        raise MeshError(
            "The beams of the plane frames cannot be told from their neighbours: numbered a row or "
            "a column further they fit the nominal projector as well. Give its angles in "
            "capture.toml more exactly, or show a border of the mesh in the picture.")
    return Identity(projector=nominal.with_parameters(vector), beams=tuple(beams), rms_px=rms,
                    matched=matched, margin=margin, expected=expected, offset_mm=offset)


def _fit(search, vector, beams, count):
    """RMS distance in px, share of matched spots and distances that should show each beam.

    Refuses a mesh that is not there. Beams that are hardly ever found may be dead: the share of the
    spots is that of the others, which must be most of the mesh.
    """
    nominal, planes = search.nominal, search.planes
    inside = search.alive & np.array([search.inside(search.predict(vector, plane))
                                      for plane in range(len(planes))])
    found = np.array([np.isin(np.arange(nominal.beams), beam) for beam in beams])
    shown = inside.sum(axis=0)
    alive = (found & inside).sum(axis=0) > _DEAD_SHARE * shown
    predicted = int(inside[:, alive].sum())
    matched = min(int((found & inside)[:, alive].sum()) / max(predicted, 1), 1.0)
    rms = float(np.sqrt(np.mean(np.sum(search.residuals(vector, beams) ** 2, axis=1)))
                ) if count else float("inf")
    if count < 8 or matched < 0.6 or alive.sum() < USABLE_SHARE * (shown > 0).sum():
        predicted = int(inside.sum())
        raise MeshError(
            f"The spots of the plane frames do not form the nominal {nominal.rows} x "
            f"{nominal.columns} mesh (only {count} of {predicted} expected spots are where a "
            "projector like that puts them): check [projector] in capture.toml and z_mm in "
            "planes.csv, or set another threshold.")
    distances = np.array([plane.z_mm for plane in planes])
    expected = np.array([len(np.unique(distances[column])) for column in inside.T])
    return rms, matched, expected


def _differences(search, vector):
    """The parameters beyond their limits, in words."""
    words = []
    names = ("x of base_mm", "y of base_mm", "z of base_mm", "pitch_deg", "rotation_deg",
             "toe_in_deg", "tilt")
    for name, value, start, limit in zip(names, vector, search.start, search.limit, strict=True):
        if abs(value - start) > limit:
            if name in names[4:]:
                # The vector's toe-in is signed the other way for a projector on the right.
                side = -1 if name == "toe_in_deg" and search.nominal.base_mm[0] > 0 else 1
                words.append(f"{name} {side * np.degrees(value - start):+.1f} degrees")
            elif name == "pitch_deg":
                words.append(f"{name} {value / start - 1:+.1%}")
            else:
                words.append(f"{name} {value - start:+.2f} mm")
    return ", ".join(words)
