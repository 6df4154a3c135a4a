"""Centres of spots: sums divided by the weight, by a reciprocal table and a product."""

import numpy as np

__all__ = ["LSB_PX", "centres"]

#: Centres have 9 bits behind the binary point; so have all image coordinates on the link.
LSB_PX = 1 / 512

_SLOPE_BITS = 16


def centres(spots, reciprocal):
    """Centres of gravity, unsigned Q9.9 pixels.

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
        total = spots[name].astype(np.int64) << shift
        high, next_bit, last_bit = total >> 10, (total >> 9) & 1, (total >> 8) & 1
        # In half LSBs: 1 rounds; the two bits below the product's operand are worth 1 to 2 LSB
        # and half of that.
        low = 1 + next_bit * (3 - upper) + last_bit * (2 - upper)
        half = 8 * high + low - ((high * complement) >> 15)
        result.append((half >> 1) & 0x3FFFF)
    return tuple(result)
