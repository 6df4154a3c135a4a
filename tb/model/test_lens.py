"""The lens model against OpenCV, and its calibration from drawn photographs."""


from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.chessboards import calibrate_lens, fit_lens
from calibration.lens import Lens
from calibration.undistortion import GAIN_LIMIT, lens_tables, undistortion_settings
from model.errors import UserError
from model.optics.rigs import RIGS
from model.settings import Settings
from model.stereo.undistort import undistort
from tb.model.rig_spots import board_corners, board_views, fitted_lens


@pytest.mark.parametrize("k1, k2, p1, p2", [
    (0, 0, 0, 0), (-0.35, 0.15, 1e-3, -1e-3), (0.25, 0, -2e-3, 1e-3), (-0.12, 0.02, 5e-4, -4e-4)])
def test_undistort_is_the_inverse_of_opencv(k1, k2, p1, p2):
    lens = Lens(352, 288, 360.0, 177.1, 142.3, k1, k2, p1, p2)
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-150, 150, (2, 500))
    slopes = np.stack([*lens.ray(x, y), np.ones(500)], axis=-1)
    image, _ = cv2.projectPoints(slopes, np.zeros(3), np.zeros(3), lens.matrix, lens.coefficients)
    np.testing.assert_allclose(np.stack(lens.distort(x, y), -1), image[:, 0], atol=1e-9)
    np.testing.assert_allclose(lens.undistort(*image[:, 0].T), (x, y), atol=1e-6)
    assert not lens.folds()


@pytest.mark.parametrize("focal, k1, k2, folds", [
    (150, -0.35, 0, True), (360, -0.35, 0, False), (200, -0.35, 0.3, False),
    (200, 0.2, -0.25, True), (360, 0.25, 0, False)])
def test_lens_that_folds(focal, k1, k2, folds):
    lens = Lens(352, 288, focal, 175.5, 143.5, k1, k2)
    # The same question, answered by walking from the principal point to the farthest corner.
    radius = np.linspace(0, 3, 300001)
    distorted = radius * (1 + k1 * radius**2 + k2 * radius**4)
    turn = np.flatnonzero(np.diff(distorted) <= 0)
    reach = distorted[turn[0]] if len(turn) else np.inf
    assert (reach < np.hypot(176, 144) / focal) == folds
    assert lens.folds() == folds
    if folds:
        usable = replace(lens, usable_px=0.98 * reach * focal)
        assert not usable.folds()
        x, _ = usable.undistort(175.5 + 0.97 * reach * focal * np.array([1, 1.02]), [143.5, 143.5])
        assert np.isfinite(x[0]) and np.isnan(x[1])


def test_lens_is_recovered():
    lens, views = board_views()
    blank = ("blank.png", np.full((288, 352), 120, np.uint8))
    found, report = calibrate_lens([*views[:4], blank, *views[4:]], 9, 6, 4.0, 360 * 1.03)
    assert report.without_board == ("blank.png",) and len(report.used) == 10
    assert report.rms_px < 0.1
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(0, 352, 16), np.arange(0, 288, 16)))
    error = np.hypot(*(np.array(lens.ray(*lens.undistort(u, v)))
                       - found.ray(*found.undistort(u, v)))) * 360
    assert np.sqrt(np.mean(error**2)) < 0.5


def test_same_views_give_the_same_lens():
    """To the last bit, however many threads OpenCV uses."""
    lenses = {calibrate_lens(board_views()[1], 9, 6, 4.0, 370)[0] for _ in range(4)}
    assert len(lenses) == 1


def test_too_few_boards_are_refused():
    views = board_views()[1][:4]
    blank = ("blank.png", np.full((288, 352), 120, np.uint8))
    with pytest.raises(UserError, match=r"in 4 photographs \(not in blank.png\), at least 5"):
        calibrate_lens([*views, blank], 9, 6, 4.0, 360)


def test_boards_that_fit_no_lens_are_refused(monkeypatch):
    rng = np.random.default_rng(2)
    grid = np.mgrid[:9, :6].T.reshape(-1, 2) * 20.0 + 60
    monkeypatch.setattr("calibration.chessboards.find_corners", lambda *_: (
        [(grid + rng.normal(scale=6, size=grid.shape)).astype(np.float32)] * 2))
    blank = np.zeros((288, 352), np.uint8)
    with pytest.raises(UserError, match="fit a lens only to .* px RMS|an impossible lens"):
        calibrate_lens([(str(number), blank) for number in range(8)], 9, 6, 4.0, 360)


@pytest.mark.parametrize("k1, k2, k3", [(0, 0, 0), (0.2, -0.05, 0.01), (-0.1, 0.02, 0)])
def test_equidistant_lens(k1, k2, k3):
    """The angle to the axis makes the radius."""
    lens = Lens(256, 256, 90.0, 128.9, 126.2, k1, k2, k3=k3, model="equidistant")
    angle, azimuth = np.random.default_rng(2).uniform((0, -np.pi), (1.2, np.pi), (400, 2)).T
    radius = 90 * angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6)
    u, v = 128.9 + radius * np.cos(azimuth), 126.2 + radius * np.sin(azimuth)
    x, y = lens.undistort(u, v)
    slope = np.hypot(*lens.ray(x, y))
    np.testing.assert_allclose(np.arctan(slope), angle, atol=1e-8)
    np.testing.assert_allclose(lens.distort(x, y), (u, v), atol=1e-7)
    # The gain is that of the larger of two steps, one along the radius and one across it.
    step = 1e-4 * np.array([np.cos(azimuth), np.sin(azimuth)])
    along = np.hypot(*(np.array(lens.undistort(u + step[0], v + step[1])) - (x, y))) / 1e-4
    across = np.hypot(*(np.array(lens.undistort(u - step[1], v + step[0])) - (x, y))) / 1e-4
    np.testing.assert_allclose(lens.gain(x, y), np.maximum(along, across), rtol=2e-3)


