# amaranth: UnusedElaboratable=no
"""The pins of the screen, seen by a monitor, against the model: every pixel of every screen."""

import numpy as np
import pytest

from hdl.display.vga import VGA
from model.display.vga import scale_and_origin
from tb.acquisition.bank_faults import planted
from tb.display.screens import play
from tb.display.stores import sram_store


def stimuli(rng, width, height, count=8):
    """Random images, and lists of spots anywhere, some of them too long."""
    images = rng.integers(0, 256, (count, height, width)).astype(np.uint8)
    lists = []
    for number in range(count):
        length = [0, 1, 128, 140, 49][number] if number < 5 else int(rng.integers(0, 129))
        u, v = rng.integers(0, width * 512, length), rng.integers(0, height * 512, length)
        lists.append([(int(a), int(b), int(c))
                      for a, b, c in zip(u, v, rng.integers(0, 2, length), strict=True)])
    # All in one row, in the corners, and on top of each other.
    last = width * 512 - 1, height * 512 - 1
    lists[5] = [(int(u), height // 2 * 512, int(u) % 2) for u in rng.integers(0, last[0], 128)]
    lists[6] = [(u, v, u == v) for u in (0, last[0]) for v in (0, last[1])] * 3
    lists[7] = [(width * 256 + 300 * k, height * 256, k % 2) for k in range(9)]
    return images, lists


def check(show, screens):
    """Not a pixel is wrong in any screen, and frames go forward."""
    assert show.torn == 0, f"{show.torn} of {len(show.numbers)} screens are no frame's picture"
    assert len(show.numbers) == screens
    numbers = [number for number in show.numbers if number is not None]
    assert numbers == sorted(numbers)
    assert show.numbers[0] is None and len(numbers) >= screens - 2
    return len(set(numbers))


@pytest.mark.parametrize("seed", [1])
def test_cif_frames(request, tmp_path, seed):
    """8 MHz pixels of 352 x 288 in pairs of 40 ms, as the instrument has them; 25.175 MHz."""
    images, lists = stimuli(np.random.default_rng(seed), 352, 288)
    show = play(request, tmp_path, images, lists, 11, sync_ps=62_500, period=2,
                blanking=320_000 - 2 * 352 * 288, delay=3000)
    assert check(show, 11) >= 8
    assert all(show.overlaid[1:])


@pytest.mark.parametrize("seed", [2])
def test_more_frames_than_screens(request, tmp_path, seed):
    """Frames of 64 x 64 come 240 times a screen: one of them is shown, whole, seven times as big.

    Their lists follow so closely that some screens have to do without.
    """
    images, lists = stimuli(np.random.default_rng(seed), 64, 64)
    show = play(request, tmp_path, images, lists, 11, pairs=False, sync_ps=17_000, period=1,
                blanking=8, delay=1500)
    assert check(show, 11) >= 9
    assert 0 < sum(show.overlaid) < 10


@pytest.mark.parametrize("seed", [3])
def test_nearly_the_screens_rate(request, tmp_path, seed):
    """An odd size; a frame every screen, and its end drifts slowly through the blanking."""
    width, height, bits = 101, 37, 4
    images, lists = stimuli(np.random.default_rng(seed), width, height)
    show = play(request, tmp_path, images, lists, 32, pairs=False, sync_ps=39_720,
                display_ps=39_722, period=100, blanking=421_000 - 100 * width * height, delay=9,
                colour_bits=bits)
    assert check(show, 32) >= 30


@pytest.mark.parametrize("seed", [5])
def test_frames_in_external_memory(request, tmp_path, seed):
    """As above, from an external memory that another client keeps busy: no row is late."""
    images, lists = stimuli(np.random.default_rng(seed), 352, 288)
    show = play(request, tmp_path, images, lists, 11, stores=sram_store(352, 288),
                sync_ps=62_500, period=2, blanking=320_000 - 2 * 352 * 288, delay=3000)
    assert check(show, 11) >= 8
    assert all(show.overlaid[1:])


@pytest.mark.parametrize("seed", [4])
def test_a_torn_picture_is_seen(request, tmp_path, seed, monkeypatch):
    """A writer that takes the reader's bank tears pictures, and the bench finds it."""
    monkeypatch.setattr("hdl.acquisition.frame_memory.FrameBanks", lambda *arguments: planted(
        "the writer takes the reader's bank", *arguments))
    images, lists = stimuli(np.random.default_rng(seed), 64, 64)
    show = play(request, tmp_path, images, lists, 4, pairs=False, sync_ps=62_500, period=2,
                blanking=900, delay=100)
    assert show.torn >= 2


@pytest.mark.parametrize("arguments, error", [
    ((1, 5), "Frame width must be an integer from 2 to 512, not 1"),
    ((8, 481), "Frame height must be an integer from 2 to 480, not 481"),
    ((8, 8, 9), "Bits of a colour must be an integer from 1 to 8, not 9"),
])
def test_refuses_parameters(arguments, error):
    with pytest.raises(ValueError) as caught:
        VGA(*arguments)
    assert str(caught.value) == error


@pytest.mark.parametrize("size, scale", [((352, 288), 1), ((64, 64), 7), ((101, 37), 6),
                                         ((320, 240), 2), ((512, 480), 1)])
def test_scale(size, scale):
    assert VGA(*size).scale == scale == scale_and_origin(*size)[0]
