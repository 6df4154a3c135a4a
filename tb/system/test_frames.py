"""RTL against golden model on whole frames, identical down to the last bit."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from hdl.config import Config
from model.capsule import Capsule as Model
from model.link.framer import frame as framed
from model.link.points import packets
from scripts.host.decoder import Decoder
from scripts.host.rebuild import Rebuilder
from scripts.simulation.engine import RTLEngine
from tb.system import endoscope
from tb.system.stimuli import any_settings, directed_frames, random_frame, spot_frame

#: With a queue for the most crowded of these frames, so that nothing is dropped.
SMALL = Config(width=64, height=64, beams=16, lanes=2, spot_depth=512)
CIF = Config(lanes=2)
#: Gains of lit, core and dent, window, weights.
MODES = [*product([(18, 40, 4), (24, 48, 0)], [9], (False, True)), ((18, 36, 4), 11, True)]
#: Noise that makes the lit level 36 grey values with the default gains.
NOISE = 256


def settings_of(config, gains=(18, 40, 4), seed=1, **changes):
    """Settings with these gains for a sensor."""
    lit, core, dent = gains
    return any_settings(config.width, config.height, config.beams, seed, lit_gain=lit,
                        core_gain=core, dent_gain=dent, mean_window=config.mean_window, **changes)


def expected(settings, config, images, full_records=True):
    """What the reader gets of ``images``, as the model says it."""
    model, sequence = Model(settings, config.width, config.height), 0
    decoder, frames = Decoder(Rebuilder(settings, config.width, config.height)), []
    for image in images:
        octets, sequence = framed(packets(model.frame(image), full_records), sequence)
        frames += decoder.feed(b"".join(octets))
    return frames + decoder.finish()


def shown(settings, config, images, full_records=True, **blanking):
    """The same from the RTL, the learning frame included."""
    engine = RTLEngine(settings, config, full_records=full_records, **blanking)
    frames = []
    for image in images:
        frames += engine._show(image, discard=False)
    return frames + list(engine._finish())


def assert_same(got, wanted, names=None):
    assert len(got) == len(wanted)
    for index, (mine, other) in enumerate(zip(got, wanted, strict=True)):
        name = names[index] if names else index
        for field in ("number", "level", "grey_noise", "saturated", "learning", "broken", "spots",
                      "ok", "noise", "ambiguous", "rejected", "dropped", "check", "verified"):
            assert getattr(mine, field) == getattr(other, field), f"frame {name}: {field}"
        assert np.array_equal(mine.points, other.points), f"frame {name}: points"


@pytest.mark.parametrize("gains,window,weighted", MODES)
@pytest.mark.parametrize("seed", [1, 2])
def test_random_frames_64(gains, window, weighted, seed):
    """5 modes x 2 seeds x 20 frames."""
    config = replace(SMALL, mean_window=window)
    settings = settings_of(config, gains, seed, weighted=weighted, area_min=2, area_max=120)
    images = [random_frame(64, 64, 100 * seed + n) for n in range(20)]
    got = shown(settings, config, images, frame_blanking=50_000)
    assert_same(got, expected(settings, config, images))
    assert sum(frame.ok for frame in got) > 20


@pytest.mark.parametrize("gains,window,weighted", MODES)
def test_directed_frames_64(gains, window, weighted):
    """What breaks such designs, at fixed levels."""
    frames = directed_frames(64, 64)
    config = replace(SMALL, mean_window=window)
    # Rejected spots are not sent here: some of these frames have a thousand.
    settings = settings_of(config, gains, weighted=weighted, fixed_noise=NOISE, area_min=5,
                           area_max=60, report_rejected=False)
    assert_same(shown(settings, config, frames.values()),
                expected(settings, config, frames.values()), list(frames))


@pytest.mark.parametrize("width,height,window", [(18, 16, 9), (22, 40, 11), (16, 16, 7)])
def test_the_smallest_sensors(width, height, window):
    config = replace(SMALL, width=width, height=height, mean_window=window)
    settings = settings_of(config, area_min=1)
    images = [random_frame(width, height, n) for n in range(15)]
    assert_same(shown(settings, config, images, frame_blanking=20_000),
                expected(settings, config, images))


@pytest.mark.parametrize("line,frame", [(0, 1), (7, 40), (48, 3000)])
def test_blanking_changes_nothing(line, frame):
    settings = any_settings(64, 64, SMALL.beams, 5)
    images = [random_frame(64, 64, n) for n in range(4)]
    assert_same(shown(settings, SMALL, images, line_blanking=line, frame_blanking=frame),
                expected(settings, SMALL, images))


@pytest.mark.parametrize("lanes", [8, 49])
def test_lanes_change_nothing(lanes):
    config = replace(CIF, lanes=lanes)
    settings = any_settings(352, 288, config.beams, 6, area_min=3)
    images = [spot_frame(352, 288, n, spots=49) for n in range(2)]
    assert_same(shown(settings, config, images), expected(settings, config, images))


@pytest.mark.parametrize("gains,window,weighted", MODES)
def test_frames_352(gains, window, weighted):
    """5 modes x 4 frames of spots, thin noise and blocks."""
    config = replace(CIF, mean_window=window)
    settings = settings_of(config, gains, 7, weighted=weighted, area_min=3, report_rejected=False)
    images = [spot_frame(352, 288, 70 + n, spots=60) for n in range(3)]
    images.append(random_frame(352, 288, 3))
    assert_same(shown(settings, config, images), expected(settings, config, images))


@pytest.mark.parametrize("seed", [11, 12])
def test_compact_points_carry_the_same(seed):
    """The reader's beams and depths are the chip's: every frame's check says so."""
    settings = any_settings(352, 288, CIF.beams, seed, area_min=3, report_rejected=False)
    images = [spot_frame(352, 288, 10 * seed + n, spots=60) for n in range(4)]
    got = shown(settings, CIF, images, full_records=False, frame_blanking=50_000)
    assert_same(got, expected(settings, CIF, images, full_records=False))
    assert all(frame.verified for frame in got[1:]) and sum(frame.ok for frame in got) > 20
    full = expected(settings, CIF, images)
    for frame, other in zip(got, full, strict=True):
        ok, others = (f.points[f.points["status"] == 0] for f in (frame, other))
        assert np.array_equal(ok, others)


@pytest.mark.parametrize("noise", [120, NOISE])
def test_directed_frames_352(noise):
    frames = directed_frames(352, 288)
    settings = any_settings(352, 288, CIF.beams, fixed_noise=noise, area_min=9, area_max=80,
                            report_rejected=False)
    assert_same(shown(settings, CIF, frames.values()),
                expected(settings, CIF, frames.values()), list(frames))


def test_fetoscope_photographs():
    """Ten photographs of a dot board through a real endoscope: identical to the model, and on
    three of them every dot within 0.5 px of the reference centres."""
    photographs = endoscope.photographs()
    settings = any_settings(352, 288, CIF.beams, fixed_noise=endoscope.NOISE,
                            area_min=12, area_max=255)
    images = [photograph.image for photograph in photographs]
    got = shown(settings, CIF, images)
    assert_same(got, expected(settings, CIF, images))
    for number in (1, 4, 10):
        photograph = photographs[number - 1]
        points = got[number - 1].points
        centres = np.stack([points["u"], points["v"]], axis=-1) / 512
        error = photograph.errors(centres)
        assert len(error) == 33, f"frame {number}: {len(error)} of 33 dots"
        assert np.sqrt(np.mean(error**2)) <= 0.5, f"frame {number}"
