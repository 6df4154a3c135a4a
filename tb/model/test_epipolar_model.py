"""Models of the matcher and of the depth against slow, obvious arithmetic."""

import random
from fractions import Fraction
from math import floor

import numpy as np
import pytest

from model.stereo.depth import inverse_depth, pack_depth
from model.stereo.epipolar import (
    AMBIGUOUS,
    NOISE,
    OK,
    REJECTED,
    match,
    pack_line,
    pack_window,
    unpack_line,
    unpack_window,
)

LSB = Fraction(1, 512)


def oracle(x, y, rejected, beams):
    """Status and beam of one spot; ``beams`` are tuples of integers as the words hold them."""
    near, found = False, []
    for beam, (slope, offset, tolerance, u_min, u_max) in enumerate(beams):
        exact = Fraction(slope, 1 << 17) * x  # in LSB of a coordinate
        estimate = floor(exact + Fraction(1, 2)) + offset
        if abs(y - estimate) * LSB < Fraction(tolerance, 32):
            near = True
            if Fraction(u_min, 16) <= Fraction(floor(x * LSB * 16), 16) <= Fraction(u_max, 16):
                found.append(beam)
    if rejected:
        return REJECTED, 0
    if len(found) == 1:
        return OK, found[0]
    if found:
        return AMBIGUOUS, 0
    return (REJECTED, 0) if near else (NOISE, 0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_match_against_fractions(seed):
    rng = random.Random(seed)
    beams = [(rng.randint(-(1 << 17), (1 << 17) - 1) if rng.random() < 0.3 else
              rng.randint(-9000, 9000), rng.randint(-60000, 60000), rng.choice([0, 1, 90, 511]),
              rng.randint(-4096, 1000), rng.randint(-1000, 4095)) for _ in range(13)]
    slope, offset, tolerance, u_min, u_max = zip(*beams, strict=True)
    line, window = pack_line(slope, offset), pack_window(tolerance, u_min, u_max)
    spots = []
    for _ in range(600):
        x = rng.randint(-(1 << 17), (1 << 17) - 1)
        a, b, t, low, high = rng.choice(beams)
        if rng.random() < 0.5:
            x = min(max(rng.choice([low, high]) * 32 + rng.choice([-1, 0, 31, 32]), -(1 << 17)),
                    (1 << 17) - 1)
        y = ((a * x + (1 << 16)) >> 17) + b + rng.choice([-1, 1]) * (
            16 * t + rng.choice([-1, 0, 1]))
        spots.append((x, y, rng.random() < 0.05))
    x, y, rejected = (np.array(column) for column in zip(*spots, strict=True))
    status, beam = match(x, y, rejected, line, window)
    assert list(zip(status.tolist(), beam.tolist(), strict=True)) == [
        oracle(*spot, beams) for spot in spots]
    assert set(status.tolist()) == {OK, NOISE, AMBIGUOUS, REJECTED}


def test_words_hold_what_was_packed():
    assert [v.tolist() for v in unpack_line(pack_line([-131072, 131071], [131071, -131072]))] == [
        [-131072, 131071], [131071, -131072]]
    fields = ([0, 511], [-4096, 4095], [4095, -4096])
    assert tuple(v.tolist() for v in unpack_window(pack_window(*fields))) == fields
    assert int(pack_line(1, 1)) == 1 | 1 << 18
    assert int(pack_window(1, 1, 1)) == 1 | 1 << 9 | 1 << 22


@pytest.mark.parametrize("pack,fields,name", [
    (pack_line, (131072, 0), "Slope"), (pack_line, (0, -131073), "Offset"),
    (pack_window, (512, 0, 0), "Tolerance"), (pack_window, (0, 4096, 0), "Lower window limit"),
    (pack_window, (0, 0, -4097), "Upper window limit"),
])
def test_what_does_not_fit_is_refused(pack, fields, name):
    with pytest.raises(ValueError, match=f"{name} must be between"):
        pack(*fields)


def test_no_spots():
    line, window = pack_line([0], [0]), pack_window([1], [0], [0])
    status, beam = match([], [], [], line, window)
    assert len(status) == len(beam) == 0
    assert [len(a) for a in inverse_depth([], [], [], pack_depth([0], [0]))] == [0, 0, 0]


@pytest.mark.parametrize("seed", [1, 2])
def test_depth_against_fractions(seed):
    rng = random.Random(seed)
    alpha = [rng.randint(-131072, 131071) for _ in range(20)]
    beta = [rng.randint(-(1 << 31), 1 << 31) for _ in range(20)]
    table = pack_depth(alpha, beta)
    n = 500
    x = [rng.randint(-131072, 131071) for _ in range(n)]
    beam = [rng.randrange(20) for _ in range(n)]
    status = [rng.choice([OK, OK, OK, NOISE, REJECTED]) for _ in range(n)]
    for at in range(0, n, 3):  # about the limits of the range
        limit = rng.choice([1, 1 << 18]) << 12
        k = beam[at]
        beta[k] = limit - 2048 - alpha[k] * x[at] + rng.choice([-1, 0, 1])
        table[2 * k + 1] = beta[k] & 0xFFFFFFFFF
        got = inverse_depth(x[at], k, OK, table)
        value = floor(Fraction(alpha[k] * x[at] + beta[k], 1 << 12) + Fraction(1, 2))
        want = (OK, k, value) if 1 <= value <= 0x3FFFF else (REJECTED, 0, 0)
        assert tuple(int(a[0]) for a in got) == want
    got = inverse_depth(x, beam, status, table)
    for at in range(n):
        value = floor(Fraction(alpha[beam[at]] * x[at] + beta[beam[at]], 1 << 12)
                      + Fraction(1, 2))
        want = (status[at], 0, 0)
        if status[at] == OK:
            want = (OK, beam[at], value) if 1 <= value <= 0x3FFFF else (REJECTED, 0, 0)
        assert tuple(int(a[at]) for a in got) == want


def test_depth_error_budget():
    """Half an LSB of alpha at this column, half an LSB of beta, half an LSB of the result."""
    rng = random.Random(7)
    for _ in range(300):
        alpha, beta = rng.uniform(-20, 20), rng.uniform(0, 200000)
        table = pack_depth([round(alpha * 4096)], [round(beta * 4096)])
        x = rng.randint(-9000, 9000)
        exact = alpha * x + beta
        if 1 < exact < 262143:
            got = int(inverse_depth(x, 0, OK, table)[2][0])
            assert abs(got - exact) <= 0.5 + (abs(x) + 1) / 8192
