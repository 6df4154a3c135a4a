"""The imager model: images like those of the renderer, and wrong ones for wrong sequences."""

import numpy as np
import pytest

from model.optics import render, scenes
from model.optics.conditions import Conditions
from model.optics.imager import DARK, PATTERN_US, TEXTURE_US, Charge, Imager, Light, light
from model.optics.rigs import RIGS, Noise

SIZES = pytest.mark.parametrize("name", ["small", "endoscope"])


def flat(visible=0.01, infrared=0.1, shape=(4, 5)):
    return Light(np.full(shape, visible), np.full(shape, infrared))


def looks_at(name, seed, noise=True):
    """A rig, a polyp, an imager in front of it, and the truth."""
    rig = RIGS[name]
    scene = scenes.sequence("polyp", rig, 3, np.random.default_rng(seed))[1]
    truth = light(rig, scene, np.random.default_rng([seed, 0]))[1]
    return rig, scene, Imager.of_scene(rig, scene, seed, noise), truth


def centre_errors(image, truth, reach=4):
    """Distances of the centres of the spots that count from the truth, by weighted means."""
    errors = []
    for beam in truth[truth["inside"] & (truth["peak"] > 60)]:
        u, v = int(round(beam["u_px"])), int(round(beam["v_px"]))
        part = image[v - reach:v + reach + 1, u - reach:u + reach + 1].astype(float)
        weight = np.maximum(part - np.median(image) - 12, 0)
        y, x = np.mgrid[-reach:reach + 1, -reach:reach + 1]
        mean = np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum() + (u, v)
        errors.append(np.hypot(*(mean - (beam["u_px"], beam["v_px"]))))
    return np.array(errors)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_pattern_is_as_good_as_the_simulators(seed):
    rig, scene, imager, truth = looks_at("endoscope", seed)
    mine = imager.expose(PATTERN_US, PATTERN_US)
    other, _ = render.pattern_frame(rig, scene, np.random.default_rng(seed))
    assert abs(np.median(mine.astype(float)) - np.median(other)) < 4
    background = [image[image < 40].std() for image in (mine, other)]
    assert background[0] < 1.5 * background[1]
    errors = centre_errors(mine, truth), centre_errors(other, truth)
    assert len(errors[0]) > 20
    assert np.median(errors[0]) < 1.2 * np.median(errors[1]) + 0.005
    bright = truth[truth["inside"] & (truth["peak"] > 100)]
    for beam in bright:
        pixel = int(round(beam["v_px"])), int(round(beam["u_px"]))
        assert abs(float(mine[pixel]) - float(other[pixel])) < 25


@SIZES
def test_texture_is_the_simulators_over_the_dark_level(name):
    rig, scene, imager, _ = looks_at(name, 4, noise=None)
    levels = render.texture_levels(rig, scene, np.random.default_rng([4, 0]))
    image = imager.expose(TEXTURE_US, 0)
    assert np.array_equal(image, np.clip(np.rint(levels + DARK), 0, 255))
    noisy = Imager.of_scene(rig, scene, 4).expose(TEXTURE_US, 0).astype(float)
    other = render.texture_frame(rig, scene, np.random.default_rng([4, 0]))
    assert abs((noisy - image).std() / (other - levels).std() - 1) < 0.05


@SIZES
def test_pattern_holds_its_share_of_visible_light(name):
    """A twentieth of the texture, under the spots."""
    _, _, imager, _ = looks_at(name, 5, noise=None)
    texture = imager.expose(TEXTURE_US, 0).astype(float) - DARK
    dark_pattern = imager.expose(PATTERN_US, 0).astype(float) - DARK
    assert np.abs(dark_pattern - texture * PATTERN_US / TEXTURE_US).max() <= 0.6
    spots = imager.expose(PATTERN_US, PATTERN_US).astype(float) - dark_pattern - DARK
    where = (imager.light.infrared == 0)
    assert np.abs(spots[where]).max() <= 1 and spots.max() > 150


def run_sequence(imager, events):
    """Expose by what happens to the pins; times in microseconds."""
    charge = Charge()
    for time, levels in events:
        charge.at(time, **levels)
    return imager.expose(charge.integrated, charge.lit)


def pair(skip=(), lit=((200, 700),), pattern_us=500):
    """Events of a pattern and what is collected of it by its end, then of the texture's."""
    start = 200
    events = [(100, {"reset": 1}), (200, {"reset": 0}), (start, {"integrate": 1}),
              (start + pattern_us, {"integrate": 0})]
    texture = [(15_000, {"reset": 1}), (15_100, {"reset": 0}), (15_100, {"integrate": 1}),
               (25_100, {"integrate": 0})]
    both = [[event for number, event in enumerate(part) if (kind, number) not in skip]
            for kind, part in (("pattern", events), ("texture", texture))]
    light_events = [event for on, off in lit for event in (
        (on, {"laser": 1}), (off, {"laser": 0}))]

    def until(time):
        return sorted((event for event in (*both[0], *both[1], *light_events)
                       if event[0] <= time), key=lambda event: event[0])
    return until(start + pattern_us), until(25_100)