def capsule_corners(camera, columns, rows):
    """Corners of the photographs of a real capsule endoscope."""
    table = [line.split(",") for line in (
        Path(__file__).with_name("capsule_corners.csv").read_text().splitlines())
             if line.startswith(camera)]
    views = {}
    for _, number, u, v in table:
        views.setdefault(number, []).append((float(u), float(v)))
    assert all(len(view) == columns * rows for view in views.values())
    return [(np.array(view, np.float32),) * 2 for view in views.values()]


@pytest.mark.parametrize("camera, board, size, focal, limit, reach", [
    ("MiroCam", (7, 6), 320, 160, 0.6, (130, 160)), ("PillCam", (8, 6), 256, 75, 0.35, (95, 110))])
def test_capsule_endoscopes(camera, board, size, focal, limit, reach):
    """Real photographs: the equidistant model, a usable region, and the chip's table for it."""
    views = capsule_corners(camera, *board)
    names = [str(number) for number in range(len(views))]
    lens, report = fit_lens(names, views, (size, size), (*board, 2.0), focal)
    assert lens.model == "equidistant" and report.rms_px <= limit and not report.outliers
    assert reach[0] < lens.usable_px < reach[1] and not lens.folds()
    corners = np.concatenate([view for view, _ in views])
    assert np.isfinite(lens.undistort(*corners.T)).all()
    assert bool(report.flags) == (camera == "MiroCam")
    tables = lens_tables(lens)
    assert tables["worst_error"] < 0.015 and tables["worst_gain"] <= GAIN_LIMIT
    # Beyond the region no position is left in the columns where windows can be.
    settings = Settings(**undistortion_settings(lens))
    rng = np.random.default_rng(1)
    u, v = rng.uniform(0, size - 1, (2, 20000))
    beyond = np.hypot(u - lens.principal_u, v - lens.principal_v) > lens.usable_px + 1
    x, y, ok = undistort(np.rint(u * 512), np.rint(v * 512), settings, size, size)
    radius = np.hypot(x / 512 - lens.principal_x, y / 512 - lens.principal_y)
    assert (~ok | (radius > lens.reach * lens.focal))[beyond].all() and beyond.sum() > 5000
    assert ok[~beyond].mean() > 0.95


def test_an_ordinary_lens_is_browns():
    """And has no limit: with the boards of the simulated capture, in the whole picture."""
    lens, report = fitted_lens(board_corners(1))
    assert lens.model == "brown" and lens.usable_px is None and not report.flags
    assert abs(lens.focal - 360) < 4 * report.focal_sigma * lens.focal < 4


@pytest.mark.parametrize("seed", range(5))
def test_frontal_boards_do_not_determine_the_lens(seed):
    with pytest.raises(UserError, match=r"do not determine the lens \(focal length \d+ px \+-\d+%"
                                        r", .* photograph the board tilted by 20 to 40 degrees"):
        fitted_lens(board_corners(seed, tilt_deg=1.0))


def test_nearly_frontal_boards_are_flagged():
    lens, report = fitted_lens(board_corners(2, tilt_deg=3.0))
    assert "hardly determine the focal length (+-4" in report.flags[0]
    assert abs(lens.focal / 360 - 1) < 3 * report.focal_sigma


def test_corners_without_boards_are_left_out_where_the_model_is_uncertain():
    """Few small boards in the middle: the picture's corners are not usable, and nothing is refused.
    """
    camera = replace(RIGS["endoscope"].camera, focal_px=305.0, k1=0.0, k2=0.0, p1=0.0, p2=0.0)
    lens, _ = fitted_lens(board_corners(3, camera=camera, count=6, noise=0.15,
                                        distance=(70, 90)), 305.0)
    assert 100 < lens.usable_px < lens.corner_px and not lens.folds()
    lens_tables(lens)


def test_photographs_of_two_cameras_are_found():
    other = replace(RIGS["endoscope"].camera, focal_px=330.0, k1=-0.25)
    mixed = board_corners(4, count=9) + board_corners(5, count=6, camera=other)
    with pytest.raises(UserError, match="are of two cameras, .* the smaller group is 09.png, 10.png"
                                        ", 11.png, 12.png, 13.png, 14.png: keep those"):
        fitted_lens(mixed)


def test_few_photographs_of_another_camera_are_left_out_and_named():
    other = replace(RIGS["endoscope"].camera, focal_px=330.0, k1=-0.25)
    lens, report = fitted_lens(board_corners(4, count=12) + board_corners(5, count=3, camera=other))
    assert report.outliers and set(report.outliers) <= {"12.png", "13.png", "14.png"}
    assert "do not fit the lens of the others" in report.flags[0]
    assert abs(lens.focal / 360 - 1) < 0.01


def test_poor_photographs_of_one_camera_are_not_called_two():
    lens, report = fitted_lens(board_corners(6, noise=0.3))
    assert report.rms_px > 0.2 and abs(lens.focal / 360 - 1) < 0.03
