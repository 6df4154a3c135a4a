"""Depth errors: simulate, calibrate and measure, over rigs, scenes, conditions, modes and seeds."""

import tempfile
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from model.optics.conditions import TISSUE, Conditions

__all__ = ["CASES", "CONDITIONS", "Case", "Depth", "measure"]

_PLANES = ("plane", "tilted")
_ALL = ("plane", "tilted", "polyp", "tube")
_FOLDS = ("tilted", "polyp", "tube")


@dataclass(frozen=True)
class Case:
    """A rig, scenes, weights, conditions, and the largest allowed mean error (None: no limit)."""

    rig: str
    kinds: tuple
    centre: str = "weighted"
    limit: float | None = None
    split: bool = False
    preset: str = "capsule"
    conditions: Conditions = Conditions()
    bayer: str | None = None


@dataclass(frozen=True)
class Depth:
    """What was measured.

    Parameters
    ----------
    error : array of :class:`float`
        Relative error of each ok point.
    expected, found : :class:`int`
        Beams inside, and those of them that have an ok point.
    spots, real : :class:`int`
        Spots reported with any status, and those of them within 3 px of a visible beam's.
    """

    error: np.ndarray
    expected: int
    found: int
    spots: int
    real: int


CASES = (
    Case("endoscope", _PLANES, limit=0.0012),
    Case("demonstrator", _PLANES, limit=0.0005),
    Case("endoscope", _ALL),
    Case("endoscope", _ALL, split=True),
)
#: The same rig under conditions that are not kind.
CONDITIONS = {
    "plain": Case("endoscope", _PLANES),
    **{name: Case("endoscope", _PLANES, conditions=conditions) for name, conditions in {
        "ramp 80": Conditions(ramp=80), "pool 100": Conditions(pool=100),
        "flicker 60": Conditions(flicker=60), "6 bits": Conditions(bits=6),
        "gain 4": Conditions(gain=4), "light / 4": Conditions(light=0.25),
        "light / 8": Conditions(light=0.125), "light x 4": Conditions(light=4),
        "20 hot pixels": Conditions(hot_pixels=20), "defocus 4 px": Conditions(defocus=4),
        "motion 9 px": Conditions(motion=9), "4 highlights": Conditions(highlights=4),
        "12-look speckle": Conditions(speckle=12), "full speckle": Conditions(speckle=1),
        "15 % dim": Conditions(dim=0.15), "3 dead beams": Conditions(dead=3),
        "3 overbright beams": Conditions(overbright=3)}.items()},
    "colour filters": Case("endoscope", _PLANES, bayer="RGGB"),
    "tissue": Case("endoscope", _FOLDS, conditions=TISSUE),
    "tissue, planes only": Case("endoscope", _PLANES, conditions=TISSUE),
}
_FRAMES = 4  # of each kind and seed
_NEAR_PX = 3.0


def _calibration(case, rig, seed):
    """From a capture of its own; conditions are those of the frames to measure alone."""
    return _calibrated(rig, case.centre == "weighted", case.preset == "paper", seed)


@lru_cache(maxsize=8)
def _calibrated(rig, weighted, paper, seed):
    from calibration.calibrate import Options, calibrate
    from calibration.capture import read_capture
    from model.optics import capture
    from model.settings import Settings

    settings = Settings(
        weighted=weighted, **({"erosion": "erode", "area_min": 3} if paper else {}))
    with tempfile.TemporaryDirectory() as folder:
        capture.write(folder, "plane", rig, seed, frames=1)
        return calibrate(read_capture(folder), Options(
            settings=settings, remapped=paper)).calibration


def _frames(case, rig, seed):
    """Images, and the truth of each."""
    from model.optics import render, scenes
    from scripts.results.accuracy import TRUTH

    rng = np.random.default_rng([seed, 99])
    conditions = replace(case.conditions, seed=seed)
    images, truth = [], []
    for kind in case.kinds:
        for scene in scenes.sequence(kind, rig, _FRAMES, rng):
            image, rows = render.pattern_frame(rig, scene, rng, conditions, len(images))
            true = np.zeros(len(rows), TRUTH)
            true["frame"], true["beam"] = len(images), rows["beam"]
            true["inside"] = rows["inside"]
            for name, column in zip("uvxyz", rows.dtype.names[1:6], strict=True):
                true[name] = rows[column]
            images.append(image)
            truth.append((true, rows["visible"]))
    return images, truth


def _near(points, true):
    """Number of points near a true spot."""
    u, v = (points[name][:, None] - true[name] for name in "uv")
    return int((np.hypot(u, v) < _NEAR_PX).any(axis=1).sum()) if len(true) else 0


def measure(case, seeds, step=None):
    """Depth over the seeds, as :class:`Depth`.

    Every seed has its own capture: lens, planes and frames are simulated, the nominal values are
    off by their default error, and the calibration uses only the capture. The golden model
    measures, whose points are those of the RTL. The threshold is learnt on the frame itself,
    but on the frame before where the background flickers.
    """
    from model.optics.rigs import RIGS
    from scripts.results.accuracy import compare
    from scripts.results.locator import Locator
    from scripts.simulation.engine import open_engine

    rig = RIGS[case.rig].with_filters(case.bayer)
    rig = replace(rig, spots=replace(rig.spots, split=case.split))
    errors, expected, found, spots, real = [], 0, 0, 0, 0
    for seed in seeds:
        calibration = _calibration(case, rig, seed)
        images, truth = _frames(case, rig, seed)
        engine = open_engine("model", calibration)
        frames = engine.frames(images, independent=not case.conditions.flicker)
        locate = Locator(calibration, related=False)
        points = [locate(frame.points, index, images[index])
                  for index, frame in enumerate(frames)]
        accuracy = compare(np.concatenate(points), np.concatenate([true for true, _ in truth]),
                           range(len(images)))
        errors.append(np.abs(accuracy.error))
        expected += accuracy.expected
        found += round(accuracy.found * accuracy.expected)
        spots += sum(len(each) for each in points)
        real += sum(_near(each, true[visible]) for each, (true, visible) in zip(
            points, truth, strict=True))
        if step:
            step()
    return Depth(np.concatenate(errors), expected, found, spots, real)
