"""The model of two-pass labelling against OpenCV, and against the streaming one."""

import time

import numpy as np
import pytest

from model.oracles.two_pass_labelling_oracle import components_in_two_passes
from model.preprocessing.labelling import SPOT_DTYPE, label
from model.preprocessing.two_pass_labelling import label_in_two_passes, labels_used
from tb.preprocessing.labelling_images import bitmaps_4x4, directed, noise, tiled_4x4


def check(lit, seed, labels, what):
    """Against OpenCV; without dropped ones also against the streaming model."""
    core = lit & (np.random.default_rng(seed).random(lit.shape) < 0.05)
    got, dropped = label_in_two_passes(lit, core, labels)
    want, missed = components_in_two_passes(lit, core, labels)
    assert got.dtype == SPOT_DTYPE and dropped == missed, what
    assert got.tolist() == want, what
    if not dropped:
        streamed = label(lit, core, 0 * lit, 0 * lit, False)
        assert sorted(streamed.tolist()) == sorted(want), what
    return dropped


@pytest.mark.parametrize(("size", "labels"), [
    ((64, 64), 3), ((64, 64), 100), ((64, 64), 32767), ((288, 352), 1023), ((5, 3), 2),
    ((1, 9), 3), ((9, 1), 3)])
def test_directed(size, labels):
    for name, lit in {**directed(*size), **noise(*size, seed=1)}.items():
        dropped = check(lit, 2, labels, name)
        assert not dropped or labels < 32767


@pytest.mark.parametrize("labels", [1, 2, 4])
def test_4x4_bitmaps(labels):
    """Each by itself, touching all borders; the others in the tiles below."""
    dropped = sum(check(bitmap, number, labels, f"bitmap {number}") > 0
                  for number, bitmap in enumerate(bitmaps_4x4()[labels::16]))
    # No bitmap needs more than four labels.
    assert (dropped == 0) == (labels == 4)


def test_every_4x4_bitmap_in_tiles():
    for number, frame in enumerate(tiled_4x4(288, 352)):
        check(frame, number, 32767, f"tiles {number}")


@pytest.mark.parametrize("seed", range(4))
def test_random_sizes(seed):
    rng = np.random.default_rng(seed)
    for number in range(250):
        height, width = rng.integers(1, 40, 2)
        lit = rng.random((height, width)) < rng.random()
        check(lit, number, int(rng.integers(1, 60)), f"seed {seed}, frame {number}")


def test_worst_case_of_cif():
    lit = directed(288, 352)["isolated pixels"]
    assert labels_used(lit, 32767) == 25344
    spots, dropped = label_in_two_passes(lit, lit, 1023)
    assert len(spots) == 1023 and dropped == 25344 - 1023


def test_stays_fast():
    for name, lit in {**directed(288, 352), **noise(288, 352, seed=3)}.items():
        start = time.perf_counter()
        label_in_two_passes(lit, lit, 1023)
        took = time.perf_counter() - start
        assert took < 0.5, f"{name}: {took * 1e3:.0f} ms"
