"""Points of simulated scenes as the chip would measure them, without images: exact but for noise.

Beams are cast at the scene; their spots move by Gaussian noise; depth follows from the exact lines.
"""

from dataclasses import replace

import numpy as np

from calibration.file import Beam, Calibration
from calibration.lens import Lens
from calibration.projector import Projector
from model.optics import scenes
from model.optics.geometry import beam_lines, line_separation
from model.optics.rigs import RIGS
from model.optics.spots import trace
from scripts.results.points import OK, POINT
from tb.system.stimuli import any_settings

__all__ = ["calibration_of", "measured", "mesh_rig", "true_points"]

#: Pitch and rotation of meshes of so many rows and columns that fill the endoscope's picture, with
#: lines apart in their windows.
_MESHES = {7: (6.3, 8.5), 11: (3.9, 22.0), 19: (2.15, 27.0)}


def mesh_rig(side):
    """The rig ``endoscope`` with a mesh of side x side beams."""
    rig = RIGS["endoscope"]
    pitch, rotation = _MESHES[side]
    return replace(rig, projector=replace(rig.projector, rows=side, columns=side, pitch_deg=pitch,
                                          rotation_deg=rotation, irregularity_deg=0.0))


def calibration_of(rig, noise_px):
    """The exact calibration of a rig whose spots have so much noise; its tables are of no rig."""
    camera, projector = rig.camera, rig.projector
    lines = beam_lines(camera, projector)
    beams = tuple(
        Beam(*row, 0.0, float(camera.width), 1.0, None, noise_px, noise_px, 1.0, 12)
        for row in zip(*(getattr(lines, name).tolist() for name in ("a", "b", "alpha", "beta")),
                       strict=True))
    lens = Lens(camera.width, camera.height, camera.focal_px, *camera.principal_px, camera.k1,
                camera.k2, camera.p1, camera.p2)
    mesh = Projector(projector.rows, projector.columns, projector.pitch_deg,
                     projector.rotation_deg, projector.toe_in_deg, projector.base_mm)
    settings = any_settings(camera.width, camera.height, min(projector.beams, 128))
    return Calibration(lens, mesh, beams, settings, 1e-6, *rig.range_mm,
                       {"sigma_u_px": noise_px, "sigma_v_px": noise_px})


def measured(rig, calibration, scene, rng, noise_px, frame=0, off=None, truth=None):
    """Rows of a frame's ok points.

    ``off`` is an error of each beam's spots in px that stays from frame to frame, that of its
    calibration; ``truth`` is that of the scene, if it was traced before.
    """
    truth = trace(rig, scene)[0] if truth is None else truth
    seen = truth[truth["inside"]]
    points = np.zeros(len(seen), POINT)
    points["frame"], points["beam"], points["status"] = frame, seen["beam"], OK
    shift = rng.normal(scale=noise_px, size=(2, len(seen)))
    if off is not None:
        shift[0] += off[seen["beam"]]
    points["u"], points["v"] = seen["u_px"] + shift[0], seen["v_px"] + shift[1]
    x, y = calibration.lens.undistort(points["u"], points["v"])
    beams = [calibration.beams[beam] for beam in seen["beam"]]
    inverse = np.array([beam.alpha for beam in beams]) * x + [beam.beta for beam in beams]
    slope = calibration.lens.ray(x, y)
    points["z"] = 1 / inverse
    points["x"], points["y"] = slope[0] / inverse, slope[1] / inverse
    points["area"] = 20
    return points


def true_points(rig, scene, image):
    """Where the rays through image coordinates (n, 2) meet the scene, mm."""
    ray = rig.camera.normalise(np.asarray(image, float))
    directions = np.column_stack([ray, np.ones(len(ray))])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distance = scenes.cast(scene, np.zeros(3), directions, 2.5 * rig.range_mm[1], 0.4 * rig.scale)
    return directions * distance[:, None]


def smallest_line_distance(rig):
    """In pixels, within the windows of the beams."""
    return line_separation(rig.camera, rig.projector, *rig.range_mm)[0]
