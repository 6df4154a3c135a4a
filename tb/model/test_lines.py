"""Epipolar lines and depth laws against the simulator's exact ones."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.identity import identify
from calibration.lines import Observations, fit_lines
from model.optics.geometry import beam_lines
from model.optics.rigs import RIGS
from tb.model.rig_spots import fitted, observe


@pytest.mark.parametrize("name", ["endoscope", "demonstrator", "small"])
def test_lines_and_depth_are_the_simulators(name):
    rig = RIGS[name]
    _, _, lines = fitted(rig, 11, noise=0.02)
    exact = beam_lines(rig.camera, rig.projector)
    for z in np.linspace(*rig.range_mm, 9):
        column = exact.column_at(z)
        off = lines.a * column + lines.b - exact.a * column - exact.b
        assert np.abs(off).max() < 0.05
        move = column - lines.column_at(z)
        assert np.sqrt(np.mean(move**2)) < 0.02
    assert 0.01 < lines.rms_px < 0.03


def test_the_common_origin_helps():
    """Held-out planes say so, and the truth agrees."""
    rig = RIGS["endoscope"]
    planes, _, nominal, lens = observe(rig, 12, noise=0.05)
    data = Observations.of(planes, identify(planes, nominal, lens), lens)
    lines = fit_lines(data, lens)
    assert lines.strength >= 1
    assert lines.held_out_px[lines.strength] < 0.96 * lines.held_out_px[0.0]


def test_outliers_do_not_move_the_lines():
    rig = RIGS["endoscope"]
    planes, _, nominal, lens = observe(rig, 13, noise=0.02, strays=0)
    data = Observations.of(planes, identify(planes, nominal, lens), lens)
    rng = np.random.default_rng(1)
    wrong = rng.random(len(data.x)) < 0.03
    spoilt = replace(data, x=data.x + wrong * rng.uniform(0.5, 2, len(wrong)),
                     y=data.y + wrong * rng.uniform(0.5, 2, len(wrong)))
    lines = fit_lines(spoilt, lens)
    exact = beam_lines(rig.camera, rig.projector)
    assert lines.outliers >= 0.9 * wrong.sum()
    for z in (40, 60, 110):
        assert np.abs(lines.column_at(z) - exact.column_at(z)).max() < 0.06
