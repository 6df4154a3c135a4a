# amaranth: UnusedElaboratable=no
"""Labelling: whole frames through the Verilated block, and the protocol bench in cocotb."""

from functools import cache

import cv2
import numpy as np
import pytest

from hdl.payloads import Spot
from hdl.preprocessing.labelling import Labelling
from model.oracles.labelling_oracle import components, last_pixels
from model.preprocessing.labelling import SPOT_DTYPE, label
from tb.hdlsim import run
from tb.native_block import NativeBlock
from tb.preprocessing.frames import BROKEN_MASK, check_spots, mask_words, spot_frames
from tb.preprocessing.labelling_images import bitmaps_4x4, directed, noise, tiled_4x4

SMALL, CIF = (64, 64), (288, 352)


@cache
def block(height, width):
    return NativeBlock(Labelling(width, height))


def started(size, weighted=True):
    """The block of a size, out of reset."""
    dut = block(*size)
    dut.set(weighted=int(weighted))
    dut.reset()
    return dut


def greys(lit, seed):
    """Core, excess and saturated for masks of shape (frames, height, width)."""
    rng = np.random.default_rng(seed)
    core = lit & (rng.random(lit.shape) < 0.05)
    excess = np.where(lit, rng.choice([0, 255, *rng.integers(0, 256, 14)], lit.shape), 0)
    return core, excess.astype(np.uint8), lit & (rng.random(lit.shape) < 0.02)


def ending_pixels(last, width):
    """The pixels that end components: below and to the right of their last ones."""
    return last + width + (last % width < width - 1)


def check(size, masks, names, seed, gap=0.0, stall=0.0, weighted=True, oracle=False):
    """Frames back to back through the block; every one must be the model's. Returns the beats."""
    lit = np.asarray(masks)
    parts = lit, *greys(lit, seed)
    words = mask_words(*parts)
    out = started(size, weighted).stream(
        words.reshape(-1, words.shape[2]), gap, stall, seed,
        idle=int((3 * size[1] + 40) / (1 - stall)))
    frames = spot_frames(out.fields(Spot))
    assert len(frames) == len(lit)
    for index, (spots, broken) in enumerate(frames):
        what = f"seed {seed}, frame {index} ({names[index]})"
        assert not broken, what
        check_spots(spots, label(*(part[index] for part in parts), weighted), what)
        if oracle:
            want = components(*(part[index] for part in parts), weighted)
            check_spots(spots, np.array(want, SPOT_DTYPE), f"{what} against OpenCV")
    return out, lit


def hard(size, seed):
    """Directed masks and noise in seeded order."""
    masks = {**directed(*size), **noise(*size, seed)}
    names = list(masks)
    np.random.default_rng(seed).shuffle(names)
    return [masks[name] for name in names], names


@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize(("gap", "stall"), [(0, 0), (0.3, 0), (0, 0.4), (0.5, 0.5), (0.9, 0.1)])
def test_hard_masks(gap, stall, weighted):
    masks, names = hard(SMALL, seed=1)
    check(SMALL, masks, names, 1, gap, stall, weighted, oracle=gap == 0)


@pytest.mark.parametrize(("gap", "stall"), [(0, 0), (0.3, 0.3)])
def test_hard_masks_cif(gap, stall):
    masks, names = hard(CIF, seed=2)
    check(CIF, masks, names, 2, gap, stall, oracle=gap == 0)


@pytest.mark.parametrize("seed", range(4))
def test_noise(seed):
    rng = np.random.default_rng(seed)
    masks = [rng.random(SMALL) < rng.random() for _ in range(40)]
    check(SMALL, masks, ["noise"] * 40, seed, gap=rng.random() / 2, stall=rng.random() / 2)


@pytest.mark.parametrize("size", [(5, 7), (1, 2)])
@pytest.mark.parametrize(("gap", "stall"), [(0, 0), (0.4, 0.4)])
def test_odd_sizes(size, gap, stall):
    rng = np.random.default_rng(8)
    masks = rng.random((600, *size)) < rng.random((600, 1, 1))
    check(size, masks, ["noise"] * len(masks), 8, gap, stall, oracle=True)


