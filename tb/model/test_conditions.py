"""What each condition does to the pixels, and that the truth stays exact."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from model.errors import UserError
from model.optics import effects, exposure, render, scenes, spots
from model.optics.conditions import LIMITS, PLAIN, TISSUE, Conditions, conditions_of
from model.optics.rigs import RIGS
from scripts.cyclope import cli
from tb.model.truth import ENDOSCOPE, uv

SMALL = RIGS["small"]
PLANE = scenes.Plane(60.0)
SHAPE = 288, 352


def frame(conditions, number=0, rig=ENDOSCOPE, scene=PLANE):
    """A pattern frame as an array of float, and its truth."""
    image, truth = render.pattern_frame(
        rig, scene, np.random.default_rng(1), conditions, number)
    return image.astype(float), truth


def light(conditions, number=0, scene=PLANE):
    """Laser, ambient levels and truth without noise."""
    return effects.pattern_light(ENDOSCOPE, scene, conditions, number)


def centroids(levels, truth, half):
    """Centroid of the light around each spot."""
    found = []
    for u, v in zip(np.rint(truth["u_px"]).astype(int), np.rint(truth["v_px"]).astype(int),
                    strict=True):
        part = levels[v - half:v + half + 1, u - half:u + half + 1]
        row, column = np.mgrid[v - half:v + half + 1, u - half:u + half + 1]
        found.append([(part * column).sum() / part.sum(), (part * row).sum() / part.sum()])
    return np.array(found)


@pytest.mark.parametrize("split", [False, True])
def test_no_condition_changes_nothing(split):
    """The pixels are those of the levels and the noise alone, drawn in that order."""
    rig = replace(SMALL, spots=replace(SMALL.spots, split=split))
    image, truth = render.pattern_frame(rig, PLANE, np.random.default_rng(1))
    rng = np.random.default_rng(1)
    levels, _ = spots.pattern_levels(rig, PLANE)
    np.testing.assert_array_equal(
        image, exposure.expose(rig, levels + exposure.background(rig, rng), rng))
    assert PLAIN.plain and Conditions(seed=7).plain and (truth["light"] == 1).all()
    again, _ = render.pattern_frame(rig, PLANE, np.random.default_rng(1), Conditions(seed=7), 3)
    np.testing.assert_array_equal(image, again)


@pytest.mark.parametrize("name, value", [
    ("ramp", 80), ("pool", 100), ("flicker", 60), ("highlights", 3), ("speckle", 4),
    ("light", 0.5), ("dim", 0.5), ("defocus", 3), ("motion", 6), ("gain", 2), ("dead", 2),
    ("overbright", 2), ("hot_pixels", 9), ("bits", 6)])
def test_every_condition_is_seeded_and_independent_of_the_others(name, value):
    def image(seed, number=1, **more):
        return frame(Conditions(**{name: value}, seed=seed, **more), number, SMALL)[0]

    first = image(1)
    np.testing.assert_array_equal(first, image(1))
    assert (first != frame(PLAIN, 1, SMALL)[0]).any()
    drawn = name not in ("flicker", "speckle", "light", "defocus", "gain", "bits")
    if drawn:
        assert any((image(seed) != first).any() for seed in (2, 3))
    laser, ambient, _ = effects.pattern_light(SMALL, PLANE, Conditions(**{name: value}), 1)
    if name not in ("hot_pixels", "bits", "gain"):
        other = "ramp" if name != "ramp" else "pool"
        more, around, _ = effects.pattern_light(
            SMALL, PLANE, Conditions(**{name: value, other: 0.5}), 1)
        np.testing.assert_allclose(laser, more, atol=1e-9)
        assert 0.2 < np.abs(around - ambient).max() <= 0.5


def test_ramp_grows_from_side_to_side():
    _, ambient, _ = light(Conditions(ramp=80), 2)
    assert ambient.min() == pytest.approx(0) and ambient.max() == pytest.approx(80)
    np.testing.assert_allclose(np.diff(ambient, 2), 0, atol=1e-9)
    corners = ambient[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert corners.min() == pytest.approx(0) and corners.max() == pytest.approx(80)
    assert (light(Conditions(ramp=80), 3)[1] != ambient).any()


def test_pool_is_brightest_at_its_middle():
    _, ambient, _ = light(Conditions(pool=100))
    assert 99 < ambient.max() <= 100
    v, u = np.unravel_index(ambient.argmax(), SHAPE)
    away = u + 70 if u < 176 else u - 70
    assert ambient[v, away] == pytest.approx(100 * np.exp(-0.5 * (70 / 70.4) ** 2), abs=1)


def test_flicker_is_in_every_other_frame():
    for number in range(4):
        assert (light(Conditions(flicker=60), number)[1] == 60 * (number % 2)).all()


def test_highlights_saturate_and_hide_what_is_below():
    conditions = Conditions(highlights=40)
    image, truth = frame(conditions)
    _, ambient, _ = light(conditions)
    assert 40 < (image == 255).sum() < 4000
    levels = ambient[np.rint(truth["v_px"]).astype(int), np.rint(truth["u_px"]).astype(int)]
    assert not truth["visible"][levels > 300].any() and truth["visible"][levels < 20].all()
    assert 0 < (~truth["visible"]).sum() < 15
    np.testing.assert_array_equal(truth["inside"], truth["visible"])
    plain = frame(PLAIN)[1]
    for name in ("u_px", "v_px", "z_mm"):
        np.testing.assert_array_equal(truth[name], plain[name])


@pytest.mark.parametrize("looks", [1, 12])
def test_speckle_has_the_contrast_of_its_looks(looks):
    plain, _, _ = light(PLAIN)
    laser, ambient, _ = light(Conditions(speckle=looks))
    factor = laser[plain > 1] / plain[plain > 1]
    assert factor.mean() == pytest.approx(1, abs=0.05)
    assert factor.std() == pytest.approx(looks**-0.5, rel=0.08) and not ambient.any()


def test_light_of_all_beams_and_of_some():
    plain, _, truth = light(PLAIN)
    quarter, _, less = light(Conditions(light=0.25))
    np.testing.assert_allclose(quarter, plain / 4)
    np.testing.assert_allclose(less["peak"], truth["peak"] / 4)
    _, _, some = light(Conditions(dim=0.15))
    assert sorted(set(some["light"])) == [pytest.approx(1 / 3), 1]
    assert (some["light"] < 1).sum() == 7
    assert (some["light"] != light(Conditions(dim=0.15), 1)[2]["light"]).any()
    assert some["visible"].all() and some["inside"].all()


def test_dead_and_overbright_beams_are_those_of_the_rig():
    conditions = Conditions(dead=2, overbright=3)
    laser, _, truth = light(conditions)
    plain, _, before = light(PLAIN)
    dead, bright = truth["light"] == 0, truth["light"] == 10
    assert dead.sum() == 2 and bright.sum() == 3
    for name in ("u_px", "v_px", "x_mm", "y_mm", "z_mm"):
        assert np.isnan(truth[name][dead]).all()
        np.testing.assert_array_equal(truth[name][~dead], before[name][~dead])
    assert not truth["visible"][dead].any() and not truth["inside"][dead].any()
    at = np.rint(before["v_px"]).astype(int), np.rint(before["u_px"]).astype(int)
    np.testing.assert_allclose(laser[at], plain[at] * truth["light"], atol=1e-3)
    for number in (1, 2):
        np.testing.assert_array_equal(light(conditions, number)[2]["light"], truth["light"])
    np.testing.assert_array_equal(light(conditions.of_rig())[2]["light"], truth["light"])
    split, _ = spots.trace_rays(ENDOSCOPE, PLANE, conditions.beam_light(49, 0))
    np.testing.assert_array_equal(split["light"], truth["light"])


@pytest.mark.parametrize("conditions, variance", [
    (Conditions(defocus=8), 8**2 / 16), (Conditions(motion=9), 9**2 / 12 / 2)])
def test_blur_widens_spots_about_the_truth(conditions, variance):
    """Mean of the variances along u and v: d^2 / 16 for a disc of diameter d; that of a line of
    length l is l^2 / 12 along it and 0 across it."""
    scene = scenes.Plane(45.0)
    plain, _, truth = light(PLAIN, scene=scene)
    laser, _, _ = light(conditions, scene=scene)
    assert laser.sum() == pytest.approx(plain.sum(), rel=1e-3)
    truth = truth[ENDOSCOPE.camera.inside(uv(truth), 13)]
    before, after = centroids(plain, truth, 12), centroids(laser, truth, 12)
    np.testing.assert_allclose(after, before, atol=2e-3)

    def spread(levels):
        each = []
        for (u, v), row, column in zip(before, np.rint(truth["v_px"]).astype(int),
                                       np.rint(truth["u_px"]).astype(int), strict=True):
            part = levels[row - 12:row + 13, column - 12:column + 13]
            y, x = np.mgrid[row - 12:row + 13, column - 12:column + 13]
            each.append((part * ((x - u) ** 2 + (y - v) ** 2)).sum() / part.sum() / 2)
        return np.mean(each)

    assert spread(laser) - spread(plain) == pytest.approx(variance, rel=0.1)


def test_hot_pixels_stay_where_they_are():
    conditions = Conditions(hot_pixels=20)
    difference = [frame(conditions, number, scene=scenes.Plane(z))[0]
                  - frame(PLAIN, number, scene=scenes.Plane(z))[0]
                  for number, z in ((0, 60.0), (1, 90.0))]
    hot = effects.hot_levels(SHAPE, conditions) > 0
    assert hot.sum() == 20
    for each in difference:
        assert each[hot].mean() > 50 and np.abs(each[~hot]).mean() < 3


def test_bits_and_gain():
    image, _ = frame(PLAIN)
    six, _ = frame(Conditions(bits=6))
    np.testing.assert_array_equal(six, image // 4 * 4)
    stretched, truth = frame(Conditions(gain=4))
    np.testing.assert_array_equal(stretched, np.minimum(image * 4, 255))
    assert truth["inside"].all()


def test_spots_in_saturated_light_are_not_visible():
    _, truth = frame(Conditions(pool=255, gain=2))
    _, ambient, _ = light(Conditions(pool=255))
    levels = ambient[np.rint(truth["v_px"]).astype(int), np.rint(truth["u_px"]).astype(int)]
    assert not truth["visible"][levels > 120].any() and truth["visible"][levels < 40].all()
    assert 3 < truth["visible"].sum() < 46


def test_values_out_of_range_are_refused():
    for name, (low, high, _) in LIMITS.items():
        for value in (low - 1, high + 1, float("nan")):
            with pytest.raises(ValueError, match=f"^{name} must be .*from {low} to {high}, not"):
                Conditions(**{name: value})
    with pytest.raises(ValueError, match="an integer"):
        Conditions(bits=6.5)
    with pytest.raises(UserError, match="9 dead and 8 overbright beams are more than the 16"):
        Conditions(dead=9, overbright=8).beam_light(16, 0)


def test_kinds_have_their_conditions():
    assert conditions_of("plane", 3) == Conditions(seed=3)
    assert conditions_of("tissue") == TISSUE and not TISSUE.plain
    chosen = conditions_of("tissue", 2, speckle=4, ramp=0, gain=None)
    assert (chosen.speckle, chosen.ramp, chosen.highlights, chosen.gain) == (4, 0, 4, 1)


def rows_of(path):
    """Rows of a capture's table of truth."""
    with open(path / "truth.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_tissue_can_be_simulated(tmp_path):
    arguments = ["simulate", "tissue", "--rig", "small", "--frames", "3", "--dead", "2"]
    for name in ("a", "b"):
        assert cli.main([*arguments, tmp_path / name]) == 0
    assert cli.main([*arguments, tmp_path / "c", "--seed", "1"]) == 0
    rows = rows_of(tmp_path / "a")
    assert ",".join(rows[0]) == "frame,beam,u_px,v_px,x_mm,y_mm,z_mm,inside,visible,dead,light"
    assert rows == rows_of(tmp_path / "b") and len(rows) == 48
    dead = [row for row in rows if row["dead"] == "1"]
    assert len({row["beam"] for row in dead}) == 2 and len(dead) == 6
    for row in dead:
        assert (row["u_px"], row["z_mm"], row["inside"], row["visible"], row["light"]) == (
            "", "", "0", "0", "0")
    assert {row["light"] for row in rows} == {"0", "0.3333", "1"}
    assert all(row["visible"] == "1" for row in rows if row["inside"] == "1")
    first, second = (sorted((tmp_path / name).rglob("*.png")) for name in "ab")
    assert [file.read_bytes() for file in first] == [file.read_bytes() for file in second]
    # The scenes of tissue do not change the images for the calibration, but the dead beams do.
    assert cli.main(["simulate", "plane", tmp_path / "d", "--rig", "small", "--frames", "1"]) == 0
    for name, same in (("lens/00.png", True), ("planes/03.png", False)):
        read = [(tmp_path / folder / name).read_bytes() for folder in "ad"]
        assert (read[0] == read[1]) == same


@pytest.mark.parametrize("option, words", [
    (["--ramp", "300"], "--ramp must be 0 to 255, not 300"),
    (["--dim", "nan"], "--dim must be 0 to 1, not nan"),
    (["--bits", "0"], "--bits must be 1 to 8, not 0"),
    (["--hot-pixels", "-1"], "--hot-pixels must be 0 to 10000, not -1"),
    (["--dead", "10", "--overbright", "7"], "10 dead and 7 overbright beams are more than the 16")])
def test_bad_conditions_are_refused(option, words, tmp_path, capsys):
    assert cli.main(["simulate", "plane", tmp_path / "out", "--rig", "small", *option]) == 2
    message = capsys.readouterr().err
    assert words in message and message.count("\n") == 1 and not list(tmp_path.iterdir())
