"""The Verilated instrument with an imager that looks at simulated scenes."""

from dataclasses import replace

import numpy as np

from hdl.config import PRESETS
from model.optics.capture import TRUTH_HEADER, truth_rows
from model.optics.imager import Imager, light
from model.optics.scenes import sequence
from scripts.simulation.instrument import Instrument

__all__ = ["Emulator"]

#: Number of the random stream of the scenes: not that of captures, so that what calibrated a rig
#: is not what it measures.
_SCENES, _LIGHT, _NOISE = 100, 101, 102


class Emulator:
    """An instrument whose imager looks at another scene with each pair of frames.

    It has what :class:`scripts.simulation.terminal.Terminal` wants: ``send``, ``run`` and
    ``receive``.

    Parameters
    ----------
    kind : :class:`str`
        Kind of scene, see :mod:`model.optics.scenes`.
    rig : :class:`model.optics.rigs.Rig`
        The rig.
    seed : :class:`int`
        Of everything random.
    scenes : :class:`int`
        Scenes, shown in turn.
    baud : :class:`int` or None
        Of the serial line; None for the preset's.

    Attributes
    ----------
    shown : list
        For each frame that the imager sent: the picture, and the number of the scene.
    """

    def __init__(self, kind, rig, seed=0, scenes=12, baud=None):
        camera, projector = rig.camera, rig.projector
        self._light, self._truth = zip(*(
            light(rig, scene, np.random.default_rng([seed, _LIGHT, number]))
            for number, scene in enumerate(sequence(
                kind, rig, scenes, np.random.default_rng([seed, _SCENES])))), strict=True)
        self._imager = Imager(self._light[0], rig.noise, [seed, _NOISE])
        self.shown = []
        self.scene = None
        config = replace(PRESETS["capsule"], width=camera.width, height=camera.height,
                         beams=projector.rows * projector.columns)
        if baud:
            config = replace(config, baud=baud)
        self.instrument = Instrument(config, self._picture)
        self.send, self.run = self.instrument.send, self.instrument.run
        self.receive = self.instrument.receive

    def _picture(self, integrated_us, lit_us):
        if lit_us:
            self.scene = 0 if self.scene is None else self.scene + 1
            self._imager.look(self._light[self.scene % len(self._light)])
        image = self._imager.expose(integrated_us, lit_us)
        self.shown.append((image, self.scene if lit_us else None))
        return image

    def truth(self):
        """Lines of ``truth.csv`` of all frames with the laser on; a frame has the number that the
        chip gives it if no frame was lost before."""
        lines = [TRUTH_HEADER]
        for number, (_, scene) in enumerate(self.shown):
            if scene is not None:
                lines += truth_rows(number, self._truth[scene % len(self._truth)])
        return lines
