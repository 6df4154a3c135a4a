"""Rays, surfaces and the truth of every beam against algebra."""


import cv2
import numpy as np
import pytest

from model.errors import UserError
from model.optics import capture, scenes, spots
from model.optics.geometry import triangulate
from tb.model.truth import ALL, ENDOSCOPE, Sphere, Union, uv, xyz


@pytest.mark.parametrize("tilt, azimuth", [(0, 0), (20, 30), (35, 200), (-12, 77)])
def test_truth_on_planes_is_the_closed_form(tilt, azimuth):
    plane = scenes.Plane(67.0, tilt, azimuth)
    truth, _, _ = spots.trace(ENDOSCOPE, plane)
    turn, _ = cv2.Rodrigues(np.radians(tilt) * np.array(
        [-np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth)), 0]))
    normal = turn @ [0, 0, 1]
    base, directions = np.array(ENDOSCOPE.projector.base_mm), ENDOSCOPE.projector.directions()
    distance = (normal @ ([0, 0, 67.0] - base)) / (directions @ normal)
    np.testing.assert_allclose(xyz(truth), base + directions * distance[:, None], atol=1e-9)
    assert truth["visible"].all()
    camera = ENDOSCOPE.camera
    image, _ = cv2.projectPoints(
        xyz(truth), np.zeros(3), np.zeros(3), camera.matrix, camera.coefficients)
    np.testing.assert_allclose(uv(truth), image[:, 0], atol=1e-7)


def test_cast_meets_spheres_and_tubes_where_algebra_says():
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(300, 3)) * [0.3, 0.3, 0] + [0, 0, 1]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    centre, radius = np.array([3.0, -2.0, 70.0]), 18.0
    along = directions @ centre
    root = along**2 - centre @ centre + radius**2
    expected = np.where(root > 0, along - np.sqrt(np.maximum(root, 0)), np.nan)
    found = scenes.cast(Sphere(centre, radius), np.zeros(3), directions, 200, 0.4)
    certain = np.abs(root) > 1
    assert 50 < np.isfinite(expected).sum() < 250
    np.testing.assert_allclose(found[certain], expected[certain], atol=1e-9)

    tube = scenes.Tube((4.0, 12.0, 5.0), (0.7, 0.2, 0.5), 30.0, fold_depth_mm=0.0)
    axis = np.array(tube.axis) / np.linalg.norm(tube.axis)

    def across(vector):
        return vector - np.multiply.outer(vector @ axis, axis)

    d, o = across(directions), across(-np.array(tube.axis_point_mm))
    a, b, c = (d**2).sum(axis=1), d @ o, o @ o - 900
    expected = (-b + np.sqrt(b * b - a * c)) / a
    found = scenes.cast(tube, np.zeros(3), directions, 1000, 0.4)
    np.testing.assert_allclose(found, expected, atol=1e-7)


@ALL
@pytest.mark.parametrize("kind", ["tilted", "polyp", "tube"])
def test_beams_end_on_the_first_surface_that_they_meet(rig, kind):
    base, directions = np.array(rig.projector.base_mm), rig.projector.directions()
    share = []
    for scene in scenes.sequence(kind, rig, 8, np.random.default_rng(5)):
        truth, _, _ = spots.trace(rig, scene)
        hit = np.isfinite(truth["z_mm"])
        points = xyz(truth)[hit]
        assert np.abs(scene.clearance(points)).max() < 1e-9 * rig.scale
        along = np.linspace(0, 0.999, 1500)[:, None, None]
        assert (scene.clearance(base + along * (points - base)) > 0).all()
        np.testing.assert_allclose(np.cross(points - base, directions[hit]), 0, atol=1e-6)
        # Nothing lies between the camera and a visible spot; something does before a hidden one.
        free = (scene.clearance(along * points) > -1e-9).all(axis=(0))
        assert (free >= truth["visible"][hit]).all()
        assert not truth["visible"][~hit].any() and not truth["inside"][~truth["visible"]].any()
        share.append(truth["inside"].mean())
        z = truth["z_mm"][truth["inside"]]
        assert rig.range_mm[0] <= z.min() and z.max() <= rig.range_mm[1]
    assert np.mean(share) > 0.9


def test_hidden_spots_are_not_visible():
    wall = scenes.Plane(100.0)
    clear, _, _ = spots.trace(ENDOSCOPE, wall)
    # A small ball on the camera's line of sight to the middle spot, beside every beam.
    ball = Sphere(xyz(clear)[24] * 0.3, 0.5)
    truth, _, light = spots.trace(ENDOSCOPE, Union(wall, ball))
    assert not truth["visible"][24] and not truth["inside"][24] and light[24] == 0
    others = np.arange(49) != 24
    assert truth["visible"][others].all()
    np.testing.assert_allclose(xyz(truth), xyz(clear), atol=1e-9)


def test_beams_that_meet_nothing_have_no_position():
    truth, _, light = spots.trace(ENDOSCOPE, Sphere((0, 0, 80), 12))
    missed = np.isnan(truth["z_mm"])
    assert 0 < missed.sum() < 49 and not light[missed].any() and not truth["inside"][missed].any()
    rows = capture.truth_rows(3, truth)
    assert rows[np.flatnonzero(missed)[0]].endswith(",,,,,,0")
    levels, _ = spots.pattern_levels(ENDOSCOPE, Sphere((0, 0, -80), 12))
    assert not levels.any()


@ALL
@pytest.mark.parametrize("kind", ["plane", "tilted", "polyp", "tube"])
def test_triangulation_gives_the_truth_back(rig, kind):
    scene, = scenes.sequence(kind, rig, 1, np.random.default_rng(8))
    truth, _, _ = spots.trace(rig, scene)
    truth = truth[truth["visible"]]
    points = triangulate(rig.camera, rig.projector, uv(truth), truth["beam"])
    np.testing.assert_allclose(points, xyz(truth), rtol=1e-8, atol=1e-6 * rig.scale)


def test_unknown_kind_is_refused():
    with pytest.raises(UserError, match="no scene of the kind 'cube'; choose one of plane, tilted"):
        scenes.sequence("cube", ENDOSCOPE, 1, np.random.default_rng(0))


def test_mixed_capture_shows_every_kind():
    sequence = scenes.sequence("mixed", ENDOSCOPE, 8, np.random.default_rng(1))
    assert [type(scene) for scene in sequence] == [
        scenes.Plane, scenes.Plane, scenes.Polyp, scenes.Tube] * 2
