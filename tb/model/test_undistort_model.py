"""Undistortion against float; ``pytest -s`` prints the largest errors."""

import cv2
import numpy as np
import pytest

from calibration.lens import Lens
from calibration.undistortion import GAIN_LIMIT, build, undistortion_settings
from model.errors import UserError
from model.oracles import undistort_oracle as oracle
from model.settings import RADIAL_WORDS, Settings
from model.stereo.undistort import radius_bits, undistort

LIMIT = 0.01
FIELDS = ("principal_u", "principal_v", "tangential_1", "tangential_2", "radial")
SENSORS = {(352, 288): (150, 600), (64, 64): (40, 120)}


def settings_of(tables):
    return Settings(**{name: tables[name] for name in FIELDS})


def fraction(width, height):
    """Fraction bits of coordinates."""
    return 9 if max(width, height) <= 512 else 8


def positions(width, height, seed, count=900):
    """Centres all over the image, its corners and borders among them."""
    rng = np.random.default_rng(seed)
    right, bottom = (width - 1 << fraction(width, height), height - 1 << fraction(width, height))
    u = rng.integers(0, right + 1, count)
    v = rng.integers(0, bottom + 1, count)
    u[:200], v[200:400] = rng.choice([0, right], 200), rng.choice([0, bottom], 200)
    u[:4], v[:4] = (0, 0, right, right), (0, bottom, 0, bottom)
    return u, v


def exact(u, v, lens, width, height):
    """Undistorted positions about the image centre in float, and the gain there."""
    focal, cx, cy, *distortion = lens
    pixel = 1 << fraction(width, height)
    x, y = oracle.undistort((u / pixel - cx) / focal, (v / pixel - cy) / focal, *distortion)
    return (x * focal + cx - (width - 1) / 2, y * focal + cy - (height - 1) / 2,
            oracle.gain(x, y, *distortion))


def random_lens(rng, size, tangential):
    width, height = size
    low, high = SENSORS[size]
    return (low * (high / low) ** rng.random(),
            (width - 1) / 2 + rng.uniform(-0.04, 0.04) * width,
            (height - 1) / 2 + rng.uniform(-0.04, 0.04) * height,
            rng.uniform(-0.35, 0.25), rng.choice([0, rng.uniform(-0.1, 0.15)]),
            *rng.uniform(-tangential, tangential, 2))


@pytest.mark.parametrize("tangential,gain,rounds", [
    (0, GAIN_LIMIT, 2), (0.001, 3, 2), (0.002, 2, 2), (0.003, 3, 3), (0.005, 2, 3)])
@pytest.mark.parametrize("seed", [1])
def test_against_float(tangential, gain, rounds, seed):
    """Random lenses on both sensors, k1 in [-0.35, 0.25], wherever the chip must have an answer."""
    rng = np.random.default_rng([seed, round(tangential * 1000)])
    worst, measured, refused = 0.0, 0, 0
    for number in range(110):
        size = list(SENSORS)[number % 2]
        lens = random_lens(rng, size, tangential)
        try:
            tables = build(*lens, *size, rounds)
        except ValueError:
            refused += 1
            continue
        if tables["worst_gain"] > gain:
            continue
        u, v = positions(*size, number)
        x, y, ok = undistort(u, v, settings_of(tables), *size, rounds)
        wanted_x, wanted_y, _ = exact(u, v, lens, *size)
        assert not np.isnan(wanted_x).any(), "a lens that folds in the image was not refused"
        size_of = np.maximum(np.abs(wanted_x), np.abs(wanted_y))
        assert ok[size_of < 255.5].all(), f"rejected inside the range: {lens}"
        assert not ok[size_of > 256.1].any(), f"answered outside the range: {lens}"
        error = np.hypot(x / 512 - wanted_x, y / 512 - wanted_y)[ok].max()
        assert error <= LIMIT, f"{error:.4f} px, {size}, {lens}"
        worst, measured = max(worst, error), measured + 1
    assert measured > 60
    print(f"\n|p| <= {tangential:g}, gain <= {gain:g}, {rounds} rounds: largest error {worst:.4f} "
          f"px over {measured} lenses ({refused} refused)")


