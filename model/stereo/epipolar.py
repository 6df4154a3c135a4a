"""Which beam made a spot: estimation, comparison and encoding over the epipolar lines."""

import numpy as np

__all__ = ["OK", "NOISE", "AMBIGUOUS", "REJECTED", "pack_line", "pack_window", "unpack_line",
           "unpack_window", "hits", "match"]

OK, NOISE, AMBIGUOUS, REJECTED = range(4)


def _signed(word, bits):
    """Two's complement value of the ``bits`` least significant bits."""
    word = np.asarray(word, dtype=np.int64) & ((1 << bits) - 1)
    return word - ((word >> (bits - 1)) << bits)


def _packed(fields):
    """Join (name, value, bits, is_signed), first field in the least significant bits."""
    word, shift = 0, 0
    for name, value, bits, is_signed in fields:
        value = np.asarray(value, dtype=np.int64)
        low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if is_signed else (
            0, (1 << bits) - 1)
        if np.any((value < low) | (value > high)):
            raise ValueError(f"{name} must be between {low} and {high}")
        word = word | ((value & ((1 << bits) - 1)) << shift)
        shift += bits
    return word


def pack_line(slope, offset):
    """Line words: slope signed 18 bits Q0.17, offset signed 18 bits, a coordinate."""
    return _packed([("Slope", slope, 18, True), ("Offset", offset, 18, True)])


def pack_window(tolerance, u_min, u_max):
    """Window words: tolerance unsigned 9 bits, in 16 LSBs of a coordinate, limits of x signed
    13 bits, in 32 LSBs."""
    return _packed([("Tolerance", tolerance, 9, False), ("Lower window limit", u_min, 13, True),
                    ("Upper window limit", u_max, 13, True)])


def unpack_line(line):
    """Slope and offset of line words."""
    line = np.asarray(line, dtype=np.int64)
    return _signed(line, 18), _signed(line >> 18, 18)


def unpack_window(window):
    """Tolerance, lower and upper limit of window words."""
    window = np.asarray(window, dtype=np.int64)
    return window & 0x1FF, _signed(window >> 9, 13), _signed(window >> 22, 13)


def hits(x, y, line, window):
    """For every spot and beam: is it on the line, and is it within the beam's window too?

    The estimate is ``((slope * x + 2**16) >> 17) + offset``, exact, without wrapping. A spot is
    on the line when it is closer than the tolerance, so that a tolerance of zero disables a beam.
    Its column, truncated to 32 LSBs, may equal both window limits.

    Parameters
    ----------
    x, y : array of :class:`int`
        Undistorted coordinates, signed, in LSBs.
    line, window : array of :class:`int`
        A word for each beam.

    Returns
    -------
    tuple of two boolean arrays (spots, beams)
        On the line; on the line and within the window.
    """
    x = np.atleast_1d(np.asarray(x, dtype=np.int64))[:, None]
    y = np.atleast_1d(np.asarray(y, dtype=np.int64))[:, None]
    slope, offset = unpack_line(line)
    tolerance, u_min, u_max = unpack_window(window)
    error = y - (((slope * x + (1 << 16)) >> 17) + offset)
    on_line = np.abs(error) < (tolerance << 4)
    column = x >> 5
    return on_line, on_line & (u_min <= column) & (column <= u_max)


def match(x, y, rejected, line, window):
    """Status and beam of every spot.

    Exactly one hit gives the beam; several make the spot ambiguous. A spot without a hit is
    rejected if it lies on some line (outside its window), else noise. Spots that come in rejected
    stay so. The beam is zero unless the status is ok.

    Parameters
    ----------
    x, y, rejected : array
        As :func:`hits`; spots that are already out.
    line, window : array of :class:`int`
        A word for each beam.

    Returns
    -------
    tuple of two :class:`numpy.ndarray` of int64
        Status (:data:`OK`, :data:`NOISE`, :data:`AMBIGUOUS`, :data:`REJECTED`) and beam.
    """
    on_line, hit = hits(x, y, line, window)
    count = hit.sum(axis=1)
    status = np.select(
        [np.atleast_1d(rejected).astype(bool), count > 1, count == 1, on_line.any(axis=1)],
        [REJECTED, AMBIGUOUS, OK, REJECTED], NOISE)
    return status, np.where(status == OK, hit.argmax(axis=1), 0)
