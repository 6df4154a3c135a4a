"""What the report calls good, and what not; whether the lens fits the plane frames."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.calibrate import Options, calibrate_beams, with_lens
from calibration.chessboards import LensReport
from calibration.figures import figures, health
from calibration.identity import identify
from calibration.lens_check import doubts, turned_lenses
from model.optics.rigs import RIGS
from model.settings import Settings
from tb.model.rig_spots import observe


@pytest.fixture(scope="module")
def result():
    """A good calibration, from plane spots straight from geometry."""
    planes, _, nominal, lens = observe(RIGS["endoscope"], 61, noise=0.02, missing=0, strays=0)
    settings = with_lens(Settings(), lens)
    return calibrate_beams(planes, nominal, lens, LensReport(0.06, ("0.png",) * 15),
                           Options(settings), settings)


def test_a_good_calibration_is_called_good(result):
    assert health(result) == "Health: good; every figure is in its range."
    rows = {figure.name: figure for figure in figures(result)}
    assert {"lens", "focal length", "usable region", "spots", "lines", "plane offset",
            "depth error", "undistortion", "1/z"} <= set(rows)
    assert rows["lens"].range == "below 0.5 px" and rows["usable region"].value == "all"
    assert "A wrong scale of z_mm cannot be seen" in rows["plane offset"].meaning
    assert "left out" not in rows


@pytest.mark.parametrize("name, change", [
    ("lens", lambda r: replace(r, lens_report=replace(r.lens_report, rms_px=0.7))),
    ("lens", lambda r: replace(r, lens_report=replace(r.lens_report, flags=("Doubtful.",)))),
    ("focal length", lambda r: replace(r, lens_report=replace(r.lens_report, focal_sigma=0.05))),
    ("spots", lambda r: replace(r, identity=replace(r.identity, matched=0.8))),
    ("lines", lambda r: replace(r, lines=replace(r.lines, rms_px=0.11))),
    ("line separation", lambda r: replace(r, windows=replace(r.windows, smallest_px=1.2))),
    *((figure, lambda r, key=key, value=value: replace(r, calibration=replace(
        r.calibration, budget={**r.calibration.budget, key: value}))) for figure, key, value in (
            ("held out", "held_out_px", 0.2), ("depth error", "expected_depth_relative", 0.01),
            ("undistortion", "undistortion_px", 0.02), ("1/z", "depth_relative", 2e-4)))])
def test_each_figure_can_be_bad(result, name, change):
    words = health(change(result))
    assert words.startswith(f"Health: look at {name}: outside the range")


def test_usable_region_is_named(result):
    lens = replace(result.calibration.lens, usable_px=190.0)
    bounded = replace(result, calibration=replace(result.calibration, lens=lens))
    row = next(figure for figure in figures(bounded) if figure.name == "usable region")
    assert row.value == "190 px" and "from 177, 142; spots beyond are not used" in row.meaning


def planes_of(rig, seed=62):
    """Planes of a rig, their identity and the right lens."""
    planes, _, nominal, lens = observe(rig, seed, noise=0.015, strays=0, planes=12)
    return planes, identify(planes, nominal, lens), lens


def test_a_lens_that_fits_the_planes_is_not_doubted():
    for name in ("endoscope", "small"):
        planes, identity, lens = planes_of(RIGS[name])
        beams = np.arange(identity.projector.beams)
        assert doubts(planes, identity, lens, 0.0, beams) == []


@pytest.mark.parametrize("change", [
    {"k1": -0.2}, {"k1": 0.0, "k2": 0.0}, {"focal": 300.0}])
def test_the_lens_of_another_camera_is_doubted(change):
    planes, identity, lens = planes_of(RIGS["endoscope"])
    words = doubts(planes, identity, replace(lens, **change), 0.0, np.arange(49))
    assert len(words) == 1 and "does not fit the plane frames" in words[0]


@pytest.mark.parametrize("how", ["turned by 180 degrees", "mirrored left to right"])
def test_turned_photographs_are_named(how):
    """The principal point must be off the middle: else a turn changes nothing."""
    rig = RIGS["endoscope"]
    rig = replace(rig, camera=replace(rig.camera, principal_px=(195.0, 150.0), k1=-0.25))
    planes, identity, lens = planes_of(rig)
    words = doubts(planes, identity, turned_lenses(lens)[how], 0.0, np.arange(49))
    assert len(words) == 1 and f"photographs seem to be {how} against the plane" in words[0]


def test_turned_lenses_turn_the_distortion():
    """A point turned with the picture has the undistorted position turned."""
    for width in (288, 352):
        lens = replace(planes_of(RIGS["endoscope"])[2], width=width, height=288)
        u, v = 40.0, 200.0
        x, y = lens.undistort(u, v)
        right, below = width - 1, 287
        points = {
            "turned by 180 degrees": ((right - u, below - v), (-x, -y)),
            "mirrored left to right": ((right - u, v), (-x, y)),
            "mirrored upside down": ((u, below - v), (x, -y)),
            "turned by 90 degrees clockwise": ((below - v, u), (-y, x)),
            "turned by 90 degrees counterclockwise": ((v, right - u), (y, -x))}
        turned = turned_lenses(lens)
        assert len(turned) == (5 if width == 288 else 3)
        for name, other in turned.items():
            image, position = points[name]
            np.testing.assert_allclose(other.undistort(*image), position, atol=1e-6)
