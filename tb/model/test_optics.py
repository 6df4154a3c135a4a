"""The simulated world against independent computations, and every capture that is refused."""

import csv
import filecmp
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.capture import read_capture, read_image
from model.errors import UserError
from model.optics import capture, render, rigs, scenes
from model.optics.geometry import (
    Camera,
    Projector,
    beam_lines,
    line_separation,
    triangulate,
)
from model.optics.rigs import RIGS
from scripts.cyclope import cli

CAPSULE = RIGS["endoscope"]
ALL = pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)


def xyz(truth):
    """Places of the truth in space."""
    return np.stack([truth[name] for name in ("x_mm", "y_mm", "z_mm")], axis=-1)


def uv(truth):
    """Places of the truth in the image."""
    return np.stack([truth["u_px"], truth["v_px"]], axis=-1)


def undistorted(camera, image):
    """Undistorted pixels about the image centre, by OpenCV."""
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-13)
    found = cv2.undistortPoints(image[:, None], camera.matrix, camera.coefficients,
                                P=camera.matrix, criteria=criteria)
    return found[:, 0] - camera.centre_px


# Camera and mesh.

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
    projector = replace(CAPSULE.projector, irregularity_deg=0.02)
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


@ALL
def test_rigs_keep_their_promises(rig):
    documented = {"endoscope": 4.85, "demonstrator": 3.05, "small": 2.65}[rig.name]
    planes = rig.calibration_planes()
    assert len(planes) >= 8 and planes.min() < rig.range_mm[0] and planes.max() > rig.range_mm[1]
    _, whole_mesh = line_separation(rig.camera, rig.projector, planes.min(), planes.max())
    assert whole_mesh > documented
    for z in planes:
        truth, _, _ = render.spots(rig, scenes.Plane(z))
        assert truth["seen"].all() and rig.camera.inside(uv(truth), rig.margin_px * 0.8).all()
        assert (truth["sigma_minor_px"] > 1.0).all() and (truth["sigma_major_px"] < 2.0).all()
        inside = rig.range_mm[0] <= z <= rig.range_mm[1]
        assert (truth["inside"] == inside).all()


def test_separation_counts_what_two_beams_share():
    camera = Camera(352, 288, 360.0, (175.5, 143.5))
    # Without rotation the beams of a row lie on one line; their windows do not meet.
    projector = Projector(2, 2, 6.0, 0.0, 0.0, (5.0, 0, 0))
    shared, whole = line_separation(camera, projector, 40, 110)
    assert whole == pytest.approx(0, abs=1e-9)
    assert shared == pytest.approx(360 * np.tan(np.radians(6)))


# Rays and surfaces.

class Sphere:
    """A ball, for the closed form."""

    def __init__(self, centre, radius):
        self.centre, self.radius = np.array(centre, dtype=float), radius

    def clearance(self, points):
        return np.linalg.norm(points - self.centre, axis=-1) - self.radius


class Union:
    """Several surfaces at once."""

    def __init__(self, *parts):
        self.parts = parts

    def clearance(self, points):
        return np.minimum.reduce([part.clearance(points) for part in self.parts])


@pytest.mark.parametrize("tilt, azimuth", [(0, 0), (20, 30), (35, 200), (-12, 77)])
def test_truth_on_planes_is_the_closed_form(tilt, azimuth):
    plane = scenes.Plane(67.0, tilt, azimuth)
    truth, _, _ = render.spots(CAPSULE, plane)
    turn, _ = cv2.Rodrigues(np.radians(tilt) * np.array(
        [-np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth)), 0]))
    normal = turn @ [0, 0, 1]
    base, directions = np.array(CAPSULE.projector.base_mm), CAPSULE.projector.directions()
    distance = (normal @ ([0, 0, 67.0] - base)) / (directions @ normal)
    np.testing.assert_allclose(xyz(truth), base + directions * distance[:, None], atol=1e-9)
    assert truth["seen"].all()
    camera = CAPSULE.camera
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
        truth, _, _ = render.spots(rig, scene)
        hit = np.isfinite(truth["z_mm"])
        points = xyz(truth)[hit]
        assert np.abs(scene.clearance(points)).max() < 1e-9 * rig.scale
        along = np.linspace(0, 0.999, 1500)[:, None, None]
        assert (scene.clearance(base + along * (points - base)) > 0).all()
        np.testing.assert_allclose(np.cross(points - base, directions[hit]), 0, atol=1e-6)
        # What the camera sees is met by nothing on its way either; what it does not see is.
        free = (scene.clearance(along * points) > -1e-9).all(axis=(0))
        assert (free >= truth["seen"][hit]).all()
        assert not truth["seen"][~hit].any() and not truth["inside"][~truth["seen"]].any()
        share.append(truth["inside"].mean())
        z = truth["z_mm"][truth["inside"]]
        assert rig.range_mm[0] <= z.min() and z.max() <= rig.range_mm[1]
    assert np.mean(share) > 0.9


