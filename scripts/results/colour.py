"""The picture that a texture shows, in colour if the sensor has colour filters."""

import numpy as np

__all__ = ["colour_picture", "spread", "to_file"]

_REACH = 8


def colour_picture(image, came, bayer):
    """What a texture shows.

    Parameters
    ----------
    image : array (height, width) of uint8
        The texture as the chip sends it.
    came : array (height, width) of :class:`bool`
        Which of its pixels have come.
    bayer : :class:`str` or None
        Pattern of the sensor's colour filters, one of :data:`model.bayer.BAYER`.

    Returns
    -------
    array
        Without filters (height, width), where a pixel that has not come is like the nearest one in
        its column that has, within eight rows. With filters (height, width, 3) in red, green, blue;
        such a pixel has the value of the nearest one of its colour. Where one of the colours is
        missing for more than eight rows, it is grey.
    """
    if bayer is None or min(image.shape) < 2:
        return spread(came, image)[0]
    import cv2

    code = getattr(cv2, f"COLOR_Bayer{bayer}2RGB")
    if came.all():
        return cv2.cvtColor(image, code)
    filled, near = np.empty_like(image), np.empty(image.shape, bool)
    for row in (0, 1):
        for column in (0, 1):
            site = slice(row, None, 2), slice(column, None, 2)
            row_of, distance = _nearest(came[site])
            filled[site] = np.take_along_axis(image[site], row_of, axis=0)
            near[site] = 2 * distance <= _REACH
    # All four colours of a pixel's surroundings.
    near = cv2.erode(near.astype(np.uint8), np.ones((3, 3))).astype(bool)
    colours = cv2.cvtColor(filled, code)
    grey = np.take_along_axis(image, _nearest(came)[0], axis=0)
    grey = cv2.blur(grey, (2, 1))  # a row has two colours in turn
    return np.where(near[:, :, None], colours, grey[:, :, None])


def spread(known, plane):
    """A plane with unknown pixels like the nearest known one in their column, if that is near.

    Gives the plane, and where it is known then: within eight rows.
    """
    if known.all():
        return plane, known
    row_of, distance = _nearest(known)
    near = distance <= _REACH
    return np.where(near, np.take_along_axis(plane, row_of, axis=0), plane), near


def to_file(picture):
    """A picture as :func:`cv2.imencode` takes it: blue, green, red where it has colours."""
    return picture[:, :, ::-1] if picture.ndim == 3 else picture


def _nearest(known):
    """For each pixel the row of the nearest known one in its column, and how far that is."""
    height, far = len(known), np.int16(1 << 13)
    row = np.arange(height, dtype=np.int16)[:, None]
    above = np.maximum.accumulate(np.where(known, row, -far), axis=0)
    below = np.minimum.accumulate(np.where(known, row, far)[::-1], axis=0)[::-1]
    nearest = np.where(row - above <= below - row, above, below)
    return np.clip(nearest, 0, height - 1), np.abs(nearest - row)
