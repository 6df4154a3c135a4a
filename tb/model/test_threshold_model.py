"""The level's definition against floating point, and the experiments that chose it."""

import csv
from math import floor
from pathlib import Path

import numpy as np
import pytest

from model.preprocessing.histogram import histogram
from model.preprocessing.threshold import threshold
from tb.preprocessing.histograms import directed, random_counts


def oracle(counts, alpha):
    """T in floating point, by the docstring's words; alpha as a number."""
    counts = np.array(counts, dtype=float)
    share = np.cumsum(counts) / counts.sum()
    pixels = counts.sum()
    counts[[0, 255]] = 0
    smooth = np.convolve(counts, [1, 2, 1], "same")
    candidates = np.where(share >= 0.5, smooth, 0)
    candidates[[0, 255]] = 0
    high = candidates > pixels // 64
    if not high.any():
        return 1 if share[254] >= 0.5 else 255
    at = int(np.argmax(high))  # climb until the histogram has fallen to a quarter
    peak = at
    while at < 255 and 4 * smooth[at] >= smooth[peak]:
        peak = at if candidates[at] > smooth[peak] else peak
        at += 1
    low = high = peak
    while low > 1 and 4 * smooth[low - 1] >= smooth[peak]:
        low -= 1
    while high < 254 and 4 * smooth[high + 1] >= smooth[peak]:
        high += 1
    bins = np.arange(low, high + 1)
    distance = bins - peak
    weights = counts[bins] / counts[bins].sum()
    level = peak + weights @ distance + alpha * 1.5 * (weights @ abs(distance))
    return min(255, max(peak + 1, 1 + floor(level)))


@pytest.mark.parametrize("pixels", [2944, 99968])
@pytest.mark.parametrize("seed", range(3))
def test_within_one_of_floating_point(pixels, seed):
    """3/2 alpha loses half an LSB of 1/16: at most a sigma's 1/32, 2 at sigma 60."""
    rng = np.random.default_rng(seed)
    cases = list(directed(pixels).values()) + [random_counts(rng, pixels) for _ in range(200)]
    for counts in cases:
        for alpha in (0, 32, 80, 160):
            assert abs(threshold(counts, alpha) - oracle(counts, alpha / 16)) <= 1
        assert abs(threshold(counts, 255) - oracle(counts, 255 / 16)) <= 3


def scene(rng, height, width, mean, sigma, spots):
    """Background, and the background with spots of 1.6 pixels sigma on a grid."""
    background = rng.normal(mean, sigma, (height, width))
    image = background.copy()
    row, column = np.mgrid[:height, :width]
    side = round(spots**0.5)
    positions = []
    for index in range(spots):
        u = width * (index % side + 0.5) / side + rng.uniform(-2, 2)
        v = height * (index // side + 0.5) / side + rng.uniform(-2, 2)
        positions.append((u, v))
        image += rng.uniform(70, 150) * np.exp(-((column - u)**2 + (row - v)**2) / (2 * 1.6**2))
    image, background = (np.clip(np.round(x), 0, 255).astype(np.uint8) for x in
                         (image, background))
    return image, background, positions


@pytest.mark.parametrize("mean", [12, 24, 40, 60])
@pytest.mark.parametrize("sigma", [2, 4, 8])
@pytest.mark.parametrize("height,width,spots", [(288, 352, 49), (64, 64, 9)])
def test_parts_spots_from_gaussian_background(height, width, spots, mean, sigma):
    """T within a sigma or 3 of mean + 5 sigma: no background pixel in 10,000 lit, no spot lost."""
    rng = np.random.default_rng([height, mean, sigma])
    image, background, positions = scene(rng, height, width, mean, sigma, spots)
    level = threshold(histogram(image), 80)
    assert abs(level - (mean + 5 * sigma)) <= max(3, sigma)
    assert np.count_nonzero(background >= level) <= image.size / 10_000
    for u, v in positions:
        assert image[round(v), round(u)] >= level


@pytest.mark.parametrize("mean,sigma", [(0, 1.5), (0, 3), (1, 2), (3, 3), (5, 8), (-3, 4)])
def test_dark_frames_that_clip_at_black(mean, sigma):
    """Up to most of the background piles up at 0; spots stand out all the same."""
    rng = np.random.default_rng(4)
    image, background, positions = scene(rng, 288, 352, mean, sigma, 49)
    level = threshold(histogram(image), 80)
    assert 2.5 * sigma - 1 <= level - max(mean, 0) <= 6 * sigma + 2
    assert np.count_nonzero(background >= level) <= image.size / 500
    for u, v in positions:
        assert image[round(v), round(u)] >= level


@pytest.mark.parametrize("black", [0.1, 0.3, 0.45])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_round_picture_in_black_corners(black, noise):
    rng = np.random.default_rng(9)
    image, _, positions = scene(rng, 288, 352, 50, 4, 49)
    row, column = np.mgrid[:288, :352]
    radius = np.hypot(row - 143.5, column - 175.5)
    outside = radius > np.quantile(radius, 1 - black)
    image[outside] = np.clip(np.round(rng.normal(1, noise, outside.sum())), 0, 255)
    level = threshold(histogram(image), 80)
    assert 65 <= level <= 76


@pytest.mark.parametrize("grey", [0, 1, 77, 254, 255])
def test_single_value_is_dark(grey):
    """Nothing is lit in an image without contrast, but white, which no level can part from."""
    image = np.full((288, 352), grey, np.uint8)
    level = threshold(histogram(image), 80)
    assert level == min(255, grey + 1)


def test_two_backgrounds():
    """The one that makes up half of the image is the background."""
    rng = np.random.default_rng(3)
    for share, wanted in ((0.3, (40, 46)), (0.7, (130, 136))):
        bright = rng.random((288, 352)) < share
        image = np.round(rng.normal(np.where(bright, 120, 30), 2.3)).astype(np.uint8)
        assert wanted[0] <= threshold(histogram(image), 80) <= wanted[1]


def _real_histograms():
    """Histograms of real frames: (frame, pixels) to 256 counts.

    ``counted`` are the pixels that the chip counts, ``image`` all of them, ``dots`` those that the
    authors marked as laser dots. The frames are of the HLEDataset (hle: vocal folds, high-speed
    laryngoscope; Henningson, MIT) and of EndoSLAM (tissue seen by four endoscopes; MIT).
    """
    with open(Path(__file__).with_name("real_histograms.csv"), newline="") as file:
        return {(frame, pixels): np.array(counts, int)
                for frame, pixels, *counts in list(csv.reader(file))[1:]}


REAL = _real_histograms()


@pytest.mark.parametrize("frame,lit", [
    ("hle_cf", 0.05), ("hle_dd", 0.05), ("endoslam_lowcam_0", 0.02), ("endoslam_mirocam_0", 0.02),
    ("endoslam_pillcam_0", 0.02), ("endoslam_wifi_0", 0.02)])
def test_real_tissue_stays_dark(frame, lit):
    """Wide histograms, highlights, black corners: at 5 sigma hardly anything but spots is lit."""
    counts = REAL[frame, "image"]
    assert counts[threshold(REAL[frame, "counted"], 80):].sum() <= lit * counts.sum()


@pytest.mark.parametrize("frame", ["hle_cf", "hle_dd"])
def test_real_dots_are_lit(frame):
    """Marked laser dots are lit at 2 sigma, the tissue mostly is not."""
    level = threshold(REAL[frame, "counted"], 32)
    dots, counts = REAL[frame, "dots"], REAL[frame, "image"]
    assert dots[level:].sum() >= 0.95 * dots.sum()
    assert counts[level:].sum() < 0.12 * counts.sum()
