"""The best rotation of a mesh that is still to be made, from a rig's nominal values.

Every beam has an epipolar line. Lines of a mesh that stands square to the base coincide row by row;
turning it moves them apart. The farther apart they are where spots of both can be, the more a spot
may be off its line, and the fewer highlights are taken for one.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibration.lens import Lens
from calibration.projector import beam_slopes, predict
from calibration.tables import (
    SEPARATION_PX,
    TOLERANCE_PX,
    separations,
    spot_columns,
    widest_tolerance,
    window_columns,
)
from hdl.protocol import MOST_BEAMS, fraction_bits
from model.errors import UserError

__all__ = ["Plan", "plan_mesh"]

#: Rotations that are tried, degrees: a square mesh looks the same after a quarter turn.
_STEP_DEG = 0.25
#: Distances at which beams have to be inside the picture.
_DISTANCES = 9
#: Share of the most beams that a rotation has to keep in the picture.
_KEPT = 0.95
#: Alternatives are at least so many degrees apart.
_APART_DEG = 2.0


@dataclass(frozen=True)
class Plan:
    """A mesh in one rotation, as the camera would see it.

    Parameters
    ----------
    projector : :class:`calibration.projector.Projector`
        The mesh.
    separation_px : :class:`float`
        Smallest vertical distance between two epipolar lines where spots of both can be; inf if
        there is no such place.
    always, sometimes : :class:`int`
        Beams that are inside the picture at every distance of the range, and at some.
    pitch_px : :class:`float`
        Smallest distance between two spots of a flat target, at any distance of the range.
    chance : :class:`float`
        Share of the picture in which a random highlight is taken for a beam.
    """

    projector: object
    separation_px: float
    always: int
    sometimes: int
    pitch_px: float
    chance: float

    @property
    def usable(self):
        """Whether the lines are far enough apart for the calibration to accept the mesh."""
        return self.separation_px >= SEPARATION_PX


def _judge(projector, lens, z_min, z_max):
    """The :class:`Plan` of a projector. The lens has no distortion and the picture's size."""
    vector = projector.parameters()
    row, column = projector.positions()
    slope = beam_slopes(row, column, vector)
    # In undistorted pixels a beam's spot is at p + q / z, r + s / z.
    p, r = lens.focal * slope[:, 0] + lens.principal_x, lens.focal * slope[:, 1] + lens.principal_y
    q, s = (lens.focal * (vector[axis] - vector[2] * slope[:, axis]) for axis in (0, 1))
    half = np.array([lens.width - 1, lens.height - 1]) / 2
    spots = np.stack([predict(lens, row, column, vector, inverse)
                      for inverse in np.linspace(1 / z_max, 1 / z_min, _DISTANCES)])
    inside = (np.abs(spots) <= half).all(axis=-1)
    seen = inside.any(axis=0)
    if seen.sum() < 2:
        return None
    spots[~inside] = np.nan
    a, alpha, beta = (s / q)[seen], (1 / q)[seen], (-p / q)[seen]
    b = r[seen] - a * p[seen]
    low, high = window_columns(alpha, beta, z_min, z_max)
    low, high = np.maximum(low, -half[0]), np.minimum(high, half[0])
    distance = separations(a, b, low, high, *spot_columns(alpha, beta, z_min)).min(axis=1)
    tolerance = np.minimum(np.minimum(distance / 2, TOLERANCE_PX), widest_tolerance(
        fraction_bits(lens.width, lens.height)))
    share = (2 * tolerance * np.maximum(high - low, 0)).sum() / (lens.width * lens.height)
    pitch = np.inf
    mesh = spots.reshape(len(spots), projector.rows, projector.columns, 2)
    for axis in (1, 2):
        step = np.hypot(*np.moveaxis(np.diff(mesh, axis=axis), -1, 0))
        if np.isfinite(step).any():
            pitch = min(pitch, float(np.nanmin(step)))
    return Plan(projector, float(distance.min()), int(inside.all(axis=0).sum()), int(seen.sum()),
                pitch, float(share))


def plan_mesh(width, height, focal_px, projector, z_min, z_max):
    """Rotations of a mesh, the best first.

    A square mesh is turned by less than a quarter, another one by less than a half turn. Rotations
    that lose more than one beam in twenty of those that the best one keeps in the picture come
    last; the others are ordered by the separation of their lines.

    Parameters
    ----------
    width, height : :class:`int`
        Sensor, pixels.
    focal_px : :class:`float`
        Nominal focal length, px.
    projector : :class:`calibration.projector.Projector`
        The mesh in any rotation.
    z_min, z_max : :class:`float`
        Depth range, mm.

    Returns
    -------
    list of :class:`Plan`
        Up to four, at least two degrees apart.

    Raises
    ------
    :class:`model.errors.UserError`
        If the mesh has one beam or more than :data:`hdl.protocol.MOST_BEAMS`, if the range is
        empty, or if no rotation shows two beams.
    """
    if not 2 <= projector.beams <= MOST_BEAMS:
        raise UserError(f"A mesh of {projector.rows} x {projector.columns} beams cannot be "
                        f"planned: name one of 2 to {MOST_BEAMS} beams.")
    if not z_min < z_max:
        raise UserError(f"The depth range from {z_min:g} to {z_max:g} mm is empty: name a smaller "
                        "--depth-min or a larger --depth-max.")
    lens = Lens(width, height, focal_px, (width - 1) / 2, (height - 1) / 2)
    turn = 90 if projector.rows == projector.columns else 180
    plans = [_judge(replace(projector, rotation_deg=float(angle)), lens, z_min, z_max)
             for angle in np.arange(0, turn, _STEP_DEG)]
    plans = [plan for plan in plans if plan is not None]
    if not plans:
        raise UserError("No rotation of the mesh brings two beams into the picture: correct "
                        "pitch_deg, toe_in_deg and base_mm in capture.toml.")
    most = max(plan.always for plan in plans)
    plans.sort(key=lambda plan: (plan.always < _KEPT * most, -plan.separation_px))
    chosen = []
    for plan in plans:
        angle = plan.projector.rotation_deg
        apart = [abs(angle - other.projector.rotation_deg) for other in chosen]
        if all(min(step, turn - step) >= _APART_DEG for step in apart):
            chosen.append(plan)
        if len(chosen) == 4:
            break
    return chosen
