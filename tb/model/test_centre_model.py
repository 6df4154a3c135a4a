"""The centre's arithmetic against exact division; ``pytest -s`` prints the largest errors."""

import numpy as np
import pytest

from calibration.reciprocal import reciprocal_table
from model.oracles.centre_oracle import centre
from model.preprocessing.centre import centres

TABLE = reciprocal_table()
LIMIT = 0.005


def errors(weight, total):
    """Error in pixels, exact but for the last step: both sides are whole numbers."""
    u, v = centres({"weight": weight, "sum_u": total, "sum_v": total}, TABLE)
    assert np.array_equal(u, v)
    return (u * weight - 512 * total) / (512.0 * weight)


@pytest.mark.parametrize("seed", [1])
def test_larger_sensors(seed):
    """With 8 fraction bits, twice the error in pixels for columns up to 1,023."""
    rng = np.random.default_rng(seed)
    weight = np.tile(np.arange(1, 261_889), 2)
    total = np.rint(weight * rng.uniform(0, 1023, len(weight))).astype(np.int64)
    total[:261_888] = 1023 * weight[:261_888]
    u, _ = centres({"weight": weight, "sum_u": total, "sum_v": total}, TABLE, 8)
    assert np.abs(u / 256 - total / weight).max() <= 2 * LIMIT


def test_table_words():
    assert len(TABLE) == 256
    assert all(isinstance(word, int) and 0 <= word < 2**36 for word in TABLE)


def test_every_binary_centre():
    """Every area up to 255 and every sum of coordinates up to 511."""
    worst = 0.0
    for area in range(1, 256):
        total = np.arange(511 * area + 1)
        worst = max(worst, np.abs(errors(np.full(len(total), area), total)).max())
    print(f"\nbinary centres: largest error {worst:.5f} px over every sum of every area")
    assert worst <= LIMIT


@pytest.mark.parametrize("seed", [1])
def test_every_weight(seed):
    """Every weight up to 65,280: the largest sums, which err most, and random ones."""
    rng = np.random.default_rng(seed)
    weight = np.arange(1, 65281)
    worst = 0.0
    for turn in range(100):
        share = (1, 8, 64, 511)[turn % 4]
        total = np.maximum(511 * weight - rng.integers(0, share * weight + 1), 0)
        worst = max(worst, np.abs(errors(weight, total)).max())
    print(f"\nweighted centres: largest error {worst:.5f} px over 100 sums of every weight")
    assert worst <= LIMIT


@pytest.mark.parametrize("seed", [1])
def test_against_fractions(seed):
    rng = np.random.default_rng(seed)
    weight = np.concatenate([rng.integers(1, 65281, 1500), 1 << np.arange(16), [65280, 255]])
    total = np.floor(rng.random(len(weight)) * (511 * weight + 1)).astype(int)
    u, _ = centres({"weight": weight, "sum_u": total, "sum_v": total}, TABLE)
    for each, weight_of, total_of in zip(u.tolist(), weight, total, strict=True):
        assert abs(each - 512 * centre(weight_of, total_of)) <= 512 * LIMIT


def test_result_stays_in_the_image():
    """The last column's and row's centres never wrap or pass 511 px."""
    weight = np.arange(1, 65281)
    u, v = centres({"weight": weight, "sum_u": 511 * weight, "sum_v": 0 * weight}, TABLE)
    assert u.max() <= 511 * 512 + 2 and u.min() >= 511 * 512 - 2
    assert not v.any()


def test_no_spots():
    empty = np.zeros(0, int)
    u, v = centres({"weight": empty, "sum_u": empty, "sum_v": empty}, TABLE)
    assert len(u) == len(v) == 0
