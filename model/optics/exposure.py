"""From light to grey values: vignetting, background, noise, saturation, conversion and gain."""

import cv2
import numpy as np

from model.bayer import channels

from .conditions import PLAIN, Conditions
from .effects import hot_levels
from .rigs import Rig

__all__ = ["background", "expose", "infrared_response", "vignette"]

#: Response of red, green and blue pixels to the laser's near infrared, which all filters pass.
_INFRARED = (1.05, 1.0, 0.95)


def infrared_response(camera) -> np.ndarray | float:
    """Factor on the light of each pixel of a pattern frame, (height, width); 1 without filters."""
    if camera.bayer is None:
        return 1.0
    return np.array(_INFRARED)[channels(camera.bayer, camera.height, camera.width)]


def background(rig: Rig, rng: np.random.Generator) -> np.ndarray:
    """The image of the tissue without laser: levels, float64."""
    camera, noise = rig.camera, rig.noise
    shape = camera.height, camera.width
    coarse = rng.normal(size=(7, 9))
    smooth = cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)
    smooth += 0.5 * cv2.resize(
        rng.normal(size=(28, 36)), shape[::-1], interpolation=cv2.INTER_CUBIC
    )
    smooth /= max(smooth.std(), 1e-9)
    return np.maximum(noise.background * vignette(rig) * (1 + noise.texture * smooth), 0)


def vignette(rig: Rig) -> np.ndarray:
    """Share of the light that reaches each pixel: 1 at the principal point, least in a corner."""
    camera = rig.camera
    u, v = camera.principal_px
    square = (np.arange(camera.width) - u) ** 2 + (np.arange(camera.height)[:, None] - v) ** 2
    return 1 - rig.noise.vignetting * square / square.max()


def expose(
    rig: Rig, levels: np.ndarray, rng: np.random.Generator, conditions: Conditions = PLAIN
) -> np.ndarray:
    """Hot pixels, shot noise, read noise, saturation, conversion, and gain."""
    noise = rig.noise
    if conditions.hot_pixels:
        levels = levels + hot_levels(levels.shape, conditions)
    if noise.electrons > 0:
        levels = rng.poisson(np.maximum(levels, 0) * noise.electrons) / noise.electrons
    levels = levels + rng.normal(scale=noise.read, size=levels.shape) if noise.read else levels
    grey = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    lost = 8 - conditions.bits
    grey = grey >> lost << lost
    if conditions.gain != 1:
        grey = np.clip(np.rint(conditions.gain * grey.astype(float)), 0, 255).astype(np.uint8)
    return grey
