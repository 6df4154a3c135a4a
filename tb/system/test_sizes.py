"""Sensors longer than 512 pixels, whose coordinates have a fraction bit less."""

import numpy as np
import pytest

from calibration.file import load
from hdl.config import Config
from hdl.instrument import Instrument
from scripts.cyclope import cli
from scripts.results.accuracy import compare, load_points, load_truth
from tb.system.stimuli import spot_frame
from tb.system.test_frames import assert_same, expected, settings_of, shown


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("width,height", [(1024, 24), (24, 1024)])
def test_frames(width, height, weighted):
    """RTL = model, with spots at both ends of the long side."""
    config = Config(width=width, height=height, beams=8, lanes=2, spot_depth=512)
    settings = settings_of(config, weighted=weighted, area_min=3, report_rejected=False)
    images = [spot_frame(width, height, n, spots=60) for n in range(4)]
    got = shown(settings, config, images, frame_blanking=50_000)
    assert_same(got, expected(settings, config, images))
    assert sum(frame.ok for frame in got) > 5
    along = np.concatenate([frame.points["u" if width > height else "v"] for frame in got]) / 256
    assert along.min() < 50 and along.max() > max(width, height) - 50


def test_an_instrument_that_is_too_slow_for_its_frames():
    Instrument(Config(width=640, height=480))
    with pytest.raises(ValueError, match="640 x 480 pixels take 20480 us .* make clock_hz more"):
        Instrument(Config(width=640, height=480, clock_hz=15_000_000))


def test_vga_from_simulation_to_points(tmp_path):
    """640 x 480: own calibration; the RTL's points are the model's, and right."""
    capture, calibration = tmp_path / "capture", tmp_path / "calibration.json"
    assert cli.main(["simulate", "mixed", str(capture), "--rig", "vga", "--frames", "2",
                     "--seed", "3"]) == 0
    assert cli.main(["calibrate", str(capture), "--no-picture", "-o", str(calibration)]) == 0
    budget = load(calibration).budget
    assert budget["centre_px"] <= 0.01 and budget["line_px"] <= 0.006
    assert budget["undistortion_px"] <= 0.02
    points = []
    for engine in ("model", "rtl"):
        folder = tmp_path / engine
        assert cli.main(["run", str(capture), "--calibration", str(calibration), "--engine", engine,
                         "--no-pictures", "-o", str(folder)]) == 0
        points.append((folder / "points.csv").read_bytes())
    assert points[0] == points[1]
    result = compare(load_points(tmp_path / "rtl" / "points.csv"),
                     load_truth(capture / "truth.csv"), range(2))
    assert result.expected > 90
    assert result.found == 1 and result.wrong == 0 and result.mean <= 0.0005
