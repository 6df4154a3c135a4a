"""Lenses that the undistortion is tried with, and settings that no lens has."""

import numpy as np

from calibration.undistortion import build
from model.settings import Settings

__all__ = ["LENSES", "lens_settings", "random_settings"]

_FIELDS = ("principal_u", "principal_v", "tangential_1", "tangential_2", "radial")

#: (width, height): focal length, offset of the principal point, k1, k2, p1, p2.
LENSES = {
    "none": ((352, 288), 300, (0, 0), 0, 0, 0, 0),
    "barrel": ((352, 288), 370, (4, -3), -0.35, 0, 0.001, -0.001),
    "wide": ((352, 288), 200, (-5, 5), -0.2, 0.03, -0.001, 0.0005),
    "pincushion": ((352, 288), 150, (8, 2), 0.25, 0.1, 0.003, 0.003),
    "small": ((64, 64), 40, (1, 1), -0.35, 0.12, 0.001, 0.002),
    "large": ((512, 512), 500, (-9, 7), -0.3, 0.05, 0.0005, -0.0005),
}


def lens_settings(name):
    """Settings for a lens of :data:`LENSES`, its sensor's size, its numbers in float."""
    (width, height), focal, offset, *distortion = LENSES[name]
    numbers = (focal, (width - 1) / 2 + offset[0], (height - 1) / 2 + offset[1], *distortion)
    tables = build(*numbers, width, height)
    return Settings(**{key: tables[key] for key in _FIELDS}), (width, height), numbers


def random_settings(seed):
    """Every bit of every register and word at random: all that may wrap wraps."""
    rng = np.random.default_rng(seed)
    return Settings(
        principal_u=int(rng.integers(1 << 18)), principal_v=int(rng.integers(1 << 18)),
        tangential_1=int(rng.integers(-1 << 17, 1 << 17)),
        tangential_2=int(rng.integers(-1 << 17, 1 << 17)),
        radial=tuple(int(word) for word in rng.integers(1 << 18, size=1024)))
