"""Frames, noise, boards and textures."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from model.optics import board, exposure, render, scenes
from tb.model.truth import ALL, ENDOSCOPE


def test_noise_has_the_statistics_that_it_should():
    rng = np.random.default_rng(1)
    for level in (20.0, 100.0, 200.0):
        frame = exposure.expose(ENDOSCOPE, np.full((400, 400), level), rng).astype(float)
        assert frame.mean() == pytest.approx(level, abs=0.05)
        assert frame.var() == pytest.approx(4 + level / 40 + 1 / 12, rel=0.03)
    dark = exposure.expose(ENDOSCOPE, np.zeros((100, 100)), rng)
    bright = exposure.expose(ENDOSCOPE, np.full((100, 100), 600.0), rng)
    assert dark.min() == 0 and dark.max() < 12 and (bright == 255).all()
    silent = replace(ENDOSCOPE, noise=replace(ENDOSCOPE.noise, read=0.0, electrons=0.0))
    assert (exposure.expose(silent, np.full((4, 4), 77.4), rng) == 77).all()


def test_background_is_dim_uneven_and_darker_in_the_corners():
    levels = exposure.background(ENDOSCOPE, np.random.default_rng(3))
    assert levels.shape == (288, 352) and 8 < levels.mean() < 12 and 0.5 < levels.std() < 3
    shade = exposure.vignette(ENDOSCOPE)
    assert shade.max() == pytest.approx(1, abs=1e-4)
    assert shade.min() == pytest.approx(0.65, abs=1e-6)


def test_pattern_frame_is_bright_where_the_truth_is():
    image, truth = render.pattern_frame(ENDOSCOPE, scenes.Plane(60.0), np.random.default_rng(1))
    assert image.dtype == np.uint8 and image.shape == (288, 352)
    at = image[np.rint(truth["v_px"]).astype(int), np.rint(truth["u_px"]).astype(int)]
    assert at.min() > 60 and np.median(image) < 15
    again, _ = render.pattern_frame(ENDOSCOPE, scenes.Plane(60.0), np.random.default_rng(1))
    np.testing.assert_array_equal(image, again)


@ALL
def test_photographs_show_the_board_where_the_pose_says(rig):
    corners, half = [], 5 if rig.camera.width > 64 else 3
    for number in range(5):
        image, pose = board.photograph(rig, number, np.random.default_rng(number))
        found, corners_px = cv2.findChessboardCorners(image, (rig.board.columns, rig.board.rows))
        assert found
        corners_px = cv2.cornerSubPix(image, corners_px.reshape(-1, 1, 2), (half, half), (-1, -1), (
            cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4))[:, 0]
        expected = pose.corners(rig)
        offset = corners_px[:, None] - expected
        offset = offset[np.arange(len(corners_px)), np.linalg.norm(offset, axis=-1).argmin(axis=1)]
        # Single corners have the errors of OpenCV, the whole image must not be shifted.
        assert np.sqrt(np.mean(offset**2)) < (0.1 if rig.camera.width > 64 else 0.25)
        assert (np.abs(offset.mean(axis=0)) < (0.03 if rig.camera.width > 64 else 0.1)).all()
        corners.append(expected)
        outline = np.array([[0, 0], [rig.board.columns + 1, rig.board.rows + 1]])
        assert rig.camera.inside(rig.camera.project(pose.points(rig.board, outline)), 1).all()
    spread = np.ptp(np.concatenate(corners), axis=0)
    share = 0.6 if rig.camera.width > 64 else 0.4
    assert (spread > share * np.array([rig.camera.width, rig.camera.height])).all()


def test_texture_shows_the_scene():
    scene = scenes.Polyp(scenes.Plane(80.0), (5.0, -4.0), (10.0, 9.0, 7.0), 5.0)
    points, _ = render.surface(ENDOSCOPE, scene)
    known = ~np.isnan(points[..., 0])
    assert known.all() and np.abs(scene.clearance(points[known])).max() < 0.1
    assert points[..., 2].min() == pytest.approx(68, abs=0.5)
    image = render.texture_frame(ENDOSCOPE, scene, np.random.default_rng(1))
    assert image.shape == (288, 352) and image.dtype == np.uint8 and image.std() > 10
