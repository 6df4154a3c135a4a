"""Frames of a simulated rig some of whose beams are dead, dim or overbright."""

import numpy as np

from model.optics import spots
from model.optics.exposure import background, expose

__all__ = ["pattern_frame_with"]


def pattern_frame_with(rig, scene, rng, gains):
    """A pattern frame and its truth, each beam's light times its gain: 0 is a dead beam.

    Parameters
    ----------
    rig : :class:`model.optics.rigs.Rig`
        The true rig.
    scene
        What the beams fall on.
    rng : :class:`numpy.random.Generator`
        For background and noise.
    gains : :class:`dict`
        From numbers of beams to their gains; the others have 1.
    """
    truth, covariance, light = spots.trace(rig, scene)
    for beam, gain in gains.items():
        light[beam] *= gain
    centres = np.stack([truth["u_px"], truth["v_px"]], axis=-1)
    levels = spots.draw((rig.camera.height, rig.camera.width), centres, covariance, light)
    return expose(rig, levels + background(rig, rng), rng), truth
