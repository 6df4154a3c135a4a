"""Centres of spots: sums divided by the weight, by a reciprocal table and a product."""

import numpy as np

from hdl.protocol import fraction_bits

__all__ = ["centres", "lsb_px"]

_SLOPE_BITS = 16


def lsb_px(width, height):
    """What one LSB of a centre is worth in pixels, and of all image coordinates on the link."""
    return 2.0**-fraction_bits(width, height)


def centres(spots, reciprocal, fraction=9):
    """Centres of gravity in pixels, unsigned, with so many fraction bits.

    The weight is shifted left until its bit 17 is set, and the sums with it; be m the shifted
    weight, S a shifted sum, so that S / m is the centre. With R = 2**35 / m, between 2**17 and
    2**18, the centre in LSB is (S / 2**9) R / 2**17. The table has C = 2**18 - R, which has 17
    bits: a word for each 512 values of m, the value of C in the upper 20 bits (3 of them
    fraction) and its slope by m / 4 in the lower 16 (12 of them fraction).

    The product takes the upper 17 of the 27 bits of S. The next two bits add what they are worth
    on average, which depends on R and so on bit 16 of m; so no sum of more than 17 bits has to be
    multiplied. Largest error against the quotient: 0.0048 px, 0.0032 px where the weight is at
    most 255 (R is then the only thing that is rounded, besides the result).

    Parameters
    ----------
    spots : structured array
        ``weight`` 1 to 261,888, ``sum_u``, ``sum_v`` below 512 times the weight.
    reciprocal : sequence of 256 :class:`int`
        The table, see :func:`calibration.reciprocal.reciprocal_table`.
    fraction : :class:`int`
        9; or 8, for sums below 1024 times the weight: half of S takes the place of S, and errors in
        pixels are twice as large.

    Returns
    -------
    u, v : arrays of int64
    """
    weight = spots["weight"].astype(np.int64)
    table = np.asarray(reciprocal, dtype=np.int64)
    # Bits of the weight, exact: frexp gives weight = fraction * 2**bits, fraction in [0.5, 1).
    shift = 18 - np.frexp(weight.astype(np.float64))[1]
    mantissa = weight << shift
    word = table[(mantissa >> 9) & 0xFF] if len(table) else np.zeros_like(mantissa)
    value, slope = word >> _SLOPE_BITS, word & ((1 << _SLOPE_BITS) - 1)
    complement = ((value + ((slope * (mantissa & 0x1FF)) >> 11)) >> 3) & 0x1FFFF
    upper = (mantissa >> 16) & 1

    result = []
    for name in ("sum_u", "sum_v"):
        total = spots[name].astype(np.int64) << shift >> 9 - fraction
        high, next_bit, last_bit = total >> 10, (total >> 9) & 1, (total >> 8) & 1
        # In half LSBs: 1 rounds; the two bits below the product's operand are worth 1 to 2 LSB
        # and half of that.
        low = 1 + next_bit * (3 - upper) + last_bit * (2 - upper)
        half = 8 * high + low - ((high * complement) >> 15)
        result.append((half >> 1) & 0x3FFFF)
    return tuple(result)
