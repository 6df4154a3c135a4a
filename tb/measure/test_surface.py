"""The surface between the spots: exact for planes, refused where nothing was measured."""

import numpy as np
import pytest

from model.errors import UserError
from model.optics.scenes import Plane
from scripts.measure.surface import Surface
from scripts.results.points import DOUBTFUL
from tb.measure.simulated import calibration_of, measured, mesh_rig, true_points

NOISE_PX = 0.04
MARKS = [[120.0, 90.0], [200.5, 140.25], [230.0, 200.0], [150.0, 180.0]]


def surface_of(scene, noise_px=NOISE_PX, side=7, seed=1, **changes):
    rig = mesh_rig(side)
    calibration = calibration_of(rig, NOISE_PX)
    points = measured(rig, calibration, scene, np.random.default_rng(seed), noise_px, frame=5)
    for name, values in changes.items():
        points[name] = values
    return rig, Surface(points, calibration)


def test_a_plane_is_a_plane_between_the_spots():
    scene = Plane(60, 30, 40)
    rig, surface = surface_of(scene, noise_px=1e-9)
    assert np.allclose(surface.pick(MARKS).xyz, true_points(rig, scene, MARKS), atol=1e-4)


def test_picked_points_are_on_their_rays():
    _, surface = surface_of(Plane(60, 20, 100))
    assert np.allclose(surface.image(surface.pick(MARKS).xyz), MARKS, atol=1e-6)


def test_uncertainty_is_that_of_the_errors():
    """On a plane, over many frames: no more and no less than the depth varies."""
    scene, found = Plane(60, 10, 30), []
    for seed in range(40):
        _, surface = surface_of(scene, seed=seed)
        found.append(surface.pick(MARKS))
    varies = np.std([1 / picked.xyz[:, 2] for picked in found], axis=0)
    given = np.sqrt(np.mean([np.diag(picked.noise_covariance) for picked in found], axis=0))
    assert (given < 1.5 * varies).all() and (given > 0.6 * varies).all()
    whole = np.sqrt(np.mean([np.diag(picked.inverse_covariance) for picked in found], axis=0))
    assert (whole > given).all()


def test_noise_is_seen_in_the_spots_distances_from_their_lines():
    for noise in (0.02, 0.2):
        _, surface = surface_of(Plane(60, 10, 30), noise_px=noise)
        assert 0.6 * noise < surface.noise_px < 1.5 * noise + 0.02


def test_no_surface_where_nothing_was_measured():
    _, surface = surface_of(Plane(60))
    with pytest.raises(UserError, match=r"no measured surface at 3.0,2.0 in frame 5: choose"):
        surface.pick([[120, 90], [3, 2]])


def test_doubtful_spots_are_no_surface():
    _, surface = surface_of(Plane(60), status=DOUBTFUL)
    assert len(surface.points) == 0 and len(surface.triangle) == 0
    with pytest.raises(UserError, match="no measured surface"):
        surface.pick(MARKS)


def test_a_beam_counts_once():
    rig, surface = surface_of(Plane(60))
    twice = np.concatenate([surface.points, surface.points[:5]])
    again = Surface(twice, surface.calibration)
    assert np.array_equal(again.pick(MARKS).xyz, surface.pick(MARKS).xyz)
    assert rig.projector.beams == len(again.points)
