"""The top in cocotb: whole frames from the sensor's pins to the reader, good and bad ones."""

import numpy as np
import pytest

from hdl.config import Config
from model.capsule import Capsule as Model
from tb.system.frames import show
from tb.system.stimuli import any_settings, random_frame, spot_frame

SMALL = Config(width=64, height=64, beams=16, lanes=2)


def same(frame, wanted):
    """A decoded frame against the model's."""
    return (frame.level, frame.grey_noise, frame.saturated, frame.spots, frame.rejected,
            frame.dropped) == (
        wanted.level, wanted.grey_noise, wanted.saturated, wanted.spots,
        wanted.rejected + np.count_nonzero(wanted.points["status"] == 3), wanted.dropped
    ) and np.array_equal(frame.points, wanted.points)


def test_cif_frames_reach_the_reader(request):
    """Frames of 352 x 288, three clocks a bit: what the reader gets is what the model says.

    The spots' clock always runs here; the other tests stop it.
    """
    config = Config()
    settings = any_settings(352, 288, config.beams, 3, area_min=5)
    images = [spot_frame(352, 288, seed, spots=49) for seed in range(4)]
    frames, _ = show(request, config, settings, images, divisor=3, clock_gated=False,
                     line_blanking=2)
    model = Model(settings, 352, 288)
    assert len(frames) == len(images)
    for number, (frame, image) in enumerate(zip(frames, images, strict=True)):
        assert same(frame, model.frame(image)), f"frame {number}"
    assert sum(frame.ok for frame in frames) > 10


#: Faults of a frame of 64 lines: lines and frames that are too short and too long.
FAULTS = [
    {"row": 0, "extra": -1}, {"row": 20, "extra": -64}, {"row": 63, "extra": -1},
    {"row": 31, "extra": 1}, {"row": 40, "extra": 63}, {"row": 99, "lines": 1},
    {"row": 99, "lines": 60}, {"row": 63, "extra": 1},
]


@pytest.mark.parametrize("blanking", [(1, 1), (9, 30)])
def test_bad_sync_costs_one_frame(request, blanking):
    """Short and long lines and frames: flagged, a part of the model's points, the next one exact.

    One clock of blanking after a line, and one or more after a frame.
    """
    settings = any_settings(64, 64, SMALL.beams, 4, area_min=2, report_rejected=False)
    images = [spot_frame(64, 64, 40 + seed, spots=12) for seed in range(6)]
    bad = 2
    frames, _ = show(request, SMALL, settings, images, faulty=bad, line_blanking=blanking[0],
                     frame_blanking=blanking[1] + 6000, faults=FAULTS)
    assert [frame.number for frame in frames] == list(range(len(images) * len(FAULTS)))
    model = Model(settings, 64, 64)
    for frame in frames:
        fault, number = FAULTS[frame.number // len(images)], frame.number % len(images)
        what = f"fault {fault}, frame {number}"
        noise = model._noise
        wanted = model.frame(images[number])
        assert frame.balanced, what
        # A pixel too many in the last line comes when the frame is complete.
        if number == bad and not (fault["row"] == 63 and fault["extra"] > 0):
            assert frame.broken, what
            theirs = {point.tobytes() for point in wanted.points}
            assert all(point.tobytes() in theirs for point in frame.points), what
            model._noise = noise  # nothing is learnt from a broken frame
        else:
            assert not frame.broken, what
            assert same(frame, wanted), what


@pytest.mark.parametrize("seed", [5])
def test_slow_link_drops_whole_spots_and_recovers(request, seed):
    """More spots than the link can carry: a part of the model's points, counters in balance."""
    settings = any_settings(64, 64, SMALL.beams, seed, area_min=1, area_max=255,
                            fixed_noise=300, report_rejected=False)
    pairs = np.arange(64) % 4 < 2
    crowded = np.where(pairs[:, None] & pairs, 200, 20).astype(np.uint8)
    calm = [random_frame(64, 64, seed) for seed in (0, 1)]
    images = [calm[0], crowded, crowded, *calm * 4]
    frames, _ = show(request, SMALL, settings, images, divisor=4, frame_blanking=25_000)
    assert any(frame.dropped for frame in frames)
    model, last = Model(settings, 64, 64), -1
    for frame in frames:
        assert frame.balanced
        while last < frame.number:
            last += 1
            wanted = model.frame(images[last])
        theirs = {point.tobytes() for point in wanted.points}
        assert all(point.tobytes() in theirs for point in frame.points)
        assert frame.spots == wanted.spots
    assert frames[-1].number == len(images) - 1
    assert frames[-1].dropped == 0
    assert same(frames[-1], wanted)