@pytest.mark.parametrize("k1,k2", [(-0.35, 0), (-0.35, 0.12), (-0.2, 0.03), (0.25, 0), (0.25, 0.1)])
@pytest.mark.parametrize("size", SENSORS, ids="{0[0]}x{0[1]}".format)
def test_widest_lens(size, k1, k2):
    """The shortest focal length that is not refused, to 1 %: next to the fold, if there is one."""
    width, height = size
    centre = (width - 1) / 2, (height - 1) / 2
    for focal in SENSORS[size][0] * 1.01 ** np.arange(150):
        try:
            build(focal, *centre, k1, k2, 0, 0, *size)
            break
        except ValueError:
            pass
    lens = (focal, *centre, k1, k2, 0, 0)
    tables = build(*lens, *size)
    u, v = positions(*size, 1, 5000)
    x, y, ok = undistort(u, v, settings_of(tables), *size)
    wanted_x, wanted_y, gain = exact(u, v, lens, *size)
    error = np.hypot(x / 512 - wanted_x, y / 512 - wanted_y)[ok].max()
    print(f"\n{width} x {height}, k1 {k1:g}, k2 {k2:g}: focal length {focal:.1f} px, gain "
          f"{gain.max():.2f}, largest error {error:.4f} px")
    assert error <= LIMIT
    assert tables["worst_error"] <= LIMIT


def test_oracle_is_opencv():
    rng = np.random.default_rng(1)
    distortion = (-0.2, 0.05, 0.002, -0.003)
    xy = rng.uniform(-0.6, 0.6, (500, 2))
    image = cv2.projectPoints(
        np.c_[xy, np.ones(500)], np.zeros(3), np.zeros(3), np.eye(3), np.array(distortion))[0][:, 0]
    np.testing.assert_allclose(np.stack(oracle.distort(*xy.T, *distortion), 1), image, atol=1e-12)
    np.testing.assert_allclose(np.stack(oracle.undistort(*image.T, *distortion), 1), xy, atol=1e-9)


def test_oracle_knows_the_fold():
    """Past the fold there is no answer, and just before it the gain is large."""
    fold = oracle.fold_radius(-0.35, 0)
    assert fold == pytest.approx(np.sqrt(1 / 1.05))
    radius = fold * (1 - 0.35 * fold**2)
    x, _ = oracle.undistort(np.array([0.999, 1.001]) * radius, np.zeros(2), -0.35, 0, 0, 0)
    assert x[0] < fold and np.isnan(x[1])
    assert oracle.gain(x[:1], np.zeros(1), -0.35, 0, 0, 0) > 10
    assert oracle.fold_radius(0.2, 0) == oracle.fold_radius(0, 0) == np.inf


def test_reported_error_is_true():
    lens = (330, 178, 140, -0.3, 0.03, 0.001, -0.001)
    tables = build(*lens, 352, 288)
    u, v = positions(352, 288, 3, 20_000)
    x, y, ok = undistort(u, v, settings_of(tables), 352, 288)
    wanted_x, wanted_y, gain = exact(u, v, lens, 352, 288)
    error = np.hypot(x / 512 - wanted_x, y / 512 - wanted_y)[ok].max()
    assert 0.7 < tables["worst_error"] / error < 1.1
    assert gain.max() == pytest.approx(tables["worst_gain"], rel=0.01)


def test_registers_and_words():
    tables = build(300, 176.25, 141.5, -0.1, 0.01, 0.001, -0.002, 352, 288)
    assert tables["principal_u"] == 176.25 * 512 and tables["principal_v"] == 141.5 * 512
    assert tables["tangential_1"] == round(0.001 / 300 * 2**27)
    assert tables["tangential_2"] == round(-0.002 / 300 * 2**27)
    assert len(tables["radial"]) == RADIAL_WORDS
    assert all(isinstance(word, int) and 0 <= word < 2**18 for word in tables["radial"])


def test_no_distortion():
    tables = build(300, 175.5, 143.5, 0, 0, 0, 0, 352, 288)
    u, v = positions(352, 288, 1)
    x, y, ok = undistort(u, v, settings_of(tables), 352, 288)
    assert ok.all()
    assert np.abs(x - (u - 175.5 * 512)).max() <= 1 and np.abs(y - (v - 143.5 * 512)).max() <= 1


