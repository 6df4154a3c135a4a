"""Pixels of a packet of texture: an independent decoder."""

import numpy as np

__all__ = ["unpack"]

_HEAD_OCTETS, _MOST_OCTETS = 4, 88
_ACTIVITY = 8  # at a packet's start
_LITERAL, _ROW_END = 6, 7  # zeros before the one


def unpack(body):
    """Pieces of rows that a packet holds.

    Parameters
    ----------
    body : :class:`bytes`
        Words of 4 octets, the head first.

    Returns
    -------
    list of (:class:`int`, :class:`int`, array of uint8), or None
        Row, first column and pixels of each piece; None if no chip sends such a packet.
    """
    if len(body) % 4 or not _HEAD_OCTETS < len(body) <= _MOST_OCTETS:
        return None
    head = int.from_bytes(body[:_HEAD_OCTETS], "little")
    row, column, form = head >> 8 & 0x3FF, head >> 18 & 0x3FF, head >> 28
    if form & 3 == 3 or form >> 3:
        return None
    bound, distance = 2 * (form & 3), 1 + (form >> 2)
    found = _values(_Bits(body[_HEAD_OCTETS:]), distance, (255 + bound) // (2 * bound + 1))
    if found is None:
        return None
    values, ends = found
    grey = np.minimum((2 * bound + 1) * np.array(values), 255).astype(np.uint8)
    pieces, begin = [], 0
    for end in ends:
        if end > begin:
            pieces.append((row, column, grey[begin:end]))
        begin, row, column = end, row + _step(row), 0
    return pieces


def _step(row):
    """Rows from one to the next of the same pass."""
    return 2 if row % 2 else 4 if row % 4 else 8


class _Bits:
    """Bits, the lowest of each octet first; beyond the end there are zeros."""

    def __init__(self, octets):
        self.rest, self.left = int.from_bytes(octets, "little"), 8 * len(octets)

    def take(self, count):
        """A number of so many bits."""
        taken = self.rest & (1 << count) - 1
        self.rest >>= count
        self.left -= count
        return taken

    def zeros(self):
        """How many zeros stand before the next one; takes that too."""
        zeros = (self.rest & -self.rest).bit_length() - 1
        self.take(zeros + 1)
        return zeros


def _values(bits, distance, most):
    """Quantised pixels, and where each row ends among them; None if they cannot be that."""
    values, ends, activity = [], [], _ACTIVITY
    while bits.rest:  # zeros fill the last word
        zeros = bits.zeros()
        if len(values) < distance and not zeros:
            values.append(bits.take(8))
        elif not values or zeros > _ROW_END or (len(values) < distance and zeros != _ROW_END):
            return None
        else:
            length = (activity >> 3).bit_length()
            rest, equal = 0, 0 if length else 2
            if length or zeros:
                rest = bits.take({_LITERAL: 8, _ROW_END: 0}.get(zeros, length))
                equal = 0 if length else bits.take(1)
            for _ in range(equal):
                values.append(values[-distance])
                activity -= activity >> 2
            if zeros == _ROW_END:
                ends.append(len(values))
            elif length or zeros:
                before, fold = values[-distance], zeros << length | rest
                value = rest if zeros == _LITERAL else before + (fold >> 1 ^ -(fold & 1))
                step = value - before
                activity += (2 * step if step >= 0 else -2 * step - 1) - (activity >> 2)
                values.append(value)
        if values and not 0 <= values[-1] <= most:
            return None
    return None if bits.left < 0 else (values, [*ends, len(values)])