def test_hidden_spots_are_not_seen():
    wall = scenes.Plane(100.0)
    clear, _, _ = render.spots(CAPSULE, wall)
    # A small ball on the camera's line of sight to the middle spot, beside every beam.
    ball = Sphere(xyz(clear)[24] * 0.3, 0.5)
    truth, _, light = render.spots(CAPSULE, Union(wall, ball))
    assert not truth["seen"][24] and not truth["inside"][24] and light[24] == 0
    others = np.arange(49) != 24
    assert truth["seen"][others].all()
    np.testing.assert_allclose(xyz(truth), xyz(clear), atol=1e-9)


def test_beams_that_meet_nothing_have_no_place():
    truth, _, light = render.spots(CAPSULE, Sphere((0, 0, 80), 12))
    missed = np.isnan(truth["z_mm"])
    assert 0 < missed.sum() < 49 and not light[missed].any() and not truth["inside"][missed].any()
    rows = capture.truth_rows(3, truth)
    assert rows[np.flatnonzero(missed)[0]].endswith(",,,,,,0")
    levels, _ = render.pattern_levels(CAPSULE, Sphere((0, 0, -80), 12))
    assert not levels.any()


@ALL
@pytest.mark.parametrize("kind", ["plane", "tilted", "polyp", "tube"])
def test_triangulation_gives_the_truth_back(rig, kind):
    scene, = scenes.sequence(kind, rig, 1, np.random.default_rng(8))
    truth, _, _ = render.spots(rig, scene)
    truth = truth[truth["seen"]]
    points = triangulate(rig.camera, rig.projector, uv(truth), truth["beam"])
    np.testing.assert_allclose(points, xyz(truth), rtol=1e-8, atol=1e-6 * rig.scale)


def test_unknown_kind_is_refused():
    with pytest.raises(UserError, match="no scene of the kind 'cube'; choose one of plane, tilted"):
        scenes.sequence("cube", CAPSULE, 1, np.random.default_rng(0))


# Spots and noise.

def moments(image):
    """Sum, centroid and covariance of a picture."""
    v, u = np.mgrid[:image.shape[0], :image.shape[1]]
    total = image.sum()
    centre = np.array([(image * u).sum(), (image * v).sum()]) / total
    du, dv = u - centre[0], v - centre[1]
    mixed = (image * du * dv).sum()
    matrix = np.array([[(image * du * du).sum(), mixed], [mixed, (image * dv * dv).sum()]]) / total
    return total, centre, matrix


@pytest.mark.parametrize("matrix", [
    [[2.6, 0], [0, 2.6]], [[4, 1.5], [1.5, 2]], [[0.6, -0.1], [-0.1, 0.7]], [[9, 5], [5, 4]]])
