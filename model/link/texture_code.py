"""How pixels of a texture are packed: nearly without loss, each packet for itself."""

import numpy as np

__all__ = ["BOUNDS", "next_row", "pack", "quantise"]

#: Largest error of a pixel in grey values, by the code that stands in a packet.
BOUNDS = (0, 2, 4)

_HEAD_BITS = 32
_FULL = 704 - 16  # bits of a packet, less those of the longest code
_LITERAL, _ROW_END = 6, 7  # zeros
_ACTIVITY = 8  # at a packet's start


def quantise(pixels, bound):
    """Numbers of the steps of ``2 bound + 1`` grey values that ``pixels`` are nearest to."""
    return (np.asarray(pixels, np.int32) + bound) // (2 * bound + 1)


def next_row(row, height):
    """The row that follows, and whether another pass begins with it.

    The passes take every eighth row from 0 on, every eighth from 4 on, every fourth from 2 on, and
    every second from 1 on.
    """
    first, step = (1, 2) if row % 2 else (2, 4) if row % 4 else (4, 8) if row % 8 else (0, 8)
    following = row + step
    if following < height:
        return following, False
    return {0: 4, 4: 2, 2: 1, 1: 0}[first], True


def pack(rows, height, row, column, number, bound=0, mosaic=False):
    """The packet that begins with a pixel: as many pixels as it holds, or as are left of the pass.

    Parameters
    ----------
    rows : callable
        Given a row, its quantised pixels as a list of :class:`int`.
    height : :class:`int`
        Rows of the image.
    row, column : :class:`int`
        Place of the packet's first pixel.
    number : :class:`int`
        Of the frame.
    bound : :class:`int`
        One of :data:`BOUNDS`, with which the pixels were quantised.
    mosaic : :class:`bool`
        A pixel resembles the one two to the left, not the one beside it.

    Returns
    -------
    :class:`bytes`
        Body of the packet.
    tuple of two :class:`int`
        Row and column of the pixel after its last one.
    :class:`bool`
        The pass is over.
    """
    line = rows(row)
    value = line[column]
    head = (number & 0xFF | row << 8 | column << 18 | BOUNDS.index(bound) << 28
            | int(mosaic) << 30)
    word, used = head | (1 | value << 1) << _HEAD_BITS, _HEAD_BITS + 9
    before, other = value, value  # two pixels to the left, and the one between
    plain = int(mosaic)  # pixels that are sent as they are
    activity, waits = _ACTIVITY, 0
    column += 1
    over = False
    while used < _FULL and not over:
        if column == len(line):
            word |= (1 | waits << 1) << used + _ROW_END
            used += _ROW_END + 1 + (activity < 8)
            waits = 0
            (row, over), column = next_row(row, height), 0
            line = rows(row)
            continue
        value = line[column]
        column += 1
        difference = value - (before if mosaic else other)
        before, other = other, value
        if plain:
            plain = 0
            word |= (1 | value << 1) << used
            used += 9
            continue
        fold = 2 * difference if difference >= 0 else -2 * difference - 1
        bits = (activity >> 3).bit_length()
        activity += fold - (activity >> 2)
        zeros = fold >> bits
        rest = fold & (1 << bits) - 1
        if zeros >= _LITERAL:
            zeros, rest, bits = _LITERAL, value | waits << 8, 8 + (not bits)
            waits = 0
        elif not bits:
            if not fold:
                waits = 1 - waits
                if waits:
                    continue
            else:
                rest, bits, waits = waits, 1, 0
        word |= (1 | rest << 1) << used + zeros
        used += zeros + 1 + bits
    if column == len(line):  # full with the row's last pixel
        (row, over), column = next_row(row, height), 0
    return word.to_bytes(4 * (used // 32 + 1), "little"), (row, column), over
