"""Whole-image distortion correction: a table of places, nearest neighbour."""

import numpy as np

__all__ = ["OUTSIDE", "remap"]

#: Word of a corrected pixel that no pixel of the image shows.
OUTSIDE = (1 << 18) - 1


def remap(frame, table):
    """The corrected image.

    Parameters
    ----------
    frame : array (height, width) of uint8
        Grey values.
    table : sequence of height x width :class:`int`
        For each pixel of the corrected image, in raster order, the number of the image's pixel
        that it shows, in raster order too, or :data:`OUTSIDE`.

    Returns
    -------
    array (height, width) of uint8
        Grey values, 0 outside the image.
    """
    table = np.asarray(table, dtype=np.int64) & OUTSIDE
    # Words that name no pixel of the image show nothing either.
    shown = table < min(frame.size, OUTSIDE)
    return np.where(shown, frame.ravel()[table * shown], 0).astype(np.uint8).reshape(frame.shape)