def test_every_4x4_bitmap_alone():
    """All 65,536 as frames of 4x4, touching all borders, back to back: against OpenCV itself."""
    lit = bitmaps_4x4()
    lit = lit[np.random.default_rng(5).permutation(len(lit))]
    words = mask_words(lit, lit, np.zeros(lit.shape, np.uint8))
    out = started((4, 4)).stream(words.reshape(-1, words.shape[2]), idle=20)
    frames = spot_frames(out.fields(Spot))
    assert len(frames) == len(lit)
    for bitmap, (spots, _) in zip(lit, frames, strict=True):
        count, _, stats, centres = cv2.connectedComponentsWithStats(
            bitmap.view(np.uint8), connectivity=8)
        areas = stats[1:, cv2.CC_STAT_AREA]
        sums = np.rint(centres[1:] * areas[:, None]).astype(int)
        begin, size = stats[1:, :2], stats[1:, 2:4]
        border = ((begin == 0) | (begin + size == 4)).any(axis=1)
        want = sorted(zip(border.tolist(), areas.tolist(), *sums.T.tolist(), strict=True))
        got = sorted(zip(*(spots[name].tolist() for name in ("border", "area", "sum_u", "sum_v")),
                         strict=True))
        assert got == want, f"{bitmap.astype(int)}: {got}, not {want}"
    assert np.all(np.diff(out.taken) == 1)


@pytest.mark.parametrize(("gap", "stall"), [(0, 0), (0.3, 0.3)])
def test_every_4x4_bitmap_with_gaps(gap, stall):
    lit = bitmaps_4x4()[::-7]
    check((4, 4), lit, ["4x4"] * len(lit), 6, gap, stall)


def test_every_4x4_bitmap_in_tiles():
    frames = tiled_4x4(*SMALL)
    check(SMALL, frames, ["tiles"] * len(frames), 7)


@pytest.mark.parametrize("size", [SMALL, CIF])
def test_latency_and_throughput(size):
    """One pixel a clock, and each spot within a row and 8 clocks of its last pixel."""
    masks, names = hard(size, seed=3)
    if size == CIF:
        masks, names = masks[:12], names[:12]
    out, lit = check(size, masks, names, 3)
    assert np.array_equal(np.diff(out.taken), np.ones(len(out.taken) - 1)), "a pixel had to wait"
    width, pixels = size[1], size[0] * size[1]
    fields, at = out.fields(Spot), 0
    for number, mask in enumerate(lit):
        first = out.taken[number * pixels]
        last = last_pixels(mask)
        clocks = out.clocks[at:at + len(last)] - first
        assert np.array_equal(clocks, ending_pixels(last, width) + Labelling.latency), names[number]
        assert np.all(clocks - last <= width + 4)
        at += len(last)
        assert fields["end"][at]
        assert out.clocks[at] - first == pixels + width + Labelling.latency, names[number]
        at += 1


@pytest.mark.parametrize("gap", [0.2, 0.5, 0.8])
def test_latency_in_pixels(gap):
    masks, names = hard(SMALL, seed=4)
    out, lit = check(SMALL, masks, names, 4, gap)
    width, pixels = SMALL[1], SMALL[0] * SMALL[1]
    spots = np.flatnonzero(out.fields(Spot)["end"] == 0)
    last = np.concatenate([number * pixels + last_pixels(mask) for number, mask in enumerate(lit)])
    waited = out.accepted[spots] - 1 - last
    assert waited.max() <= width + 8


@pytest.mark.parametrize("size", [SMALL, CIF])
def test_last_row_needs_no_further_pixel(size):
    height, width = size
    mask = np.zeros(size, bool)
    mask[-1, ::2] = mask[-1, -1] = True
    words = mask_words(mask[None], mask[None], np.zeros((1, *size), np.uint8))[0]
    out = started(size).stream(words, idle=width + 8)
    fields = out.fields(Spot)
    assert fields["end"][-1] and len(fields) == len(last_pixels(mask)) + 1
    last = (height - 1) * width + last_pixels(mask[-1:])
    assert np.all(out.clocks[:-1] - out.taken[last] <= width + 4)


@pytest.mark.parametrize("seed", range(12))
def test_next_frame_pauses_in_its_first_row(seed):
    """The walk of the last row and the next frame's first row, in every rhythm."""
    rng = np.random.default_rng(seed)
    height, width = SMALL
    count = 12
    lit = rng.random((count, height, width)) < rng.uniform(0.1, 0.9, (count, 1, 1))
    parts = lit, *greys(lit, seed)
    pauses = np.zeros((count, height * width), int)
    for frame in pauses:
        places = rng.integers(0, width + 2, rng.integers(1, 20))
        frame[places] = rng.integers(1, rng.choice([3, 8, 70]), len(places))
    words = mask_words(*parts)
    out = started(SMALL).stream(words.reshape(-1, words.shape[2]), pauses=pauses.ravel(),
                                stall=0.5 * (seed % 2), seed=seed, idle=600)
    frames = spot_frames(out.fields(Spot))
    assert len(frames) == count
    for index, (spots, _) in enumerate(frames):
        check_spots(spots, label(*(part[index] for part in parts), True),
                    f"seed {seed}, frame {index}")


