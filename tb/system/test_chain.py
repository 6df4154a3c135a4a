"""The chip's latency, from a frame's last pixel to its last point."""

from dataclasses import replace

from hdl.config import PRESETS
from tb.system.chain import last_point_latency, spots_on_the_last_row


def test_last_point_comes_within_seven_rows_and_1000_clocks():
    """64 spots that all end on the last row, eight lanes; clocks, not seconds."""
    config = replace(PRESETS["capsule"], lanes=8)
    clocks, points = last_point_latency(config, spots_on_the_last_row(config))
    assert points == 64
    assert clocks <= (3 + config.mean_window // 2) * config.width + 1000
