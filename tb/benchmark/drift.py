"""What moves in a rig, and how soon it is noticed: ``python -m tb.benchmark.drift [FRAMES]``.

Spots of simulated scenes are displaced as the moved rig displaces them, with noise and some that
are not of their beam, and located with the calibration of the unmoved one, which was made from
simulated images. So many frames of the unmoved rig (100,000 unless said), located with ten
calibrations, show how often there is an alarm without a cause.
"""

import sys
from dataclasses import dataclass, replace

import numpy as np

from model.optics import scenes
from model.optics.geometry import Projector
from model.optics.rigs import RIGS
from model.optics.spots import trace
from scripts.results.drift import DriftMonitor
from scripts.simulation.live_rig import calibrated
from tb.measure.simulated import measured

__all__ = ["MOVED", "NOISE_PX", "Seen", "follow", "move", "report"]

#: Noise of spots, px: twice that of simulated images of smooth scenes, and that of tissue.
NOISE_PX = {"polyp": 0.03, "tissue": 0.1}
_FRAMES, _SCENES = 100, 24
#: Part of the spots that are none of their beam's, and how far they lie beside its line, px.
_WRONG, _BESIDE_PX = 0.02, 0.8
_CALIBRATIONS = 10


@dataclass(frozen=True)
class _Turned(Projector):
    """A projector that was turned in its seat."""

    turn: tuple = (0.0, 0.0, 0.0)

    def directions(self):
        x, y, z = np.radians(self.turn)
        return super().directions() @ (np.eye(3) + np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]]))


def _focus(rig, part):
    return replace(rig, camera=replace(rig.camera, focal_px=rig.camera.focal_px * (1 + part)))


def _base(rig, part, axis):
    base = np.array(rig.projector.base_mm)
    base[axis] += part * np.linalg.norm(base)
    return replace(rig, projector=replace(rig.projector, base_mm=tuple(base)))


def _turned(rig, degrees, axis):
    turn = tuple(degrees * np.eye(3)[axis])
    return replace(rig, projector=_Turned(**vars(rig.projector), turn=turn))


#: What is moved by how much, the name of its cause, and whether it can be seen.
MOVED = {
    "focus 0.5 % longer": (lambda rig: _focus(rig, 0.005), "focus", True),
    "focus 0.5 % shorter": (lambda rig: _focus(rig, -0.005), "focus", True),
    "base 1 % to the side": (lambda rig: _base(rig, 0.01, 1), "base", True),
    "base 1 % forwards": (lambda rig: _base(rig, 0.01, 2), "base", True),
    "base 1 % along itself": (lambda rig: _base(rig, 0.01, 0), "base", False),
    "turned 0.05 degrees about x": (lambda rig: _turned(rig, 0.05, 0), "turned", True),
    "turned 0.05 degrees about y": (lambda rig: _turned(rig, 0.05, 1), "turned", True),
    "turned 0.05 degrees about z": (lambda rig: _turned(rig, 0.05, 2), "turned", True),
}


def move(rig, what):
    """The rig after one of :data:`MOVED`."""
    return MOVED[what][0](rig)


@dataclass(frozen=True)
class Seen:
    """Number of the first frame with an alarm or None, frames with one, and the last state."""

    first: int | None
    alarms: int
    last: object


def follow(rig, calibration, kind, noise_px, seed, frames=_FRAMES):
    """What a monitor says of so many frames of a rig, which may have moved.

    Parameters
    ----------
    rig : :class:`model.optics.rigs.Rig`
        As it is now.
    calibration : :class:`calibration.file.Calibration`
        Of the rig as it was.
    kind : :class:`str`
        Kind of scene.
    noise_px : :class:`float`
        Standard deviation of a spot's coordinates.
    seed, frames : :class:`int`
        Of everything random; how many frames.

    Returns
    -------
    :class:`Seen`
    """
    rng = np.random.default_rng(seed)
    shown = [(scene, trace(rig, scene)[0])
             for scene in scenes.sequence(kind, rig, min(frames, _SCENES), rng)]
    monitor, first, alarms, state = DriftMonitor(calibration), None, 0, None
    for number in range(frames):
        scene, truth = shown[number % len(shown)]
        points = measured(rig, calibration, scene, rng, noise_px, number, truth=truth)
        wrong = rng.random(len(points)) < _WRONG
        points["v"][wrong] += rng.uniform(-_BESIDE_PX, _BESIDE_PX, wrong.sum())
        points["z"][wrong] *= rng.uniform(0.7, 1.4, wrong.sum())
        state = monitor.add(points) or state
        if state and state.causes:
            first = number if first is None else first
            alarms += 1
    return Seen(first, alarms, state)


def report(console, many):
    """Print what is found of moved rigs, and the alarms in so many frames of an unmoved one."""
    from rich.console import Console
    from rich.progress import track
    from rich.table import Table

    progress = Console(stderr=True)
    table = Table(title="What has moved, from the distances of spots across their lines",
                  title_justify="left")
    for title in ("rig", "scenes", "moved", "found in frame", "named", "amount"):
        table.add_column(title)
    cases = [(name, kind, what) for name in ("endoscope", "dense") for kind in NOISE_PX
             for what in MOVED]
    for name, kind, what in track(cases, "moved rigs", console=progress, transient=True):
        rig = RIGS[name]
        seen = follow(move(rig, what), calibrated(rig), kind, NOISE_PX[kind], 1)
        last = seen.last
        amount = {"focus": f"{100 * last.focus:+.2f} %", "turned": f"{last.turned_deg:.3f} degrees",
                  "base": f"{last.base_mm:.3f} mm"}
        table.add_row(name, kind, what, "never" if seen.first is None else str(seen.first),
                      " or ".join(last.causes), " or ".join(amount[each] for each in last.causes))
    console.print(table)
    rig = RIGS["endoscope"]
    for kind, noise_px in NOISE_PX.items():
        count = many // len(NOISE_PX)
        parts = [follow(rig, calibrated(rig, seed % _CALIBRATIONS), kind, noise_px, seed,
                        min(2000, count))
                 for seed in track(range(-(-count // 2000)), f"unmoved, {kind}", console=progress,
                                   transient=True)]
        console.print(f"unmoved, {kind}: {sum(part.alarms for part in parts)} frames with an alarm "
                      f"of {len(parts) * min(2000, count):,}")


if __name__ == "__main__":
    from rich.console import Console

    report(Console(), int(sys.argv[1]) if sys.argv[1:] else 100_000)
