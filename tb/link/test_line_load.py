import numpy as np
import pytest

from model.link.framer import wire_octets
from model.link.points import PatternFrame
from model.link.texture import TEXTURE, Texture, TextureFrame
from tb.benchmark.line_load import octets_per_pair, points_octets, realistic_frames, refresh_seconds
from tb.benchmark.texture_time import simulated_tissue
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


def test_a_texture_takes_what_its_packets_need(frames):
    image = simulated_tissue()
    texture, octets = Texture(352, 288), 0
    while not octets or texture.stands != (0, 0):
        texture.frame(image, TextureFrame(), 2)
        while (content := texture.packet()) is not None:
            octets += wire_octets([content]) * (content[0] == TEXTURE)
    for frame, taken in ((None, 0), (frames[0], points_octets(frames[0]))):
        left = octets_per_pair() - taken - (12 + 1 + 4 + 3 + 3 + 1)  # one packet of the frame
        coarse, whole = refresh_seconds(image, frame)
        assert whole == pytest.approx(octets / left * 0.040, rel=0.1)
        assert coarse < whole / 6


def test_more_points_leave_less_for_texture():
    image = np.random.default_rng(1).integers(0, 256, (64, 64), np.uint8)
    frame = PatternFrame(points=near_points(np.random.default_rng(1), 70), spots=70)
    assert refresh_seconds(image, frame)[1] > 2 * refresh_seconds(image)[1]
