"""What makes the frames of a real rig harder than those of a kind simulator, in numbers."""

from dataclasses import dataclass, fields

import numpy as np

from model.errors import UserError

__all__ = ["LIMITS", "PLAIN", "TISSUE", "Conditions", "conditions_of"]

#: Smallest and largest value of each condition, and whether only whole numbers are allowed.
LIMITS = {
    "ramp": (0, 255, False), "pool": (0, 255, False), "flicker": (0, 255, False),
    "highlights": (0, 200, True), "speckle": (0, 1000, True), "light": (0.001, 100, False),
    "dim": (0, 1, False), "defocus": (0, 30, False), "motion": (0, 60, False),
    "gain": (0.1, 32, False), "dead": (0, 128, True), "overbright": (0, 128, True),
    "hot_pixels": (0, 10000, True), "bits": (1, 8, True)}


@dataclass(frozen=True)
class Conditions:
    """Light, scene and faults of a capture; the default values change nothing.

    The first ten are conditions of the frames to measure, drawn anew for each; the last four
    belong to the rig: they are the same in all frames, those of the planes included.

    Parameters
    ----------
    ramp : :class:`float`
        Levels that the background gains from one side of the picture to the opposite one, in a
        direction drawn for each frame.
    pool : :class:`float`
        Levels at the middle of a pool of light: a Gaussian with a standard deviation of a fifth of
        the picture's width, anywhere in the picture.
    flicker : :class:`float`
        Levels that the background has more in frames with an odd number.
    highlights : :class:`int`
        Wet highlights in a frame: elliptical reflections of 200 to 600 levels, which saturate.
    speckle : :class:`int`
        Looks of the speckle of the laser's light: its contrast (standard deviation over mean) is
        1 / sqrt(looks), its grains are as large as a pixel. 0 is none.
    light : :class:`float`
        Factor on the light of the laser.
    dim : :class:`float`
        Share of the beams, drawn for each frame, that have a third of their light.
    defocus : :class:`float`
        Diameter of the circle of confusion in pixels.
    motion : :class:`float`
        Pixels by which the picture moves while a frame is exposed, in a direction drawn for each;
        the truth is that of the middle of the exposure.
    gain : :class:`float`
        Factor on the grey values after conversion; they saturate at 255 and leave gaps.
    dead : :class:`int`
        Beams without light.
    overbright : :class:`int`
        Beams with ten times their light.
    hot_pixels : :class:`int`
        Pixels that have 60 to 300 levels more than the light gives them, in all images of the
        sensor.
    bits : :class:`int`
        Bits of a grey value that count, in all images of the sensor; the others are 0.
    seed : :class:`int`
        Seed of all that is drawn.

    Raises
    ------
    ValueError
        If a value is out of its :data:`LIMITS`.
    """

    ramp: float = 0.0
    pool: float = 0.0
    flicker: float = 0.0
    highlights: int = 0
    speckle: int = 0
    light: float = 1.0
    dim: float = 0.0
    defocus: float = 0.0
    motion: float = 0.0
    gain: float = 1.0
    dead: int = 0
    overbright: int = 0
    hot_pixels: int = 0
    bits: int = 8
    seed: int = 0

    def __post_init__(self):
        for name, (low, high, whole) in LIMITS.items():
            value = getattr(self, name)
            if not low <= value <= high or whole and value != int(value):
                raise ValueError(f"{name} must be {'an integer ' * whole}from {low} to {high}, "
                                 f"not {value}")

    @property
    def plain(self) -> bool:
        """Whether these conditions change nothing."""
        return all(getattr(self, field.name) == field.default
                   for field in fields(self) if field.name != "seed")

    def of_rig(self) -> "Conditions":
        """The conditions of the plane frames: only what belongs to the rig."""
        return Conditions(dead=self.dead, overbright=self.overbright,
                          hot_pixels=self.hot_pixels, bits=self.bits, seed=self.seed)

    def random(self, name: str, *stream: int) -> np.random.Generator:
        """The random numbers of a condition: no condition changes those of another one."""
        return np.random.default_rng([self.seed, 50, list(LIMITS).index(name), *stream])

    def beam_light(self, beams: int, number: int) -> np.ndarray:
        """Factor on the light of each beam in frame `number`; 0 is a dead beam.

        Raises
        ------
        UserError
            If more beams should be dead or overbright than there are.
        """
        if self.dead + self.overbright > beams:
            raise UserError(f"{self.dead} dead and {self.overbright} overbright beams are more "
                            f"than the {beams} beams of the mesh: ask for fewer.")
        light = np.full(beams, float(self.light))
        faulty = self.random("dead").permutation(beams)
        dim = self.random("dim", number).permutation(beams)[:round(self.dim * beams)]
        light[dim] /= 3
        # Overbright beams are taken from the other end of the permutation, so that the number of
        # dead ones does not change them.
        light[faulty[beams - self.overbright:]] *= 10
        light[faulty[:self.dead]] = 0
        return light


PLAIN = Conditions()
#: A realistic mix: what the kind `tissue` has.
TISSUE = Conditions(ramp=40.0, highlights=4, speckle=12, dim=0.15)


def conditions_of(kind: str, seed: int = 0, **chosen) -> Conditions:
    """The conditions of a kind of scene, with those that were chosen instead of its own.

    Values of None are not chosen.
    """
    own = TISSUE if kind == "tissue" else PLAIN
    values = {name: getattr(own, name) for name in LIMITS}
    values |= {name: value for name, value in chosen.items() if value is not None}
    return Conditions(**values, seed=seed)
