"""Depth under conditions that are not kind: beams found, points wrong, and the error."""

import numpy as np
import pytest

from tb.benchmark.depth_error import CONDITIONS, measure

_SEED = 1
#: The least share of the beams that is found, and the largest error, as a multiple of that on plain
#: frames.
_LIMITS = {
    "ramp 80": (1, 1.3), "pool 100": (1, 1.3), "flicker 60": (1, 1.3), "6 bits": (1, 1.3),
    "gain 4": (1, 1.5), "light / 4": (0.99, 5), "light / 8": (0.95, 10), "light x 4": (1, 1.3),
    "20 hot pixels": (0.995, 2), "defocus 4 px": (1, 3), "motion 9 px": (0.99, 4),
    "4 highlights": (0.99, 3), "12-look speckle": (0.995, 7), "15 % dim": (1, 2),
    "3 dead beams": (1, 1.3), "3 overbright beams": (0.995, 1.5), "tissue": (0.98, 7),
    "full speckle": (0.95, 20), "colour filters": (1, 1.3)}


@pytest.fixture(scope="module")
def plain():
    """Mean error on plain frames."""
    depth = measure(CONDITIONS["plain"], [_SEED])
    assert depth.found == depth.expected == 8 * 49 and depth.real == depth.spots
    return depth.error.mean()


@pytest.mark.parametrize("name", _LIMITS)
def test_depth_under_conditions(name, plain):
    found, error = _LIMITS[name]
    depth = measure(CONDITIONS[name], [_SEED])
    assert depth.found >= found * depth.expected
    assert np.mean(depth.error > 0.05) <= (0.005 if name == "full speckle" else 0.001)
    assert depth.error.mean() <= error * plain
    assert depth.expected > (350 if "dead" in name else 380)


def test_every_condition_has_limits():
    assert set(_LIMITS) | {"plain", "tissue, planes only"} == set(CONDITIONS)
