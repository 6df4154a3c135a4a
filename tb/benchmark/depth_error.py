"""Depth errors: simulate, calibrate and measure, over rigs, scenes, modes and seeds."""

import tempfile
from dataclasses import dataclass, replace

import numpy as np

__all__ = ["CASES", "Case", "measure"]

_PLANES = ("plane", "tilted")
_ALL = ("plane", "tilted", "polyp", "tube")


@dataclass(frozen=True)
class Case:
    """A rig, scenes and modes, and the largest allowed mean error (None: no limit)."""

    rig: str
    kinds: tuple
    erosion: str
    centre: str
    limit: float | None
    split: bool = False
    preset: str = "capsule"


CASES = (
    Case("endoscope", _PLANES, "gate", "weighted", 0.0012),
    Case("endoscope", _PLANES, "erode", "binary", 0.007),
    Case("demonstrator", _PLANES, "gate", "weighted", 0.0005),
    Case("endoscope", _ALL, "gate", "weighted", None),
    Case("endoscope", _ALL, "gate", "weighted", None, split=True),
)
_FRAMES = 4  # of each kind and seed


def measure(case, seeds, step=None):
    """Errors of all ok points over the seeds, numbers of beams expected and found.

    Every seed has its own capture: lens, planes and frames are simulated, the nominal values are
    off by their default error, and the calibration uses only the capture. The golden model
    measures, whose points are those of the RTL.
    """
    from calibration.calibrate import Options, calibrate
    from calibration.capture import read_capture
    from model.optics import capture, render, scenes
    from model.optics.rigs import RIGS
    from model.settings import Settings
    from scripts.results.accuracy import TRUTH, compare
    from scripts.results.points import locate
    from scripts.simulation.engine import open_engine

    rig = RIGS[case.rig]
    rig = replace(rig, spots=replace(rig.spots, split=case.split))
    settings = Settings(erosion=case.erosion, weighted=case.centre == "weighted")
    errors, expected, found = [], 0, 0
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            capture.write(folder, "plane", rig, seed, frames=1)
            calibration = calibrate(read_capture(folder), Options(
                settings=settings, remapped=case.preset == "paper")).calibration
        rng = np.random.default_rng([seed, 99])
        images, truth = [], []
        for kind in case.kinds:
            for scene in scenes.sequence(kind, rig, _FRAMES, rng):
                image, rows = render.pattern_frame(rig, scene, rng)
                true = np.zeros(len(rows), TRUTH)
                true["frame"], true["beam"] = len(images), rows["beam"]
                true["inside"] = rows["inside"]
                for name, column in zip("uvxyz", rows.dtype.names[1:6], strict=True):
                    true[name] = rows[column]
                images.append(image)
                truth.append(true)
        engine = open_engine("model", calibration)
        points = [locate(frame.points, index, calibration, images[index])
                  for index, frame in enumerate(engine.frames(images, independent=True))]
        accuracy = compare(
            np.concatenate(points), np.concatenate(truth), range(len(images)))
        errors.append(np.abs(accuracy.error))
        expected += accuracy.expected
        found += round(accuracy.found * accuracy.expected)
        if step:
            step()
    return np.concatenate(errors), expected, found
