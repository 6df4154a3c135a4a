# amaranth: UnusedElaboratable=no
"""Erosion: RTL against model on streams of frames, model against OpenCV."""

import cv2
import numpy as np
import pytest

from hdl.payloads import MaskPixel
from hdl.preprocessing.erosion import Erosion
from model.preprocessing.erosion import erode
from tb import hdlsim
from tb.native_block import NativeBlock
from tb.preprocessing.frames import BROKEN_MASK, mask_words

MODES = ("off", "erode", "gate")


def random_mask(rng, height, width):
    """Lit pixels of some density, often dense enough for cores, and their excess."""
    lit = rng.random((height, width)) < rng.choice([0.0, 0.3, 0.7, 0.9, 0.97, 1.0])
    return lit, np.where(lit, rng.integers(0, 256, lit.shape), 0).astype(np.uint8)


def expected_words(lit, excess, mode):
    out, core = erode(lit, mode)
    return mask_words(out, core, np.where(out, excess, 0))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("seed", range(3))
def test_model_is_opencvs_erosion(mode, seed):
    rng = np.random.default_rng(seed)
    for height, width in [(3, 3), (16, 16), (64, 64), (288, 352)]:
        lit, _ = random_mask(rng, height, width)
        wanted = cv2.erode(lit.astype(np.uint8), np.ones((3, 3), np.uint8),
                           borderType=cv2.BORDER_CONSTANT, borderValue=0).astype(bool)
        out, core = erode(lit, mode)
        assert np.array_equal(core, lit if mode == "off" else wanted)
        assert np.array_equal(out, wanted if mode == "erode" else lit)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("gap,stall", [(0, 0), (0.4, 0), (0, 0.4), (0.3, 0.5), (0.9, 0)])
@pytest.mark.parametrize("width,seed", [(3, 1), (16, 2), (64, 3)])
def test_frames_back_to_back(mode, gap, stall, width, seed):
    rng = np.random.default_rng(seed)
    masks = [random_mask(rng, 12, width) for _ in range(12)]
    block = NativeBlock(Erosion(width))
    block.reset()
    block.set(mode=MODES.index(mode))
    beats = block.stream(np.concatenate([mask_words(lit, lit, excess) for lit, excess in masks]),
                         gap, stall, seed, idle=4 * width + 64)
    assert np.array_equal(
        beats.words, np.concatenate([expected_words(*mask, mode) for mask in masks]))


def test_one_pixel_a_clock_and_flush_by_itself():
    rng = np.random.default_rng(5)
    lit, excess = random_mask(rng, 288, 352)
    block = NativeBlock(Erosion(352))
    block.reset()
    block.set(mode=2)
    words = mask_words(lit, lit, excess)
    beats = block.stream(np.concatenate([words] * 3), idle=400)
    assert beats.taken[-1] - beats.taken[0] == 3 * 352 * 288 - 1
    assert len(beats.words) == 3 * len(words)
    assert beats.clocks[-1] - beats.taken[-1] <= 352 + 3
    behind = 352 + 1
    assert np.array_equal(beats.clocks[:-behind] - beats.taken[behind:],
                          np.full(len(beats.taken) - behind, Erosion.latency))


@pytest.mark.parametrize("gap,stall", [(0, 0), (0.3, 0.3)])
@pytest.mark.parametrize("seed", range(6))
def test_broken_frames_are_discarded(gap, stall, seed):
    rng = np.random.default_rng(seed)
    width, height = 16, 10
    sent, wanted, masks = [], [], []
    for _ in range(40):
        lit, excess = random_mask(rng, height, width)
        words = mask_words(lit, lit, excess)
        if rng.random() < 0.5:
            cut = rng.choice([0, 1, 2, width - 1, width, width + 1, 2 * width, len(words) - 1])
            sent += [words[:cut], BROKEN_MASK]
            masks.append(None)
        else:
            sent.append(words)
            masks.append(expected_words(lit, excess, "gate"))
    block = NativeBlock(Erosion(width))
    block.reset()
    block.set(mode=2)
    beats = block.stream(np.concatenate(sent), gap, stall, seed, idle=8 * width)
    fields = beats.fields(MaskPixel)
    ends = np.flatnonzero(fields["marker_frame_end"]) + 1
    assert len(ends) == len(masks)
    for frame, wanted in zip(np.split(beats.words, ends[:-1]), masks, strict=True):
        if wanted is None:
            assert np.array_equal(frame[-1], BROKEN_MASK[0])
        else:
            assert np.array_equal(frame, wanted)


@pytest.mark.parametrize("width,seed", [(3, 1), (17, 2)])
def test_erosion(request, width, seed):
    hdlsim.run(request, "erosion", "tb.preprocessing.tb_erosion", component=Erosion(width),
               parameters={"width": width, "seed": seed})


@pytest.mark.parametrize("width", [2, 513, "wide", 8.0])
def test_refuses_widths(width):
    with pytest.raises(ValueError, match="must be an integer from 3 to 512"):
        Erosion(width)
