"""Centres in a corrected image to undistorted places."""

import numpy as np

__all__ = ["recentre"]


def recentre(u, v, width, height):
    """Places about the image centre of centres in an image that was corrected as a whole.

    Parameters
    ----------
    u, v : arrays of :class:`int`
        Centres, unsigned Q9.9 pixels.
    width, height : :class:`int`
        Sensor size in pixels.

    Returns
    -------
    x, y : arrays of int64
        Signed Q9.9 pixels; where not ``ok`` they are what 18 bits hold.
    ok : array of :class:`bool`
        Neither leaves +-256 px, which no place in an image does.
    """
    places, ok = [], True
    for centre, size in ((u, width), (v, height)):
        place = np.asarray(centre, dtype=np.int64) - (size - 1) * 256
        held = ((place + (1 << 17)) & 0x3FFFF) - (1 << 17)
        ok = ok & (place == held)
        places.append(held)
    return (*places, ok)