def test_spots_are_integrated_over_the_pixels(matrix):
    matrix, centre, fine = np.array(matrix, dtype=float), np.array([30.3, 24.8]), 16
    image = render.draw_spots((48, 60), centre[None], matrix[None], np.array([1000.0]))
    v, u = (np.mgrid[:48 * fine, :60 * fine] + 0.5) / fine - 0.5
    offset = np.stack([u, v], axis=-1) - centre
    density = np.exp(-0.5 * np.einsum("...i,ij,...j", offset, np.linalg.inv(matrix), offset))
    density *= 1000 / (2 * np.pi * np.sqrt(np.linalg.det(matrix)))
    expected = density.reshape(48, fine, 60, fine).mean(axis=(1, 3))
    np.testing.assert_allclose(image, expected, atol=1e-3 * expected.max())
    total, found, spread = moments(image)
    assert total == pytest.approx(1000, rel=1e-4)
    np.testing.assert_allclose(found, centre, atol=1e-4)
    np.testing.assert_allclose(spread, matrix + np.eye(2) / 12, rtol=2e-3, atol=2e-3)


def test_spots_at_and_beyond_the_border_are_cut():
    centres = np.array([[0.0, 0.0], [59.0, 20.0], [-50.0, 5.0], [np.nan, np.nan]])
    image = render.draw_spots((48, 60), centres, np.tile(np.eye(2) * 2, (4, 1, 1)),
                              np.array([100.0, 100, 100, 0]))
    assert image.shape == (48, 60) and 75 < image.sum() < 110


@pytest.mark.parametrize("kind", ["plane", "tilted", "polyp", "tube"])
def test_centroids_without_noise_are_the_truth(kind):
    scene, = scenes.sequence(kind, CAPSULE, 1, np.random.default_rng(4))
    levels, truth = render.pattern_levels(CAPSULE, scene)
    for spot in truth[truth["inside"]]:
        u, v = int(spot["u_px"] + 0.5), int(spot["v_px"] + 0.5)
        top, left = max(0, v - 9), max(0, u - 9)
        _, centre, _ = moments(levels[top:v + 10, left:u + 10])
        cut = min(u, v, 351 - u, 287 - v) < 10
        assert np.hypot(*(centre + [left, top] - [spot["u_px"], spot["v_px"]])) < (
            0.1 if cut else 0.02)
        assert levels[v, u] == pytest.approx(spot["peak"], rel=0.25)


SPLIT = replace(CAPSULE, spots=replace(CAPSULE.spots, split=True))


@pytest.mark.parametrize("plane", [scenes.Plane(60.0), scenes.Plane(70.0, 30.0, 140.0)],
                         ids=["square", "tilted"])
def test_split_spots_are_the_same_on_planes(plane):
    whole, truth = render.pattern_levels(CAPSULE, plane)
    split, again = render.pattern_levels(SPLIT, plane)
    np.testing.assert_array_equal(truth, again)
    assert split.sum() == pytest.approx(whole.sum(), rel=1e-3)
    assert np.abs(split - whole).max() < 0.02 * whole.max()
    for spot in truth[truth["inside"]]:
        u, v = int(spot["u_px"] + 0.5), int(spot["v_px"] + 0.5)
        place = slice(max(0, v - 9), v + 10), slice(max(0, u - 9), u + 10)
        # Perspective moves the centroid of a tilted footprint a little off the axis.
        difference = moments(split[place])[1] - moments(whole[place])[1]
        assert np.hypot(*difference) < 0.03


def test_split_spots_are_torn_by_edges():
    """A beam half on a step shows two spots, each where its half of the light falls."""
    step = scenes.Plane(80.0)
    clear, _, _ = render.spots(CAPSULE, step)
    u, v = clear["u_px"][24], clear["v_px"][24]

    class Step:
        """Nearer by 30 mm just above the middle beam's axis."""

        def clearance(self, points):
            axis = CAPSULE.projector.directions()[24]
            base = np.array(CAPSULE.projector.base_mm)
            line = base[1] + (points[..., 2] - base[2]) * axis[1] / axis[2]
            height = points[..., 1] - line + 0.02
            return np.minimum(80 - points[..., 2], np.maximum(50 - points[..., 2], height))

    levels, truth = render.pattern_levels(SPLIT, Step())
    row = levels[int(v) - 12:int(v) + 13].sum(axis=0)
    near = CAPSULE.camera.project(CAPSULE.projector.points_at(50.0)[24:25])[0, 0]
    assert abs(near - u) > 8
    for place in (near, u):
        part = row[int(place) - 3:int(place) + 5].sum()
        assert 0.15 < part / row[int(min(near, u)) - 8:int(max(near, u)) + 10].sum() < 0.85
    assert truth["z_mm"][24] == pytest.approx(80, abs=1e-6)


