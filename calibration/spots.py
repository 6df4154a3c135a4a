"""Spots of a frame as the chip will see them: the golden model's own chain, up to the centres."""

import numpy as np

from calibration.identity import PlaneSpots
from hdl.protocol import fraction_bits
from model import paper
from model.preprocessing.centre import centres, lsb_px
from model.preprocessing.front_chain import (
    find_corrected_spots,
    find_spots,
    learn_noise,
    lit_level,
    measure_level,
)

__all__ = ["image_spots", "plane_spots"]


def image_spots(image, settings):
    """Spots of one image as the chip measures them, and the level that it takes for them.

    Noise or threshold are measured on the image itself, as if it came twice. With a remap table in
    ``settings`` the chip is the preset ``paper``, and the spots are those of the corrected image.

    Parameters
    ----------
    image : array (height, width) of uint8
        Grey values; in the preset ``capsule`` no side shorter than ``settings.mean_window``.
    settings : :class:`model.settings.Settings`
        Levels, weighting, area limits and the reciprocal table.

    Returns
    -------
    spots : array of :data:`model.preprocessing.spot_queue.QUEUED_DTYPE`
        Rejected ones among them only if ``settings.report_rejected``.
    u, v : arrays of :class:`float`
        Centres in pixels.
    level : :class:`float`
        Grey values from which on a pixel is lit: above the local mean, or in the preset ``paper``
        above 0.
    """
    if settings.remap:
        level = settings.level_fixed or measure_level(image, settings)
        spots, _ = find_corrected_spots(image, level, settings, paper.LABELS)
    else:
        noise = settings.fixed_noise or learn_noise(image, settings)
        level = lit_level(noise, settings) / 16
        spots, _, _ = find_spots(image, noise, settings)
    size = image.shape[::-1]
    u, v = (np.asarray(axis, float) * lsb_px(*size)
            for axis in centres(spots, settings.reciprocal, fraction_bits(*size)))
    return spots, u, v, level


def plane_spots(name, z_mm, image, settings, lens):
    """Spots of one plane frame.

    As :func:`image_spots` finds them, without those that are rejected. The centres are undistorted
    in float; with a remap table in ``settings``, they are those of the corrected image.

    Parameters
    ----------
    name : :class:`str`
        The frame, for messages.
    z_mm : :class:`float`
        Distance of the plane.
    image : array (height, width) of uint8
        Grey values.
    settings : :class:`model.settings.Settings`
        Levels, weighting, area limits and the reciprocal table.
    lens : :class:`calibration.lens.Lens`
        Undistorts the centres.

    Returns
    -------
    :class:`calibration.identity.PlaneSpots`
    """
    spots, u, v, level = image_spots(image, settings)
    kept = ~spots["rejected"]
    spots, u, v = spots[kept], u[kept], v[kept]
    if settings.remap:
        x, y = (axis - middle for axis, middle in zip((u, v), lens.centre, strict=True))
        u, v = lens.distort(x, y)
    else:
        x, y = lens.undistort(u, v)
    good = np.isfinite(x) & np.isfinite(y)
    return PlaneSpots(name=name, z_mm=float(z_mm), u=u[good], v=v[good], x=x[good], y=y[good],
                      area=np.asarray(spots["area"])[good], level=level)
