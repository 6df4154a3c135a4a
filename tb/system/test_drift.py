"""What has moved in a rig is noticed and named, and nothing is where nothing has."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration import file
from model.optics.rigs import RIGS
from model.optics.scenes import Plane
from scripts.host.verdict import find_unusable
from scripts.results.drift import Drift, DriftMonitor
from scripts.results.points import POINT
from tb.benchmark.drift import MOVED, NOISE_PX, follow, move
from tb.measure.simulated import measured
from tb.system.fake_instrument import any_calibration

RIG = RIGS["endoscope"]
#: What the states after 100 frames must be near to.
AMOUNTS = {"focus": ("focus", 0.005, 0.0005), "turned": ("turned_deg", 0.05, 0.015),
           "base": ("base_mm", 0.05, 0.01)}


@pytest.fixture(scope="module")
def calibration(prepared):
    return file.load(prepared[1])


@pytest.mark.parametrize("what", MOVED)
@pytest.mark.parametrize("kind", NOISE_PX)
def test_what_moved_is_named(calibration, kind, what):
    _, cause, visible = MOVED[what]
    seen = follow(move(RIG, what), calibration, kind, NOISE_PX[kind], 2, 100)
    if not visible:
        assert not seen.alarms
        return
    assert seen.first is not None and cause in seen.last.causes
    # A shift forwards is like a change of the focus.
    assert seen.last.causes[0] == cause or what == "base 1 % forwards"
    name, amount, tolerance = AMOUNTS[cause]
    assert abs(abs(getattr(seen.last, name)) - amount) < tolerance


@pytest.mark.parametrize("seed", [3])
@pytest.mark.parametrize("kind", NOISE_PX)
def test_nothing_moved(calibration, kind, seed):
    seen = follow(RIG, calibration, kind, NOISE_PX[kind], seed, 400)
    assert not seen.alarms
    assert 0.3 * seen.last.normal_px / 3 < seen.last.distance_px < seen.last.normal_px


@pytest.mark.parametrize("beams, seed", [(49, 4), (9, 5)])
def test_more_than_a_small_change_has_no_name(calibration, beams, seed):
    """Spots far beside the lines, in no pattern that one cause makes, or of too few beams."""
    rng = np.random.default_rng(seed)
    frame = measured(RIG, calibration, Plane(60), rng, 0.03)[:beams]
    frame["v"] += rng.choice([-0.8, 0.8], len(frame))
    monitor = DriftMonitor(calibration)
    states = [monitor.add(frame) for _ in range(20)]
    assert not states[10].causes and states[-1].causes == ("unknown",)
    assert "beside their lines, more than a small change explains" in states[-1].sentence


def test_few_frames_few_beams_and_no_points_say_nothing(calibration):
    moved = move(RIG, "focus 0.5 % longer")
    assert follow(moved, calibration, "polyp", 0.03, 1, 15).alarms == 0
    assert DriftMonitor(calibration).add(np.zeros(0, POINT)) is None
    monitor = DriftMonitor(any_calibration())  # its lines belong to no rig
    points = np.zeros(9, POINT)
    points["beam"], points["u"], points["v"], points["z"] = range(9), 30, range(20, 29), 20
    for _ in range(40):
        assert not monitor.add(points).causes


def test_a_moved_rig_is_the_verdict():
    assert Drift(0.1, 0.2).sentence == ""
    state = Drift(0.4, 0.2, ("focus", "base"), 0.005, 0.1, 0.35)
    recorder = SimpleNamespace(
        complete={}, frames=9, seen=set(), tripped=0, lit=9, tabled=9, unverified=0, verified=9,
        points=99, drift=state)
    assert find_unusable(recorder) == [
        "the rig is not as it was calibrated: the focus has changed by +0.50 %, or the projector "
        "has moved by 0.350 mm; calibrate it again."]
    recorder.drift = Drift(0.1, 0.2)
    assert find_unusable(recorder) == []