@pytest.mark.parametrize("wrong, picture", [
    ({"skip": {("pattern", 0), ("pattern", 1)}}, "pattern"),  # no reset at all
    ({"skip": {("texture", 0), ("texture", 1)}}, "texture"),  # none before the texture
    ({"skip": {("texture", 1)}}, "texture"),  # reset is not released
    ({"skip": {("pattern", 2)}}, "pattern"),  # no integration
    ({"lit": ()}, "pattern"),  # no laser
    ({"lit": ((16_000, 16_500),)}, "texture"),  # laser in the wrong exposure
    ({"lit": ((100, 200),)}, "pattern"),  # laser during the reset
    ({"lit": ((200, 25_100),)}, "texture"),  # laser is not put out
    ({"pattern_us": 5000, "lit": ((200, 5200),)}, "pattern"),  # far too long
])
def test_wrong_sequences_give_wrong_pictures(wrong, picture):
    _, _, imager, _ = looks_at("small", 6, noise=None)
    good, bad = (run_sequence(imager, pair(**choices)[picture == "texture"]).astype(float)
                 for choices in ({}, wrong))
    assert np.abs(good - bad).max() > 100


def test_right_sequence_gives_the_nominal_pictures():
    _, _, imager, _ = looks_at("small", 6, noise=None)
    pattern, texture = pair()
    assert np.array_equal(run_sequence(imager, pattern), imager.expose(500, 500))
    assert np.array_equal(run_sequence(imager, texture), imager.expose(10_000, 0))


def test_charge_counts_only_while_integrating():
    charge = Charge()
    assert charge.at(5, reset=1) == (0, 0)
    assert charge.at(9, reset=0, laser=1) == (0, 0)
    assert charge.at(12, integrate=1) == (0, 0)
    assert charge.at(20, laser=0) == (8, 8)
    assert charge.at(30, integrate=0) == (18, 8)
    assert charge.at(50) == (18, 8), "pixels keep what they have"
    assert charge.at(51, integrate=1, laser=1) == (18, 8)
    assert charge.at(53, reset=1) == (0, 0), "reset wins over integration"
    with pytest.raises(ValueError, match="An event at 52 cannot follow one at 53"):
        charge.at(52)


@pytest.mark.parametrize("us, level", [
    (0, 5), (49, 5), (51, 6), (10_000, 105), (24_940, 254), (25_000, 255), (26_000, 255),
    (1e12, 255)])
def test_levels(us, level):
    """Dark level, rounding, the end of the range, a full pixel."""
    assert np.all(Imager(flat()).expose(us, 0) == level)


def test_noise_is_seeded_and_of_the_size_asked_for():
    noise = Noise(read=2.0, electrons=40.0)
    images = [Imager(flat(0.01, 0.1, (200, 200)), noise, seed).expose(10_000, 0)
              for seed in (1, 1, 2)]
    assert np.array_equal(images[0], images[1]) and not np.array_equal(images[0], images[2])
    assert abs(images[0].std() - np.sqrt(2.0**2 + 100 / 40 + 1 / 12)) < 0.1
    imager = Imager(flat(), noise, 1)
    assert not np.array_equal(imager.expose(9000, 0), imager.expose(9000, 0))


def test_rolling_shutter_needs_a_long_exposure():
    view = flat(shape=(288, 352))
    assert Imager(view, shutter="rolling", shortest_us=20_000).expose(20_000, 0).shape == (288, 352)
    with pytest.raises(ValueError) as caught:
        Imager(view, shutter="rolling")
    assert str(caught.value) == (
        "A rolling shutter exposes its 288 rows one after the other, over 14400 us, so in an "
        "exposure of 500 us no pulse of the laser is seen by all rows: take a global shutter")


@pytest.mark.parametrize("call, sentence", [
    (lambda: Imager(flat(), shutter="iris"),
     "The shutter must be 'global' or 'rolling', not 'iris'"),
    (lambda: Imager(flat(), full_well=200),
     "A pixel that is full at 200 levels above 5 never reaches level 255"),
    (lambda: Imager(flat()).look(flat(shape=(5, 4))),
     "The visible light must fall on 5 x 4 pixels, not on 4 x 5"),
    (lambda: Imager(flat(infrared=-1.0)), "The infrared light must not be negative"),
    (lambda: Imager(flat()).expose(5, 6), "The laser cannot have been lit for 6 of 5 us"),
])
def test_refuses(call, sentence):
    with pytest.raises(ValueError) as caught:
        call()
    assert str(caught.value) == sentence


def test_conditions_are_there_while_the_laser_is_lit():
    rig, scene = RIGS["small"], scenes.Plane(70.0)
    plain, before = light(rig, scene, np.random.default_rng(1))
    falls, truth = light(rig, scene, np.random.default_rng(1), Conditions(ramp=80, dead=2), 1)
    np.testing.assert_array_equal(falls.visible, plain.visible)
    added = (falls.infrared - plain.infrared) * PATTERN_US
    assert 60 < added.max() < 81 and (truth["light"] == 0).sum() == 2
    assert before["visible"].all() and (~truth["visible"] == (truth["light"] == 0)).all()
    image = Imager(falls, None).expose(TEXTURE_US, 0)
    np.testing.assert_array_equal(image, Imager(plain, None).expose(TEXTURE_US, 0))
