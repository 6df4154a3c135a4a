"""Pattern and texture frames as the sensor delivers them."""

from functools import lru_cache

import cv2
import numpy as np

from model.bayer import channels

from . import scenes
from .conditions import PLAIN, Conditions
from .effects import hide, pattern_light
from .exposure import background, expose, infrared_response, vignette
from .rigs import Rig
from .spots import pattern_levels

__all__ = ["pattern_frame", "surface", "texture_frame", "texture_levels"]

#: Red, green and blue of tissue: its colour, blotches, and what vessels take away.
_COLOUR, _BLOTCHES, _VESSELS = (1.15, 0.62, 0.5), (0.15, 0.3, 0.3), (0.2, 0.55, 0.5)


def pattern_frame(
    rig: Rig, scene, rng: np.random.Generator, conditions: Conditions = PLAIN, number: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """A pattern frame (uint8, height x width) and its truth (`TRUTH`, one row per beam).

    Parameters
    ----------
    rig : :class:`.rigs.Rig`
        Who looks.
    scene : scene
        At what.
    rng : :class:`numpy.random.Generator`
        Of background and noise.
    conditions : :class:`.conditions.Conditions`
        What makes the frame harder, with random numbers of its own.
    number : :class:`int`
        Of the frame, for the conditions.
    """
    if conditions.plain:
        levels, truth = pattern_levels(rig, scene)
        levels = (levels + background(rig, rng)) * infrared_response(rig.camera)
        return expose(rig, levels, rng), truth
    laser, ambient, truth = pattern_light(rig, scene, conditions, number)
    plain = background(rig, rng)
    hide(truth, laser, plain, ambient, 255 / max(conditions.gain, 1))
    levels = (laser + plain + ambient) * infrared_response(rig.camera)
    return expose(rig, levels, rng, conditions), truth


def surface(rig: Rig, scene) -> tuple[np.ndarray, np.ndarray]:
    """Where the rays of every second pixel in u and v meet the scene, by sphere tracing.

    For textures, not for the truth: accurate to about a thousandth of the distance.

    Returns
    -------
    points : :class:`numpy.ndarray`, (ceil(height / 2), ceil(width / 2), 3)
        Millimetres, NaN where the ray meets nothing.
    directions : :class:`numpy.ndarray`, of the same shape
        Unit vectors of the rays.
    """
    directions = _directions(rig.camera)
    rays = directions.reshape(-1, 3)
    distance = np.full(len(rays), 1e-3)
    active = np.arange(len(rays))
    close = 5e-4 * rig.middle_mm
    for _ in range(120):
        clearance = scene.clearance(rays[active] * distance[active, None])
        distance[active] += np.maximum(clearance, close / 4)
        active = active[(clearance > close) & (distance[active] < 4 * rig.range_mm[1])]
        if not len(active):
            break
    distance[distance >= 4 * rig.range_mm[1]] = np.nan
    return (rays * distance[:, None]).reshape(directions.shape), directions


def texture_levels(rig: Rig, scene, rng: np.random.Generator) -> np.ndarray:
    """The image without laser, with a long exposure and light from beside the camera.

    In levels (float64), without noise; with colour filters each pixel sees its colour only.
    """
    camera = rig.camera
    points, directions = surface(rig, scene)
    known = ~np.isnan(points[..., 0])
    normal = scenes.normals(scene, np.nan_to_num(points, nan=1.0), 0.05 * rig.scale)
    cosine = np.maximum(-(normal * directions).sum(axis=-1), 0)
    square = (points**2).sum(axis=-1) / rig.middle_mm**2
    # Tissue: blotches and thin dark vessels, fixed to the surface.
    waves = rng.normal(size=(6, 3)) / rig.scale * np.array([0.15, 0.2, 0.3, 0.4, 0.6, 0.8])[:, None]
    phase = rng.uniform(0, 2 * np.pi, 6)
    ripple = np.sin(points @ waves.T + phase)
    blotches = ripple.mean(axis=-1)
    vessels = np.exp(-((ripple[..., 0] + ripple[..., 2] + 0.6 * ripple[..., 4]) / 0.12) ** 2)

    def reflected(blotch, vessel):
        bright = (0.15 + 0.85 * cosine) / square * (1 + blotch * blotches) * (1 - vessel * vessels)
        bright = np.where(known, bright, 0)
        bright *= 150 / max(np.quantile(bright, 0.9), 1e-9)
        return cv2.resize(bright, (2 * bright.shape[1], 2 * bright.shape[0]),
                          interpolation=cv2.INTER_LINEAR)[:camera.height, :camera.width]

    if camera.bayer is None:
        bright = reflected(0.25, 0.35)
    else:
        colours = [share * reflected(blotch, vessel) for share, blotch, vessel in zip(
            _COLOUR, _BLOTCHES, _VESSELS, strict=True)]
        bright = np.choose(channels(camera.bayer, camera.height, camera.width), colours)
    # Long exposures saturate softly, as with an imager's knee.
    return 250 * (1 - np.exp(-bright / 170)) * vignette(rig)


def texture_frame(
    rig: Rig, scene, rng: np.random.Generator, conditions: Conditions = PLAIN
) -> np.ndarray:
    """A texture frame (uint8, height x width), with what of the conditions belongs to the rig."""
    return expose(rig, texture_levels(rig, scene, rng), rng, conditions.of_rig())


@lru_cache(maxsize=4)
def _directions(camera) -> np.ndarray:
    """Unit vectors of the rays between the pixels of each 2 x 2."""
    v, u = np.mgrid[0.5:camera.height:2, 0.5:camera.width:2]
    directions = camera.normalise(np.stack([u, v], axis=-1))
    directions = np.concatenate([directions, np.ones((*u.shape, 1))], axis=-1)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)
