"""Sensors with colour filters: what they see, and the picture that is made of it."""

import numpy as np
import pytest

from model.bayer import BAYER, channels
from model.optics import exposure, render, scenes
from model.optics.rigs import RIGS
from scripts.results.colour import colour_picture, spread, to_file

EVERY = pytest.mark.parametrize("bayer", BAYER)
WALL = (200, 90, 40)


def mosaic(bayer, height=48, width=64):
    """A wall of one colour, as a sensor with filters sees it."""
    return np.array(WALL, np.uint8)[channels(bayer, height, width)]


def test_channels_are_in_the_order_of_the_pattern_s_name():
    assert channels("GRBG", 3, 3).tolist() == [[1, 0, 1], [2, 1, 2], [1, 0, 1]]


@EVERY
def test_a_wall_has_its_colour(bayer):
    image = mosaic(bayer)
    came = np.ones(image.shape, bool)
    assert (colour_picture(image, came, bayer) == WALL).all()
    assert (to_file(colour_picture(image, came, bayer)) == WALL[::-1]).all()
    assert colour_picture(image, came, None) is image and to_file(image) is image


@EVERY
def test_what_has_not_come_is_filled_and_never_a_wrong_colour(bayer):
    image = mosaic(bayer)
    came = np.zeros(image.shape, bool)
    came[::8] = True  # rows of one kind: two colours
    picture = colour_picture(np.where(came, image, 0), came, bayer)
    assert (picture == picture[:, :, :1]).all() and np.ptp(picture[:, 1:-1]) <= 1
    came[::2] = came[1:17:4] = True
    picture = colour_picture(np.where(came, image, 0), came, bayer)
    assert (picture[:16] == WALL).all()
    assert (picture[32:] == picture[32:, :, :1]).all()


def test_rows_that_have_not_come_are_like_the_nearest_one():
    plane, known = np.zeros((24, 2), np.uint8), np.zeros((24, 2), bool)
    plane[3], plane[5], known[[3, 5]] = 30, 50, True
    filled, near = spread(known, plane)
    assert (filled[:4] == 30).all() and (filled[5:14] == 50).all() and (filled[14:] == 0).all()
    assert near[:14].all() and not near[14:].any()
    assert (colour_picture(plane, known, None) == filled).all()
    assert not spread(np.zeros_like(known), plane)[1].any()


@EVERY
def test_simulated_frames(bayer):
    """The laser's light differs by 5 % between colours; tissue is red, and fills all pixels."""
    plain, rig = RIGS["small"], RIGS["small"].with_filters(bayer)
    colours = channels(bayer, 64, 64)
    response = exposure.infrared_response(rig.camera)
    means = [response[colours == colour].mean() for colour in range(3)]
    assert np.allclose(means, [1.05, 1.0, 0.95]) and exposure.infrared_response(plain.camera) == 1
    frames = [render.pattern_frame(each, scenes.Plane(60), np.random.default_rng(1))[0].astype(int)
              for each in (plain, rig)]
    bright = frames[0] > 60
    for colour, wanted in enumerate((1.05, 1.0, 0.95)):
        site = bright & (colours == colour)
        assert abs(frames[1][site].sum() / frames[0][site].sum() - wanted) < 0.02
    texture = render.texture_frame(rig, scenes.Plane(60), np.random.default_rng(1))
    red, green, blue = (texture[colours == colour].mean() for colour in range(3))
    assert red > 1.3 * green > 1.3 * blue > 30
