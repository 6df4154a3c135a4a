import numpy as np
import pytest

from model.link.points import PatternFrame
from tb.benchmark.line_load import octets_per_pair, points_octets, realistic_frames, refresh_seconds
from tb.link.frames import near_points


@pytest.fixture(scope="module")
def frames():
    found = [frame for frame in realistic_frames([1], frames=2)
             if np.count_nonzero(frame.points["status"] == 0) == 49]
    assert len(found) >= 6
    return found


def test_49_points_leave_35_percent_of_the_line(frames):
    """At 115,200 baud and 25 pairs a second, pauses between packets included."""
    most = max(points_octets(frame) for frame in frames)
    assert most <= 299 and most <= 0.65 * octets_per_pair()


@pytest.mark.parametrize("seed", range(3))
def test_361_points_leave_35_percent_of_a_line_of_1_mbaud(seed):
    """At 25 pairs a second, with more long forms than simulated frames have."""
    points = near_points(np.random.default_rng(seed), 361)
    octets = points_octets(PatternFrame(points=points, spots=361))
    assert octets <= 0.65 * octets_per_pair(1_000_000)


def test_refresh_of_a_texture(frames):
    """... takes as long as the octets that are left need for its packets."""
    pair = octets_per_pair()
    rows = 288 * (4 * (100 + 3) + 8 + 14 + 3)  # four full packets and one of 8 pixels each
    for frame, octets in ((None, 0), (frames[0], points_octets(frames[0]))):
        left = pair - octets - (12 + 1 + 4 + 3 + 3 + 1)  # one packet of the frame
        expected = rows / left * 0.040
        # At the end of what was captured rows are cut.
        assert refresh_seconds(frame) == pytest.approx(expected, rel=0.05)


def test_more_points_leave_less_for_texture():
    frame = PatternFrame(points=near_points(np.random.default_rng(1), 70), spots=70)
    assert refresh_seconds(frame, 64, 64) > 2 * refresh_seconds(None, 64, 64)
