"""A CMOS imager that responds to its control pins as a real one does.

It collects visible light whenever it integrates, and infrared light while the laser is lit as
well. A sequence that omits the reset, exposes too long, or lights the laser at the wrong time
gives a wrong image.
"""

from dataclasses import dataclass

import numpy as np

from . import render
from .conditions import PLAIN, Conditions
from .effects import hide, pattern_light
from .exposure import infrared_response
from .rigs import Noise

__all__ = ["PATTERN_US", "TEXTURE_US", "Charge", "Imager", "Light", "light"]

#: Nominal exposures, at which images have the brightness of `render`'s.
PATTERN_US, TEXTURE_US = 500, 10_000
#: Levels of a pixel that collected nothing.
DARK = 5.0
#: Levels above dark that a pixel can collect; the converter saturates below that.
FULL_WELL = 280.0


@dataclass(frozen=True)
class Light:
    """What falls on the pixels, in levels per microsecond (float64, height x width).

    ``infrared`` is what the laser adds while it is lit.
    """

    visible: np.ndarray
    infrared: np.ndarray


def light(
    rig, scene, rng, conditions: Conditions = PLAIN, number: int = 0
) -> tuple[Light, np.ndarray]:
    """A scene's light on a rig's sensor, and the truth of its beams (`spots.TRUTH`).

    What the conditions add to the background is there while the laser is lit; those of the sensor
    (hot pixels, bits, gain) have no effect here.
    """
    laser, ambient, truth = pattern_light(rig, scene, conditions, number)
    visible = render.texture_levels(rig, scene, rng) / TEXTURE_US
    if not conditions.plain:
        hide(truth, laser, DARK + visible * PATTERN_US, ambient)
    infrared = (laser + ambient) * infrared_response(rig.camera)
    return Light(visible, infrared / PATTERN_US), truth


class Charge:
    """How long the pixels have integrated since their reset, in total and with the laser lit.

    Events come in the order of their times, in any unit. Before the first reset the pixels hold
    all light since power-on: far too much.

    Attributes
    ----------
    integrated, lit : number
        At the time of the last event.
    """

    POWER_ON = 1_000_000_000_000

    def __init__(self):
        self.time, self.integrated, self.lit = 0, self.POWER_ON, 0
        self._level = {"reset": 0, "integrate": 0, "laser": 0}

    def at(self, time, **levels):
        """Advance to ``time``, when some of ``reset``, ``integrate`` and ``laser`` change."""
        if time < self.time:
            raise ValueError(f"An event at {time} cannot follow one at {self.time}")
        if self._level["reset"]:
            self.integrated = self.lit = 0
        elif self._level["integrate"]:
            self.integrated += time - self.time
            self.lit += (time - self.time) * self._level["laser"]
        self.time = time
        self._level |= levels
        if self._level["reset"]:
            self.integrated = self.lit = 0
        return self.integrated, self.lit


class Imager:
    """Pixels with a global reset and a global shutter, and an 8-bit converter.

    Parameters
    ----------
    light : :class:`Light`
        The light on its pixels; see :meth:`look`.
    noise : :class:`.rigs.Noise` or None
        Read and shot noise; without, a pixel is rounded to the nearest level.
    seed : :class:`int`
        Seed of the noise.
    dark, full_well : :class:`float`
        Levels of a pixel without charge, and levels above it at which a pixel is full.
    shutter : ``"global"`` or ``"rolling"``
        A rolling shutter must expose for longer than its read-out takes, else it is refused.
    shortest_us, row_us : :class:`float`
        Shortest exposure that will be used, and the time to read a row with its blanking.
    """

    def __init__(self, light, noise=None, seed=0, dark=DARK, full_well=FULL_WELL,
                 shutter="global", shortest_us=PATTERN_US, row_us=50.0):
        if shutter not in ("global", "rolling"):
            raise ValueError(f"The shutter must be 'global' or 'rolling', not {shutter!r}")
        self.height, self.width = light.visible.shape
        if shutter == "rolling" and shortest_us <= self.height * row_us:
            raise ValueError(
                f"A rolling shutter exposes its {self.height} rows one after the other, over "
                f"{self.height * row_us:g} us, so in an exposure of {shortest_us:g} us no pulse "
                "of the laser is seen by all rows: take a global shutter")
        if not full_well > 255 - dark:
            raise ValueError(f"A pixel that is full at {full_well:g} levels above {dark:g} never "
                             "reaches level 255")
        self.noise, self.dark, self.full_well = noise, dark, full_well
        self.draw_from(seed)
        self.look(light)

    @classmethod
    def of_scene(cls, rig, scene, seed=0, noise: Noise | None | bool = True, **choices):
        """An imager that looks at a scene through a rig's lens, with the rig's noise by default."""
        falls, _ = light(rig, scene, np.random.default_rng([seed, 0]))
        return cls(falls, rig.noise if noise is True else noise or None, [seed, 1], **choices)

    def look(self, light):
        """Change the light on the pixels."""
        for name in ("visible", "infrared"):
            levels = getattr(light, name)
            if levels.shape != (self.height, self.width):
                raise ValueError(
                    f"The {name} light must fall on {self.width} x {self.height} pixels, not on "
                    f"{' x '.join(str(size) for size in levels.shape[::-1])}")
            if not np.isfinite(levels).all() or (levels < 0).any():
                raise ValueError(f"The {name} light must not be negative")
        self.light = light

    def draw_from(self, seed):
        """Draw the noise of the next images from this seed on."""
        self._random = np.random.default_rng(seed)

    def expose(self, integrated_us, lit_us):
        """The image after an integration of the given length.

        Parameters
        ----------
        integrated_us, lit_us : :class:`float`
            Microseconds of integration since the reset, and the part of them with the laser lit.

        Returns
        -------
        :class:`numpy.ndarray` of uint8, (height, width)
        """
        if not 0 <= lit_us <= integrated_us:
            raise ValueError(f"The laser cannot have been lit for {lit_us} of {integrated_us} us")
        levels = self.light.visible * integrated_us + self.light.infrared * lit_us
        noise = self.noise
        if noise and noise.electrons > 0:
            # Where the pixel saturates anyway, the number of electrons does not matter.
            electrons = np.minimum(levels, 2 * self.full_well) * noise.electrons
            levels = self._random.poisson(electrons) / noise.electrons
        levels = self.dark + np.minimum(levels, self.full_well)
        if noise and noise.read:
            levels = levels + self._random.normal(scale=noise.read, size=levels.shape)
        return np.clip(np.rint(levels), 0, 255).astype(np.uint8)
