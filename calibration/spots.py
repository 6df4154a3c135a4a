"""Spots of a frame as the chip will see them: the golden model's own chain, up to the centres."""

import numpy as np

from calibration.identity import PlaneSpots
from model import paper
from model.preprocessing.centre import centres
from model.preprocessing.front_chain import find_spots, measure_level

__all__ = ["plane_spots"]

#: Image coordinates have 9 bits behind the binary point.
_LSB_PX = 1 / 512


def plane_spots(name, z_mm, image, settings, lens):
    """Spots of one plane frame.

    The threshold is measured on the frame itself, as if the frame came twice; the centres are the
    chip's, undistorted in float; with a remap table in ``settings``, they are those of the
    corrected image, as the preset ``paper`` has them.

    Parameters
    ----------
    name : :class:`str`
        The frame, for messages.
    z_mm : :class:`float`
        Distance of the plane.
    image : array (height, width) of uint8
        Grey values.
    settings : :class:`model.settings.Settings`
        Threshold, erosion, weighting, area limits and the reciprocal table.
    lens : :class:`calibration.lens.Lens`
        Undistorts the centres.

    Returns
    -------
    :class:`calibration.identity.PlaneSpots`
    """
    corrected = bool(settings.remap)
    level = settings.level_fixed
    if level is None:
        level = measure_level(image, settings, whole=corrected)
    spots, _ = find_spots(image, level, settings, paper.LABELS if corrected else None)
    spots = spots[spots["rejected"] == 0]
    u, v = (np.asarray(axis, float) * _LSB_PX for axis in centres(spots, settings.reciprocal))
    if corrected:
        x, y = (axis - middle for axis, middle in zip((u, v), lens.centre, strict=True))
        u, v = lens.distort(x, y)
    else:
        x, y = lens.undistort(u, v)
    good = np.isfinite(x) & np.isfinite(y)
    return PlaneSpots(name=name, z_mm=float(z_mm), u=u[good], v=v[good], x=x[good], y=y[good],
                      area=np.asarray(spots["area"])[good], level=level)
