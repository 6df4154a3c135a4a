"""Packets on the line, both ways: COBS between zeros, closed by a CRC-32.

A packet is 00, COBS (Cheshire and Baker, 1999) of its content and the content's CRC-32/ISO-HDLC,
low octet first, and 00 again. Content is so short that COBS always adds exactly one octet.
"""

import zlib

from hdl.protocol import CONTENT_LIMIT

__all__ = ["CHECK_OCTETS", "Deframer", "frame_packet"]

CHECK_OCTETS = 4
_SHORTEST = 2 + CHECK_OCTETS  # kind and sequence number, or command and tag


def frame_packet(content):
    """The octets on the line of a packet.

    Parameters
    ----------
    content : :class:`bytes`
        Without its check.

    Raises
    ------
    ValueError
        If the packet would be longer than the line allows.
    """
    checked = content + zlib.crc32(content).to_bytes(CHECK_OCTETS, "little")
    if len(checked) > CONTENT_LIMIT:
        raise ValueError(f"A packet holds at most {CONTENT_LIMIT - CHECK_OCTETS} octets, "
                         f"not {len(content)}")
    stuffed = b"".join(bytes([len(run) + 1]) + run for run in checked.split(b"\0"))
    return b"\0" + stuffed + b"\0"


class Deframer:
    """Finds packets in octets that come in pieces of any size; never raises.

    Attributes
    ----------
    octets : :class:`int`
        All that were fed.
    garbage : :class:`int`
        Octets between zeros that are too few or too many for a packet.
    damaged : :class:`int`
        Pieces whose COBS or check is wrong.
    """

    def __init__(self):
        self.octets = self.garbage = self.damaged = 0
        self._pending = b""  # since the last zero
        self._overlong = False  # that much came without a zero that it cannot be a packet

    def feed(self, octets):
        """Contents of the packets that end in ``octets``, without their checks, in a list."""
        octets = bytes(octets)
        self.octets += len(octets)
        *pieces, rest = (self._pending + octets).split(b"\0")
        contents = []
        for piece in pieces:
            if self._overlong:
                self.garbage += len(piece)
                self._overlong = False
            elif piece:
                content = self._content(piece)
                if content is not None:
                    contents.append(content)
        if self._overlong or len(rest) > CONTENT_LIMIT + 1:
            self.garbage += len(rest)
            self._overlong = True
            rest = b""
        self._pending = rest
        return contents

    def _content(self, piece):
        if not _SHORTEST < len(piece) <= CONTENT_LIMIT + 1:
            self.garbage += len(piece)
            return None
        # Each code octet stands where the zero is that it tells of; the first one is extra.
        content, place = bytearray(piece), 0
        while place < len(piece):
            step = piece[place]
            content[place] = 0
            place += step
        body, check = bytes(content[1:-CHECK_OCTETS]), content[-CHECK_OCTETS:]
        if place != len(piece) or zlib.crc32(body) != int.from_bytes(check, "little"):
            self.damaged += 1
            return None
        return body
