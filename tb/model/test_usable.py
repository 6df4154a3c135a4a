"""Meshes with dead, overbright and hidden beams: calibrated without them, and named."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.calibrate import Options, calibrate_beams, with_lens
from calibration.chessboards import LensReport
from calibration.figures import health
from calibration.identity import identify
from calibration.lines import Observations, fit_lines
from calibration.projector import Projector
from calibration.report import beam_remarks, beams_table, summary_table
from calibration.spots import plane_spots
from calibration.usable import drop_scattered, relative_areas, seen_dead, usable_beams
from model.capsule import Capsule
from model.errors import UserError
from model.optics import rigs, scenes
from model.optics.rigs import RIGS
from model.settings import Settings
from scripts.results.overlay import beam_segments
from tb.model.beam_faults import pattern_frame_with
from tb.model.rig_spots import lens_of, observe


def without(planes, truth, gone):
    """Plane spots without the spots of some beams; ``gone(beam, plane)`` says which."""
    result = []
    for number, (plane, beams) in enumerate(zip(planes, truth, strict=True)):
        keep = ~np.array([beam >= 0 and gone(beam, number) for beam in beams])
        result.append(replace(plane, **{name: getattr(plane, name)[keep]
                                        for name in ("u", "v", "x", "y", "area")}))
    return result


def usable(planes, nominal, lens):
    """Usable beams of plane spots, and the identity."""
    identity = identify(planes, nominal, lens)
    observations = Observations.of(planes, identity, lens)
    return usable_beams(observations, nominal, identity.expected), identity


@pytest.mark.parametrize("dead", [(0,), (6,), (24,), (48,), (0, 1, 2), (5, 6, 13), (17, 24, 31),
                                  (3, 20, 40)])
def test_dead_beams_are_left_out_and_the_others_unchanged(dead):
    planes, truth, nominal, lens = observe(RIGS["endoscope"], 31, missing=0)
    whole = fit_lines(usable(planes, nominal, lens)[0].observations, lens)
    found, _ = usable(without(planes, truth, lambda beam, _: beam in dead), nominal, lens)
    assert sorted(found.left_out) == list(dead)
    assert all("dead, blocked" in reason for reason in found.left_out.values())
    lines = fit_lines(found.observations, lens)
    assert lines.numbers.tolist() == [beam for beam in range(49) if beam not in dead]
    for z in (40, 60, 110):
        assert np.abs(lines.column_at(z) - whole.column_at(z)[lines.numbers]).max() < 0.01
    assert np.abs(lines.a - whole.a[lines.numbers]).max() < 1e-3


@pytest.mark.parametrize("dead", [range(7), range(6, 49, 7), range(28), (0, 8, 20)],
                         ids=["row 0", "column 6", "four rows", "single ones"])
def test_beams_that_are_known_to_be_dead(dead):
    """Not looked for, not counted, and the others unchanged; unnamed, a row is missing."""
    planes, truth, nominal, lens = observe(RIGS["endoscope"], 31, missing=0)
    whole = fit_lines(usable(planes, nominal, lens)[0].observations, lens)
    planes = without(planes, truth, lambda beam, _: beam in dead)
    if len(dead) > 3:
        with pytest.raises(UserError):
            usable(planes, nominal, lens)
    identity = identify(planes, nominal, lens, dead=dead)
    assert identity.matched > 0.99 and not identity.expected[list(dead)].any()
    found = usable_beams(Observations.of(planes, identity, lens), nominal, identity.expected, dead)
    assert found.left_out == dict.fromkeys(dead, "known to be dead")
    assert seen_dead(found, planes, identity, lens).left_out == found.left_out
    lines = fit_lines(found.observations, lens)
    assert lines.numbers.tolist() == [beam for beam in range(49) if beam not in dead]
    assert np.abs(lines.column_at(60) - whole.column_at(60)[lines.numbers]).max() < 0.02


def test_a_beam_that_is_not_as_dead_as_it_was_said_to_be():
    planes, _, nominal, lens = observe(RIGS["endoscope"], 31, missing=0)
    identity = identify(planes, nominal, lens, dead=[17])
    found = usable_beams(Observations.of(planes, identity, lens), nominal, identity.expected, [17])
    found = seen_dead(found, planes, identity, lens)
    assert list(found.left_out) == [17] and 17 not in found.observations.numbers
    assert "known to be dead, but there are spots where its own would be at 10 distances" in (
        found.left_out[17])


def test_beams_out_of_the_picture_at_some_distances():
    """Seen at four distances or more they are used; at fewer they are named."""
    rig = RIGS["endoscope"]
    rig = replace(rig, projector=replace(rig.projector, toe_in_deg=-6.0))
    planes, _, nominal, lens = observe(rig, 32, missing=0, strays=0, planes=12)
    found, identity = usable(planes, nominal, lens)
    cut = np.flatnonzero(identity.expected < 12)
    assert len(cut) >= 7 and (identity.expected[cut] >= 4).any()
    assert set(found.left_out) == set(np.flatnonzero(identity.expected < 4).tolist())
    assert all("inside the usable part of the picture at" in reason
               for reason in found.left_out.values())


def test_a_mesh_of_which_too_little_is_left_is_refused():
    planes, truth, nominal, lens = observe(RIGS["endoscope"], 33, missing=0)
    identity = identify(planes, nominal, lens)
    data = Observations.of(planes, identity, lens)
    seldom = ~((data.beam % 2 == 0) & (data.plane >= 3))
    few = replace(data, **{name: getattr(data, name)[seldom]
                           for name in ("beam", "plane", "inverse_z", "x", "y")})
    with pytest.raises(UserError, match=r"Only 24 of the 49 beams can be used, .* left out are 0 "
                                        r"\(row 0, column 0\): found at 3 of the 10 distances"):
        usable_beams(few, nominal, identity.expected)
    dead = without(planes, truth, lambda beam, _: beam % 5 < 3)
    with pytest.raises(UserError, match="do not form the nominal 7 x 7 mesh"):
        identify(dead, nominal, lens)


def test_too_few_planes_are_refused():
    planes, _, nominal, lens = observe(RIGS["endoscope"], 14, planes=3)
    with pytest.raises(UserError, match="show 3 distances, at least 4 different"):
        usable(planes, nominal, lens)


def test_a_beam_whose_spots_scatter_is_left_out():
    planes, _, nominal, lens = observe(RIGS["endoscope"], 34, missing=0, strays=0)
    found, _ = usable(planes, nominal, lens)
    data = found.observations
    off = np.where(data.beam == 17, np.random.default_rng(1).uniform(-3, 3, len(data.beam)), 0)
    spoilt = replace(found, observations=replace(data, y=data.y + off))
    lines = fit_lines(spoilt.observations, lens)
    fewer = drop_scattered(spoilt, lines, nominal)
    assert list(fewer.left_out) == [17] and "lie on a line" in fewer.left_out[17]
    again = fit_lines(fewer.observations, lens)
    assert drop_scattered(fewer, again, nominal) is fewer and 17 not in again.numbers


@pytest.fixture(scope="module")
def faulty():
    """A rig whose beams 0 and 31 are dead, 24 ten times too bright: result and the chip's model."""
    rig, rng = RIGS["endoscope"], np.random.default_rng(35)
    lens, gains = lens_of(rig), {0: 0, 31: 0, 24: 10}
    settings = with_lens(Settings(), lens)
    planes = [plane_spots(f"{z}.png", z, pattern_frame_with(rig, scenes.Plane(z), rng, gains)[0],
                          settings, lens) for z in rig.calibration_planes(6)]
    nominal = rigs.nominal(rig, rng)
    projector = Projector(7, 7, nominal.pitch_deg, nominal.rotation_deg, nominal.toe_in_deg,
                          nominal.base_mm)
    return calibrate_beams(planes, projector, lens, LensReport(0.05), Options(settings), settings)


