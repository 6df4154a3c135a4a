"""Spots of beams: where they fall, how they look, how bright they are."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from model.optics import scenes, spots
from tb.model.truth import ENDOSCOPE, uv, xyz


def moments(image):
    """Sum, centroid and covariance of an image."""
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
    image = spots.draw((48, 60), centre[None], matrix[None], np.array([1000.0]))
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
    image = spots.draw((48, 60), centres, np.tile(np.eye(2) * 2, (4, 1, 1)),
                              np.array([100.0, 100, 100, 0]))
    assert image.shape == (48, 60) and 75 < image.sum() < 110


@pytest.mark.parametrize("kind", ["plane", "tilted", "polyp", "tube"])
def test_centroids_without_noise_are_the_truth(kind):
    scene, = scenes.sequence(kind, ENDOSCOPE, 1, np.random.default_rng(4))
    levels, truth = spots.pattern_levels(ENDOSCOPE, scene)
    for spot in truth[truth["inside"]]:
        u, v = int(spot["u_px"] + 0.5), int(spot["v_px"] + 0.5)
        top, left = max(0, v - 9), max(0, u - 9)
        _, centre, _ = moments(levels[top:v + 10, left:u + 10])
        cut = min(u, v, 351 - u, 287 - v) < 10
        assert np.hypot(*(centre + [left, top] - [spot["u_px"], spot["v_px"]])) < (
            0.1 if cut else 0.02)
        assert levels[v, u] == pytest.approx(spot["peak"], rel=0.25)


SPLIT = replace(ENDOSCOPE, spots=replace(ENDOSCOPE.spots, split=True))


@pytest.mark.parametrize("plane", [scenes.Plane(60.0), scenes.Plane(70.0, 30.0, 140.0)],
                         ids=["square", "tilted"])
def test_split_spots_are_the_same_on_planes(plane):
    whole, truth = spots.pattern_levels(ENDOSCOPE, plane)
    split, again = spots.pattern_levels(SPLIT, plane)
    np.testing.assert_array_equal(truth, again)
    assert split.sum() == pytest.approx(whole.sum(), rel=1e-3)
    assert np.abs(split - whole).max() < 0.02 * whole.max()
    for spot in truth[truth["inside"]]:
        u, v = int(spot["u_px"] + 0.5), int(spot["v_px"] + 0.5)
        window = slice(max(0, v - 9), v + 10), slice(max(0, u - 9), u + 10)
        # Perspective moves the centroid of a tilted footprint a little off the axis.
        difference = moments(split[window])[1] - moments(whole[window])[1]
        assert np.hypot(*difference) < 0.03


def test_split_spots_are_torn_by_edges():
    """A beam half on a step shows two spots, each where its half of the light falls."""
    step = scenes.Plane(80.0)
    clear, _, _ = spots.trace(ENDOSCOPE, step)
    u, v = clear["u_px"][24], clear["v_px"][24]

    class Step:
        """Nearer by 30 mm just above the middle beam's axis."""

        def clearance(self, points):
            axis = ENDOSCOPE.projector.directions()[24]
            base = np.array(ENDOSCOPE.projector.base_mm)
            line = base[1] + (points[..., 2] - base[2]) * axis[1] / axis[2]
            height = points[..., 1] - line + 0.02
            return np.minimum(80 - points[..., 2], np.maximum(50 - points[..., 2], height))

    levels, truth = spots.pattern_levels(SPLIT, Step())
    row = levels[int(v) - 12:int(v) + 13].sum(axis=0)
    near = ENDOSCOPE.camera.project(ENDOSCOPE.projector.points_at(50.0)[24:25])[0, 0]
    assert abs(near - u) > 8
    for column in (near, u):
        part = row[int(column) - 3:int(column) + 5].sum()
        assert 0.15 < part / row[int(min(near, u)) - 8:int(max(near, u)) + 10].sum() < 0.85
    assert truth["z_mm"][24] == pytest.approx(80, abs=1e-6)


def test_footprint_is_where_the_beam_s_edge_falls():
    """Rays one standard deviation from the axis end on the ellipse of one standard deviation."""
    rig = replace(ENDOSCOPE, spots=replace(ENDOSCOPE.spots, blur_px=0.0))
    plane = scenes.Plane(60.0, 40.0, 20.0)
    truth, covariance, _ = spots.trace(rig, plane)
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
        rig = replace(ENDOSCOPE, spots=replace(
            ENDOSCOPE.spots, exposure_span=1.0, blur_px=1e-3, least_cosine=0.0))
        truth, covariance, light = spots.trace(rig, plane)
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
        truth, _, _ = spots.trace(ENDOSCOPE, scenes.Plane(z))
        assert np.quantile(truth["peak"], 0.9) == pytest.approx(190, rel=1e-6)
    truth, _, _ = spots.trace(ENDOSCOPE, scenes.Plane(200.0))
    assert truth["peak"].max() < 120
