# amaranth: UnusedElaboratable=no
"""Threshold alone on any histogram, and behind the histogram on whole frames."""

import numpy as np
import pytest
from amaranth.hdl import C, Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.payloads import GreyPixel
from hdl.preprocessing.histogram import Histogram
from hdl.preprocessing.threshold import Threshold
from model.preprocessing.histogram import histogram
from model.preprocessing.threshold import threshold
from tb.hdlsim import run
from tb.native_block import NativeBlock
from tb.preprocessing.frames import BROKEN_GREY, grey_words
from tb.system.stimuli import directed_frames, random_frame


class Learner(wiring.Component):
    """Histogram and threshold beside a stream of frames that only passes by.

    With ``whole`` the stream waits between frames until the bins are clean.
    """

    def __init__(self, width, height, whole=False):
        self.width, self.height, self.whole = width, height, whole
        super().__init__({
            "i": In(stream.Signature(GreyPixel)), "o": Out(stream.Signature(GreyPixel)),
            "threshold_alpha": In(8), "level": Out(8), "threshold_valid": Out(1)})

    def elaborate(self, platform):
        m = Module()
        m.submodules.histogram = bins = Histogram(self.width, self.height, self.whole)
        m.submodules.threshold = level = Threshold(self.width, self.height, self.whole)
        passes = bins.clean if self.whole else C(1)
        if self.whole:
            m.d.comb += bins.clear.eq(level.known)
        m.d.comb += [
            self.o.valid.eq(self.i.valid & passes), self.o.payload.eq(self.i.payload),
            self.i.ready.eq(self.o.ready & passes),
            bins.i.valid.eq(self.i.valid & self.i.ready), bins.i.payload.eq(self.i.payload),
            level.closed.eq(bins.closed),
            level.done.eq(level.known if self.whole else bins.done), level.lost.eq(bins.lost),
            bins.address.eq(level.address), level.count.eq(bins.count),
            level.threshold_alpha.eq(self.threshold_alpha), self.level.eq(level.level),
            self.threshold_valid.eq(level.threshold_valid)]
        return m


@pytest.mark.parametrize("width,height,seed", [(64, 64, 1), (352, 288, 2)])
def test_threshold(request, width, height, seed):
    component = Threshold(width, height)
    run(request, "threshold", "tb.preprocessing.tb_threshold", component=component,
        parameters={"pixels": component.pixels, "seed": seed})


@pytest.mark.parametrize("width,height,frames,gap", [
    (64, 64, 60, 0.0), (64, 64, 30, 0.3), (352, 288, 8, 0.0), (64, 19, 40, 0.0), (16, 200, 20, 0.0),
    (512, 512, 2, 0.0)])
def test_frames_without_blanking(width, height, frames, gap):
    """The level of a frame holds from the clock after its last pixel on, to the next one's."""
    rng = np.random.default_rng([width, frames])
    block = NativeBlock(Learner(width, height))
    block.reset()
    images = list(directed_frames(width, height).values())[:frames // 3]
    images += [random_frame(width, height, seed) for seed in range(frames - len(images))]
    level = None
    for number, image in enumerate(images):
        alpha = int(rng.choice([16, 48, 80, 255]))
        block.set(threshold_alpha=alpha)
        words = grey_words(image)
        for part in np.split(words, np.sort(rng.integers(1, len(words), 3))):
            assert level is None or block.get("level") == level
            block.stream(part, gap, seed=number)
        level = threshold(histogram(image), alpha)
        assert (block.get("level"), block.get("threshold_valid")) == (level, 1), f"frame {number}"


@pytest.mark.parametrize("seed", range(3))
def test_a_lost_frame_costs_no_other(seed):
    rng = np.random.default_rng(seed)
    block = NativeBlock(Learner(64, 64))
    block.reset()
    block.set(threshold_alpha=80)
    level, valid = block.get("level"), 0
    for number in range(60):
        words = grey_words(image := random_frame(64, 64, int(rng.integers(1000))))
        if rng.random() < 0.5:
            cut = int(rng.choice([0, 1, 300, 2000, 50 * 64, 51 * 64, 51 * 64 + 400, 4095]))
            block.stream(np.concatenate([words[:cut], BROKEN_GREY]), seed=number)
        else:
            block.stream(words, seed=number)
            level, valid = threshold(histogram(image), 80), 1
        assert (block.get("level"), block.get("threshold_valid")) == (level, valid), (
            f"frame {number}")


@pytest.mark.parametrize("width,height,frames,gap", [
    (64, 64, 60, 0.0), (64, 64, 30, 0.3), (352, 288, 6, 0.0), (32, 20, 60, 0.0),
    (512, 512, 2, 0.0)])
def test_whole_frames(width, height, frames, gap):
    """The level of a frame is that of all its pixels, and known a little later."""
    rng = np.random.default_rng([width, frames, 5])
    block = NativeBlock(Learner(width, height, whole=True))
    block.reset()
    images = list(directed_frames(width, height).values())[:frames // 3]
    images += [random_frame(width, height, seed) for seed in range(frames - len(images))]
    level = None
    for number, image in enumerate(images):
        alpha = int(rng.choice([16, 48, 80, 255]))
        block.set(threshold_alpha=alpha)
        words = grey_words(image)
        if rng.random() < 0.3:
            cut = int(rng.integers(1, len(words)))
            block.stream(np.concatenate([words[:cut], BROKEN_GREY]), gap, seed=number)
        block.stream(words, gap, seed=number)
        assert level is None or block.get("level") == level
        block.stream(words[:0], idle=Threshold.latency + 2)
        level = threshold(histogram(image, whole=True), alpha)
        assert (block.get("level"), block.get("threshold_valid")) == (level, 1), f"frame {number}"
        start = block.clocks
        taken = block.stream(words[:1]).taken[0] - start
        assert taken <= 260, "the bins take too long to be cleared"
        block.stream(BROKEN_GREY)


@pytest.mark.parametrize("size", [(0, 64), (64, 18), (64, None)])
def test_refuses_sizes(size):
    with pytest.raises(ValueError, match="Frame height must be|Frame width must be|too small"):
        Threshold(*size)
