# amaranth: UnusedElaboratable=no
"""What measures in the preset paper, against its golden model, bit for bit."""

import tempfile
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibration.calibrate import Options, calibrate
from calibration.capture import read_capture
from calibration.lens import Lens
from calibration.remap import remap_table
from hdl.config import PRESETS, Config
from hdl.paper_points import PaperPoints
from model.optics import capture, render, scenes
from model.optics.rigs import RIGS
from model.paper import Paper
from model.settings import Settings
from tb.system.paper_rig import PaperBench, frames_of
from tb.system.stimuli import any_settings, directed_frames, random_frame, spot_frame

SMALL = replace(PRESETS["paper"], width=64, height=64, beams=16, lanes=16)
CIF = PRESETS["paper"]


@cache
def settings_of(config, **changes):
    """Settings with a strong lens, so that much of the corrected image lies outside."""
    width, height = config.width, config.height
    lens = Lens(width, height, 0.85 * width, (width - 1) / 2 + 1.3, (height - 1) / 2 - 0.7,
                k1=0.15, k2=0.02, p1=1e-3, p2=-2e-3)
    return any_settings(width, height, config.beams, **{
        "erosion": "erode", "weighted": False, "remap": remap_table(lens), **changes})


def check(name, mine, wanted):
    """A frame's answer against the model's."""
    for field in ("level", "spots", "rejected", "dropped"):
        got, other = getattr(mine, field), int(getattr(wanted, field))
        assert got == other, f"{name}: {got} for {field}, not {other}"
    assert len(mine.points) == len(wanted.points), f"{name}: number of points"
    for field in wanted.points.dtype.names:
        wrong = np.flatnonzero(mine.points[field] != wanted.points[field])
        assert not len(wrong), (f"{name}: {field} of point {wrong[0]}: "
                                f"{mine.points[wrong[0]]}, not {wanted.points[wrong[0]]}")
    assert not mine.broken


def compare(config, settings, images):
    """Frames, one after the other, against the model; gives what was measured."""
    bench = PaperBench(config, settings)
    model = Paper(settings, config.width, config.height, config.labels)
    answers = []
    for number, (name, image) in enumerate(images):
        mine = bench.measure(image, gap=0.2 * (number % 3 == 1), seed=number)
        check(name, mine, model.frame(image))
        assert (mine.number, mine.skipped) == (number, 0)
        assert bench.block.get("idle")
        answers.append(mine)
    return answers


def images_of(config, seeds):
    return [*directed_frames(config.width, config.height).items(),
            *((f"random {seed}", random_frame(config.width, config.height, seed))
              for seed in seeds)]


@pytest.mark.parametrize("erosion,fixed", [("erode", None), ("gate", None), ("off", 100)])
def test_small_frames(erosion, fixed):
    settings = settings_of(SMALL, erosion=erosion, level_fixed=fixed, area_min=1)
    answers = compare(SMALL, settings, images_of(SMALL, range(30)))
    assert sum(len(answer.points) for answer in answers) > 100


def test_more_components_than_labels():
    """Those that find no label are dropped whole, and counted."""
    config = replace(SMALL, labels=15)
    settings = settings_of(config, erosion="off", area_min=1)
    answers = compare(config, settings, images_of(config, range(25)))
    assert sum(answer.dropped > 0 for answer in answers) > 10


def test_cif_frames():
    answers = compare(CIF, settings_of(CIF), images_of(CIF, range(6)))
    assert max(len(answer.points) for answer in answers) > 150


@pytest.mark.parametrize("rig,config", [("small", SMALL), ("endoscope", CIF)])
def test_rendered_frames(rig, config):
    """A simulated rig, calibrated through the corrected images: beams are found."""
    rig = RIGS[rig]
    with tempfile.TemporaryDirectory() as folder:
        capture.write(folder, "plane", rig, 1, frames=1)
        options = Options(Settings(erosion="erode", weighted=False), remapped=True)
        calibration = calibrate(read_capture(folder), options).calibration
    rng = np.random.default_rng(7)
    images = [(f"{kind} {index}", render.pattern_frame(rig, scene, rng)[0])
              for kind in ("plane", "polyp", "tube")
              for index, scene in enumerate(scenes.sequence(kind, rig, 3, rng))]
    settings = replace(calibration.settings, report_rejected=True)
    answers = compare(config, settings, images)
    found = sum(int((answer.points["status"] == 0).sum()) for answer in answers)
    assert found > len(images) * config.beams // 2


def test_broken_frames_are_told_of_and_cost_no_other():
    settings = settings_of(SMALL)
    bench, model = PaperBench(SMALL, settings), Paper(settings, 64, 64)
    rng = np.random.default_rng(5)
    number = 0
    for seed in range(20):
        image = spot_frame(64, 64, seed, spots=12)
        if seed % 2:
            cut = int(rng.integers(1, image.size))
            broken = bench.measure(image, cut=cut, gap=0.1 * (seed % 3))
            assert broken.broken and broken.number == number
            assert not len(broken.points) and not broken.spots
            number += 1
        mine = bench.measure(image)
        check(seed, mine, model.frame(image))
        assert mine.number == number
        number += 1


def test_frames_that_come_too_soon_are_skipped_whole():
    """Frames back to back, four times as fast as they can be measured."""
    settings = settings_of(SMALL)
    bench = PaperBench(SMALL, settings)
    images = [spot_frame(64, 64, seed, spots=12) for seed in range(24)]
    wanted = [Paper(settings, 64, 64).frame(image) for image in images]
    beats = [bench.show(image, idle=700 * (number % 4)) for number, image in enumerate(images)]
    beats.append(bench.show(images[0], cut=1, idle=80_000))
    words = np.concatenate([each.words for each in beats])
    answers = frames_of(replace(beats[0], words=words, clocks=np.arange(len(words))))[:-1]
    assert 5 <= len(answers) < 20
    before = -1
    for mine in answers:
        check(mine.number, mine, wanted[mine.number])
        assert mine.skipped == mine.number - before - 1
        before = mine.number
    assert bench.block.get("lost") >= len(images) - len(answers)


@pytest.mark.parametrize("change,error", [
    ({"preset": "pill"}, "preset must be one of capsule, paper, not 'pill'"),
    ({"labels": 0}, "labels must be an integer from 1 to 32767, not 0"),
    ({"clock_hz": 16_500_000}, "clock_hz must be a multiple of 1 MHz, not 16500000"),
    ({"clock_hz": 16e6}, "clock_hz must be an integer from 1000000 to 65000000, not 16000000.0"),
    ({"preset": "paper", "width": 640},
     "The preset paper takes sensors of at most 512 x 512 pixels, not 640 x 288: its words of the "
     "remap table and its external memory hold no more; use the preset capsule"),
    ({"width": 1025}, "width must be an integer from 16 to 1024, not 1025"),
    ({"lanes": 50}, "lanes must be an integer from 1 to 49, not 50"),
    ({"converter_latency": 0}, "converter_latency must be an integer from 1 to 64, not 0"),
    ({"converter_latency": 4, "converter_interval": 3},
     "352 x 288 pixels of 3 clocks each take 19008 us to read, and a frame may take 19000 us: make "
     "converter_interval less or clock_hz more"),
])
def test_choices_out_of_range_are_refused(change, error):
    with pytest.raises(ValueError) as caught:
        Config(**change)
    assert str(caught.value) == error


def test_wants_a_config():
    with pytest.raises(TypeError, match="The configuration must be a Config, not 'paper'"):
        PaperPoints("paper")
