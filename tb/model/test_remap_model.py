"""The corrected image against OpenCV's, and its way through the calibration file."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.lens import Lens
from calibration.remap import remap_table
from model.optics.rigs import RIGS
from model.preprocessing.remap import OUTSIDE, pack_remap, remap
from tb.system.stimuli import spot_frame


def lens_of(name):
    camera = RIGS[name].camera
    return Lens(camera.width, camera.height, camera.focal_px, *camera.principal_px, camera.k1,
                camera.k2, camera.p1, camera.p2)


# The preset paper, which corrects whole images, has sensors to 512 x 512.
LENSES = {
    **{name: lens_of(name) for name in RIGS if name != "vga"},
    "pincushion": Lens(352, 288, 300.0, 170.3, 150.1, k1=0.2, k2=0.05, p1=1e-3, p2=-1e-3)}


@pytest.mark.parametrize("name", LENSES)
def test_table_is_opencvs(name):
    """But for ties: OpenCV's maps are in single precision."""
    lens = LENSES[name]
    size = lens.width, lens.height
    maps = cv2.initUndistortRectifyMap(
        lens.matrix, lens.coefficients, None,
        np.array([[lens.focal, 0, (lens.width - 1) / 2 + lens.principal_x],
                  [0, lens.focal, (lens.height - 1) / 2 + lens.principal_y], [0, 0, 1]]),
        size, cv2.CV_32FC1)
    u, v = (np.floor(axis + 0.5).astype(int) for axis in maps)
    inside = (u >= 0) & (u < lens.width) & (v >= 0) & (v < lens.height)
    table = np.reshape(remap_table(lens), (lens.height, lens.width))
    assert np.count_nonzero(np.where(inside, v * lens.width + u, OUTSIDE) != table) <= 8
    assert np.all(inside) == (name != "pincushion")
    image = spot_frame(*size, seed=3)
    wanted = cv2.remap(image, u.astype(np.float32), v.astype(np.float32), cv2.INTER_NEAREST,
                       borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    assert np.count_nonzero(remap(image, table.ravel()) != wanted) <= 8


def test_beyond_the_fold_there_is_nothing():
    lens = replace(LENSES["endoscope"], focal=150.0, k1=-0.4, k2=0.0)
    shown = np.reshape(remap_table(lens), (lens.height, lens.width)) != OUTSIDE
    row, column = np.mgrid[:lens.height, :lens.width]
    radius = np.hypot(column - lens.principal_u, row - lens.principal_v) / lens.focal
    assert not shown[radius >= lens.fold_radius].any() and shown.any()


@pytest.mark.parametrize("name", LENSES)
def test_words_tell_the_places(name):
    table = np.array(remap_table(LENSES[name]))
    words = pack_remap(table)
    first = words & 0x3FFFF
    second = first + ((words >> 18 & 0xFFF) ^ 0x800) - 0x800
    first, second = (np.where(words >> bit & 1, OUTSIDE, pixel)
                     for bit, pixel in ((30, first), (31, second)))
    assert np.array_equal(np.stack([first, second], axis=-1).ravel(), table)
    assert words.max() < 1 << 32


def test_words_have_room_for_so_much():
    assert pack_remap([0, 2047]).tolist() == [2047 << 18]
    assert pack_remap([2048, 0, 5]).tolist() == [2048 | 0x800 << 18, 5 | 1 << 31]
    assert pack_remap([OUTSIDE, 7, OUTSIDE, OUTSIDE]).tolist() == [7 | 1 << 30, 3 << 30]
    for table in ([0, 2048], [2049, 0]):
        with pytest.raises(ValueError, match="Neighbours in the corrected image lie too far"):
            pack_remap(table)
