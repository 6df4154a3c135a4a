"""Beam and inverse depth of compact points, from the calibration that the chip holds.

The chip sends of an ok point only where it is and how large. What it made of that follows from
the same tables, with the same integers; the check of each frame shows whether it did.
"""

import numpy as np

from model.stereo.depth import inverse_depth
from model.stereo.epipolar import match
from model.stereo.undistort import undistort

__all__ = ["Rebuilder", "point_check"]

_BEAM_BITS, _DEPTH_BITS = 9, 18


def _table():
    """CRC of each octet, polynomial 1021 reflected."""
    table = []
    for value in range(256):
        for _ in range(8):
            value = value >> 1 ^ (0x8408 if value & 1 else 0)
        table.append(value)
    return table


_CRC = _table()


def point_check(beam, inverse_z):
    """CRC-16/IBM-SDLC over beams and inverse depths, bits in a row without padding.

    Parameters
    ----------
    beam, inverse_z : array of :class:`int`
        9 and 18 bits of each ok point.
    """
    words = (np.asarray(beam, np.int64) | np.asarray(inverse_z, np.int64) << _BEAM_BITS).reshape(-1)
    bits = (words[:, None] >> np.arange(_BEAM_BITS + _DEPTH_BITS) & 1).astype(np.uint8).reshape(-1)
    whole = len(bits) // 8 * 8
    crc = 0xFFFF
    for octet in np.packbits(bits[:whole], bitorder="little").tobytes():
        crc = crc >> 8 ^ _CRC[(crc ^ octet) & 0xFF]
    for bit in bits[whole:].tolist():
        crc = crc >> 1 ^ (0x8408 if (crc ^ bit) & 1 else 0)
    return crc ^ 0xFFFF


class Rebuilder:
    """Status, beam and inverse depth of points, bit for bit as the chip has them.

    Parameters
    ----------
    settings : :class:`model.settings.Settings`
        What the chip was loaded with.
    width, height : :class:`int`
        Sensor size in pixels.
    """

    def __init__(self, settings, width, height):
        self.settings, self.width, self.height = settings, width, height

    def __call__(self, u, v):
        """Status, beam and inverse depth at image coordinates, unsigned, in LSBs."""
        settings = self.settings
        x, y, inside = undistort(u, v, settings, self.width, self.height)
        status, beam = match(x, y, ~inside, settings.line, settings.window)
        return inverse_depth(x, beam, status, settings.depth)
