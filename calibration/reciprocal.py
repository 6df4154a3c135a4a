"""The reciprocal table of the centre unit."""

import numpy as np

__all__ = ["reciprocal_table"]

_WORDS = 256
_STEPS = 128  # shifted weights to a word
_VALUE_FRACTION = 3
_SLOPE_FRACTION = 12
_SLOPE_BITS = 16


def reciprocal_table():
    """256 words of 36 bits for :func:`model.preprocessing.centre.centres`.

    Word i gives C = 2**18 - 2**33 / m for the 128 shifted weights from 2**15 + 128 i on: the
    value at the first one, with 3 fraction bits, in bits 16 to 35, and the slope, with 12, in
    bits 0 to 15. The value includes the half that rounds C, and balances the largest errors of
    both signs.
    """
    words = []
    steps = np.arange(_STEPS)
    for index in range(_WORDS):
        exact = 2.0**18 - 2.0**33 / (2**15 + _STEPS * index + steps)
        slope = round((exact[-1] - exact[0]) / (_STEPS - 1) * 2**_SLOPE_FRACTION)
        error = exact * 2**_VALUE_FRACTION - (slope * steps >> (_SLOPE_FRACTION - _VALUE_FRACTION))
        half = 2 ** (_VALUE_FRACTION - 1)
        value = round((error.max() + error.min()) / 2 + half - 0.5)
        words.append(value << _SLOPE_BITS | slope)
    return words
