"""Scenes: surfaces at which rays can be cast.

A surface is a function `clearance(points)` (..., 3) -> (...): positive in the free space between
camera and tissue, negative in the tissue, zero on the surface, smooth, and never steeper than
about 1 per mm, so that it bounds the distance to the surface from below or nearly so.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from model.errors import UserError

#: Kinds of scenes that `sequence` makes.
KINDS = ("plane", "tilted", "polyp", "tube", "mixed", "tissue")
#: Kinds of the scenes that the others show in turn.
_IN_TURN = {"mixed": ("plane", "tilted", "polyp", "tube"), "tissue": ("tilted", "polyp", "tube")}


def _unit(vector) -> np.ndarray:
    vector = np.asarray(vector, dtype=float)
    return vector / np.linalg.norm(vector)


@lru_cache(maxsize=64)
def _frame(axis: tuple) -> np.ndarray:
    """A right-handed orthonormal frame (rows) whose last row is `axis`."""
    axis = _unit(axis)
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    first = _unit(np.cross(helper, axis))
    return np.stack([first, np.cross(axis, first), axis])


@dataclass(frozen=True)
class Plane:
    """Plane through (0, 0, distance), its normal tilted by `tilt_deg` towards `azimuth_deg`."""

    distance_mm: float
    tilt_deg: float = 0.0
    azimuth_deg: float = 0.0

    @property
    def normal(self) -> np.ndarray:
        """Unit normal, pointing away from the camera."""
        tilt, azimuth = np.radians(self.tilt_deg), np.radians(self.azimuth_deg)
        return np.array([
            np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)
        ])

    def clearance(self, points: np.ndarray) -> np.ndarray:
        """Distance to the plane, positive on the camera's side."""
        return (np.array([0, 0, self.distance_mm]) - points) @ self.normal


@dataclass(frozen=True)
class Polyp:
    """An ellipsoid on a stalk, on a tilted wall, all smoothly joined.

    `head_mm` are the ellipsoid's half axes: two along the wall, one away from it. A sessile polyp
    has `stalk_mm` = 0: a dome.
    """

    wall: Plane
    position_mm: tuple[float, float] = (0.0, 0.0)
    head_mm: tuple[float, float, float] = (10.0, 8.0, 6.0)
    stalk_mm: float = 4.0
    stalk_radius_mm: float = 4.0
    blend_mm: float = 2.0
    turn_deg: float = 0.0

    def clearance(self, points: np.ndarray) -> np.ndarray:
        """Smooth minimum of the clearances of wall, stalk and head."""
        normal = self.wall.normal
        foot = np.array([*self.position_mm, 0.0])
        foot[2] = self.wall.distance_mm - (foot @ normal) / normal[2]
        first, second, _ = _frame(tuple(normal))
        angle = np.radians(self.turn_deg)
        along = np.cos(angle) * first + np.sin(angle) * second
        across = np.cross(normal, along)
        offset = points - foot
        x, y, height = offset @ along, offset @ across, -(offset @ normal)
        scaled = np.stack([
            x / self.head_mm[0], y / self.head_mm[1], (height - self.stalk_mm) / self.head_mm[2]
        ])
        length = np.sqrt((scaled**2).sum(axis=0) + 1e-12)
        gradient = np.sqrt(
            ((scaled.T / np.asarray(self.head_mm)).T ** 2).sum(axis=0) + 1e-12
        )
        head = length * (length - 1) / gradient
        clearance = _smooth_minimum(height, head, self.blend_mm)
        if self.stalk_mm > 0:
            side = np.sqrt(x * x + y * y + 1e-12) - self.stalk_radius_mm
            stalk = _smooth_maximum(side, height - self.stalk_mm, self.blend_mm / 2)
            clearance = _smooth_minimum(clearance, stalk, self.blend_mm)
        return clearance


@dataclass(frozen=True)
class Tube:
    """A tube around an axis, narrowed by haustral folds: three-sided rings at regular distances.

    `axis_point_mm` is a point of the axis, on a fold, and `axis` its direction.
    """

    axis_point_mm: tuple[float, float, float]
    axis: tuple[float, float, float]
    radius_mm: float = 30.0
    fold_depth_mm: float = 4.0
    fold_pitch_mm: float = 30.0
    fold_width_mm: float = 4.0
    phase_deg: float = 0.0

    def clearance(self, points: np.ndarray) -> np.ndarray:
        """Lower bound of the distance to the wall: the slope of the folds is allowed for."""
        first, second, axis = _frame(tuple(self.axis))
        offset = points - np.asarray(self.axis_point_mm, dtype=float)
        x, y, along = offset @ first, offset @ second, offset @ axis
        radius = np.sqrt(x * x + y * y + 1e-12)
        phase = (along / self.fold_pitch_mm + 0.5) % 1.0 - 0.5
        ridge = np.exp(-0.5 * (phase * self.fold_pitch_mm / self.fold_width_mm) ** 2)
        # Three taeniae hold the wall out: there, the folds are shallow. cos 3 phi without angles.
        turned = np.radians(self.phase_deg)
        cosine, sine = np.cos(turned), np.sin(turned)
        c = (cosine * x - sine * y) / radius
        lobes = 0.7 + 0.3 * (4 * c**3 - 3 * c)
        wall = self.radius_mm - self.fold_depth_mm * ridge * lobes * np.minimum(
            1, radius / self.radius_mm
        )
        return (wall - radius) * 0.75


def _smooth_minimum(one: np.ndarray, two: np.ndarray, width: float) -> np.ndarray:
    """Minimum with its corner rounded over about `width`; infinitely differentiable."""
    if not width:
        return np.minimum(one, two)
    difference = one - two
    return (one + two - np.sqrt(difference**2 + (width / 2) ** 2)) / 2


