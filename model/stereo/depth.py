"""Inverse depth of matched spots."""

import numpy as np

from model.stereo.epipolar import OK, REJECTED

__all__ = ["INVERSE_Z_LIMIT", "pack_depth", "inverse_depth"]

#: The inverse depth has 18 bits.
INVERSE_Z_LIMIT = 1 << 18


def pack_depth(alpha, beta):
    """Table words of all beams: alpha (signed 18 bits, Q5.12) and beta (signed 36 bits, 12
    fraction bits) in turn; both per LSB of the inverse depth."""
    words = []
    for name, values, bits in [("Alpha", alpha, 18), ("Beta", beta, 36)]:
        values = np.asarray(values, dtype=np.int64)
        if np.any((values < -(1 << (bits - 1))) | (values >= 1 << (bits - 1))):
            raise ValueError(f"{name} must fit in {bits} signed bits")
        words.append(values & ((1 << bits) - 1))
    return np.stack(words, axis=-1).reshape(-1)


def inverse_depth(x, beam, status, table):
    """Status, beam and inverse depth of every spot.

    The inverse depth of an ok spot is ``(alpha * x + beta + 2**11) >> 12``; where that is below 1
    or above ``2**18 - 1`` the spot is rejected. Other spots pass with an inverse depth of zero.

    Parameters
    ----------
    x : array of :class:`int`
        Undistorted column, signed, in LSBs of a coordinate.
    beam, status : array of :class:`int`
        From :func:`model.stereo.epipolar.match`.
    table : array of :class:`int`
        Words 2k and 2k + 1 are alpha and beta of beam k.

    Returns
    -------
    tuple of three :class:`numpy.ndarray` of int64
        Status, beam, inverse depth; the latter two zero unless the status is ok.
    """
    x, beam, status, table = (
        np.atleast_1d(np.asarray(a, dtype=np.int64)) for a in (x, beam, status, table))
    alpha, beta = table[2 * beam] & 0x3FFFF, table[2 * beam + 1] & 0xFFFFFFFFF
    alpha = alpha - ((alpha >> 17) << 18)
    beta = beta - ((beta >> 35) << 36)
    value = (alpha * x + beta + (1 << 11)) >> 12
    seen = (value >= 1) & (value < INVERSE_Z_LIMIT)
    status = np.where((status == OK) & ~seen, REJECTED, status)
    ok = status == OK
    return status, np.where(ok, beam, 0), np.where(ok, value, 0)
