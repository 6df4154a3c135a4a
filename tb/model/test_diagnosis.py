"""The real cause is named: no spots, a mistyped value of the projector, distances, sizes."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis import check_planes, identify_or_explain
from calibration.lines import Observations
from calibration.usable import usable_beams
from model.errors import UserError
from model.optics.rigs import RIGS
from tb.model.rig_spots import observe


@pytest.fixture(scope="module")
def seen():
    """Plane spots of the rig endoscope, its nominal projector and lens."""
    planes, _, nominal, lens = observe(RIGS["endoscope"], 71, planes=6)
    return planes, nominal, lens


@pytest.mark.parametrize("change, words", [
    (lambda n: replace(n, base_mm=(-n.base_mm[0], *n.base_mm[1:])),
     "base_mm has the wrong sign in [projector] of capture.toml: the projector is on the"),
    (lambda n: replace(n, toe_in_deg=-n.toe_in_deg), "toe_in_deg has the wrong sign in"),
    (lambda n: replace(n, rotation_deg=-n.rotation_deg), "rotation_deg has the wrong sign in"),
    (lambda n: replace(n, rows=8), "the mesh has 7 rows, not 8: correct rows in [projector] of"),
    (lambda n: replace(n, rows=6), "continue the 6 x 7 mesh"),
    (lambda n: replace(n, base_mm=tuple(part / 10 for part in n.base_mm)),
     "base_mm in [projector] of capture.toml or z_mm in planes.csv is wrong by a factor of 10"),
    (lambda n: replace(n, pitch_deg=1.4 * n.pitch_deg), "do not form the nominal 7 x 7 mesh")],
    ids=["base", "toe-in", "rotation", "more rows", "fewer rows", "unit", "pitch"])
def test_a_mistyped_value_is_named(seen, change, words):
    planes, nominal, lens = seen
    with pytest.raises(UserError) as refusal:
        identify_or_explain(planes, change(nominal), lens)
    assert words in str(refusal.value)


@pytest.mark.parametrize("key, side", [("rows", "row 0"), ("columns", "column [08]")])
def test_two_rows_too_many_are_not_taken_for_dead_beams(seen, key, side):
    planes, nominal, lens = seen
    more = replace(nominal, **{key: 9})
    identity = identify_or_explain(planes, more, lens)
    with pytest.raises(UserError, match=f"The spots of {side} are missing .* fewer than 9 "
                                        f"{key}; correct {key} in"):
        usable_beams(Observations.of(planes, identity, lens), more, identity.expected)


def test_frames_without_spots_are_named(seen):
    planes = seen[0]
    nothing = {name: getattr(planes[0], name)[:0] for name in ("u", "v", "x", "y", "area")}
    check_planes([replace(planes[0], **nothing), *planes[1:]])
    dark = [replace(plane, name=f"{number}.png", **nothing) if number < 4 else plane
            for number, plane in enumerate(planes)]
    with pytest.raises(UserError, match=r"No spots were found in 4 of the 6 plane frames \(0.png, "
                                        r"1.png, 2.png, 3.png\): check that the laser was on"):
        check_planes(dark)


def test_the_right_values_need_no_explanation(seen):
    planes, nominal, lens = seen
    assert np.mean(np.concatenate(identify_or_explain(planes, nominal, lens).beams) >= 0) > 0.9
