"""Whole-image distortion correction: a remap table, nearest neighbour."""

import numpy as np

__all__ = ["OUTSIDE", "pack_remap", "remap"]

#: Place of a corrected pixel that shows nothing.
OUTSIDE = (1 << 18) - 1
_DIFFERENCE_BITS = 12


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
    table = np.asarray(table, dtype=np.int64)
    shown = table != OUTSIDE
    return np.where(shown, frame.ravel()[table * shown], 0).astype(np.uint8).reshape(frame.shape)


def pack_remap(table):
    """The table as the chip's memory holds it, a word of 32 bits for each two pixels.

    Bits 0 to 17 are the first pixel's position, bits 18 to 29 the second one's minus the first
    one's, signed. Bit 30 says that the first pixel, bit 31 that the second one shows nothing; its
    position is then that of its neighbour.

    Raises
    ------
    ValueError
        If two positions are too far apart.
    """
    positions = np.asarray(table, dtype=np.int64)
    positions = np.append(positions, np.full(len(positions) % 2, OUTSIDE)).reshape(-1, 2)
    outside = positions == OUTSIDE
    positions = np.where(outside, positions[:, ::-1], positions)
    positions = np.where(outside.all(axis=1)[:, None], 0, positions)
    difference = positions[:, 1] - positions[:, 0]
    limit = 1 << (_DIFFERENCE_BITS - 1)
    if np.any((difference < -limit) | (difference >= limit)):
        raise ValueError("Neighbours in the corrected image lie too far from each other in the "
                         f"image: more than {limit} pixels, in raster order")
    return (positions[:, 0] | (difference & (2 * limit - 1)) << 18
            | outside[:, 0].astype(np.int64) << 30 | outside[:, 1].astype(np.int64) << 31)
