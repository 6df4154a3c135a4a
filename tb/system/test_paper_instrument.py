# amaranth: UnusedElaboratable=no
"""The whole instrument of the preset paper: imager, laser, host, memory and screen, natively."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.lens import Lens
from calibration.remap import remap_table
from hdl.protocol import DISPLAY_FAULTS, Mode, Reason
from model.errors import UserError
from model.paper import Paper
from scripts.host.chip import RefusedError, check_chip
from scripts.host.loading import load
from tb.system.fake_instrument import any_calibration
from tb.system.stimuli import spot_frame
from tb.system.test_paper import CIF, settings_of
from tb.system.test_paper import SMALL as SLOW
from tb.system.whole import Whole, same

#: Loading takes longer than all else; the line's speed is not what matters here.
SMALL = replace(SLOW, baud=2_000_000)
VIDEO = replace(CIF, baud=1_000_000)


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


@pytest.mark.parametrize("config,spots", [(SMALL, 12), (VIDEO, 49)], ids=["64x64", "cif"])
def test_pairs_at_video_rate(config, spots):
    """25 pairs a second: every lit pattern is measured, and textures come beside them."""
    pairs = 4
    whole = whole_of(config, 1, spots, line_blanking=48, mode=1,
                     places_in_memory=config.width > 64)
    whole.run(40_000 * (pairs + 3))
    assert not check_frames(whole)
    assert whole.assert_light_is_safe() >= pairs
    lit = [frame for frame in whole.frames if frame.laser]
    assert len(lit) >= pairs and len(whole.textures) >= pairs
    assert (np.diff([frame.timestamp_us for frame in lit]) == 40_000).all()
    assert sum(len(frame.points) for frame in lit) > 5 * len(lit)
    assert not whole.commands.status()["display"]


def test_spots_that_are_not_drawn_are_reported():
    """The display draws 128 spots of a frame; there are 196."""
    row, column = np.mgrid[:64, :64]
    image = np.where((row % 4 < 2) & (column % 4 < 2) & (row < 56) & (column < 56), 200, 20)
    settings = settings_of(SLOW, erosion="off", area_min=1, level_fixed=100)
    whole = Whole(SMALL, settings, [image.astype(np.uint8)], points_max=0, mode=3)
    whole.run(90_000)
    assert any(frame.spots > 128 for frame in whole.frames)
    assert whole.commands.status()["display"] == 1 << DISPLAY_FAULTS.index("overlay")


def test_a_broken_frame_costs_no_other():
    whole = whole_of(SMALL, 2, 12, mode=3)
    whole.run(130_000)
    whole.instrument.stop_row(30)
    whole.run(200_000)
    broken, = check_frames(whole)
    assert not broken.spots and not len(broken.points)
    assert sum(frame.index > broken.index for frame in whole.frames) >= 3


def test_tables_come_over_the_line():
    """What `cyclope load` does with a calibration for whole images; a bit wrong in the table of
    places, or that table alone missing, and there is no light."""
    table = remap_table(Lens(64, 64, 54.0, 32.8, 30.8, k1=0.15))
    calibration = any_calibration(rows=4, columns=4, erosion="erode", weighted=False, remap=table)
    images = [spot_frame(64, 64, seed, spots=12) for seed in range(4)]
    whole = Whole(SMALL, calibration.settings, images, load=False)
    commands = whole.commands
    check_chip(commands.identify(), calibration)
    with pytest.raises(UserError, match="calibrate with `cyclope calibrate --preset paper`"):
        check_chip(commands.identify(), any_calibration(rows=4, columns=4))

    def damage(words):
        places = list(words["remap"])
        places[777] ^= 1 << 40
        return {**words, "remap": places}

    for harm in (damage, lambda words: {**words, "remap": []}):
        with pytest.raises(RefusedError) as refused:
            whole.load(calibration.settings, harm)
        assert refused.value.reason == Reason.DAMAGED_TABLE
        assert not commands.status()["state"].tables_valid
    steps = []
    load(commands, calibration, lambda done, total: steps.append((done, total)))
    assert steps[-1][0] == steps[-1][1]
    commands.write("mode", Mode.CONTINUOUS)
    whole.run(6 * 40_000)
    assert commands.status()["state"].tables_valid
    assert not check_frames(whole) and whole.assert_light_is_safe() >= 3
