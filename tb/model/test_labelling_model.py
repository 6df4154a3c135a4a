"""The labelling model against OpenCV."""

import time

import numpy as np
import pytest

from model.oracles.labelling_oracle import components
from model.preprocessing.labelling import SPOT_DTYPE, label
from tb.preprocessing.labelling_images import bitmaps_4x4, directed, noise, tiled_4x4


def grey(lit, seed):
    """Core, excess and saturated for a mask: few are core, the brightest value is met."""
    rng = np.random.default_rng(seed)
    core = lit & (rng.random(lit.shape) < 0.05)
    excess = np.where(lit, rng.choice([0, 1, 254, 255, *rng.integers(0, 256, 12)], lit.shape), 0)
    return core, excess.astype(np.uint8), lit & (rng.random(lit.shape) < 0.02)


def check(lit, seed, weighted, what):
    pixels = lit, *grey(lit, seed)
    got = label(*pixels, weighted)
    want = np.array(components(*pixels, weighted), dtype=SPOT_DTYPE)
    assert got.dtype == SPOT_DTYPE
    assert len(got) == len(want), f"{what}: {len(got)} components, not {len(want)}"
    for index, (one, other) in enumerate(zip(got, want, strict=True)):
        assert one == other, f"{what}, weighted {weighted}, spot {index}: {one}, not {other}"


@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize("size", [(64, 64), (288, 352), (5, 3), (1, 9), (9, 1)])
def test_directed(size, weighted):
    for name, lit in {**directed(*size), **noise(*size, seed=1)}.items():
        check(lit, 2, weighted, name)


def test_every_4x4_bitmap():
    for number, bitmap in enumerate(bitmaps_4x4()):
        if number % 16 == 0:  # each by itself, touching all borders; the others in the tiles below
            check(bitmap, number, True, f"bitmap {number}")
    for number, frame in enumerate(tiled_4x4(288, 352)):
        check(frame, number, True, f"tiles {number}")


@pytest.mark.parametrize("seed", range(4))
def test_random_sizes(seed):
    rng = np.random.default_rng(seed)
    for number in range(250):
        height, width = rng.integers(1, 40, 2)
        lit = rng.random((height, width)) < rng.random()
        check(lit, number, bool(number & 1), f"seed {seed}, frame {number}")


def test_worst_noise_stays_fast():
    best = 1.0
    for name, lit in noise(288, 352, seed=3).items():
        pixels = lit, *grey(lit, 4)
        took = []
        for _ in range(3):
            start = time.perf_counter()
            label(*pixels, True)
            took.append(time.perf_counter() - start)
        best = min(took)
        assert best < 0.04, f"{name}: {best * 1e3:.1f} ms"
