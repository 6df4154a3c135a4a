"""Undistortion of spot centres: the Brown model inverted by a radial table and iteration."""

import numpy as np

from hdl.protocol import fraction_bits

__all__ = ["ROUNDS", "SEGMENTS", "radius_bits", "tangential_bits", "undistort"]

#: Times that the tangential part is evaluated.
ROUNDS = 2
#: Segments of the radial table, two words each.
SEGMENTS = 512

_SEGMENT_BITS = 9  # fraction of a segment
_SUM_SHIFT = 12
_ADD_SHIFT = 14
_ESTIMATE_SHIFT = 4


def radius_bits(width, height):
    """Bits of the squared radius, in px^2, that the radial table covers.

    The least n with 2**n at least 1.25 times the squared half diagonal, so that the principal
    point may lie off the centre by a tenth of the half diagonal. At least 12, and at most 17, or
    19 with 8 fraction bits, beyond which coordinates leave their range.
    """
    need = (width * width + height * height) * 1.25 / 4
    most = 17 + 2 * (9 - fraction_bits(width, height))
    return next((bits for bits in range(12, most) if 2**bits >= need), most)


def tangential_bits(width, height):
    """The tangential registers hold p1 and p2 over the focal length in pixels, times 2 to this."""
    return 36 - fraction_bits(width, height)


def undistort(u, v, settings, width, height, rounds=ROUNDS):
    """Undistorted coordinates of centres, about the image centre.

    With d the position about the principal point, X the undistorted one and P = (p2, p1) / focal
    length, the Brown model reads d = X g(|X|^2) + 2 (P X) X + P |X|^2, and without the tangential
    part X = d s(|d|^2). So y = d first, and then, in each round, X = y s(|y|^2) from the last y
    and y = d - 2 (P X) X - P |X|^2. The last y gives the result.

    Signs are chosen so that every step adds: the chip holds -d and -y, and the table -s.

    The table has 512 segments of |y|^2, each ``2**(radius_bits(width, height) - 9)`` px^2 wide.
    Word 2i holds -s at the start of segment i in 2**-16, word 2i + 1 its change over the segment;
    both are signed, 18 bits. The first round makes do with the value. The rounds take s with 12
    fraction bits, so that X has 5 and the tangential products, which are small, more.

    Error budget at the border of 352 x 288 pixels, in px, where a position gains g (the largest
    derivative of X by d): s rounded and interpolated, 0.003; result rounded, 0.001; |y|^2 cut to
    0.25 px^2, 0.0006 (g - s); y rounded, 0.001 g; tangential products and registers, 0.0007 g;
    the principal point's rounding, 0.001 (g - 1). The tangential iteration leaves about k^n times
    the tangential shift after n rounds, with k = 6 p g r at the normalised radius r. Measured over
    random lenses: at most 0.007 px for p1, p2 up to 0.001 and g up to 3, or 0.002 and 2; with
    three rounds up to 0.003 and 3, or 0.009 px for 0.005 and 2. With 8 fraction bits all
    integers are those of an image of half the size, and errors in pixels twice as large.

    Parameters
    ----------
    u, v : arrays of :class:`int`
        Centres, unsigned, with the fraction bits of the sensor's size, as all coordinates.
    settings : :class:`model.settings.Settings`
        ``principal_u, principal_v`` (coordinates), ``tangential_1, tangential_2`` (p1 and p2 over
        the focal length, signed, see :func:`tangential_bits`) and ``radial``.
    width, height : :class:`int`
        Sensor size in pixels.
    rounds : :class:`int`
        Rounds of the tangential iteration.

    Returns
    -------
    x, y : arrays of int64
        Signed coordinates; where not ``ok`` they are what the chip's 18 bits hold.
    ok : array of :class:`bool`
        Neither the result nor any y leaves the 18 bits of a coordinate, nor |y|^2 the table.
    """
    u, v = np.asarray(u, dtype=np.int64), np.asarray(v, dtype=np.int64)
    table = np.zeros((SEGMENTS, 2), dtype=np.int64)
    words = np.asarray(settings.radial, dtype=np.int64) & 0x3FFFF
    table.reshape(-1)[:len(words)] = words - ((words >> 17) << 18)
    fraction = fraction_bits(width, height)
    # All is done in units in which a coordinate has 9 fraction bits: pixels, or two of them.
    radius_shift = radius_bits(width, height) - 2 * (9 - fraction)
    principal = (settings.principal_u, settings.principal_v)
    tangential = (settings.tangential_2, settings.tangential_1)
    ok = np.ones(u.shape, dtype=bool)

    def wrapped(value, bits=18):
        half = 1 << (bits - 1)
        return ((value + half) & (2 * half - 1)) - half

    def dot(first, second):
        return sum((a * b) >> _SUM_SHIFT for a, b in zip(first, second, strict=True))

    def checked(values):
        nonlocal ok
        for value in values:
            ok = ok & (value == wrapped(value))
        return [wrapped(value) for value in values]

    def scale(position, interpolate):
        nonlocal ok
        radius = dot(position, position) >> (radius_shift - _SUM_SHIFT)
        ok = ok & (radius >> 18 == 0)
        radius = radius & 0x3FFFF
        value, slope = np.moveaxis(table[radius >> _SEGMENT_BITS], -1, 0)
        fraction = radius & ((1 << _SEGMENT_BITS) - 1)
        return value + ((slope * fraction) >> _SEGMENT_BITS) if interpolate else value

    offset = [p - c for p, c in zip(principal, (u, v), strict=True)]
    position = checked(offset)
    for turn in range(rounds):
        factor = wrapped(scale(position, turn > 0) >> _ESTIMATE_SHIFT)
        # Undistorted, with 5 fraction bits.
        estimate = [wrapped((((a * factor) >> _ADD_SHIFT) + 1) >> 2) for a in position]
        slope = wrapped(dot(tangential, estimate))  # P X, 20 fraction bits
        square = wrapped(dot(estimate, estimate))  # px^2 / 4
        # Sums have 11 fraction bits; the first one is halved, since its product must count twice.
        half = [wrapped(2 * d + 1 + ((a * slope) >> _ADD_SHIFT), 20) for d, a in zip(
            offset, estimate, strict=True)]
        position = checked([(2 * h + 1 + ((p * square) >> _ADD_SHIFT)) >> 2 for h, p in zip(
            half, tangential, strict=True)])
    factor = wrapped(scale(position, True))
    shift = [p - ((size - 1) << fraction - 1) for p, size in zip(
        principal, (width, height), strict=True)]
    x, y = checked([(2 * (2 * s + 1) + 1 + ((a * factor) >> _ADD_SHIFT)) >> 2 for s, a in zip(
        shift, position, strict=True)])
    return x, y, ok
