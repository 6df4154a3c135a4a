"""Sensors longer than 512 pixels, where coordinates have a fraction bit less."""

import numpy as np
import pytest

from hdl.config import Config
from tb.system.stimuli import spot_frame
from tb.system.test_frames import assert_same, expected, settings_of, shown


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("width,height", [(1024, 24), (24, 1024), (513, 16)])
def test_random_frames(width, height, weighted):
    """RTL = model, with spots at both ends of the long side."""
    config = Config(width=width, height=height, beams=8, lanes=2, spot_depth=512)
    settings = settings_of(config, weighted=weighted, area_min=3, report_rejected=False)
    images = [spot_frame(width, height, n, spots=60) for n in range(4)]
    got = shown(settings, config, images, frame_blanking=50_000)
    assert_same(got, expected(settings, config, images))
    assert sum(frame.ok for frame in got) > 5
    long = np.concatenate([frame.points["u" if width > height else "v"] for frame in got]) / 256
    assert long.min() < 50 and long.max() > max(width, height) - 50
