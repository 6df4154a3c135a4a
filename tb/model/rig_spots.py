"""Spots and photographs of the simulated rigs, straight from geometry, and their depth errors."""

from functools import cache

import cv2
import numpy as np

from calibration.chessboards import fit_lens
from calibration.identity import PlaneSpots, identify
from calibration.lens import Lens
from calibration.lines import Observations, fit_lines
from calibration.projector import Projector
from calibration.tables import build_tables, choose_windows
from calibration.usable import usable_beams
from model.capsule import Capsule
from model.optics import render, scenes
from model.optics.rigs import RIGS
from scripts.results.locator import Locator

__all__ = ["board_corners", "board_views", "depth_errors", "endoscope", "fitted", "fitted_lens",
           "lens_of", "observe"]


def lens_of(rig):
    """The simulator's own lens."""
    camera = rig.camera
    return Lens(camera.width, camera.height, camera.focal_px, *camera.principal_px, camera.k1,
                camera.k2, camera.p1, camera.p2)


def off_nominal(projector, rng):
    """Nominal values, each wrong by all that is allowed, with a random sign."""
    def sign():
        return rng.choice([-1, 1])
    base = np.array(projector.base_mm)
    aside = np.radians(0.5) * np.linalg.norm(base)
    return Projector(
        projector.rows, projector.columns, projector.pitch_deg * (1 + 0.03 * sign()),
        projector.rotation_deg + sign(), projector.toe_in_deg + sign(),
        tuple(base * (1 + 0.03 * sign()) + [0, aside * sign(), aside * sign()]))


def observe(rig, seed, noise=0.03, missing=0.03, strays=3, planes=10):
    """Plane spots straight from geometry, with their beams (-1 for strays)."""
    rng = np.random.default_rng(seed)
    lens, result, truth = lens_of(rig), [], []
    for z in rig.calibration_planes(planes):
        spots = rig.camera.project(rig.projector.points_at(z))
        visible = rig.camera.inside(spots, 3) & (rng.random(len(spots)) >= missing)
        spots = spots[visible] + rng.normal(scale=noise, size=(visible.sum(), 2))
        stray = rng.uniform((4, 4), (lens.width - 5, lens.height - 5), (strays, 2))
        u, v = np.concatenate([spots, stray]).T
        beams = np.concatenate([np.flatnonzero(visible), np.full(strays, -1)])
        order = rng.permutation(len(u))
        u, v = u[order], v[order]
        x, y = lens.undistort(u, v)
        result.append(PlaneSpots(f"{z}.png", z, u, v, x, y, np.full(len(u), 9)))
        truth.append(beams[order])
    return result, truth, off_nominal(rig.projector, rng), lens


def fitted(rig, seed, **options):
    """Lines of a rig from :func:`observe`."""
    planes, _, nominal, lens = observe(rig, seed, **options)
    identity = identify(planes, nominal, lens)
    observations = Observations.of(planes, identity, lens)
    usable = usable_beams(observations, nominal, identity.expected)
    return planes, lens, fit_lines(usable.observations, lens)


@cache
def endoscope():
    """Lens, lines, windows and tables of the rig endoscope."""
    planes, lens, lines = fitted(RIGS["endoscope"], 5)
    windows = choose_windows(lines, 7, planes[-1].z_mm, planes[0].z_mm)
    return lens, lines, windows, build_tables(lines, windows, 7, 49)


@cache
def board_views(count=10, fine=4):
    """Drawn photographs of a 9 x 6 board, fine x fine samples a pixel, and their lens."""
    lens = lens_of(RIGS["endoscope"])
    rng = np.random.default_rng(3)
    v, u = (np.mgrid[:lens.height * fine, :lens.width * fine] + 0.5) / fine - 0.5
    rays = np.stack([*lens.ray(*lens.undistort(u, v)), np.ones_like(u)], axis=-1)
    views = []
    for number in range(count):
        turn, _ = cv2.Rodrigues(np.append(rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.2, 0.2)))
        shift = np.array([rng.uniform(-8, 8), rng.uniform(-5, 5), rng.uniform(50, 65)])
        reach = (shift @ turn[:, 2]) / (rays @ turn[:, 2])
        position = ((rays * reach[..., None] - shift) @ turn[:, :2]) / 4 + [5, 3.5]
        square = np.floor(position).astype(int)
        dark = ((square >= 0) & (square < [10, 7])).all(axis=-1) & (square.sum(axis=-1) % 2 == 0)
        image = np.where(dark, 40.0, 200.0)
        image = image.reshape(lens.height, fine, lens.width, fine).mean(axis=(1, 3))
        image = cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(scale=2, size=image.shape)
        views.append((f"{number}.png", np.clip(np.rint(image), 0, 255).astype(np.uint8)))
    return lens, views


def depth_errors(rig, calibration, kinds, frames, seed, model=Capsule):
    """Relative depth errors of all ok points, and the share of beams found, by the golden model."""
    rng = np.random.default_rng([seed, 1])
    chip = model(calibration.settings, calibration.width, calibration.height)
    locate = Locator(calibration, related=False)
    errors, found, expected = [], 0, 0
    for kind in kinds:
        for scene in scenes.sequence(kind, rig, frames, rng):
            image, truth = render.pattern_frame(rig, scene, rng)
            chip.frame(image)
            points = locate(chip.frame(image).points, 0, image)
            points = points[points["status"] == 0]
            errors.append(np.abs(points["z"] / truth["z_mm"][points["beam"]] - 1))
            inside = truth["beam"][truth["inside"]]
            expected += len(inside)
            found += np.isin(inside, points["beam"]).sum()
    return np.concatenate(errors), found / expected


def board_corners(seed, tilt_deg=30.0, count=15, camera=RIGS["endoscope"].camera, noise=0.04,
                  distance=(50, 65)):
    """Corners of a 9 x 6 board of 4 mm, straight from geometry: a list for :func:`fit_lens`.

    The boards are turned out of the sensor's plane by up to ``tilt_deg``.
    """
    rng = np.random.default_rng(seed)
    board = np.zeros((54, 3))
    board[:, :2] = (np.mgrid[:9, :6].T.reshape(-1, 2) - [4, 2.5]) * 4.0
    views = []
    while len(views) < count:
        azimuth, tilt = rng.uniform(0, 2 * np.pi), np.radians(tilt_deg) * rng.random()
        turn, _ = cv2.Rodrigues(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0]))
        roll, _ = cv2.Rodrigues(np.array([0, 0, rng.uniform(-0.2, 0.2)]))
        shift = [rng.uniform(-8, 8), rng.uniform(-5, 5), rng.uniform(*distance)]
        image = camera.project(board @ (turn @ roll).T + shift)
        if camera.inside(image, 3).all():
            image = (image + rng.normal(scale=noise, size=image.shape)).astype(np.float32)
            views.append((image, image))
    return views


def fitted_lens(views, focal=370.0, size=(352, 288)):
    """Lens and report from :func:`board_corners`."""
    names = [f"{number:02}.png" for number in range(len(views))]
    return fit_lens(names, views, size, (9, 6, 4.0), focal)
