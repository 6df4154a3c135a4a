"""Calibrations of rigs as they are: what is found, and the depth error that is left."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from model.optics.conditions import PLAIN, TISSUE, Conditions

__all__ = ["CASES", "Row", "capsules", "frontal_boards", "measure"]

_FRAMES = 4  # of each kind
_CORNERS = Path(__file__).parents[1] / "model" / "capsule_corners.csv"


@dataclass(frozen=True)
class Row:
    """A line of the table: what was wrong, what came out, and what it must reach."""

    case: str
    found: str
    error: str
    limit: str


@dataclass(frozen=True)
class Case:
    """An offset of all distances in mm, conditions, and the largest mean error that is allowed.

    The plane frames have those of the conditions that belong to the rig.
    """

    name: str
    offset_mm: float = 0.0
    conditions: Conditions = PLAIN
    limit: float = 0.0012


#: Tissue, dead and overbright beams, hot pixels, six bits and wrong distances.
ALL_AT_ONCE = Case("all at once, on tissue", 1.0, replace(
    TISSUE, dead=2, overbright=1, hot_pixels=20, bits=6), 0.004)
CASES = (
    Case("nothing wrong"), Case("planes +1 mm", 1.0), Case("planes -2 mm", -2.0),
    *(Case(f"{count} dead beam{'s' * (count > 1)}", conditions=Conditions(dead=count))
      for count in (1, 3)),
    *(Case(f"{count} beam{'s' * (count > 1)} 10 x bright", conditions=Conditions(overbright=count))
      for count in (1, 3)),
    ALL_AT_ONCE)


def _capture(case, rig, seed):
    """A calibrated capture with the case's faults, and the conditions that made it."""
    from calibration.calibrate import Options, calibrate
    from calibration.capture import read_capture
    from model.optics import capture
    from model.settings import Settings

    conditions = replace(case.conditions, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        capture.write(folder, "plane", rig, seed, frames=1, conditions=conditions)
        table = Path(folder) / "planes" / "planes.csv"
        head, *rows = table.read_text().splitlines()
        rows = [f"{name},{float(z_mm) + case.offset_mm}"
                for name, z_mm in (row.split(",") for row in rows)]
        table.write_text("\n".join([head, *rows]) + "\n")
        return calibrate(read_capture(folder), Options(settings=Settings())), conditions


def measure(case, seeds):
    """A :class:`Row` over the seeds; the frames have all of the conditions."""
    from model.capsule import Capsule
    from model.optics import render, scenes
    from model.optics.rigs import RIGS
    from scripts.results.locator import Locator

    rig, errors, offsets, left, share = RIGS["endoscope"], [], [], [], []
    for seed in seeds:
        result, conditions = _capture(case, rig, seed)
        calibration, rng = result.calibration, np.random.default_rng([seed, 98])
        offsets.append(abs(result.offset.correction_mm + case.offset_mm))
        left.append(len(calibration.left_out))
        chip = Capsule(calibration.settings, calibration.width, calibration.height)
        locate = Locator(calibration, related=False)
        for kind in ("plane", "tilted"):
            for number, scene in enumerate(scenes.sequence(kind, rig, _FRAMES, rng)):
                image, truth = render.pattern_frame(rig, scene, rng, conditions, number)
                chip.frame(image)
                points = locate(chip.frame(image).points, 0, image)
                points = points[points["status"] == 0]
                errors.append(np.abs(points["z"] / truth["z_mm"][points["beam"]] - 1))
                inside = truth["beam"][truth["inside"] & truth["visible"]]
                share.append(np.isin(inside, points["beam"]).mean())
    errors = np.concatenate(errors)
    return Row(case.name, f"left out {left}, offset off by {max(offsets):.3f} mm at most, "
               f"{np.mean(share):.1%} of the beams found, {np.mean(errors > 0.05):.2%} wrong",
               f"{errors.mean():.3%}",
               f"{case.conditions.dead} left out, 0.1 mm, {case.limit:.2%}")


def frontal_boards(seeds):
    """A :class:`Row`: photographs of boards within a degree of frontal must be refused."""
    from model.errors import UserError
    from tb.model.rig_spots import board_corners, fitted_lens
    refused, focal = 0, []
    for seed in seeds:
        try:
            lens, report = fitted_lens(board_corners(seed, tilt_deg=1.0))
            refused += bool(report.flags)
            focal.append(lens.focal)
        except UserError:
            refused += 1
    return Row("boards within 1 degree of frontal", f"{refused} of {len(seeds)} refused or flagged",
               "", "all")


def capsules():
    """A :class:`Row` for each real capsule endoscope, from the corners in its photographs."""
    from calibration.chessboards import fit_lens
    rows = []
    for camera, board, size, focal in (
            ("MiroCam", (7, 6), 320, 160), ("PillCam", (8, 6), 256, 75)):
        views = {}
        for line in _CORNERS.read_text().splitlines():
            if line.startswith(camera):
                _, number, u, v = line.split(",")
                views.setdefault(number, []).append((float(u), float(v)))
        views = {name: (np.array(view, np.float32),) * 2 for name, view in views.items()}
        lens, report = fit_lens(list(views), list(views.values()), (size, size), (*board, 2.0),
                                focal)
        rows.append(Row(f"{camera}, {len(views)} photographs",
                        f"{lens.model}, usable to {lens.usable_px:.0f} px, focal length "
                        f"{lens.focal:.1f} px +-{report.scale_sigma:.1%}",
                        f"{report.rms_px:.3f} px RMS", "0.68 px, aim 0.6"))
    return rows