def _smooth_maximum(one: np.ndarray, two: np.ndarray, width: float) -> np.ndarray:
    return -_smooth_minimum(-one, -two, width)


def cast(scene, origin, directions: np.ndarray, longest_mm: float, step_mm: float) -> np.ndarray:
    """Distance along each ray (n, 3) to the first surface, NaN where there is none.

    Every ray is sampled every `step_mm` and the first change of sign is bisected to the last bits
    of a float64, so the error is far below 1e-6 mm; surfaces thinner than a step may be missed.

    Parameters
    ----------
    origin : array_like of :class:`float`, (3,)
        A point in free space.
    directions : :class:`numpy.ndarray`, (n, 3)
        Unit vectors.
    """
    origin = np.asarray(origin, dtype=float)
    directions = np.atleast_2d(directions)
    samples = np.arange(0, longest_mm + step_mm, step_mm)
    low = np.full(len(directions), np.nan)
    waiting = np.arange(len(directions))
    for start in range(0, len(samples) - 1, 64):
        distance = samples[start:start + 65]
        points = origin + directions[waiting, None] * distance[None, :, None]
        solid = scene.clearance(points) < 0
        hit = solid.any(axis=1)
        low[waiting[hit]] = distance[np.maximum(np.argmax(solid[hit], axis=1) - 1, 0)]
        waiting = waiting[~hit]
        if not len(waiting):
            break
    high = low + step_mm
    found = np.flatnonzero(~np.isnan(low))
    for _ in range(60):
        middle = (low[found] + high[found]) / 2
        solid = scene.clearance(origin + directions[found] * middle[:, None]) < 0
        high[found] = np.where(solid, middle, high[found])
        low[found] = np.where(solid, low[found], middle)
    return (low + high) / 2


def normals(scene, points: np.ndarray, step_mm: float) -> np.ndarray:
    """Unit normals (n, 3) of the surface at `points`, pointing into free space."""
    gradient = np.stack([
        scene.clearance(points + offset) - scene.clearance(points - offset)
        for offset in np.eye(3) * step_mm
    ], axis=-1)
    return gradient / np.linalg.norm(gradient, axis=-1, keepdims=True)


def sequence(kind: str, rig, frames: int, rng: np.random.Generator) -> list:
    """`frames` scenes of a kind for a rig, with every visible beam within its range.

    Planes run through the whole range, at distances other than those of the calibration; the
    others change pose, size and position from frame to frame.
    """
    if kind not in KINDS:
        raise UserError(
            f"There is no scene of the kind '{kind}'; choose one of {', '.join(KINDS)}."
        )
    low, high = rig.range_mm
    turn = _IN_TURN.get(kind, (kind,))
    scenes, steps = [], -(-frames // len(turn))
    for number in range(frames):
        step, which = number // len(turn), turn[number % len(turn)]
        # The frames are spread in 1 / z, with a random part, so that none is a plane of the
        # calibration.
        part = (step + rng.uniform(0.3, 0.7)) / steps
        distance = 1 / (1 / high + part * (1 / low - 1 / high))
        scenes.append(_SCENES[which](rig, distance, rng))
    return scenes


def _plane(rig, distance, rng):
    nearest = np.abs(distance / rig.calibration_planes() - 1).min()
    return Plane(round(distance * (1.004 if nearest < 0.002 else 1), 3))


def _tilted(rig, distance, rng):
    low, high = rig.range_mm
    tilt, azimuth = rng.uniform(10, 35), rng.uniform(0, 360)
    # The mesh's corners must stay within the range: move the plane inwards, then tilt it less.
    reach = rig.reach
    slope = np.tan(np.radians(tilt)) * reach
    slope = min(slope, 0.92 * (high - low) / (high + low))
    distance = float(np.clip(distance, low * (1 + slope) * 1.01, high * (1 - slope) * 0.99))
    return Plane(distance, float(np.degrees(np.arctan(slope / reach))), float(azimuth))


def _polyp(rig, distance, rng):
    low, high = rig.range_mm
    scale = rig.scale
    wall = Plane(
        float(np.clip(distance, low * 1.5, high * 0.88)),
        float(rng.uniform(0, 12)), float(rng.uniform(0, 360)),
    )
    head = scale * rng.uniform([8, 7, 5], [12, 10, 8])
    reach = rig.reach * wall.distance_mm * 0.35
    return Polyp(
        wall, tuple(rng.uniform(-reach, reach, 2)), tuple(head),
        float(scale * rng.choice([0.0, rng.uniform(3, 7)])), float(scale * rng.uniform(3, 5)),
        2.0 * scale, float(rng.uniform(0, 180)),
    )


def _tube(rig, distance, rng):
    low, high = rig.range_mm
    scale = rig.scale
    radius = scale * rng.uniform(28, 32)
    # The camera lies near one wall and looks across, obliquely along the tube.
    angle, azimuth = np.radians(rng.uniform(52, 64)), rng.uniform(0, 2 * np.pi)
    axis = np.array([
        np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)
    ])
    across = _unit(np.array([0, 0, 1]) - axis * axis[2])
    offset = across * (radius - scale * rng.uniform(8, 11))
    along = axis * scale * rng.uniform(0, 30)
    return Tube(
        tuple(offset + along), tuple(axis), radius, scale * rng.uniform(2.5, 4.5),
        scale * rng.uniform(24, 32), scale * rng.uniform(3, 5), float(rng.uniform(0, 360)),
    )


_SCENES = {"plane": _plane, "tilted": _tilted, "polyp": _polyp, "tube": _tube}
