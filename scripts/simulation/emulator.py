"""The Verilated instrument with an imager that looks at simulated scenes."""

from dataclasses import replace

import numpy as np

from hdl.config import PRESETS
from model.optics.capture import truth_header, truth_rows
from model.optics.conditions import conditions_of
from model.optics.imager import Imager, light
from model.optics.scenes import sequence
from scripts.simulation.instrument import Instrument

__all__ = ["Emulator"]

#: Number of the random stream of the scenes: not that of captures, so that what calibrated a rig
#: is not what it measures.
_SCENES, _LIGHT, _NOISE = 100, 101, 102


class Emulator:
    """An instrument whose imager looks at another scene with each pair of frames.

    The scenes have the conditions of their kind, see :mod:`model.optics.conditions`.

    It has what :class:`scripts.simulation.terminal.Terminal` wants: ``send``, ``run``,
    ``receive`` and ``unsent``.

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
    record : callable or None
        Given the rows of ``truth.csv`` of each frame with the laser on, as it is shown.
    keep : :class:`bool`
        Remember in ``shown`` what was shown.

    Attributes
    ----------
    count : :class:`int`
        Frames that the imager sent.
    shown : list
        For each of them: the image, and the number of the scene, None if the laser was off.
    """

    def __init__(self, kind, rig, seed=0, scenes=12, baud=None, record=None, keep=True):
        camera, projector = rig.camera, rig.projector
        self._conditions = conditions_of(kind, seed)
        shown = sequence(kind, rig, scenes, np.random.default_rng([seed, _SCENES]))
        self._light, self._truth = zip(*(
            light(rig, scene, np.random.default_rng([seed, _LIGHT, number]), self._conditions,
                  number)
            for number, scene in enumerate(shown)), strict=True)
        self._seed = seed
        self._imager = Imager(self._light[0], rig.noise)
        self.count, self.shown = 0, []
        self._record, self._keep = record, keep
        self.scene = None
        config = replace(PRESETS["capsule"], width=camera.width, height=camera.height,
                         beams=projector.rows * projector.columns)
        if baud:
            config = replace(config, baud=baud)
        self.instrument = Instrument(config, self._picture)
        self.send, self.run = self.instrument.send, self.instrument.run
        self.receive = self.instrument.receive

    @property
    def unsent(self):
        """Octets from the host that have not gone over the line yet."""
        return self.instrument.unsent

    def _picture(self, integrated_us, lit_us):
        if lit_us:
            self.scene = 0 if self.scene is None else self.scene + 1
            self._imager.look(self._light[self.scene % len(self._light)])
        # The same for a scene however many frames came before the first lit one: that depends on
        # how fast the host is.
        number = 0 if self.scene is None else self.scene + 1
        self._imager.draw_from([self._seed, _NOISE, number, int(lit_us > 0)])
        image = self._imager.expose(integrated_us, lit_us)
        scene = self.scene if lit_us else None
        if self._record is not None and scene is not None:
            self._record(self._rows(self.count, scene))
        if self._keep:
            self.shown.append((image, scene))
        self.count += 1
        return image

    def _rows(self, number, scene):
        """Rows of ``truth.csv`` of a frame, which has the number that the chip gives it if no frame
        was lost before."""
        return truth_rows(number, self._truth[scene % len(self._truth)], self._conditions)

    def truth(self):
        """Lines of ``truth.csv`` of all frames with the laser on, if they were kept."""
        return [truth_header(self._conditions), *(
            row for number, (_, scene) in enumerate(self.shown)
            if scene is not None for row in self._rows(number, scene))]
