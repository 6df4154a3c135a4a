# amaranth: UnusedElaboratable=no
"""Two-pass labelling: whole frames through the Verilated block and its memory."""

from functools import cache

import cv2
import numpy as np
import pytest

from hdl.payloads import Spot
from hdl.preprocessing.two_pass_labelling import TwoPassLabelling
from model.preprocessing.labelling import label
from model.preprocessing.two_pass_labelling import label_in_two_passes, labels_used
from tb.hdlsim import run
from tb.native_block import NativeBlock
from tb.preprocessing.frames import BROKEN_MASK, check_spots, mask_words, spot_frames
from tb.preprocessing.labelling_images import bitmaps_4x4, directed, noise, tiled_4x4
from tb.preprocessing.two_pass_rig import TwoPassPins, TwoPassRig

SMALL, CIF = (64, 64), (288, 352)
#: Every frame of 352 x 288 has its labels.
ALL_LABELS = 25344


@cache
def block(size, labels, base=0):
    return NativeBlock(TwoPassRig(size[1], size[0], labels, base))


def started(size, labels=1023, base=0, traffic=0):
    """The block, out of reset."""
    dut = block(size, labels, base)
    dut.set(traffic=traffic)
    dut.reset()
    return dut


def beats(lit, core):
    """Words of whole frames; the block has no use for the excess."""
    return mask_words(lit, core, 77 * lit)


def cores(lit, seed):
    return lit & (np.random.default_rng(seed).random(lit.shape) < 0.05)


def worst_clocks(size, labels):
    """No frame takes more, if nothing but the joining of labels lets it wait."""
    return 2 * size[0] * size[1] + 4 * labels + TwoPassLabelling.overhead + 8


def clean(dut):
    """The memory was never mistreated, and nothing was read that had not been written."""
    assert dut.get("violations") == 0 and dut.get("unwritten") == 0


def check(size, masks, names, seed, gap=0.0, stall=0.0, labels=1023, base=0, traffic=0):
    """Frames back to back through the block; every one must be the model's. Returns the beats."""
    lit = np.asarray(masks)
    core = cores(lit, seed)
    dut = started(size, labels, base, traffic)
    clocks = worst_clocks(size, labels) / (1 - stall) * (1 + traffic / 32)
    out = dut.stream(beats(lit, core).reshape(-1, 1), gap, stall, seed, idle=int(clocks),
                     limit=int(clocks))
    frames = spot_frames(out.fields(Spot))
    assert len(frames) == len(lit)
    for index, (spots, broken) in enumerate(frames):
        what = f"seed {seed}, frame {index} ({names[index]})"
        assert not broken, what
        want, dropped = label_in_two_passes(lit[index], core[index], labels)
        check_spots(spots, want, what)
        if not dropped:
            dark = np.zeros(size, np.uint8)
            streamed = label(lit[index], core[index], dark, dark, False)
            assert sorted(spots.tolist()) == sorted(streamed.tolist()), what
    assert dut.get("dropped") == dropped
    clean(dut)
    return out, lit


