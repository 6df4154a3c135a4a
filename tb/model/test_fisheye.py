"""A capsule's optics from boards to depth: photographs, planes, tables, and the chip's model."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calibration.calibrate import Options, calibrate_beams, with_lens
from calibration.identity import PlaneSpots
from model.optics.geometry import Camera
from model.optics.rigs import RIGS
from model.settings import Settings
from model.stereo.depth import inverse_depth
from model.stereo.epipolar import OK, match
from model.stereo.undistort import undistort
from tb.model.rig_spots import board_corners, fitted_lens, off_nominal

SIZE = 256


@dataclass(frozen=True)
class FisheyeCamera(Camera):
    """The angle to the axis makes the radius in the image."""

    def distort(self, normalised):
        radius = np.hypot(normalised[..., 0], normalised[..., 1])
        angle = np.arctan(radius)
        scale = angle * (1 + self.k1 * angle**2) / np.maximum(radius, 1e-9)
        return normalised * scale[..., None] * self.focal_px + np.asarray(self.principal_px)


CAMERA = FisheyeCamera(SIZE, SIZE, 110.0, (128.9, 126.3), k1=0.04)
RIG = replace(RIGS["endoscope"], camera=CAMERA, range_mm=(20.0, 60.0),
              projector=replace(RIGS["endoscope"].projector, pitch_deg=8.5))


@pytest.fixture(scope="module")
def calibrated():
    """The whole calibration, from corners and spots with noise."""
    views = board_corners(81, tilt_deg=45, camera=CAMERA, distance=(14, 26))
    lens, report = fitted_lens(views, 113.0, (SIZE, SIZE))
    settings, rng = with_lens(Settings(), lens), np.random.default_rng(82)
    planes = []
    for z in RIG.calibration_planes(10):
        image = CAMERA.project(RIG.projector.points_at(z))
        image = image[CAMERA.inside(image, 3)]
        image = image + rng.normal(scale=0.02, size=image.shape)
        x, y = lens.undistort(*image.T)
        good = np.isfinite(x)
        planes.append(PlaneSpots(f"{z}.png", z, *image[good].T, x[good], y[good],
                                 np.full(good.sum(), 9)))
    return calibrate_beams(planes, off_nominal(RIG.projector, rng), lens, report,
                           Options(settings), settings).calibration


def seen_by_the_chip(calibration, u, v):
    """Status, beam and distance of centres, as the chip has them."""
    settings = calibration.settings
    x, y, inside = undistort(np.rint(u * 512).astype(int), np.rint(v * 512).astype(int), settings,
                             SIZE, SIZE)
    status, beam = match(x, y, ~inside, settings.line, settings.window)
    status, beam, inverse_z = inverse_depth(x, beam, status, settings.depth)
    with np.errstate(divide="ignore"):
        return status, beam, 1 / (inverse_z * calibration.inverse_z_unit)


def test_depth_through_a_fisheye(calibrated):
    lens = calibrated.lens
    assert lens.model == "equidistant" and 100 < lens.usable_px < lens.corner_px
    found = expected = 0
    for z in (22.0, 31.0, 44.0, 58.0):
        image = CAMERA.project(RIG.projector.points_at(z))
        usable = np.hypot(*(image - [lens.principal_u, lens.principal_v]).T) < lens.usable_px - 2
        usable[list(calibrated.left_out)] = False
        status, beam, depth = seen_by_the_chip(calibrated, *image[usable].T)
        good = status == OK
        np.testing.assert_array_equal(beam[good], np.flatnonzero(usable)[good])
        assert np.abs(depth[good] / z - 1).mean() < 0.0015
        found, expected = found + good.sum(), expected + usable.sum()
    assert found > 0.98 * expected > 120


def test_nothing_matches_outside_the_usable_region(calibrated):
    lens = calibrated.lens
    u, v = np.random.default_rng(3).uniform(0, SIZE - 1, (2, 60000))
    beyond = np.hypot(u - lens.principal_u, v - lens.principal_v) > lens.usable_px + 1
    status, _, _ = seen_by_the_chip(calibrated, u[beyond], v[beyond])
    assert beyond.sum() > 5000 and not (status == OK).any()
    status, _, _ = seen_by_the_chip(calibrated, u[~beyond], v[~beyond])
    assert (status == OK).sum() > 500
