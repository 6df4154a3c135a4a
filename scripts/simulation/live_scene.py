"""A simulated rig that looks at a scene which moves, for the model of the instrument."""

from dataclasses import replace

import numpy as np

from model.optics import scenes
from model.optics.imager import Imager, light

__all__ = ["LiveScene", "moving_polyp"]

#: Pairs of frames of a sweep; the way back shows the same poses.
POSES = 50
#: Pairs for which a scene is shown of the kinds that do not move.
_SHOWN, _SCENES = 50, 8


def moving_polyp(rig, poses=POSES):
    """Scenes of a polyp of 9 x 8 x 5 mm on a wall that comes nearer and tilts."""
    scale, (low, high) = rig.scale, rig.range_mm
    found = []
    for number in range(poses):
        phase = number / max(poses - 1, 1)
        distance = low * 1.3 + (high - low) * 0.08 * (1 - np.cos(np.pi * phase)) / 2
        wall = scenes.Plane(distance, 8 + 5 * phase, 30 + 10 * phase)
        found.append(scenes.Polyp(
            wall, (scale * (-1.5 + 3 * phase), scale * (1 - 1.5 * phase)),
            (4.5 * scale, 4.0 * scale, 5.0 * scale), 0.0, 3.0 * scale, 0.8 * scale, 25.0))
    return found


class LiveScene:
    """What the imager sees, pair by pair.

    Parameters
    ----------
    kind : :class:`str`
        One of :data:`model.optics.scenes.KINDS`; ``polyp`` moves, the others change from time to
        time.
    rig : :class:`model.optics.rigs.Rig`
        Who looks.
    seed : :class:`int`
        Of everything random.
    progress : callable or None
        Called with the scenes done and the scenes in all.
    """

    def __init__(self, kind, rig, seed=0, progress=None):
        self._moves = kind == "polyp"
        shown = moving_polyp(rig) if self._moves else scenes.sequence(
            kind, rig, _SCENES, np.random.default_rng([seed, 100]))
        self._light = []
        for number, scene in enumerate(shown):
            # The tissue's pattern is the same in all poses.
            rng = np.random.default_rng([seed, 101, 0 if self._moves else number])
            falls, _ = light(rig, scene, rng)
            self._light.append(replace(falls, visible=falls.visible.astype(np.float32),
                                       infrared=falls.infrared.astype(np.float32)))
            if progress:
                progress(number + 1, len(shown))
        self._imager = Imager(self._light[0], replace(rig.noise, electrons=0), [seed, 102])
        self._pairs = 0

    def expose(self, pattern_us, texture_us, lit):
        """Images of the next pair, as :class:`.model_instrument.ModelInstrument` wants them."""
        count = len(self._light)
        if self._moves:
            number = self._pairs % max(2 * count - 2, 1)
            number = min(number, 2 * count - 2 - number)
        else:
            number = self._pairs // _SHOWN % count
        self._pairs += 1
        self._imager.look(self._light[number])
        return (self._imager.expose(pattern_us, pattern_us if lit else 0),
                self._imager.expose(texture_us, 0))
