# amaranth: UnusedElaboratable=no
"""Local background: model against an oracle in float, RTL against model on streams of frames."""

import cv2
import numpy as np
import pytest

from hdl.payloads import ContrastPixel
from hdl.preprocessing.background import Background
from model.preprocessing.background import background, window_mean
from tb.native_block import NativeBlock, pack, unpack
from tb.preprocessing.frames import BROKEN_GREY, grey_words

BROKEN = pack(ContrastPixel, marker_line_end=[1], marker_frame_end=[1], marker_broken=[1])


def random_image(rng, height, width):
    """Noise, ramps, blobs, extremes: each a kind of its own."""
    kind = rng.integers(6)
    image = rng.integers(0, 256, (height, width))
    if kind == 0:
        image = image * (rng.random((height, width)) < 0.1)
    elif kind == 1:
        image = np.full((height, width), rng.choice([0, 255]))
    elif kind == 2:
        image = np.linspace(0, 255, width)[None] + rng.normal(0, 2, (height, width))
    elif kind == 3:
        image = cv2.GaussianBlur(image.astype(float), (0, 0), 1.5) * 3 - 250
    elif kind == 4:
        image = (image > 128) * 255
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def words(image, window, dent, saturation=255):
    difference, smooth, dents = background(image, window, dent)
    line_end, frame_end, border = np.zeros((3, *image.shape), bool)
    line_end[:, -1] = True
    frame_end[-1, -1] = True
    border[[0, -1]] = border[:, -1] = True
    return pack(ContrastPixel, difference=difference.ravel() & 0x1FFF,
                smooth=smooth.ravel() & 0xFFF, dent=dents.ravel(), border=border.ravel(),
                saturated=image.ravel() >= saturation,
                marker_line_end=line_end.ravel(), marker_frame_end=frame_end.ravel())


def specified(beats):
    """Words without what has no meaning: *smooth* on the border, all of a broken beat."""
    beats = beats.copy()
    fields = unpack(ContrastPixel, beats)
    border, broken = (fields[name] != 0 for name in ("border", "marker_broken"))
    beats[border] &= ~pack(ContrastPixel, smooth=[0xFFF])
    beats[broken] = BROKEN
    return beats


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("window", [5, 9, 11, 15, 31])
def test_mean_is_opencvs(window, seed):
    """OpenCV's box filter, divided by what of the box lies inside, rounded down: sums of columns to
    multiples of four, the mean to 1/16, and the reciprocal costs 1/16 more."""
    rng = np.random.default_rng(seed)
    for height, width in [(window, window + 5), (64, 64), (288, 352)]:
        image = random_image(rng, height, width)
        box = {"ddepth": cv2.CV_64F, "ksize": (window, window), "normalize": False,
               "borderType": cv2.BORDER_CONSTANT}
        wanted = cv2.boxFilter(image, **box) / cv2.boxFilter(np.ones_like(image), **box)
        half = window // 2
        row = np.minimum(np.arange(height), height - 1 - half)[:, None]
        column = np.clip(np.arange(width), half, width - 1 - half)
        error = window_mean(image, window) / 16 - wanted[row, column]
        assert error.min() > -2 / 16 - 3 / (half + 1) and error.max() < 1 / 16


def test_contrast_of_a_spot():
    """By hand: a spot of one pixel, and two spots with a dent between them."""
    image = np.full((15, 24), 10, np.uint8)
    image[7, 8] = 131
    difference, smooth, dents = background(image, 11, 242)
    # Ten columns of 110 and one of 231, rounded down to 108 and 228.
    mean = int(16 * (10 * 108 + 228) / 121)
    assert difference[7, 8] == 16 * 131 - mean - 1 and difference[7, 9] == 16 * 10 - mean - 1
    for column, bright in ((6, 0), (7, 2), (8, 2), (9, 0)):
        assert smooth[7, column] == bright * 131 + (8 - bright) * 10 - (mean >> 1) - 1
    assert not dents.any()
    image[7, 12] = 131
    turned = np.ascontiguousarray(image[:, :16].T)
    for dent, dents in ((1, 1), (483, 1), (484, 0), (0, 0)):
        assert np.argwhere(background(image, 11, dent)[2]).tolist() == [[7, 10]] * dents
        assert np.argwhere(background(turned, 11, dent)[2]).tolist() == [[10, 7]] * dents


