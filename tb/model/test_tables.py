"""Windows, tolerances and quantised tables."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.tables import INVERSE_Z_ERROR, build_tables, choose_windows, separations
from model.errors import UserError
from model.optics.rigs import RIGS
from model.stereo.depth import inverse_depth
from model.stereo.epipolar import OK, match, unpack_window
from tb.model.rig_spots import endoscope, fitted


def test_separations_against_a_walk_along_the_lines():
    rng = np.random.default_rng(4)
    a, b = rng.normal(scale=0.1, size=12), rng.uniform(-20, 20, 12)
    low = rng.uniform(-100, 50, 12)
    high = low + rng.uniform(10, 60, 12)
    found = separations(a, b, low, high)
    for one in range(12):
        for other in range(12):
            first, last = max(low[one], low[other]), min(high[one], high[other])
            if one == other or first > last:
                assert np.isinf(found[one, other])
                continue
            u = np.linspace(first, last, 20001)
            gap = (a[one] - a[other]) * u + b[one] - b[other]
            walked = 0 if gap.min() < 0 < gap.max() else np.abs(gap).min()
            assert found[one, other] == pytest.approx(walked, abs=1e-9)


def test_quantised_tables_measure_as_float():
    _, lines, windows, tables = endoscope()
    assert tables.depth_relative <= INVERSE_Z_ERROR / 2
    assert tables.line_px < 0.003
    rng = np.random.default_rng(6)
    tolerance, u_min, u_max = unpack_window(tables.window)
    assert np.all(u_min / 16 <= windows.low) and np.all((u_max + 1) / 16 > windows.high)
    assert np.all(np.abs(tolerance / 32 - windows.tolerance) <= 1 / 32)
    beam = np.repeat(np.arange(49), 200)
    x = np.rint(rng.uniform(windows.low[beam], windows.high[beam]) * 512).astype(int)
    y = np.rint((lines.a[beam] * x / 512 + lines.b[beam]) * 512).astype(int)
    status, found = match(x, y, np.zeros(len(x), bool), tables.line, tables.window)
    assert np.all(status == OK) and np.array_equal(found, beam)
    status, _, value = inverse_depth(x, beam, status, tables.depth)
    assert np.all(status == OK)
    exact = lines.alpha[beam] * x / 512 + lines.beta[beam]
    assert np.abs(value * tables.inverse_z_unit / exact - 1).max() <= INVERSE_Z_ERROR / 2


def test_a_spot_is_never_within_two_tolerances():
    _, lines, windows, _ = endoscope()
    distance = separations(lines.a, lines.b, windows.low, windows.high)
    pair = np.add.outer(windows.tolerance, windows.tolerance)
    assert np.all(distance >= pair - 1e-9)


def test_ambiguous_pattern_is_refused():
    rig = RIGS["endoscope"]
    flat = replace(rig, projector=replace(rig.projector, rotation_deg=0.0, irregularity_deg=0))
    planes, _, lines = fitted(flat, 16)
    with pytest.raises(UserError, match=r"The pattern is ambiguous: the epipolar lines of beams 0 "
                                        r"and 1 \(0\.\d\d px\), .* turn the mesh"):
        choose_windows(lines, 7, planes[-1].z_mm, planes[0].z_mm)


def test_base_along_the_columns_is_refused():
    rig = RIGS["endoscope"]
    above = replace(rig.projector, base_mm=(0.2, 5.0, 0.1), toe_in_deg=0.0, pitch_deg=5.0)
    with pytest.raises(UserError, match="beside the camera along the rows"):
        fitted(replace(rig, projector=above), 17, strays=0, missing=0)


def test_depth_range_to_infinity_is_refused():
    _, lines, windows, _ = endoscope()
    endless = replace(windows, low=windows.low - 60)
    with pytest.raises(UserError, match="beyond infinite distance"):
        build_tables(lines, endless, 7, 49)
