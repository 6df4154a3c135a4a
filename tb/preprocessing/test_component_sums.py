# amaranth: UnusedElaboratable=no
"""Labelled images through the sums, against the model."""

from functools import cache

import cv2
import numpy as np
import pytest

from hdl.payloads import Spot
from hdl.preprocessing.component_sums import ComponentSums
from model.preprocessing.component_sums import component_sums
from tb.native_block import NativeBlock, pack
from tb.preprocessing.frames import check_spots, spot_frames
from tb.preprocessing.labelling_images import directed, noise
from tb.preprocessing.sums_rig import Kind, SumsCommand, SumsRig

SMALL, CIF = (64, 64), (288, 352)


@cache
def sums(size, labels, interval=1):
    return NativeBlock(SumsRig(size[1], size[0], labels, interval))


def labelled(mask, labels, rng):
    """Labels of a mask's pixels, several in a component, and the root of each; some are 0.

    As many as ``labels`` are given out where the mask has so many pixels; some have no pixel.
    """
    count, components = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    used = int(min(labels, rng.integers(count - 1, 3 * count + 1)))
    owner = rng.integers(1, count + 1, used)  # component of each label; the last one has no pixels
    root = np.arange(used + 1)
    image = np.zeros(mask.shape, int)
    for component in range(1, count + 1):
        mine = 1 + np.flatnonzero(owner == component)
        if len(mine):
            root[mine] = 0 if rng.random() < 0.1 else mine[0]
            pixels = components == component
            image[pixels] = rng.choice(mine, np.count_nonzero(pixels))
    return image, root


def frame_words(image, core, root):
    """Commands of a frame."""
    v, u = np.indices(image.shape)
    last = np.arange(image.size) == image.size - 1
    labels = np.arange(len(root))
    border = (u == 0) | (u == u.max()) | (v == 0) | (v == v.max())
    return np.concatenate([
        pack(SumsCommand, kind=np.full(len(root), Kind.LABEL.value), label=labels, root=root),
        pack(SumsCommand, kind=np.full(image.size, Kind.PIXEL.value), label=image.ravel(),
             core=core.ravel(), border=border.ravel(), last=last, column=u.ravel(), row=v.ravel())])


CANCEL = pack(SumsCommand, kind=Kind.CANCEL.value)


def check(size, masks, labels, seed, gap=0.0, stall=0.0, interval=1):
    """Frames back to back; each must be the model's. Returns what came out, the words and
    the roots of the frames.
    """
    rng = np.random.default_rng(seed)
    words, wanted, roots = [], [], []
    for mask in masks:
        image, root = labelled(mask, labels, rng)
        roots.append(root)
        core = mask & (rng.random(size) < 0.05)
        words.append(frame_words(image, core, root))
        wanted.append(component_sums(image, core, root))
    block = sums(size, labels, interval)
    block.reset()
    wait = int(labels * (interval + 2) / (1 - stall)) + 100
    out = block.stream(np.concatenate(words), gap, stall, seed, idle=wait, limit=wait)
    frames = spot_frames(out.fields(Spot))
    assert len(frames) == len(wanted)
    for index, ((spots, broken), want) in enumerate(zip(frames, wanted, strict=True)):
        assert not broken
        check_spots(spots, want, f"seed {seed}, frame {index}")
    return out, words, roots


@pytest.mark.parametrize(("gap", "stall", "interval"), [
    (0, 0, 1), (0.3, 0.4, 1), (0, 0, 5), (0.2, 0.5, 22)])
def test_hard_masks(gap, stall, interval):
    masks = {**directed(*SMALL), **noise(*SMALL, 1)}
    check(SMALL, list(masks.values()), 255, 1, gap, stall, interval)


def test_large_frames():
    """Components of more than 255 pixels, and sums of the largest columns and rows."""
    masks = {**directed(*CIF), **noise(*CIF, 2)}
    check(CIF, list(masks.values())[::4], 1023, 2)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (5, 7)])
@pytest.mark.parametrize(("labels", "gap", "stall"), [(1, 0, 0), (2, 0.4, 0.4), (30, 0, 0)])
def test_small_frames(size, labels, gap, stall):
    rng = np.random.default_rng(labels)
    check(size, rng.random((500, *size)) < rng.random((500, 1, 1)), labels, 3, gap, stall)


@pytest.mark.parametrize("interval", [1, 2, 22])
def test_clocks(interval):
    """A label a clock, four clocks after the last pixel; the spot comes ``latency`` clocks later.

    A spot makes ``interval`` - 1 clocks more, also before the end marker.
    """
    size, labels = (8, 8), 30
    out, words, roots = check(size, np.random.default_rng(4).random((40, *size)) < 0.3, labels, 4,
                              interval=interval)
    taken = out.taken[np.cumsum([len(frame) for frame in words]) - 1]
    ends = np.flatnonzero(out.fields(Spot)["end"])
    for last, root, first, stop in zip(taken, roots, [0, *(ends[:-1] + 1)], ends, strict=True):
        spots = 1 + np.flatnonzero(root[1:] == np.arange(1, len(root)))
        before = np.arange(len(spots))
        wanted = last + 4 + spots - 1 + ComponentSums.latency + before * (interval - 1)
        assert np.array_equal(out.clocks[first:stop], wanted)
        used = len(root) - 1
        assert out.clocks[stop] == (
            last + 7 + used - (used == 0) + len(spots) * (interval - 1))


def test_cancel():
    """A frame of which no pixel came leaves nothing behind."""
    rng = np.random.default_rng(5)
    size, words, wanted = (8, 8), [], []
    for number in range(40):
        image, root = labelled(rng.random(size) < 0.4, 30, rng)
        core = rng.random(size) < 0.3
        frame = frame_words(image, core, root)
        broken = number % 3 == 1
        words.append(np.concatenate([frame[:len(root)], CANCEL]) if broken else frame)
        wanted.append(None if broken else component_sums(image, core, root))
    block = sums(size, 30)
    block.reset()
    out = block.stream(np.concatenate(words), 0.2, 0.2, 5, idle=200)
    for (spots, broken), want in zip(spot_frames(out.fields(Spot)), wanted, strict=True):
        assert broken == (want is None)
        check_spots(spots, spots[:0] if broken else want, "after a cancelled frame")


def test_reset_forgets():
    """While labels, pixels or spots are under way."""
    rng = np.random.default_rng(6)
    size, block = (8, 8), sums((8, 8), 30)
    for _ in range(60):
        image, root = labelled(rng.random(size) < 0.4, 30, rng)
        frame = frame_words(image, image > 0, root)
        block.stream(frame[:int(rng.integers(1, len(frame) + 1))], stall=0.5,
                     idle=int(rng.integers(0, 40)))
        block.reset(1)
        out = block.stream(frame, idle=100)
        (spots, broken), = spot_frames(out.fields(Spot))
        assert not broken
        check_spots(spots, component_sums(image, image > 0, root), "after a reset")


@pytest.mark.parametrize(("arguments", "sentence"), [
    ((0, 4), "Frame width must be an integer from 1 to 512, not 0"),
    ((4, "foo"), "Frame height must be an integer from 1 to 512, not 'foo'"),
    ((4, 4, 0), "Labels must be an integer from 1 to 32767, not 0"),
    ((4, 4, 32768), "Labels must be an integer from 1 to 32767, not 32768"),
    ((4, 4, 1, 65), "Interval must be an integer from 1 to 64, not 65"),
])
def test_refuses_parameters(arguments, sentence):
    with pytest.raises(ValueError) as caught:
        ComponentSums(*arguments)
    assert str(caught.value) == sentence
