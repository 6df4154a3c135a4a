# amaranth: UnusedElaboratable=no
"""Noise and levels: model against floating point, RTL against model."""

import numpy as np
import pytest
from amaranth.hdl import Module, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.payloads import ContrastPixel
from hdl.preprocessing.noise import Noise
from model.preprocessing.noise import Levels, frame_noise, learning_rows, levels
from tb.native_block import NativeBlock, pack

_LEVELS = data.StructLayout({"lit": 12, "core": 12, "dent": 10, "grey_noise": 9, "valid": 1})
_REGISTERS = ("lit_gain", "core_gain", "dent_gain", "fixed_noise")


class LevelsOfFrames(wiring.Component):
    """The levels as a stream, a word in the clock after each frame's end."""

    def __init__(self, width, height):
        self.noise = Noise(width, height)
        super().__init__({
            "i": In(stream.Signature(ContrastPixel)), "o": Out(stream.Signature(_LEVELS)),
            **{name: self.noise.signature.members[name] for name in _REGISTERS}})

    def elaborate(self, platform):
        m = Module()
        m.submodules.noise = noise = self.noise
        ended = Signal()
        m.d.sync += ended.eq(self.i.valid & self.i.p.marker.frame_end)
        m.d.comb += [
            self.i.ready.eq(1), noise.i.valid.eq(self.i.valid), noise.i.p.eq(self.i.p),
            self.o.valid.eq(ended),
            *(getattr(self.o.p, name).eq(getattr(noise, name)) for name, _ in _LEVELS),
            *(getattr(noise, name).eq(getattr(self, name)) for name in _REGISTERS)]
        return m


def differences(rng, height, width):
    kind = rng.integers(6)
    if kind == 0:
        values = np.zeros((height, width))
    elif kind == 1:
        values = np.full((height, width), -4080)
    elif kind == 2:
        values = rng.integers(-4080, 4081, (height, width))
    elif kind == 3:
        values = np.where(rng.random((height, width)) < 0.001, -300, 5)
    else:
        values = rng.normal(0, rng.choice([5, 20, 60, 300]), (height, width))
    return np.clip(np.rint(values), -4080, 4080).astype(np.int64)


def contrast_words(difference):
    line_end = np.zeros(difference.shape, bool)
    line_end[:, -1] = True
    frame_end = np.zeros(difference.shape, bool)
    frame_end[-1, -1] = True
    return pack(ContrastPixel, difference=difference.ravel() & 0x1FFF,
                marker_line_end=line_end.ravel(), marker_frame_end=frame_end.ravel())


BROKEN = pack(ContrastPixel, difference=[0x1000], marker_line_end=[1], marker_frame_end=[1],
              marker_broken=[1])


@pytest.mark.parametrize("seed", range(4))
def test_model_is_the_root_mean_square(seed):
    """Of Gaussian noise, half of which lies below zero, within 2 % and an eighth."""
    rng = np.random.default_rng(seed)
    for sigma in (1.5, 3.0, 12.0):
        noise = frame_noise(np.rint(rng.normal(0, 16 * sigma, (288, 352))).astype(int)) / 8
        assert abs(noise - sigma) < 0.02 * sigma + 1 / 8


def test_noise_has_a_floor_and_a_ceiling():
    assert frame_noise(np.full((64, 64), 4000)) == 8
    assert frame_noise(np.full((64, 64), -4080)) == 511


@pytest.mark.parametrize("width,height,rows", [
    (352, 288, 186), (64, 64, 32), (64, 8, 4), (20, 9, 3), (512, 512, 256), (640, 480, 410),
    (320, 256, 205)])
def test_learning_rows(width, height, rows):
    first, found, bits = learning_rows(width, height)
    assert found == rows and abs(rows - (1 << bits) / (width // 2)) <= 0.5
    assert first >= 1 and (height - first - rows) * width >= 48


def test_levels():
    assert levels(80, 24, 40, 4) == Levels(240, 400, 10)
    assert levels(511, 63, 63, 63) == Levels(4024, 4024, 1006)


@pytest.mark.parametrize("gap", [0, 0.4])
@pytest.mark.parametrize("gains", [(18, 40, 4), (0, 63, 63), (63, 1, 0)])
@pytest.mark.parametrize("width,height,seed", [
    (64, 8, 1), (64, 64, 2), (65, 20, 3), (48, 8, 4), (47, 8, 4), (24, 8, 5), (16, 16, 6)])
def test_levels_of_frames(width, height, seed, gains, gap):
    """Frames back to back; some are broken, wherever that is, and teach nothing."""
    rng = np.random.default_rng(seed)
    last, sent, expected = (0, 0, 0, 0, 0), [], []
    for _ in range(60):
        words = contrast_words(difference := differences(rng, height, width))
        if rng.random() < 0.3:
            last_row = width * (height - 1)
            cut = int(rng.choice([0, 1, last_row - 1, last_row + width // 2, width * height - 1]))
            words = np.concatenate([words[:cut], BROKEN])
        else:
            noise = frame_noise(difference)
            level = levels(noise, *gains)
            last = level.lit, level.core, level.dent, noise, 1
        sent.append(words)
        expected.append(last)
    block = NativeBlock(LevelsOfFrames(width, height))
    block.reset()
    block.set(**dict(zip(_REGISTERS, gains, strict=False)))
    beats = block.stream(np.concatenate(sent), gap, 0, seed, idle=4)
    got = beats.fields(_LEVELS)
    assert [tuple(map(int, word)) for word in got] == expected
    # A fixed noise counts from the first pixel on, after which one is learnt anew.
    block.set(fixed_noise=100)
    block.stream(BROKEN, idle=60)
    got = block.stream(BROKEN, idle=60).fields(_LEVELS)[0]
    level = levels(100, *gains)
    assert tuple(map(int, got)) == (level.lit, level.core, level.dent, 100, 1)
    block.set(fixed_noise=0)
    assert block.stream(BROKEN, idle=4).fields(_LEVELS)[0]["valid"] == 0


@pytest.mark.parametrize("size", [(15, 64), (1025, 64), (64, 7), (64, 1025)])
def test_refuses_sizes(size):
    with pytest.raises(ValueError, match="Frame (width|height) must be an integer from"):
        Noise(*size)