def test_footprint_is_where_the_beam_s_edge_falls():
    """Rays one standard deviation from the axis end on the ellipse of one standard deviation."""
    rig = replace(CAPSULE, spots=replace(CAPSULE.spots, blur_px=0.0))
    plane = scenes.Plane(60.0, 40.0, 20.0)
    truth, covariance, _ = render.spots(rig, plane)
    base, directions = np.array(rig.projector.base_mm), rig.projector.directions()
    for beam in (0, 24, 45):
        distance = np.linalg.norm(xyz(truth)[beam] - base)
        sigma = np.hypot(rig.spots.waist_mm, rig.spots.divergence_mrad * 1e-3 * distance)
        side = np.cross(directions[beam], [0.3, 0.9, 0.1])
        side /= np.linalg.norm(side)
        for angle in np.linspace(0, 2 * np.pi, 8, endpoint=False):
            turn, _ = cv2.Rodrigues(directions[beam] * angle)
            start = base + turn @ side * sigma
            far, = scenes.cast(plane, start, directions[beam], 300, 0.4)
            offset = rig.camera.project(start + far * directions[beam]) - uv(truth)[beam]
            length = np.sqrt(offset @ np.linalg.inv(covariance[beam]) @ offset)
            assert length == pytest.approx(1, abs=0.02)


def test_spots_widen_and_dim_with_distance_and_slant():
    def middle(plane):
        rig = replace(CAPSULE, spots=replace(
            CAPSULE.spots, exposure_span=1.0, blur_px=1e-3, least_cosine=0.0))
        truth, covariance, light = render.spots(rig, plane)
        width_mm = np.sqrt(covariance[24, 1, 1]) * truth["z_mm"][24] / rig.camera.focal_px
        return light[24], width_mm, truth[24]
    near, near_mm, _ = middle(scenes.Plane(50.0))
    far, far_mm, _ = middle(scenes.Plane(100.0))
    assert near / far == pytest.approx(4, rel=0.02)
    expected = np.hypot(0.1, 0.003 * 100) / np.hypot(0.1, 0.003 * 50)
    assert far_mm / near_mm == pytest.approx(expected, rel=0.02)
    # Tilted about the horizontal, the spot is dimmer by the cosine and higher by its inverse.
    slant, slant_mm, spot = middle(scenes.Plane(50.0, 60.0, 90.0))
    assert slant * spot["z_mm"] ** 2 / (near * 50**2) == pytest.approx(0.5, rel=0.03)
    assert spot["sigma_major_px"] > spot["sigma_minor_px"]


def test_exposure_follows_the_scene_within_its_span():
    for z in (40.0, 70.0, 110.0):
        truth, _, _ = render.spots(CAPSULE, scenes.Plane(z))
        assert np.quantile(truth["peak"], 0.9) == pytest.approx(190, rel=1e-6)
    truth, _, _ = render.spots(CAPSULE, scenes.Plane(200.0))
    assert truth["peak"].max() < 120


def test_noise_has_the_statistics_that_it_should():
    rng = np.random.default_rng(1)
    for level in (20.0, 100.0, 200.0):
        frame = render.expose(CAPSULE, np.full((400, 400), level), rng).astype(float)
        assert frame.mean() == pytest.approx(level, abs=0.05)
        assert frame.var() == pytest.approx(4 + level / 40 + 1 / 12, rel=0.03)
    dark = render.expose(CAPSULE, np.zeros((100, 100)), rng)
    bright = render.expose(CAPSULE, np.full((100, 100), 600.0), rng)
    assert dark.min() == 0 and dark.max() < 12 and (bright == 255).all()
    silent = replace(CAPSULE, noise=replace(CAPSULE.noise, read=0.0, electrons=0.0))
    assert (render.expose(silent, np.full((4, 4), 77.4), rng) == 77).all()