def test_the_chip_never_matches_a_beam_that_was_left_out(faulty):
    """Frames of the repaired rig: spots of all beams, points of those that were calibrated."""
    calibration, rig = faulty.calibration, RIGS["endoscope"]
    assert calibration.left_out == (0, 31)
    assert [calibration.settings.window[beam] for beam in (0, 31)] == [0, 0]
    segments = beam_segments(calibration)
    assert np.isnan(segments[[0, 31]]).all()
    assert np.isfinite(np.delete(segments, [0, 31], axis=0)).all()
    chip, rng = Capsule(calibration.settings, 352, 288), np.random.default_rng(3)
    image, truth = pattern_frame_with(rig, scenes.Plane(63), rng, {24: 10})
    chip.frame(image)
    points = chip.frame(image).points
    points = points[points["status"] == 0]
    assert sorted(points["beam"]) == [beam for beam in range(49) if beam not in (0, 31)]
    z = 1 / (points["inverse_z"] * calibration.inverse_z_unit)
    assert np.abs(z / truth["z_mm"][points["beam"]] - 1).max() < 0.006


def test_unusual_beams_are_named(faulty):
    texts = faulty.calibration.remarks
    assert set(texts) == {0, 24, 31}
    assert texts[31].startswith("left out: no spot at the 6 distances") and (
        texts[24].startswith("overbright: its spots are 1."))
    areas = relative_areas(faulty.planes, faulty.identity.beams, 49)
    assert np.isnan(areas[[0, 31]]).all() and areas[24] > 1.35
    assert np.nanmax(np.delete(areas, 24)) < 1.2
    words = beam_remarks(faulty)
    assert [word.split(":")[0] for word in words] == [
        "Beam 0 (row 0, column 0)", "Beam 24 (row 3, column 3)", "Beam 31 (row 4, column 3)"]
    assert health(faulty) == ("Health: look at left out: outside the range where it is good, or "
                              "doubtful.")
    row = summary_table(faulty).columns[0]._cells.index("left out")
    cells = [column._cells[row] for column in summary_table(faulty).columns]
    assert cells[1:3] == ["[bold red]2 of 49 beams", "[bold red]none"]
    assert cells[3] == "no spot will match them: 0, 31"
    assert beams_table(faulty).columns[1]._cells[0] == "[bold red]none[/bold red]"
