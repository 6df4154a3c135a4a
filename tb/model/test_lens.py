"""The lens model against OpenCV, and its calibration from drawn photographs."""


import cv2
import numpy as np
import pytest

from calibration.lens import Lens, calibrate_lens
from model.errors import UserError
from tb.model.rig_spots import board_views


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
def test_lens_that_folds_is_refused(focal, k1, k2, folds):
    lens = Lens(352, 288, focal, 175.5, 143.5, k1, k2)
    # The same question, answered by walking from the principal point to the farthest corner.
    radius = np.linspace(0, 3, 300001)
    distorted = radius * (1 + k1 * radius**2 + k2 * radius**4)
    turn = np.flatnonzero(np.diff(distorted) <= 0)
    reach = distorted[turn[0]] if len(turn) else np.inf
    assert (reach < np.hypot(176, 144) / focal) == folds
    assert lens.folds() == folds
    if folds:
        with pytest.raises(UserError, match="folds back inside the 352 x 288 picture"):
            lens.check_one_to_one()
    else:
        lens.check_one_to_one()


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
    monkeypatch.setattr("calibration.lens.find_corners", lambda *_: (
        [(grid + rng.normal(scale=6, size=grid.shape)).astype(np.float32)] * 2))
    blank = np.zeros((288, 352), np.uint8)
    with pytest.raises(UserError, match="fit a lens only to .* px RMS|an impossible lens"):
        calibrate_lens([(str(number), blank) for number in range(8)], 9, 6, 4.0, 360)