def test_background_is_dim_uneven_and_darker_in_the_corners():
    levels = render.background(CAPSULE, np.random.default_rng(3))
    assert levels.shape == (288, 352) and 8 < levels.mean() < 12 and 0.5 < levels.std() < 3
    shade = render.vignette(CAPSULE)
    assert shade.max() == pytest.approx(1, abs=1e-4)
    assert shade.min() == pytest.approx(0.65, abs=1e-6)


def test_pattern_frame_is_bright_where_the_truth_is():
    image, truth = render.pattern_frame(CAPSULE, scenes.Plane(60.0), np.random.default_rng(1))
    assert image.dtype == np.uint8 and image.shape == (288, 352)
    at = image[np.rint(truth["v_px"]).astype(int), np.rint(truth["u_px"]).astype(int)]
    assert at.min() > 60 and np.median(image) < 15
    again, _ = render.pattern_frame(CAPSULE, scenes.Plane(60.0), np.random.default_rng(1))
    np.testing.assert_array_equal(image, again)


# Pictures of the board and of the tissue.

@ALL
def test_photographs_show_the_board_where_the_pose_says(rig):
    corners, half = [], 5 if rig.camera.width > 64 else 3
    for number in range(5):
        image, pose = render.board_photograph(rig, number, np.random.default_rng(number))
        found, seen = cv2.findChessboardCorners(image, (rig.board.columns, rig.board.rows))
        assert found
        seen = cv2.cornerSubPix(image, seen.reshape(-1, 1, 2), (half, half), (-1, -1), (
            cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4))[:, 0]
        expected = pose.corners(rig)
        offset = seen[:, None] - expected
        offset = offset[np.arange(len(seen)), np.linalg.norm(offset, axis=-1).argmin(axis=1)]
        # Single corners are as exact as OpenCV finds them; a picture that is shifted is not.
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
    points, _ = render.surface(CAPSULE, scene)
    known = ~np.isnan(points[..., 0])
    assert known.all() and np.abs(scene.clearance(points[known])).max() < 0.1
    assert points[..., 2].min() == pytest.approx(68, abs=0.5)
    image = render.texture_frame(CAPSULE, scene, np.random.default_rng(1))
    assert image.shape == (288, 352) and image.dtype == np.uint8 and image.std() > 10


# Capture folders.

