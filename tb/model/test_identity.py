"""Which beam made which spot: found from poor nominal values, never numbered wrongly."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.identity import identify
from calibration.projector import Projector
from model.errors import UserError
from model.optics.rigs import RIGS
from tb.model.rig_spots import observe


@pytest.mark.parametrize("name, seed", [
    ("endoscope", 1), ("endoscope", 2), ("demonstrator", 3), ("small", 4), ("small", 5)])
def test_identity_with_the_worst_nominal_values(name, seed):
    planes, truth, nominal, lens = observe(RIGS[name], seed, noise=0.1)
    identity = identify(planes, nominal, lens)
    for found, true in zip(identity.beams, truth, strict=True):
        real = true >= 0
        assert np.array_equal(found[real], true[real])
    assert sum((found[true < 0] >= 0).sum() for found, true in
               zip(identity.beams, truth, strict=True)) <= 1
    fit, projector = identity.projector, RIGS[name].projector
    assert abs(fit.rotation_deg - projector.rotation_deg) < 0.3
    assert abs(fit.base_mm[0] / projector.base_mm[0] - 1) < 0.02


@pytest.mark.parametrize("change, message", [
    ({"toe_in_deg": 2.5 + 6.3}, "projector|mesh"),
    ({"toe_in_deg": 2.5 - 6.3}, "projector|mesh"),
    ({"rows": 8}, "projector|mesh|planes"),
    ({"columns": 6}, "continue the 7 x 6 mesh"),
    ({"rotation_deg": -8.5}, "do not form the nominal 7 x 7 mesh"),
    ({"pitch_deg": 6.3 * 1.15}, "projector"),
    ({"base_mm": (-5, -0.05, 0.12)}, "mesh|projector")])
def test_numbering_is_never_shifted_silently(change, message):
    planes, _, nominal, lens = observe(RIGS["endoscope"], 8)
    with pytest.raises(UserError, match=message):
        identify(planes, replace(nominal, **change), lens)


def test_mesh_without_a_border_is_refused():
    rig = RIGS["endoscope"]
    fine = replace(rig.projector, rows=25, columns=25, pitch_deg=1.2, rotation_deg=3.0,
                   irregularity_deg=0)
    large = replace(rig, camera=replace(rig.camera, width=128, height=128,
                                        principal_px=(63.0, 64.0)), projector=fine)
    planes, _, _, lens = observe(large, 1, strays=0, missing=0, planes=5)
    nominal = Projector(25, 25, 1.2, 3.0, 2.5, fine.base_mm)
    with pytest.raises(UserError, match="cannot be told from their neighbours"):
        identify(planes, nominal, lens)


def test_frames_without_spots_are_refused():
    planes, _, nominal, lens = observe(RIGS["endoscope"], 8, missing=1, strays=0, planes=4)
    with pytest.raises(UserError, match="do not form the nominal 7 x 7 mesh"):
        identify(planes, nominal, lens)


@pytest.mark.parametrize("name, shift, found", [("small", 1.7, True), ("endoscope", 6.0, False)])
def test_a_principal_point_that_is_off_turns_the_mesh(name, shift, found):
    """By 1.2 degrees at 80 px, which is allowed for; at 360 px two pixels are next to nothing."""
    planes, truth, nominal, lens = observe(RIGS[name], 4, noise=0.1)
    toe_in = RIGS[name].projector.toe_in_deg - 0.9
    wrong = replace(lens, principal_u=lens.principal_u + shift)
    nominal = replace(nominal, toe_in_deg=toe_in)
    if not found:
        with pytest.raises(UserError, match=r"toe_in_deg .*; at most 1\.6 degrees"):
            identify(planes, nominal, wrong)
        return
    identity = identify(planes, nominal, wrong)
    for beams, true in zip(identity.beams, truth, strict=True):
        assert np.array_equal(beams[true >= 0], true[true >= 0])
