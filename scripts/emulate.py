"""``cyclope emulate``: the whole instrument, its RTL included, behind a pseudo-terminal."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from model.errors import UserError

__all__ = ["Emulator", "add_arguments", "main"]

#: Number of the random stream of the scenes: not that of captures, so that what calibrated a rig
#: is not what it measures.
_SCENES, _LIGHT, _NOISE = 100, 101, 102


def add_arguments(parser):
    """Declare what ``cyclope emulate`` takes."""
    parser.description = (
        "Put the Verilated instrument behind a pseudo-terminal, with a model of the imager that "
        "looks at scenes through a simulated rig: what `cyclope load` and `cyclope receive` open "
        "like a serial device. Ctrl-C ends it, and writes the truth of what was shown.")
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    from scripts.simulate import KINDS, RIGS
    parser.add_argument("kind", metavar="KIND", choices=KINDS, help=f"one of {', '.join(KINDS)}")
    parser.add_argument("output", type=Path, metavar="TRUTH", help="truth.csv to write")
    parser.add_argument("--rig", choices=RIGS, default="capsule", help="default: capsule")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of everything random")
    parser.add_argument("--scenes", type=int, default=12, metavar="N",
                        help="scenes, shown in turn, one for each pair; default: 12")


class Emulator:
    """An instrument whose imager looks at another scene with each pair of frames.

    It has what :class:`scripts.terminal.Terminal` wants: ``send``, ``run`` and ``receive``.

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
        from hdl.config import PRESETS
        from model.optics.imager import Imager, light
        from model.optics.scenes import sequence
        from scripts.instrument import Instrument

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
        from model.optics.capture import TRUTH_HEADER, truth_rows

        lines = [TRUTH_HEADER]
        for number, (_, scene) in enumerate(self.shown):
            if scene is not None:
                lines += truth_rows(number, self._truth[scene % len(self._truth)])
        return lines


def main(arguments):
    """Emulate with parsed arguments; gives the exit status."""
    if arguments.seed < 0:
        raise UserError(f"--seed must be 0 or more, not {arguments.seed}.")
    if not 1 <= arguments.scenes <= 1000:
        raise UserError(f"--scenes must be 1 to 1000, not {arguments.scenes}.")
    if arguments.output.exists():
        raise UserError(f"{arguments.output} is there already: name another file, or delete it.")
    from model.optics.rigs import RIGS
    from scripts.terminal import Terminal

    emulator = Emulator(arguments.kind, RIGS[arguments.rig], arguments.seed, arguments.scenes)
    terminal = Terminal(emulator)
    print(f"The instrument listens at {terminal.path}; Ctrl-C ends it.", flush=True)
    try:
        terminal.serve()
    except KeyboardInterrupt:
        pass
    finally:
        terminal.close()
    arguments.output.write_text("\n".join(emulator.truth()) + "\n")
    print(f"{len(emulator.shown)} frames were shown; their truth is in {arguments.output}")
    return 0
