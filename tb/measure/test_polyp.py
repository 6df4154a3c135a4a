"""Sizes of polyps against those of their models."""

import numpy as np
import pytest

from model.errors import UserError
from model.optics.scenes import Plane
from scripts.measure.ellipse import fit_rim
from scripts.measure.polyp import circle, polyp, size_class
from scripts.measure.records import measure_frames
from scripts.measure.surface import Surface
from tb.measure.polyps import model_polyp, true_rim
from tb.measure.simulated import calibration_of, measured, mesh_rig

NOISE_PX, HAND_PX = 0.04, 0.7


def watched(rig, calibration, scene, rng, frames=1):
    return [Surface(measured(rig, calibration, scene, rng, NOISE_PX, number), calibration)
            for number in range(frames)]


@pytest.mark.parametrize("side", [11, 19])
def test_diameter_and_height(side):
    rig, rng = mesh_rig(side), np.random.default_rng(2)
    calibration, rows = calibration_of(rig, NOISE_PX), []
    for diameter in np.linspace(3, 15, 9):
        scene = model_polyp(rng, diameter)
        marks = true_rim(rig, scene)
        surface, = watched(rig, calibration, scene, rng)
        found = polyp(surface, marks + rng.normal(scale=HAND_PX, size=marks.shape))
        rows.append((diameter, found.diameter, found.diameter_uncertainty,
                     scene.stalk_mm + scene.head_mm[2], found.height, found.height_uncertainty))
    diameter, found, sigma, height, high, high_sigma = np.array(rows).T
    assert 1 - np.mean(np.abs(found / diameter - 1)) >= 0.95
    assert np.mean(np.abs(found - diameter) <= 2 * sigma) >= 0.85
    known = np.isfinite(high)
    assert np.mean(known) > 0.7
    assert 1 - np.mean(np.abs(high / height - 1)[known]) >= 0.9
    assert (np.abs(high - height) <= 3 * high_sigma)[known].all()


def test_mean_of_frames():
    rig, rng = mesh_rig(11), np.random.default_rng(3)
    calibration, scene = calibration_of(rig, NOISE_PX), model_polyp(rng, 12.0)
    surfaces = watched(rig, calibration, scene, rng, 4)
    marks = true_rim(rig, scene)
    each = [measure_frames([surface], "polyp", marks) for surface in surfaces]
    mean = measure_frames(surfaces, "polyp", marks)
    assert np.isclose(mean.length, np.mean([one.length for one in each]))
    assert (mean.frame, mean.frames, mean.size_class, mean.notes) == (0, 4, "10-19 mm", ())
    assert mean.uncertainty < np.mean([one.uncertainty for one in each])
    moved = watched(rig, calibration, model_polyp(np.random.default_rng(9), 4.0), rng)
    assert any("moved" in note for note in measure_frames(
        surfaces + moved, "ruler", [[160, 130], [200, 150]]).notes)


@pytest.mark.parametrize("diameter, name", [
    (0.4, "<= 5 mm"), (5.49, "<= 5 mm"), (5.5, "6-9 mm"), (9.49, "6-9 mm"), (9.5, "10-19 mm"),
    (19.4, "10-19 mm"), (19.5, ">= 20 mm"), (80, ">= 20 mm")])
def test_size_classes(diameter, name):
    assert size_class(diameter) == name


def test_rims():
    angle = np.linspace(0, 2 * np.pi, 9)[:8]
    tilted = np.array([[np.cos(0.6), np.sin(0.6)], [-np.sin(0.6), np.cos(0.6)]])
    points = np.column_stack([3 * np.cos(angle), 2 * np.sin(angle)]) @ tilted + [5, -7]
    rim = fit_rim(points)
    assert np.isclose(rim.longest, 6, atol=1e-3) and np.allclose(rim.centre, [5, -7], atol=1e-3)
    assert rim.misfit < 1e-2 and np.allclose(rim.radius(points), 1, atol=1e-3)
    assert np.isclose(fit_rim(circle(3, 4, 2.5)).longest, 5, atol=1e-3)
    assert np.isclose(fit_rim(circle(3, 4, 2.5)[[0, 5, 11]]).longest, 5)


def test_what_cannot_be_measured():
    rig, rng = mesh_rig(11), np.random.default_rng(1)
    surface, = watched(rig, calibration_of(rig, NOISE_PX), Plane(60, 5, 0), rng)
    with pytest.raises(UserError, match="three points or more, not 2"):
        polyp(surface, [[100, 100], [120, 100]])
    with pytest.raises(UserError, match="are on a line"):
        polyp(surface, [[100, 100], [120, 100], [140, 100.2], [160, 100]])
    with pytest.raises(UserError, match="measured points lie around the rim"):
        polyp(surface, circle(176, 144, 140))
    with pytest.raises(UserError, match="one side of the polyp only"):
        polyp(surface, circle(20, 144, 25))
    with pytest.raises(UserError, match="no measured surface"):
        measure_frames([surface], "ruler", [[1, 1], [100, 100]])


def test_nothing_on_a_bare_wall_has_no_height():
    rig, rng = mesh_rig(19), np.random.default_rng(1)
    surface, = watched(rig, calibration_of(rig, NOISE_PX), Plane(60, 10, 0), rng)
    found = polyp(surface, circle(176, 144, 30))
    assert abs(found.height) < 2 * found.height_uncertainty < 2
    assert np.isclose(found.diameter, 60 / 360 * 60, rtol=0.05)