@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A capture of the small rig."""
    path = tmp_path_factory.mktemp("optics") / "capture"
    assert cli.main(["simulate", "plane", path, "--rig", "small", "--seed", "3", "--frames",
                     "5"]) == 0
    return path


def files(path):
    """Names of all files below a folder."""
    return sorted(str(file.relative_to(path)) for file in path.rglob("*") if file.is_file())


def test_capture_holds_what_the_contract_says(folder):
    rig, found = RIGS["small"], read_capture(folder)
    assert (found.width, found.height) == (64, 64) and found.projector.beams == 16
    assert (found.board_columns, found.board_rows, found.square_mm) == (5, 4, 8.0)
    lens, planes = found.lens_images(), found.plane_images()
    assert len(lens) == 15 and len(planes) >= 8
    for _, image in lens:
        assert cv2.findChessboardCorners(image, (5, 4))[0]
    names = [f"{number:04}_{kind}.png" for number in range(5) for kind in ("ir", "texture")]
    assert sorted(file.name for file in (folder / "frames").iterdir()) == names
    for name in names:
        read_image(folder / "frames" / name, 64, 64)
    rows = list(csv.DictReader((folder / "truth.csv").open()))
    assert ",".join(rows[0]) == "frame,beam,u_px,v_px,x_mm,y_mm,z_mm,inside"
    assert [(row["frame"], row["beam"]) for row in rows] == [
        (str(frame), str(beam)) for frame in range(5) for beam in range(16)]
    distances = {float(row["z_mm"]) for row in rows}
    assert len(distances) == 5 and min(distances) < 50 and max(distances) > 85
    assert min(abs(z - plane) for z in distances for _, plane, _ in planes) > 0.01
    for row in rows:
        image = rig.camera.project(np.array([[float(row[name]) for name in (
            "x_mm", "y_mm", "z_mm")]]))[0]
        np.testing.assert_allclose(image, [float(row["u_px"]), float(row["v_px"])], atol=1e-5)
        assert row["inside"] == "1"


def test_plane_frames_show_the_plane_that_the_table_says(folder):
    rig = RIGS["small"]
    for _, z_mm, image in read_capture(folder).plane_images():
        place = rig.camera.project(rig.projector.points_at(z_mm))
        at = image[tuple(np.rint(place[:, ::-1]).astype(int).T)]
        assert at.min() > 50


def test_same_seed_gives_the_same_bytes(folder, tmp_path):
    arguments = ["--rig", "small", "--frames", "5"]
    assert cli.main(["simulate", "plane", tmp_path / "a", *arguments, "--seed", "3"]) == 0
    assert cli.main(["simulate", "plane", tmp_path / "b", *arguments, "--seed", "4"]) == 0
    names = files(folder)
    assert files(tmp_path / "a") == names and files(tmp_path / "b") == names
    assert filecmp.cmpfiles(folder, tmp_path / "a", names, shallow=False)[0] == names
    assert filecmp.cmpfiles(folder, tmp_path / "b", names, shallow=False)[0] == [
        "planes/planes.csv"]


@ALL
def test_nominal_values_are_off_but_not_by_more_than_they_say(rig):
    worst = np.zeros(4)
    for seed in range(30):
        nominal = rigs.nominal(rig, np.random.default_rng(seed))
        base, wrong = np.array(rig.projector.base_mm), np.array(nominal.base_mm)
        error = np.array([
            nominal.focal_px / rig.camera.focal_px - 1,
            nominal.pitch_deg / rig.projector.pitch_deg - 1,
            np.linalg.norm(wrong - base) / np.linalg.norm(base),
            max(abs(nominal.rotation_deg - rig.projector.rotation_deg),
                abs(nominal.toe_in_deg - rig.projector.toe_in_deg))])
        worst = np.maximum(worst, np.abs(error))
    assert (worst < [0.0301, 0.0301, 0.034, 1.001]).all()
    assert (worst > [0.02, 0.02, 0.02, 0.7]).all()
    exact = rigs.nominal(rig, np.random.default_rng(0), error=0)
    assert exact.focal_px == rig.camera.focal_px and exact.base_mm == rig.projector.base_mm


def test_split_spots_can_be_asked_for(folder, tmp_path):
    assert cli.main(["simulate", "plane", tmp_path / "a", "--rig", "small", "--seed", "3",
                     "--frames", "5", "--split-spots"]) == 0
    same = filecmp.cmpfiles(folder, tmp_path / "a", files(folder), shallow=False)[0]
    assert {"truth.csv", "capture.toml"} <= set(same)
    assert not [name for name in same if name.endswith("_ir.png")]


def test_mixed_capture_shows_every_kind():
    sequence = scenes.sequence("mixed", CAPSULE, 8, np.random.default_rng(1))
    assert [type(scene) for scene in sequence] == [
        scenes.Plane, scenes.Plane, scenes.Polyp, scenes.Tube] * 2


@pytest.mark.parametrize("arguments, words", [
    (["cube", "OUT"], "cube"), (["plane", "OUT", "--seed", "-1"], "--seed must be 0 or more"),
    (["plane", "OUT", "--frames", "0"], "--frames must be 1 to 10000, not 0"),
    (["plane", "OUT", "--rig", "none"], "none"), (["plane"], "OUT")])
def test_simulate_refuses_bad_arguments(arguments, words, tmp_path, capsys):
    arguments = [tmp_path / "out" if word == "OUT" else word for word in arguments]
    assert cli.main(["simulate", *arguments]) == 2
    said = capsys.readouterr().err
    assert words in said and said.count("\n") == 1 and not list(tmp_path.iterdir())


def test_simulate_leaves_a_filled_folder_alone(tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    assert cli.main(["simulate", "plane", tmp_path, "--rig", "small", "--frames", "1"]) == 2
    assert "already holds files" in capsys.readouterr().err
    assert files(tmp_path) == ["mine.txt"]


def test_simulate_leaves_nothing_half_written(tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise UserError("The disk is full.")
    monkeypatch.setattr(render, "texture_frame", fail)
    assert cli.main(["simulate", "plane", tmp_path / "out", "--rig", "small"]) == 2
    assert "The disk is full." in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


# Images and captures that are refused.

def broken_png(path, image, at):
    """A PNG with one wrong octet."""
    data = bytearray(cv2.imencode(".png", image)[1].tobytes())
    data[at] ^= 1
    path.write_bytes(data)


def cut(path, image, suffix, share=0.6):
    """The first part of an image file."""
    data = cv2.imencode(suffix, image)[1].tobytes()
    path.write_bytes(data[:int(len(data) * share)])


GREY = np.random.default_rng(1).integers(0, 256, (48, 64), np.uint8)
IMAGES = {
    "missing": (lambda p: None, "does not exist"),
    "folder": (lambda p: p.mkdir(), "is not a file"),
    "empty": (lambda p: p.touch(), "is empty"),
    "text": (lambda p: p.write_text("hello"), "cannot be read as an image"),
    "png cut": (lambda p: cut(p, GREY, ".png"), "is truncated or damaged"),
    "png without end": (lambda p: cut(p, GREY, ".png", 0.997), "is truncated or damaged"),
    "png wrong bit": (lambda p: broken_png(p, GREY, 700), "is truncated or damaged"),
    "jpg cut": (lambda p: cut(p, GREY, ".jpg"), "is truncated or damaged"),
    "bmp cut": (lambda p: cut(p, GREY, ".bmp"), "is truncated or damaged"),
    "pgm cut": (lambda p: cut(p, GREY, ".pgm"), "cannot be read as an image"),
    "tiff cut": (lambda p: cut(p, GREY, ".tiff"), ""),
    "colour": (lambda p: p.write_bytes(cv2.imencode(".png", cv2.merge([GREY] * 3))[1].tobytes()),
               "is a colour image"),
    "16 bits": (lambda p: p.write_bytes(
        cv2.imencode(".png", GREY.astype(np.uint16))[1].tobytes()), "has 16 bits per pixel"),
    "size": (lambda p: p.write_bytes(cv2.imencode(".png", GREY[:40])[1].tobytes()),
             "has 64 x 40 pixels instead of the sensor's 64 x 48"),
}


@pytest.mark.parametrize("kind", IMAGES)
def test_bad_images_are_refused_in_one_sentence(kind, tmp_path):
    make, words = IMAGES[kind]
    path = tmp_path / "picture.png"
    make(path)
    with pytest.raises(UserError) as caught:
        read_image(path, 64, 48)
    said = str(caught.value)
    assert said.startswith(str(path)) and words in said and said.endswith(".") and "\n" not in said


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".pgm", ".tiff"])
def test_good_images_are_read_exactly(suffix, tmp_path):
    path = tmp_path / f"picture{suffix}"
    assert cv2.imwrite(str(path), GREY)
    np.testing.assert_array_equal(read_image(path, 64, 48), GREY)
    np.testing.assert_array_equal(read_image(str(path)), GREY)
    photograph = tmp_path / "photograph.jpg"
    assert cv2.imwrite(str(photograph), np.full((48, 64), 90, np.uint8))
    assert np.abs(read_image(photograph, 64, 48).astype(int) - 90).max() <= 2


def edit(name, old, new):
    """Replaces text in a file of the capture."""
    def change(folder):
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))
    return change


def emptied(name):
    """Empties a sub-folder."""
    def change(folder):
        shutil.rmtree(folder / name)
        (folder / name).mkdir()
    return change


CAPTURES = {
    "no folder": (shutil.rmtree, "does not exist"),
    "empty folder": (emptied(""), "is empty"),
    "no toml": (lambda f: (f / "capture.toml").unlink(), "capture.toml does not exist"),
    "bad toml": (edit("capture.toml", "width =", "width"), "capture.toml is not valid TOML"),
    "binary toml": (lambda f: (f / "capture.toml").write_bytes(b"\xff\xfe\x00"), "not valid TOML"),
    "no section": (edit("capture.toml", "[sensor]", "[other]"), "has no section [sensor]"),
    "no key": (edit("capture.toml", "focal_px", "focal"), "has no focal_px in [sensor]"),
    "text width": (edit("capture.toml", "width = 64", "width = '64'"), "width in [sensor] must be"),
    "true width": (edit("capture.toml", "width = 64", "width = true"), "width in [sensor] must be"),
    "wide": (edit("capture.toml", "width = 64", "width = 640"), "an integer from 8 to 512"),
    "no focal": (edit("capture.toml", "focal_px = ", "focal_px = -"), "focal_px in [sensor] must"),
    "endless": (edit("capture.toml", "pitch_deg = ", "pitch_deg = inf #"), "pitch_deg in"),
    "many beams": (edit("capture.toml", "columns = 4\npitch", "columns = 40\npitch"), "4 x 40 "),
    "base": (edit("capture.toml", "base_mm = [", "base_mm = [1, "), "base_mm in [projector] must"),
    "no base": (edit("capture.toml", "base_mm = [", "base_mm = [0, 0, 0] # ["), "x other than 0"),
    "square": (edit("capture.toml", "square_mm = 8.0", "square_mm = 0"), "square_mm in [lens]"),
    "no lens": (lambda f: shutil.rmtree(f / "lens"), "is not a folder that can be read"),
    "empty lens": (emptied("lens"), "lens holds no images"),
    "no planes": (emptied("planes"), "planes.csv does not exist"),
    "header": (edit("planes/planes.csv", "z_mm", "depth"), "must have the columns file,z_mm"),
    "empty table": (lambda f: (f / "planes/planes.csv").write_text(""), "must have the columns"),
    "no rows": (lambda f: (f / "planes/planes.csv").write_text("file,z_mm\n"), "names no plane"),
    "no number": (edit("planes/planes.csv", "00.png,", "00.png,far"), "line 2: z_mm must be"),
    "behind": (edit("planes/planes.csv", "00.png,", "00.png,-"), "line 2: z_mm must be"),
    "twice": (edit("planes/planes.csv", "01.png", "00.png"), "00.png twice, in lines 2 and 3"),
    "elsewhere": (edit("planes/planes.csv", "01.png", "../01.png"), "is not the name of a file"),
    "no picture": (lambda f: (f / "planes/03.png").unlink(), "03.png does not exist"),
}


@pytest.mark.parametrize("kind", CAPTURES)
def test_bad_captures_are_refused_in_one_sentence(kind, folder, tmp_path):
    change, words = CAPTURES[kind]
    copy = tmp_path / "capture"
    shutil.copytree(folder, copy)
    change(copy)
    with pytest.raises(UserError) as caught:
        read_capture(copy)
    said = str(caught.value)
    assert words in said and str(copy) in said and said.endswith(".") and "\n" not in said


def test_bad_picture_in_a_capture_is_refused(folder, tmp_path):
    copy = tmp_path / "capture"
    shutil.copytree(folder, copy)
    (copy / "lens" / "03.png").write_bytes(b"")
    (copy / "planes" / "05.png").write_bytes(b"no picture")
    found = read_capture(copy)
    with pytest.raises(UserError, match=r"lens/03\.png is empty"):
        found.lens_images()
    with pytest.raises(UserError, match=r"planes/05\.png cannot be read as an image"):
        found.plane_images()


def test_table_of_planes_may_come_from_a_spreadsheet(folder, tmp_path):
    copy = tmp_path / "capture"
    shutil.copytree(folder, copy)
    path = copy / "planes" / "planes.csv"
    lines = path.read_text().splitlines()
    text = "\r\n".join(["note,z_mm , file", *(
        f'"far, far",{line.split(",")[1]}, {line.split(",")[0]}' for line in lines[1:]), "", ""])
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert read_capture(copy).planes == tuple(
        (copy / "planes" / picture.name, z) for picture, z in read_capture(folder).planes)
