"""Spots to points in space."""

import numpy as np

from hdl.protocol import fraction_bits
from model.link.points import POINT
from model.preprocessing.centre import centres
from model.stereo.depth import inverse_depth
from model.stereo.epipolar import match
from model.stereo.undistort import undistort

__all__ = ["reconstruct"]


def reconstruct(spots, settings, width, height):
    """Points of spots.

    Parameters
    ----------
    spots : structured array
        As :func:`model.preprocessing.spot_queue.filter_spots` gives them.
    settings : :class:`model.settings.Settings`
        Registers and tables.
    width, height : :class:`int`
        Sensor size in pixels.

    Returns
    -------
    structured array
        Fields of :data:`model.link.points.POINT`, in the order of the spots.
    """
    u, v = centres(spots, settings.reciprocal, fraction_bits(width, height))
    x, y, inside = undistort(u, v, settings, width, height)
    status, beam = match(x, y, spots["rejected"] | ~inside, settings.line, settings.window)
    status, beam, inverse_z = inverse_depth(x, beam, status, settings.depth)
    points = np.zeros(len(spots), POINT)
    points["status"], points["beam"], points["inverse_z"] = status, beam, inverse_z
    points["u"], points["v"] = u, v
    for name in ("area", "saturated", "border"):
        points[name] = spots[name]
    return points