@pytest.mark.parametrize("size", [SMALL, (4, 4)])
@pytest.mark.parametrize(("gap", "stall"), [(0, 0), (0.4, 0), (0, 0.4), (0.3, 0.3)])
@pytest.mark.parametrize("seed", [1, 2])
def test_broken_frames(size, gap, stall, seed):
    """A broken frame keeps what had left; those before and after it are exact."""
    rng = np.random.default_rng(seed)
    height, width = size
    count, pixels = (90, height * width) if size == SMALL else (4000, height * width)
    lit = rng.random((count, *size)) < rng.uniform(0.05, 0.95, (count, 1, 1))
    parts = lit, *greys(lit, seed)
    words = mask_words(*parts)
    # Half of the frames break: at once, in the first row, anywhere, or on the very last pixel.
    cuts = np.select([rng.random(count) < p for p in (0.5, 0.2, 0.4, 0.4, 0.5)], [
        np.full(count, -1), np.zeros(count, int), rng.integers(0, width + 3, count),
        rng.integers(0, 2 * width, count), np.full(count, pixels - 1)],
        rng.integers(0, pixels, count))
    stream = [words[i] if cut < 0 else np.concatenate([words[i][:cut], BROKEN_MASK])
              for i, cut in enumerate(cuts)]
    out = started(size).stream(np.concatenate(stream), gap, stall, seed, idle=4 * width + 40)
    frames = spot_frames(out.fields(Spot))
    assert len(frames) == count
    for index, ((spots, broken), cut) in enumerate(zip(frames, cuts, strict=True)):
        what = f"seed {seed}, frame {index}, cut {cut}"
        assert broken == (cut >= 0), what
        want = label(*(part[index] for part in parts), True)
        if broken:
            want = want[ending_pixels(last_pixels(lit[index]), width) < cut]
        check_spots(spots, want, what)


def test_broken_frame_costs_no_clock():
    """Breaking does not hold the camera up, except where breaks queue up behind a walk."""
    rng = np.random.default_rng(9)
    lit = rng.random((20, *SMALL)) < 0.3
    words = mask_words(lit, lit, np.zeros(lit.shape, np.uint8))
    stream = [np.concatenate([frame[:200 + 97 * i], BROKEN_MASK]) for i, frame in enumerate(words)]
    out = started(SMALL).stream(np.concatenate(stream), idle=100)
    assert np.all(np.diff(out.taken) == 1)


def test_reset_forgets():
    rng = np.random.default_rng(10)
    dut = started(SMALL)
    lit = rng.random((30, *SMALL)) < 0.4
    parts = lit, *greys(lit, 10)
    words = mask_words(*parts)
    for index, frame in enumerate(words):
        cut = int(rng.integers(1, len(frame)))
        stopped = np.concatenate([words[index - 1], frame[:20]]) if index % 2 else frame[:cut]
        dut.stream(stopped, stall=0.5, seed=index)
        dut.reset(1)
        (spots, broken), = spot_frames(dut.stream(frame, idle=80).fields(Spot))
        assert not broken
        check_spots(spots, label(*(part[index] for part in parts), True), f"frame {index}")


@pytest.mark.parametrize("width", [0, 1, 1025, 3.5, "foo"])
def test_bad_width(width):
    with pytest.raises(ValueError, match="Frame width must be an integer from 2 to 1024, not "):
        Labelling(width, 4)


@pytest.mark.parametrize("height", [0, 1025, None])
def test_bad_height(height):
    with pytest.raises(ValueError, match="Frame height must be an integer from 1 to 1024, not "):
        Labelling(4, height)


@pytest.mark.parametrize(("gap", "stall", "seed"), [
    (0, 0, 1), (0.4, 0, 2), (0, 0.4, 3), (0.4, 0.4, 4), (0.4, 0.4, 5)])
def test_protocol(request, gap, stall, seed):
    width, height = 16, 9
    run(request, "labelling", "tb.preprocessing.tb_labelling",
        component=Labelling(width, height),
        parameters={"width": width, "height": height, "gap": gap, "stall": stall, "seed": seed})
