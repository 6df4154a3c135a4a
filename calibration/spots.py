"""Spots of a frame as the chip will see them: the golden model's own chain, up to the centres."""

import numpy as np

from calibration.identity import PlaneSpots
from model.paper import corrected_spots
from model.preprocessing.binarise import binarise
from model.preprocessing.centre import centres
from model.preprocessing.erosion import erode
from model.preprocessing.histogram import histogram
from model.preprocessing.labelling import label
from model.preprocessing.spot_queue import filter_spots
from model.preprocessing.threshold import threshold

__all__ = ["find_spots"]

#: Image coordinates have 9 bits behind the binary point.
_LSB_PX = 1 / 512


def find_spots(name, z_mm, image, settings, lens):
    """Spots of one plane frame.

    The threshold is learnt on the frame itself, as in the second showing of a frame; the centres
    are the chip's, undistorted in float; with a remap table in ``settings``, they are those of
    the corrected image, as the preset ``paper`` has them.

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
    if settings.remap:
        return _corrected(name, z_mm, image, settings, lens)
    level = settings.level_fixed
    if level is None:
        level = int(threshold(histogram(image), settings.threshold_alpha))
    lit, excess = binarise(image, level)
    lit, core = erode(lit, settings.erosion)
    spots, _ = filter_spots(label(lit, core, excess, settings.weighted), settings)
    spots = spots[spots["rejected"] == 0]
    u, v = (np.asarray(place, float) * _LSB_PX for place in centres(spots, settings.reciprocal))
    x, y = lens.undistort(u, v)
    good = np.isfinite(x) & np.isfinite(y)
    return PlaneSpots(name=name, z_mm=float(z_mm), u=u[good], v=v[good], x=x[good], y=y[good],
                      area=np.asarray(spots["area"])[good], level=level)


def _corrected(name, z_mm, image, settings, lens):
    level, spots, _ = corrected_spots(image, settings)
    spots = spots[spots["rejected"] == 0]
    x, y = (place * _LSB_PX - middle for place, middle in zip(
        centres(spots, settings.reciprocal), lens.centre, strict=True))
    u, v = lens.distort(x, y)
    return PlaneSpots(name=name, z_mm=float(z_mm), u=u, v=v, x=x, y=y,
                      area=np.asarray(spots["area"]), level=level)
