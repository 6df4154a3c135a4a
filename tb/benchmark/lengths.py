"""Errors of the ruler and of polyps' sizes on simulated scenes, against the truth.

Every rig is calibrated from its simulated capture, and every frame is a picture with noise that
goes through the golden model: nothing is known to the measurement that the chip would not send.
Meshes that the chip does not have are simulated without pictures: :class:`SpotWatch`.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.calibrate import Options, calibrate
from calibration.capture import read_capture
from model.capsule import Capsule
from model.errors import UserError
from model.optics import capture, render, scenes
from model.optics.rigs import RIGS
from model.optics.spots import trace
from model.settings import Settings
from scripts.measure.polyp import polyp, size_class
from scripts.measure.records import measure_frames
from scripts.measure.ruler import ruler
from scripts.measure.surface import Surface
from scripts.results.locator import Locator
from tb.measure.polyps import model_polyp, true_rim
from tb.measure.simulated import calibration_of, measured, mesh_rig, true_points

__all__ = ["HAND_PX", "Lengths", "SpotWatch", "Watch", "polyps", "rulers", "watches"]

#: How far a hand's mark is from the rim, standard deviation in px.
HAND_PX = 0.7
_KINDS = ("tilted", "polyp", "tube")
_DARK = np.zeros((1, 1), np.uint8)


@dataclass(frozen=True)
class Lengths:
    """True and measured lengths in mm, and the uncertainties that were given; arrays (n,)."""

    true: np.ndarray
    found: np.ndarray
    sigma: np.ndarray

    @property
    def accuracy(self):
        """Mean of 1 - |error| / truth."""
        return 1 - float(np.mean(np.abs(self.found / self.true - 1)))

    @property
    def held(self):
        """Share of the truths within one standard deviation."""
        return float(np.mean(np.abs(self.found - self.true) <= self.sigma))

    @property
    def called_smaller(self):
        """Share of the truths from 10 mm on that are put in a class below 10 mm; NaN if none."""
        large = self.true >= 9.5
        below = [size_class(value) in ("<= 5 mm", "6-9 mm") for value in self.found[large]]
        return float(np.mean(below)) if below else float("nan")


def watches():
    """Yield what to call them, and rigs that watch."""
    for name, rig in (("7x7", RIGS["endoscope"]), ("11x11", mesh_rig(11))):
        yield name, Watch(rig)
    if "dense" in RIGS:
        projector = RIGS["dense"].projector
        yield f"{projector.rows}x{projector.columns}", Watch(RIGS["dense"])
    yield "19x19, spots only", SpotWatch(mesh_rig(19))


class Watch:
    """A rig with its calibration, which takes frames of scenes."""

    def __init__(self, rig, seed=1):
        self.rig = rig
        with tempfile.TemporaryDirectory() as folder:
            capture.write(Path(folder), "plane", rig, seed, frames=1)
            self.calibration = calibrate(
                read_capture(Path(folder)), Options(settings=Settings())).calibration

    def surfaces(self, scene, count, rng):
        """Surfaces of frames of a scene that stands still."""
        calibration = self.calibration
        model = Capsule(calibration.settings, calibration.width, calibration.height)
        found, locate = [], Locator(calibration)
        for number in range(count + 1):
            image, _ = render.pattern_frame(self.rig, scene, rng)
            seen = model.frame(image)
            if number:  # the first one is for the levels
                found.append(Surface(locate(seen.points, number, _DARK), calibration))
        return found


class SpotWatch:
    """A rig whose spots are where they should be, but for noise; as :class:`Watch`.

    Noise and calibration are as good as those of the rig ``endoscope``.
    """

    NOISE_PX = 0.02

    def __init__(self, rig, seed=1):
        self.rig, self.calibration = rig, calibration_of(rig, self.NOISE_PX)
        self._off = np.random.default_rng(seed).normal(
            scale=self.NOISE_PX * np.sqrt(2 / 12), size=rig.projector.beams)

    def surfaces(self, scene, count, rng):
        """Surfaces of frames of a scene that stands still."""
        truth = trace(self.rig, scene)[0]
        return [Surface(measured(self.rig, self.calibration, scene, rng, self.NOISE_PX, number,
                                 self._off, truth), self.calibration)
                for number in range(count)]


def rulers(watch, scenes_each, per_scene, seed=1):
    """Lengths of 3 to 20 mm, 40 to 80 mm away, between random points of random scenes."""
    rng, rows = np.random.default_rng(seed), []
    for kind in _KINDS:
        for scene in scenes.sequence(kind, watch.rig, scenes_each, rng):
            surface, = watch.surfaces(scene, 1, rng)
            done = 0
            for _ in range(20 * per_scene):
                if done == per_scene:
                    break
                row = _one_ruler(watch.rig, scene, surface, rng)
                if row is not None:
                    rows.append(row)
                    done += 1
    return Lengths(*np.array(rows).T)


def _one_ruler(rig, scene, surface, rng):
    camera = rig.camera
    first = rng.uniform([20, 20], [camera.width - 20, camera.height - 20])
    angle, reach = rng.uniform(0, 2 * np.pi), rng.uniform(3, 20) * camera.focal_px / 60
    marks = np.round([first, first + reach * np.array([np.cos(angle), np.sin(angle)])], 2)
    try:
        found = ruler(surface, marks)
    except UserError:
        return None
    true = true_points(rig, scene, marks)
    length = np.linalg.norm(true[1] - true[0])
    if not (3 <= length <= 20 and (true[:, 2] >= 40).all() and (true[:, 2] <= 80).all()):
        return None
    return length, found.value, found.uncertainty


def polyps(watch, count, frames, seed=1):
    """Longest diameters of 3 to 15 mm: of one frame each, and in the mean of some frames.

    Returns
    -------
    tuple of two :class:`Lengths`, and how many could not be measured.
    """
    rng, single, mean, refused = np.random.default_rng(seed), [], [], 0
    for diameter in np.linspace(3, 15, count):
        scene = model_polyp(rng, diameter)
        surfaces = watch.surfaces(scene, frames, rng)
        marks = true_rim(watch.rig, scene)
        marks = marks + rng.normal(scale=HAND_PX, size=marks.shape)
        try:
            one = polyp(surfaces[0], marks)
            many = measure_frames(surfaces, "polyp", marks)
        except UserError:
            refused += 1
            continue
        single.append((diameter, one.diameter, one.diameter_uncertainty))
        mean.append((diameter, many.length, many.uncertainty))
    return Lengths(*np.array(single).T), Lengths(*np.array(mean).T), refused
