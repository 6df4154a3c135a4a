# amaranth: UnusedElaboratable=no
"""The whole instrument of the preset paper: imager, laser, host, memory and screen, natively."""

from dataclasses import replace

import numpy as np
import pytest

from model.paper import Paper
from tb.system.stimuli import spot_frame
from tb.system.test_paper import CIF, SMALL, settings_of
from tb.system.whole import Whole, same


def whole_of(config, seed, spots, **choices):
    settings = settings_of(config, report_rejected=False, area_min=5)
    images = [spot_frame(config.width, config.height, 10 * seed + n, spots=spots)
              for n in range(6)]
    return Whole(config, settings, images, **choices)


def check_frames(whole):
    """Whole pattern frames against the model of what was shown; gives the frames that broke.

    All that was lit is there. While the laser guard waits for its heartbeats, dark frames may come
    faster than they can be measured.
    """
    config = whole.config
    model = Paper(whole.settings, config.width, config.height, config.labels,
                  whole.commands.read("points_max"))
    frames = {frame.index: frame for frame in whole.frames}
    for number, (image, integrated_us, lit_us) in enumerate(whole.shown[:max(frames) + 1]):
        if number not in frames:
            assert image is None or not lit_us, f"frame {number} is missing"
        elif not frames[number].broken:
            assert same(frames[number], model.frame(image)), f"frame {number}"
            assert frames[number].laser == (lit_us > 0)
            assert frames[number].exposure_us == round(integrated_us)
    skipped = sum(event.skipped for event in (*whole.frames, *whole.textures))
    known = len(frames) + len(whole.textures) + skipped
    assert known in (max(frames) + 1, max(frames) + 2), "a frame is missing, and not counted"
    whole.assert_link_is_clean()
    return [frame for frame in frames.values() if frame.broken]


@pytest.mark.parametrize("config,pairs,spots", [
    (SMALL, 12, 12), (replace(CIF, baud=1_000_000), 6, 49)], ids=["64x64", "cif"])
def test_pairs_at_video_rate(config, pairs, spots):
    """25 pairs a second: every lit pattern is measured, and textures come beside them."""
    whole = whole_of(config, 1, spots, line_blanking=48, mode=1)
    whole.run(40_000 * (pairs + 3))
    assert not check_frames(whole)
    assert whole.assert_light_is_safe() >= pairs
    lit = [frame for frame in whole.frames if frame.laser]
    assert len(lit) >= pairs and len(whole.textures) >= pairs
    assert (np.diff([frame.timestamp_us for frame in lit]) == 40_000).all()
    assert sum(len(frame.points) for frame in lit) > 5 * len(lit)


def test_a_broken_frame_costs_no_other():
    whole = whole_of(SMALL, 2, 12, mode=3)
    whole.run(130_000)
    whole.instrument.stop_row(30)
    whole.run(200_000)
    broken, = check_frames(whole)
    assert not broken.spots and not len(broken.points)
    assert sum(frame.index > broken.index for frame in whole.frames) >= 3