def meetings(height, width):
    """Masks whose labels meet in many ways: teeth, and pixels that join two of them."""
    v, u = np.mgrid[:height, :width]
    gap = u // 2
    order = np.random.default_rng(1).permutation(width)[gap]
    level = np.log2((gap + 1) & -(gap + 1)).astype(int)  # in a tree of pairs of pairs
    masks = {
        name: (u % 2 == 0) & (v % period > 0) | (u % 2 == 1) & (v % period == row + 1)
        for name, period, row in [
            ("from the left", width // 2 + 2, gap), ("in a tree", 12, level),
            ("from the right", width // 2 + 2, (width - 2) // 2 - gap), ("all at once", 3, 0 * u),
            ("in a tree, root first", 12, 9 - level), ("in any order", width + 2, order),
            ("every second one first", 4, gap % 2)]}
    stairs = (u % 2 == 0) & (v >= height - 2 - gap % (height - 2)) | (v == height - 1)
    return masks | {"stairs": stairs, "bands of a checkerboard": ((u + v) % 2 == 0) & (v % 3 > 0)}


def hard(size, seed):
    """Directed masks and noise in seeded order."""
    masks = {**directed(*size), **noise(*size, seed), **meetings(*size)}
    names = list(masks)
    np.random.default_rng(seed).shuffle(names)
    return [masks[name] for name in names], names


@pytest.mark.parametrize(("gap", "stall", "traffic"), [
    (0, 0, 0), (0.3, 0, 0), (0, 0.4, 0), (0.5, 0.5, 0), (0, 0, 60), (0.3, 0.3, 100)])
def test_hard_masks(gap, stall, traffic):
    masks, names = hard(SMALL, seed=1)
    check(SMALL, masks, names, 1, gap, stall, traffic=traffic)


@pytest.mark.parametrize(("gap", "stall"), [(0, 0), (0.3, 0.3)])
def test_hard_masks_cif(gap, stall):
    masks, names = hard(CIF, seed=2)
    few = slice(None, None, 3) if gap == 0 else slice(0, 6)
    check(CIF, masks[few], names[few], 2, gap, stall, ALL_LABELS)


@pytest.mark.parametrize("seed", range(4))
def test_noise(seed):
    rng = np.random.default_rng(seed)
    masks = [rng.random(SMALL) < rng.random() for _ in range(40)]
    check(SMALL, masks, ["noise"] * 40, seed, gap=rng.random() / 2, stall=rng.random() / 2,
          traffic=int(rng.integers(0, 120)))


@pytest.mark.parametrize(("size", "labels", "base"), [
    ((5, 7), 3, 0), ((5, 7), 30, 1000), ((1, 4), 1, 0), ((3, 5), 2, 7), ((2, 4), 2, 1)])
@pytest.mark.parametrize(("gap", "stall", "traffic"), [(0, 0, 0), (0.4, 0.4, 80)])
def test_odd_sizes(size, labels, base, gap, stall, traffic):
    rng = np.random.default_rng(8)
    masks = rng.random((600, *size)) < rng.random((600, 1, 1))
    check(size, masks, ["noise"] * len(masks), 8, gap, stall, labels, base, traffic)


def test_every_4x4_bitmap():
    """All 65,536 as frames of 4x4, touching all borders, back to back: against OpenCV itself."""
    lit = bitmaps_4x4()
    lit = lit[np.random.default_rng(5).permutation(len(lit))]
    dut = started((4, 4), 4)
    out = dut.stream(beats(lit, lit).reshape(-1, 1), idle=100)
    frames = spot_frames(out.fields(Spot))
    assert len(frames) == len(lit)
    for bitmap, (spots, _) in zip(lit, frames, strict=True):
        _, of_pixel, stats, centres = cv2.connectedComponentsWithStats(
            bitmap.view(np.uint8), connectivity=8)
        areas = stats[1:, cv2.CC_STAT_AREA]
        sums = np.rint(centres[1:] * areas[:, None]).astype(int)
        found = of_pixel[of_pixel > 0]
        order = sorted(range(len(areas)), key=(found - 1).tolist().index)
        begin, size = stats[1:, :2], stats[1:, 2:4]
        border = ((begin == 0) | (begin + size == 4)).any(axis=1)
        want = [(1, 0, border[k], areas[k], areas[k], *sums[k]) for k in order]
        assert spots.tolist() == want, f"{bitmap.astype(int)}: {spots}, not {want}"
    assert dut.get("dropped") == 0
    clean(dut)


@pytest.mark.parametrize("labels", [1, 2, 3])
def test_4x4_bitmaps_with_few_labels(labels):
    lit = bitmaps_4x4()[labels::13]
    check((4, 4), lit, ["4x4"] * len(lit), 6, labels=labels, traffic=40 * labels)


def test_every_4x4_bitmap_in_tiles():
    frames = tiled_4x4(*SMALL)
    check(SMALL, frames, ["tiles"] * len(frames), 7)


@pytest.mark.parametrize("labels", [2, 7, 255])
def test_labels_run_out(labels):
    """Components leave whole or not at all, and what was missed is counted, frame by frame."""
    masks, names = hard(SMALL, seed=3)
    rng = np.random.default_rng(labels)
    masks += [rng.random(SMALL) < rng.random() for _ in range(20)]
    names += ["noise"] * 20
    dut = started(SMALL, labels, traffic=20)
    overflowed = 0
    for mask, name in zip(masks, names, strict=True):
        core = cores(mask, 4)
        clocks = 2 * worst_clocks(SMALL, labels)
        out = dut.stream(beats(mask[None], core[None])[0], 0.1, 0.1, labels, idle=clocks)
        (spots, broken), = spot_frames(out.fields(Spot))
        want, dropped = label_in_two_passes(mask, core, labels)
        assert not broken
        check_spots(spots, want, f"{name}, {labels} labels")
        assert dut.get("dropped") == dropped, name
        overflowed += dropped > 0
    assert overflowed > 5
    clean(dut)


def test_worst_of_cif_with_few_labels():
    """25,344 isolated pixels, of which 1,023 have labels; then a frame that needs none more."""
    mask = directed(*CIF)["isolated pixels"]
    few = np.zeros(CIF, bool)
    few[-1, -3:] = True
    out, _ = check(CIF, [mask, few], ["isolated", "few"], 9)
    assert np.flatnonzero(out.fields(Spot)["end"]).tolist() == [1023, 1025]


@pytest.mark.parametrize(("size", "labels"), [(SMALL, 1023), (CIF, 1023), (CIF, ALL_LABELS)])
def test_clocks(size, labels):
    """The formula of the docstring, for every image; joining takes at most a clock a label."""
    masks, names = hard(size, seed=3)
    if size == CIF:
        keep = [index for index, name in enumerate(names)
                if labels == 1023 and "noise" in name or name in (
                    "full", "empty", "isolated pixels", "checkerboard", "bands of a checkerboard",
                    "comb, back below", "spiral", "in a tree")]
        masks, names = [masks[index] for index in keep], [names[index] for index in keep]
    out, lit = check(size, masks, names, 3, labels=labels)
    pixels, latency = size[0] * size[1], TwoPassLabelling(size[1], size[0]).latency
    taken = out.taken.reshape(len(lit), pixels)
    ends = out.clocks[out.fields(Spot)["end"] == 1]
    most = 0
    for mask, name, clocks, end in zip(lit, names, taken, ends, strict=True):
        used = labels_used(mask, labels)
        formula = latency + 3 * used + (used > 0)
        joining = end - clocks[0] - formula
        print(f"{name}: {end - clocks[0]} clocks, {used} labels, {joining} for joining")
        assert 0 <= joining <= used + 1, f"{name}: {joining} clocks for joining"
        most = max(most, joining)
    assert most > 50
    assert np.array_equal(taken[1:, 0], ends[:-1] + 1), "a frame began late"


@pytest.mark.parametrize("interval", [2, 20])
@pytest.mark.parametrize("stall", [0, 0.5])
def test_interval(interval, stall):
    """Spots keep their distance, and cost just that."""
    size, rng = (16, 16), np.random.default_rng(interval)
    lit = rng.random((50, *size)) < rng.random((50, 1, 1)) / 2
    core = cores(lit, 1)
    dut = NativeBlock(TwoPassRig(*size, interval=interval))
    dut.set(traffic=0)
    dut.reset()
    out = dut.stream(beats(lit, core).reshape(-1, 1), 0, stall, 1, idle=10_000)
    fields = out.fields(Spot)
    frames = spot_frames(fields)
    ends = out.clocks[fields["end"] == 1]
    assert len(frames) == len(lit)
    after_spot = fields["end"][:-1] == 0
    assert np.diff(out.clocks)[after_spot].min() >= (interval if not stall else 1)
    for index, (spots, _) in enumerate(frames):
        want, _ = label_in_two_passes(lit[index], core[index], 1023)
        check_spots(spots, want, f"frame {index}")
        used = labels_used(lit[index], 1023)
        formula = 512 + 3 * used + TwoPassLabelling.overhead + (interval - 1) * len(want)
        joining = ends[index] - out.taken[256 * index] - formula
        assert stall or -(used == 0) <= joining <= used + 1


@pytest.mark.parametrize("size", [SMALL, (4, 4)])
@pytest.mark.parametrize(("gap", "stall", "traffic"), [(0, 0, 0), (0.4, 0.3, 0), (0, 0, 100)])
@pytest.mark.parametrize("seed", [1, 2])
def test_broken_frames(size, gap, stall, traffic, seed):
    """A broken frame has no spots, and those before and after it are exact."""
    rng = np.random.default_rng(seed)
    width, pixels = size[1], size[0] * size[1]
    count = 60 if size == SMALL else 1500
    lit = rng.random((count, *size)) < rng.uniform(0.05, 0.95, (count, 1, 1))
    core = cores(lit, seed)
    words = beats(lit, core)
    # Half of the frames break: at once, in the first row, anywhere, or on the very last pixel.
    cuts = np.select([rng.random(count) < p for p in (0.5, 0.2, 0.4, 0.4, 0.5)], [
        np.full(count, -1), np.zeros(count, int), rng.integers(0, width + 3, count),
        rng.integers(0, 2 * width, count), np.full(count, pixels - 1)],
        rng.integers(0, pixels, count))
    stream = [words[i] if cut < 0 else np.concatenate([words[i][:cut], BROKEN_MASK])
              for i, cut in enumerate(cuts)]
    dut = started(size, traffic=traffic)
    clocks = 4 * worst_clocks(size, 1023)
    out = dut.stream(np.concatenate(stream), gap, stall, seed, idle=clocks, limit=clocks)
    frames = spot_frames(out.fields(Spot))
    assert len(frames) == count
    for index, ((spots, broken), cut) in enumerate(zip(frames, cuts, strict=True)):
        what = f"seed {seed}, frame {index}, cut {cut}"
        assert broken == (cut >= 0), what
        want, _ = label_in_two_passes(lit[index], core[index], 1023)
        check_spots(spots, want[:0] if broken else want, what)
    clean(dut)


@pytest.mark.parametrize("seed", [1, 2])
def test_broken_frames_drop_nothing(seed):
    """With too few labels a whole frame counts what it leaves out; a broken one counts nothing."""
    rng = np.random.default_rng(seed)
    size, labels, count = (16, 16), 4, 40
    lit = rng.random((count, *size)) < 0.2
    core = cores(lit, seed)
    cuts = np.where(rng.random(count) < 0.5, rng.integers(100, 256, count), -1)
    dut = started(size, labels)
    for index, (words, cut) in enumerate(zip(beats(lit, core), cuts, strict=True)):
        sent = words if cut < 0 else np.concatenate([words[:cut], BROKEN_MASK])
        out = dut.stream(sent, seed=index, idle=worst_clocks(size, labels))
        (spots, broken), = spot_frames(out.fields(Spot))
        want, dropped = label_in_two_passes(lit[index], core[index], labels)
        assert broken == (cut >= 0) and dropped > 0
        check_spots(spots, want[:0] if broken else want, f"frame {index}")
        assert dut.get("dropped") == (0 if broken else dropped), f"frame {index}"


def test_reset_forgets():
    """In whatever state it comes: while pixels come, labels resolve, the image is read."""
    rng = np.random.default_rng(10)
    size, pixels = (16, 16), 256
    lit = rng.random((60, *size)) < 0.4
    core = cores(lit, 10)
    words = beats(lit, core)
    dut = started(size)
    for index, frame in enumerate(words):
        cut = int(rng.integers(1, pixels + 1))
        dut.stream(frame[:cut], seed=index, stall=0.5,
                   idle=int(rng.integers(0, 2 * pixels)) if cut == pixels or index % 2 else 0)
        dut.reset(1)
        out = dut.stream(words[index - 1], idle=worst_clocks(size, 200))
        (spots, broken), = spot_frames(out.fields(Spot))
        assert not broken
        want, _ = label_in_two_passes(lit[index - 1], core[index - 1], 1023)
        check_spots(spots, want, f"frame {index}")


@pytest.mark.parametrize(("arguments", "sentence"), [
    ((3, 4), "Frame width must be an integer from 4 to 512, not 3"),
    (("foo", 4), "Frame width must be an integer from 4 to 512, not 'foo'"),
    ((513, 4), "Frame width must be an integer from 4 to 512, not 513"),
    ((4, 0), "Frame height must be an integer from 1 to 512, not 0"),
    ((4, 513), "Frame height must be an integer from 1 to 512, not 513"),
    ((4, 4, 0), "Labels must be an integer from 1 to 32767, not 0"),
    ((4, 4, 32768), "Labels must be an integer from 1 to 32767, not 32768"),
    ((4, 4, 1.5), "Labels must be an integer from 1 to 32767, not 1.5"),
    ((4, 4, 1, -1), "Base must be an integer from 0 to 524280, not -1"),
    ((5, 5, 1, 524276), "Base must be an integer from 0 to 524275, not 524276"),
    ((4, 4, 1, 0, 0), "Interval must be an integer from 1 to 64, not 0"),
    ((4, 4, 1, 0, 65), "Interval must be an integer from 1 to 64, not 65"),
])
def test_bad_parameters(arguments, sentence):
    with pytest.raises(ValueError, match=f"{sentence}$"):
        TwoPassLabelling(*arguments)


@pytest.mark.parametrize(("gap", "stall", "seed"), [(0, 0, 1), (0.4, 0, 2), (0.4, 0.4, 3)])
def test_protocol(request, gap, stall, seed):
    width, height, labels = 16, 9, 7
    run(request, "two_pass_pins", "tb.preprocessing.tb_two_pass_labelling",
        component=TwoPassPins(width, height, labels),
        parameters={"width": width, "height": height, "labels": labels, "gap": gap,
                    "stall": stall, "seed": seed})