def test_outside_is_rejected():
    """A position whose undistorted one lies beyond 256 px, and one beyond the table."""
    settings = settings_of(build(280, 175.5, 143.5, -0.2, 0, 0, 0, 352, 288))
    _, _, ok = undistort([0, 20 * 512], [143 * 512] * 2, settings, 352, 288)
    assert ok.tolist() == [True, True]
    wide = settings_of(build(150, 175.5, 143.5, -0.2, 0.03, 0, 0, 352, 288))
    x, _, ok = undistort([0, 100 * 512], [143 * 512] * 2, wide, 352, 288)
    assert ok.tolist() == [False, True]
    _, _, ok = undistort([(1 << 18) - 1, 0], [0, (1 << 18) - 1], settings, 352, 288)
    assert not ok.any()


def test_table_range():
    assert radius_bits(352, 288) == 16
    assert radius_bits(64, 64) == 12
    assert radius_bits(16, 16) == 12
    assert radius_bits(512, 512) == 17
    assert radius_bits(640, 480) == 18
    assert radius_bits(1024, 1024) == 19


@pytest.mark.parametrize("size", [(640, 480), (1000, 700)], ids="{0[0]}x{0[1]}".format)
@pytest.mark.parametrize("k1,k2,tangential,gain", [
    (-0.3, 0.05, 5e-4, 3), (-0.2, 0.03, 1e-3, 3), (0.2, 0.05, 2e-3, 2)])
def test_larger_sensors(size, k1, k2, tangential, gain):
    """A fraction bit less: twice the error in pixels, over twice the range."""
    width, height = size
    lens = (width, (width - 1) / 2 + 7.3, (height - 1) / 2 - 5.6, k1, k2, tangential, -tangential)
    tables = build(*lens, *size)
    assert tables["worst_gain"] <= gain and tables["worst_error"] <= 2 * LIMIT
    u, v = positions(*size, 1, 5000)
    x, y, ok = undistort(u, v, settings_of(tables), *size)
    wanted_x, wanted_y, _ = exact(u, v, lens, *size)
    size_of = np.maximum(np.abs(wanted_x), np.abs(wanted_y))
    assert ok[size_of < 511].all() and not ok[size_of > 512.2].any()
    error = np.hypot(x / 256 - wanted_x, y / 256 - wanted_y)[ok].max()
    assert error <= 2 * LIMIT, f"{error:.4f} px"


@pytest.mark.parametrize("lens,sentence", [
    ((300, 175.5, 143.5, -0.35, 0, 0, 0),
     "The lens model folds inside the 352 x 288 image (k1 = -0.35, k2 = 0, p1 = 0, p2 = 0), so it "
     "cannot be undone there."),
    ((352, 175.5, 143.5, -0.35, 0, 0, 0),
     "The lens model is about to fold inside the 352 x 288 image (k1 = -0.35, k2 = 0): an error of "
     "a centre would grow 6.3 times, and 4 times is the limit."),
    ((0, 175.5, 143.5, 0, 0, 0, 0), "The focal length must be positive, not 0 px."),
    ((300, 230, 143.5, 0, 0, 0, 0),
     "The principal point (230.0, 143.5) is too far from the centre of a 352 x 288 image."),
    ((300, -1, 143.5, 0, 0, 0, 0),
     "The principal point (-1.0, 143.5) is too far from the centre of a 352 x 288 image."),
    ((10, 175.5, 143.5, 0, 0, 0.02, 0),
     "The tangential distortion p1 = 0.02, p2 = 0 is too strong for a focal length of 10 px: the "
     "limit is 0.0098."),
])
def test_refusals(lens, sentence):
    with pytest.raises(ValueError) as caught:
        build(*lens, 352, 288)
    assert str(caught.value) == sentence


def test_lens_of_the_calibration():
    lens = Lens(352, 288, 300.0, 176.0, 143.0, -0.1, 0.01, 1e-4, 2e-4)
    tables = undistortion_settings(lens)
    assert sorted(tables) == sorted(FIELDS)
    with pytest.raises(UserError, match="folds inside.* Photograph the chessboard"):
        undistortion_settings(Lens(352, 288, 300.0, 176.0, 143.0, -0.35))
