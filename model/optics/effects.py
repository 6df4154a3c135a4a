"""What the conditions of a capture do to the light on the sensor, and to the truth.

All functions give levels (float64, height x width), without noise or limit.
"""

import cv2
import numpy as np

from .conditions import Conditions
from .spots import draw, pattern_levels

__all__ = ["hide", "hot_levels", "pattern_light"]


def _uneven(shape, conditions: Conditions, number: int) -> np.ndarray:
    """Levels of ramp, pool and flicker."""
    height, width = shape
    v, u = np.mgrid[:height, :width].astype(float)
    levels = np.full(shape, float(conditions.flicker * (number % 2)))
    if conditions.ramp:
        angle = conditions.random("ramp", number).uniform(0, 2 * np.pi)
        along = u * np.cos(angle) + v * np.sin(angle)
        levels += conditions.ramp * (along - along.min()) / np.ptp(along)
    if conditions.pool:
        middle = conditions.random("pool", number).uniform([0, 0], [width - 1, height - 1])
        square = (u - middle[0]) ** 2 + (v - middle[1]) ** 2
        levels += conditions.pool * np.exp(-square / (2 * (width / 5) ** 2))
    return levels


def _highlights(shape, conditions: Conditions, number: int) -> np.ndarray:
    """Levels of the wet highlights: elliptical Gaussians of 200 to 600 levels."""
    random, count = conditions.random("highlights", number), conditions.highlights
    centres = random.uniform([0, 0], [shape[1] - 1, shape[0] - 1], (count, 2))
    minor = random.uniform(0.8, 2.0, count)
    major = minor * random.uniform(1, 3, count)
    angle = random.uniform(0, np.pi, count)
    peak = random.uniform(200, 600, count)
    axis = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    covariance = (major**2 - minor**2)[:, None, None] * axis[:, :, None] * axis[:, None, :]
    covariance += minor[:, None, None] ** 2 * np.eye(2)
    return draw(shape, centres, covariance, 2 * np.pi * major * minor * peak)


def _disc(diameter: float) -> np.ndarray:
    """Kernel of a disc with soft edges, of odd size and sum 1."""
    half, fine = int(np.ceil(diameter / 2)), 8
    side = (np.arange((2 * half + 1) * fine) + 0.5) / fine - half - 0.5
    inside = side**2 + side[:, None] ** 2 <= (diameter / 2) ** 2
    kernel = inside.reshape(2 * half + 1, fine, 2 * half + 1, fine).mean(axis=(1, 3))
    return kernel / kernel.sum()


def _line(length: float, angle: float) -> np.ndarray:
    """Kernel of a straight movement, about its middle, of odd size and sum 1."""
    half = int(np.ceil(length / 2)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    steps = (np.arange(16 * half) + 0.5) / (16 * half) - 0.5
    u, v = half + steps * length * np.cos(angle), half + steps * length * np.sin(angle)
    left, top = np.floor(u).astype(int), np.floor(v).astype(int)
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        share = np.abs(1 - right - (u - left)) * np.abs(1 - down - (v - top))
        np.add.at(kernel, (top + down, left + right), share)
    return kernel / kernel.sum()


def _blur(levels: np.ndarray, conditions: Conditions, number: int) -> np.ndarray:
    """Defocus and motion."""
    kernels = [_disc(conditions.defocus)] if conditions.defocus else []
    if conditions.motion:
        angle = conditions.random("motion", number).uniform(0, np.pi)
        kernels.append(_line(conditions.motion, angle))
    for kernel in kernels:
        levels = cv2.filter2D(levels, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
    return levels


def pattern_light(
    rig, scene, conditions: Conditions, number: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Light of frame `number`, and its truth.

    Returns
    -------
    laser, ambient : :class:`numpy.ndarray`
        Levels of the laser's spots, and those that the conditions add to the background.
    truth : :class:`numpy.ndarray` of `spots.TRUTH`
        Spots in saturated light still count as visible: see :func:`hide`.
    """
    shape = rig.camera.height, rig.camera.width
    laser, truth = pattern_levels(
        rig, scene, conditions.beam_light(rig.projector.beams, number))
    if conditions.speckle:
        # The sum of so many independent patterns of full contrast, whose intensities are
        # exponentially distributed.
        looks = conditions.speckle
        laser *= conditions.random("speckle", number).gamma(looks, 1 / looks, shape)
    ambient = _uneven(shape, conditions, number) + _highlights(shape, conditions, number)
    return (_blur(laser, conditions, number), _blur(ambient, conditions, number), truth)


def hide(truth, laser, background, ambient, ceiling: float = 255.0) -> None:
    """Mark spots that are outside the picture or lost in saturated light as not visible.

    A spot is lost if it has, over its middle 3 x 3 pixels, less than half of the contrast that it
    has on the background alone.

    Parameters
    ----------
    truth : :class:`numpy.ndarray` of `spots.TRUTH`, (beams,)
        Where the spots are; it is changed.
    laser, background, ambient : :class:`numpy.ndarray`
        Levels of the spots, of the plain background, and of what the conditions add to it.
    ceiling : :class:`float`
        Level at which pixels saturate.
    """
    def contrast(light):
        return cv2.blur(np.minimum(light + laser, ceiling) - np.minimum(light, ceiling), (3, 3))

    height, width = laser.shape
    u, v = np.rint(truth["u_px"]), np.rint(truth["v_px"])
    seen = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    hidden = ~seen
    at = v[seen].astype(int), u[seen].astype(int)
    hidden[seen] = contrast(background + ambient)[at] < 0.5 * contrast(background)[at]
    truth["visible"] &= ~hidden
    truth["inside"] &= ~hidden


def hot_levels(shape, conditions: Conditions) -> np.ndarray:
    """Levels of the hot pixels: 60 to 300, at the same places in all images."""
    levels = np.zeros(shape)
    random = conditions.random("hot_pixels")
    count = min(conditions.hot_pixels, levels.size)
    at = random.choice(levels.size, count, replace=False)
    levels.flat[at] = random.uniform(60, 300, count)
    return levels
