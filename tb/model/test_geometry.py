"""Camera, mesh and their lines against OpenCV."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from model.optics.geometry import Camera, Projector, beam_lines, line_separation
from tb.model.truth import ALL, ENDOSCOPE, undistorted


@ALL
def test_projection_is_opencv_s(rig):
    rng = np.random.default_rng(1)
    points = rng.uniform((-0.4, -0.35, 1), (0.4, 0.35, 1), (400, 3))
    points *= rng.uniform(40, 110, (400, 1))
    camera = rig.camera
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera.matrix, camera.coefficients)
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("k1, k2, p1, p2", [
    (0, 0, 0, 0), (-0.12, 0.02, 5e-4, -4e-4), (-0.3, 0.1, 1e-3, 2e-3), (0.25, 0, -1e-3, 1e-3)])
def test_normalise_is_the_inverse(k1, k2, p1, p2):
    camera = Camera(352, 288, 360.0, (177.0, 142.0), k1, k2, p1, p2)
    u, v = np.meshgrid(np.linspace(0, 351, 40), np.linspace(0, 287, 30))
    image = np.stack([u, v], axis=-1).reshape(-1, 2)
    np.testing.assert_allclose(camera.distort(camera.normalise(image)), image, atol=1e-9)
    np.testing.assert_allclose(camera.undistort(image), undistorted(camera, image), atol=1e-6)


@pytest.mark.parametrize("side", [1, -1], ids=["right", "left"])
def test_mesh_is_turned_as_documented(side):
    projector = Projector(5, 7, 6.0, 8.0, 4.0, (side * 5.0, 0.1, 0.2))
    row, column = 1, 5
    flat = np.array([(column - 3) * np.tan(np.radians(6)), (row - 2) * np.tan(np.radians(6)), 1])
    about_z, _ = cv2.Rodrigues(np.array([0, 0, np.radians(8.0)]))
    about_y, _ = cv2.Rodrigues(np.array([0, -side * np.radians(4.0), 0]))
    expected = about_y @ about_z @ flat
    direction = projector.directions()[row * 7 + column]
    np.testing.assert_allclose(direction, expected / np.linalg.norm(expected), atol=1e-12)
    # Towards the camera's axis, whichever side the projector is on.
    axis = projector.directions()[2 * 7 + 3]
    assert np.sign(axis[0]) == -side and abs(axis[1]) < 1e-12


def test_irregularity_is_small_and_always_the_same():
    projector = replace(ENDOSCOPE.projector, irregularity_deg=0.02)
    first, regular = projector.directions(), replace(projector, irregularity_deg=0.0).directions()
    np.testing.assert_array_equal(first, projector.directions())
    angle = np.degrees(np.linalg.norm(np.cross(first, regular), axis=1))
    assert 0.01 < np.sqrt(np.mean(angle**2)) < 0.05


@ALL
def test_lines_and_depth_laws_hold_in_opencv_s_coordinates(rig):
    camera, projector = rig.camera, rig.projector
    lines = beam_lines(camera, projector)
    for z in np.linspace(*rig.range_mm, 7):
        points = projector.points_at(z)
        np.testing.assert_allclose(points[:, 2], z, rtol=1e-12)
        image, _ = cv2.projectPoints(
            points, np.zeros(3), np.zeros(3), camera.matrix, camera.coefficients)
        x, y = undistorted(camera, image[:, 0]).T
        np.testing.assert_allclose(lines.a * x + lines.b, y, atol=1e-6)
        np.testing.assert_allclose(lines.inverse_z(x) * z, 1, atol=1e-6)
        np.testing.assert_allclose(lines.column_at(z), x, atol=1e-6)


def test_separation_counts_what_two_beams_share():
    camera = Camera(352, 288, 360.0, (175.5, 143.5))
    # Without rotation the beams of a row lie on one line; their windows do not meet.
    projector = Projector(2, 2, 6.0, 0.0, 0.0, (5.0, 0, 0))
    shared, whole = line_separation(camera, projector, 40, 110)
    assert whole == pytest.approx(0, abs=1e-9)
    assert shared == pytest.approx(360 * np.tan(np.radians(6)))
