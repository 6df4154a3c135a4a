"""Errors of the spots' centres, and the Cramer-Rao bound: what no unbiased estimate can beat."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from model.optics.conditions import PLAIN, TISSUE, Conditions

__all__ = ["CASES", "Centres", "information", "measure"]

#: Conditions whose centres are compared with their bound.
CASES = {
    "plain": PLAIN, "gain 4": Conditions(gain=4), "light x 4": Conditions(light=4),
    "light / 4": Conditions(light=0.25), "6 bits": Conditions(bits=6),
    "defocus 4 px": Conditions(defocus=4), "12-look speckle": Conditions(speckle=12),
    "tissue, planes only": TISSUE}
_KINDS = ("plane", "tilted")
_FRAMES = 4  # of each kind and seed
#: Levels for which the information is computed; brighter pixels are saturated.
_LEVELS = np.arange(0, 2048, 0.25)
#: Half of a spot's surroundings, the step of its derivatives, and how far its centre may lie; px.
_HALF, _STEP, _NEAR_PX = 12, 0.01, 3.0


@dataclass(frozen=True)
class Centres:
    """Centres of the spots that were found, and the bound of each.

    Parameters
    ----------
    error : array (n, 2)
        Centres less the true ones, px.
    variance : array (n, 2)
        Least variance of an unbiased estimate of them, square px.
    expected : :class:`int`
        Beams inside; ``n`` of them were found.
    """

    error: np.ndarray
    variance: np.ndarray
    expected: int

    @property
    def rms_px(self):
        """Error of a coordinate."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def bound_px(self):
        """The least that the error of a coordinate can be."""
        return float(np.sqrt(np.mean(self.variance)))


def information(noise, conditions, levels=_LEVELS):
    """Fisher information that a pixel's grey value holds about its level.

    Of the simulated sensor: normal read and shot noise, then rounded, limited, cut to fewer bits
    and stretched. Each grey value is a range of levels; the sum of (dp / dlevel)^2 / p over all of
    them, p their probabilities, is exact.

    Parameters
    ----------
    noise : :class:`model.optics.rigs.Noise`
        Read noise and electrons.
    conditions : :class:`model.optics.conditions.Conditions`
        ``bits`` and ``gain``.
    levels : array (n,)
        Expected levels.

    Returns
    -------
    array (n,)
        In 1 / square level.
    """
    lost = 8 - conditions.bits
    grey = np.arange(256) >> lost << lost
    grey = np.clip(np.rint(conditions.gain * grey), 0, 255)
    edges = np.flatnonzero(np.diff(grey)) + 0.5

    def probabilities(level):
        sigma = np.sqrt(noise.read**2 + (level / noise.electrons if noise.electrons else 0.0))
        below = ndtr((edges - level[:, None]) / np.atleast_1d(sigma)[:, None])
        return np.diff(below, axis=1, prepend=0, append=1)

    low, high = np.maximum(levels - 1e-3, 0), levels + 1e-3
    one, other = probabilities(low), probabilities(high)
    mean, slope = (one + other) / 2, (other - one) / (high - low)[:, None]
    return np.sum(np.where(mean > 1e-12, slope**2 / np.maximum(mean, 1e-12), 0), axis=1)


def _moved(rig, u_px, v_px):
    """The rig, all of whose pictures are shifted by so much."""
    u, v = rig.camera.principal_px
    return replace(rig, camera=replace(rig.camera, principal_px=(u + u_px, v + v_px)))


def _least_variance(slopes, weight, u, v):
    """Bound of both coordinates of the spot at ``u, v``: the profile of its light is known."""
    row, column = max(round(v) - _HALF, 0), max(round(u) - _HALF, 0)
    part = np.s_[row:round(v) + _HALF + 1, column:round(u) + _HALF + 1]
    slope = np.stack([each[part].ravel() for each in slopes])
    return np.diag(np.linalg.inv(slope * weight[part].ravel() @ slope.T))


def _frame(rig, scene, conditions, stream, number, seen):
    """Errors and bounds of one frame: arrays (n, 2), and the number of beams inside."""
    from calibration.spots import image_spots
    from model.optics import exposure, render
    from model.optics.effects import pattern_light

    settings, table = seen
    image, truth = render.pattern_frame(
        rig, scene, np.random.default_rng(stream), conditions, number)
    even = replace(conditions, speckle=0)
    laser, ambient, _ = pattern_light(rig, scene, even, number)
    level = laser + ambient + exposure.background(rig, np.random.default_rng(stream))
    slopes = [(pattern_light(_moved(rig, *step), scene, even, number)[0]
               - pattern_light(_moved(rig, *(-part for part in step)), scene, even, number)[0])
              / (2 * _STEP) for step in ((_STEP, 0), (0, _STEP))]
    weight = np.interp(level, _LEVELS, table)
    if conditions.speckle:
        # Variances add up. The best linear estimate has no less, others hardly.
        weight = weight / (1 + weight * laser**2 / conditions.speckle)
    _, u, v, _ = image_spots(image, settings)
    true = truth[truth["inside"]]
    error = np.stack([u - true["u_px"][:, None], v - true["v_px"][:, None]], axis=-1)
    distance = np.hypot(*np.moveaxis(error, -1, 0))
    found = (distance < _NEAR_PX).any(axis=1) if len(u) else np.zeros(len(true), bool)
    nearest = distance[found].argmin(axis=1) if found.any() else np.zeros(0, int)
    variance = [_least_variance(slopes, weight, *spot)
                for spot in zip(true["u_px"][found], true["v_px"][found], strict=True)]
    return error[found, nearest], np.reshape(variance, (-1, 2)), len(true)


def measure(conditions, seeds, **changes):
    """Centres on planes, as :class:`Centres`, of the golden model, whose centres are the RTL's.

    Parameters
    ----------
    conditions : :class:`model.optics.conditions.Conditions`
        Of the frames. With speckle the bound is that of the best linear estimate.
    seeds : iterable of :class:`int`
        Of frames.
    changes
        To the settings out of reset.
    """
    from model.optics import scenes
    from model.optics.rigs import RIGS
    from tb.benchmark.dots import settings

    rig = RIGS["endoscope"]
    seen = settings(**changes), information(rig.noise, conditions)
    frames = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 97])
        turn = [scene for kind in _KINDS for scene in scenes.sequence(kind, rig, _FRAMES, rng)]
        frames += [_frame(rig, scene, replace(conditions, seed=seed), [seed, 97, number], number,
                          seen) for number, scene in enumerate(turn)]
    errors, variances, expected = zip(*frames, strict=True)
    return Centres(np.concatenate(errors), np.concatenate(variances), sum(expected))