@pytest.mark.parametrize("gap,stall", [(0, 0), (0.4, 0), (0, 0.4), (0.3, 0.5), (0.9, 0)])
@pytest.mark.parametrize("width,height,window,seed", [
    (22, 11, 11, 1), (24, 13, 9, 2), (10, 12, 5, 3), (64, 64, 9, 4), (40, 30, 15, 5),
    (64, 33, 31, 6)])
def test_frames_back_to_back(width, height, window, seed, gap, stall):
    rng = np.random.default_rng(seed)
    images = [random_image(rng, height, width) for _ in range(8)]
    block = NativeBlock(Background(width, window))
    block.reset()
    dent = int(rng.choice([1, 3, 40, 1023]))
    saturation = int(rng.choice([1, 100, 255]))
    block.set(dent=dent, saturation=saturation)
    beats = block.stream(np.concatenate([grey_words(image) for image in images]), gap, stall, seed,
                         idle=(window // 2 + 1) * 2 * width + 64)
    wanted = specified(np.concatenate([
        words(image, window, dent, saturation) for image in images]))
    assert len(beats.words) == len(wanted)
    wrong = np.flatnonzero((specified(beats.words) != wanted).any(axis=-1))
    assert not len(wrong), divmod(int(wrong[0]) % (width * height), width)


def test_one_pixel_a_clock_and_drains_by_itself():
    rng = np.random.default_rng(5)
    image = random_image(rng, 288, 352)
    design = Background(352)
    block = NativeBlock(design)
    block.reset()
    beats = block.stream(np.concatenate([grey_words(image)] * 3), idle=6 * 352)
    assert beats.taken[-1] - beats.taken[0] == 3 * 352 * 288 - 1
    assert len(beats.words) == 3 * 352 * 288
    assert beats.clocks[0] - beats.taken[0] == design.latency
    assert beats.clocks[-1] - beats.taken[-1] == design.latency


@pytest.mark.parametrize("gap,stall", [(0, 0), (0.3, 0.3)])
@pytest.mark.parametrize("seed", range(6))
def test_broken_frames_are_forgotten(gap, stall, seed):
    rng = np.random.default_rng(seed)
    width, height, window = 22, 14, 11
    sent, frames = [], []
    for _ in range(40):
        image = random_image(rng, height, width)
        pixels = grey_words(image)
        if rng.random() < 0.5:
            cut = rng.choice([0, 1, 2, width - 1, width, 5 * width, 5 * width + 1, 6 * width + 3,
                              len(pixels) - 1])
            sent += [pixels[:cut], BROKEN_GREY]
            frames.append(None)
        else:
            sent.append(pixels)
            frames.append(specified(words(image, window, 4)))
    block = NativeBlock(Background(width, window))
    block.reset()
    block.set(dent=4, saturation=255)
    beats = block.stream(np.concatenate(sent), gap, stall, seed, idle=16 * width)
    ends = np.flatnonzero(beats.fields(ContrastPixel)["marker_frame_end"]) + 1
    assert len(ends) == len(frames)
    for got, wanted in zip(np.split(specified(beats.words), ends[:-1]), frames, strict=True):
        assert np.array_equal(got[-1:] if wanted is None else got,
                              BROKEN if wanted is None else wanted)


@pytest.mark.parametrize("choices, sentence", [
    ({"width": 64, "window": 8}, "The window must be an odd integer from 5 to 31, not 8"),
    ({"width": 80, "window": 33}, "The window must be an odd integer from 5 to 31, not 33"),
    ({"width": 21}, "Frame width must be an integer from 22 to 1024, not 21"),
    ({"width": 1025}, "Frame width must be an integer from 22 to 1024, not 1025"),
])
def test_refuses(choices, sentence):
    with pytest.raises(ValueError, match=sentence):
        Background(**choices)
