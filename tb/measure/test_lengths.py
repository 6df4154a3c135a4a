"""The ruler against true lengths on simulated scenes."""

import numpy as np
import pytest

from model.errors import UserError
from model.optics import scenes
from scripts.measure.ruler import ruler
from scripts.measure.surface import Surface
from tb.measure.simulated import calibration_of, measured, mesh_rig, true_points

NOISE_PX = 0.04


def errors(side, per_kind, per_scene, seed):
    """Rows of true and measured length and uncertainty, 3 to 20 mm, 40 to 80 mm away."""
    rig, rng, rows = mesh_rig(side), np.random.default_rng(seed), []
    calibration = calibration_of(rig, NOISE_PX)
    for kind in ("tilted", "polyp", "tube"):
        for scene in scenes.sequence(kind, rig, per_kind, rng):
            off = rng.normal(scale=NOISE_PX * np.sqrt(2 / 12), size=side * side)
            surface = Surface(measured(rig, calibration, scene, rng, NOISE_PX, off=off),
                              calibration)
            pairs = []
            while len(pairs) < 8 * per_scene:
                first, angle = rng.uniform([20, 20], [332, 268]), rng.uniform(0, 2 * np.pi)
                pairs.append([first, first + rng.uniform(18, 120) * np.array(
                    [np.cos(angle), np.sin(angle)])])
            true = true_points(rig, scene, np.reshape(pairs, (-1, 2))).reshape(-1, 2, 3)
            length = np.linalg.norm(true[:, 1] - true[:, 0], axis=1)
            fit = (length > 3) & (length < 20) & (
                (true[..., 2] > 40) & (true[..., 2] < 80)).all(axis=1)
            done = 0
            for pair, value in zip(np.array(pairs)[fit], length[fit], strict=True):
                try:
                    found = ruler(surface, pair)
                except UserError:
                    continue
                rows.append((value, found.value, found.uncertainty))
                done += 1
                if done == per_scene:
                    break
    return np.array(rows).T


@pytest.mark.parametrize("side", [11, 19])
def test_lengths_and_their_uncertainties(side):
    true, found, sigma = errors(side, 3, 25, seed=4)
    assert len(true) > 150
    assert 1 - np.mean(np.abs(found / true - 1)) >= 0.97
    # Lengths of a scene share its spots: their share within the interval varies.
    assert 0.55 <= np.mean(np.abs(found - true) <= sigma) <= 0.85


def test_a_ruler_needs_two_different_points():
    rig = mesh_rig(7)
    calibration = calibration_of(rig, NOISE_PX)
    surface = Surface(measured(rig, calibration, scenes.Plane(60), np.random.default_rng(1),
                               NOISE_PX), calibration)
    with pytest.raises(UserError, match="takes two points, not 3"):
        ruler(surface, [[120, 90], [200, 100], [150, 150]])
    with pytest.raises(UserError, match="are the same"):
        ruler(surface, [[120, 90], [120, 90]])


def test_swapped_ends_are_the_same_length():
    rig = mesh_rig(11)
    calibration = calibration_of(rig, NOISE_PX)
    surface = Surface(measured(rig, calibration, scenes.Plane(60, 30, 20),
                               np.random.default_rng(1), NOISE_PX), calibration)
    one, two = ruler(surface, [[120, 90], [200, 160]]), ruler(surface, [[200, 160], [120, 90]])
    assert np.isclose(one.value, two.value) and np.isclose(one.uncertainty, two.uncertainty)
    assert one.random <= one.uncertainty < 0.5
