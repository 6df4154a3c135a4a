"""A simulated rig to look at live: calibrated once, then behind a pseudo-terminal."""

import hashlib
import tempfile
from contextlib import contextmanager
from pathlib import Path

from scripts.paths import BUILD, locked
from scripts.simulation.emulator import Emulator
from scripts.simulation.live_scene import LiveScene
from scripts.simulation.model_instrument import ModelInstrument
from scripts.simulation.terminal import Terminal

__all__ = ["BAUD", "calibrated", "open_live"]

#: Of the line between the instrument and the host: a texture takes about a second.
BAUD = 1_000_000
_SEED = 7


def calibrated(rig, seed=_SEED):
    """The calibration of a rig, made from its simulated capture the first time.

    ``seed`` is that of the capture's noise.
    """
    from calibration import calibrate as program
    from calibration import file
    from calibration.capture import read_capture
    from model.errors import UserError
    from model.optics import capture

    digest = hashlib.sha256(repr((rig, seed)).encode())
    for module in (program, capture):
        for path in sorted(Path(module.__file__).parent.glob("*.py")):
            digest.update(path.read_bytes())
    path = BUILD / "live" / f"{rig.name}-{digest.hexdigest()[:16]}.json"
    with locked(path):
        try:
            return file.load(path)
        except UserError:
            pass
        with tempfile.TemporaryDirectory() as folder:
            capture.write(Path(folder), "plane", rig, seed, frames=1)
            result = program.calibrate(read_capture(Path(folder)), program.Options())
        file.save(result.calibration, path)
    return result.calibration


@contextmanager
def open_live(kind, rig, seed=0, speed=1.0, progress=None, engine="model"):
    """The instrument in front of a scene, behind a new pseudo-terminal.

    Parameters
    ----------
    kind : :class:`str`
        See :class:`scripts.simulation.live_scene.LiveScene`.
    rig : :class:`model.optics.rigs.Rig`
        The rig.
    seed : :class:`int`
        Of everything random.
    speed : :class:`float` or None
        Time that passes over the host's, at most.
    progress : callable or None
        Called with the scenes done and the scenes in all.
    engine : ``"model"`` or ``"rtl"``
        The golden models, or the Verilated RTL, as fast as it goes; it sees another scene with
        each pair.

    Yields
    ------
    :class:`scripts.simulation.terminal.Terminal`
    """
    if engine == "rtl":
        with Terminal(Emulator(kind, rig, seed, baud=BAUD, keep=False), speed=speed,
                      drop=True) as terminal:
            yield terminal
        return
    scene = LiveScene(kind, rig, seed, progress)
    projector, camera = rig.projector, rig.camera
    instrument = ModelInstrument(scene.expose, camera.width, camera.height,
                                 projector.rows * projector.columns, BAUD)
    with Terminal(instrument, step_us=5000, speed=speed, drop=True) as terminal:
        yield terminal
