# amaranth: UnusedElaboratable=no
"""Two levels: RTL against model, at the levels and one LSB beside them."""

import numpy as np
import pytest

from hdl.payloads import ContrastPixel, MaskPixel
from hdl.preprocessing.hysteresis import Hysteresis
from model.preprocessing.hysteresis import hysteresis
from model.preprocessing.noise import Levels
from tb.native_block import NativeBlock, pack, unpack
from tb.preprocessing.frames import BROKEN_MASK, mask_words


def specified(words):
    """The words without the excess of dark pixels, which has no meaning."""
    words = words.copy()
    words[unpack(MaskPixel, words)["lit"] == 0] &= ~pack(MaskPixel, excess=[0xFF])
    return words


@pytest.mark.parametrize("gap,stall", [(0, 0), (0.4, 0.4)])
@pytest.mark.parametrize("seed", range(3))
def test_hysteresis(seed, gap, stall):
    rng = np.random.default_rng(seed)
    block = NativeBlock(Hysteresis())
    block.reset()
    for lit, core in [(32, 48), (0, 0), (4095, 4095), (100, 60), (60, 100)]:
        near = np.array([lit, lit - 1, lit + 1, core, core - 1, core + 1, lit + 15, lit + 16, 0, -1,
                         -4080, 4080])
        difference = rng.choice(np.clip(near, -4096, 4095), (16, 32))
        smooth = rng.choice(np.clip(near >> 1, -2048, 2047), (16, 32))
        dent, saturated = rng.random((2, 16, 32)) < 0.2
        line_end, frame_end, border = np.zeros((3, 16, 32), bool)
        line_end[:, -1], frame_end[-1, -1] = True, True
        border[[0, -1]] = border[:, -1] = True
        words = pack(ContrastPixel, difference=difference.ravel() & 0x1FFF,
                     smooth=smooth.ravel() & 0xFFF, dent=dent.ravel(), border=border.ravel(),
                     saturated=saturated.ravel(),
                     marker_line_end=line_end.ravel(), marker_frame_end=frame_end.ravel())
        broken = pack(ContrastPixel, difference=[0xFFF], smooth=[0x7FF], marker_line_end=[1],
                      marker_frame_end=[1], marker_broken=[1])
        is_lit, *others = hysteresis(difference, smooth, dent, Levels(lit, core, 0))
        wanted = mask_words(is_lit, *others, is_lit & saturated)
        block.set(enable=1, lit=lit, core=core)
        beats = block.stream(np.concatenate([words, broken]), gap, stall, seed, idle=64)
        assert np.array_equal(specified(beats.words), np.concatenate([wanted, BROKEN_MASK]))
        block.set(enable=0)
        beats = block.stream(words, gap, stall, seed, idle=64)
        dark = np.zeros((16, 32), bool)
        assert np.array_equal(specified(beats.words), mask_words(dark, dark, dark))
