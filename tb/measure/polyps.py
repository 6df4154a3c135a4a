"""Models of polyps on a wall, and their rims as a hand marks them."""

import numpy as np

from model.optics.scenes import Plane, Polyp

__all__ = ["model_polyp", "true_rim"]


def model_polyp(rng, diameter):
    """A polyp of that longest diameter, 45 to 75 mm away: sessile, or in two of five on a stalk."""
    distance = rng.uniform(45, 75)
    wall = Plane(distance, rng.uniform(0, 15), rng.uniform(0, 360))
    half = diameter / 2
    stalk = 0.0 if rng.random() < 0.6 else rng.uniform(0.1, 0.3) * diameter
    reach = 0.2 * distance
    return Polyp(wall, tuple(rng.uniform(-reach, reach, 2)),
                 (half, half * rng.uniform(0.75, 1), diameter * rng.uniform(0.25, 0.5)),
                 stalk, 0.55 * half, min(0.5, 0.1 * diameter), rng.uniform(0, 180))


def true_rim(rig, polyp, points=12):
    """Image coordinates (points, 2) of the widest section of its head."""
    normal = polyp.wall.normal
    foot = np.array([*polyp.position_mm, 0.0])
    foot[2] = polyp.wall.distance_mm - (foot @ normal) / normal[2]
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(helper, normal)
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    turn = np.radians(polyp.turn_deg)
    along = np.cos(turn) * first + np.sin(turn) * second
    across = np.cross(normal, along)
    angle = np.arange(points) * 2 * np.pi / points
    return rig.camera.project(
        foot - polyp.stalk_mm * normal + polyp.head_mm[0] * np.outer(np.cos(angle), along)
        + polyp.head_mm[1] * np.outer(np.sin(angle), across))
