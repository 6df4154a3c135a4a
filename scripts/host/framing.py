"""Packets on the line, both ways: COBS between zeros, closed by a CRC-32.

A packet is 00, COBS (Cheshire and Baker, 1999) of its content and the content's CRC-32/ISO-HDLC,
low octet first, and 00 again. Content is so short that COBS always adds exactly one octet.
"""

import re
import zlib

from hdl.protocol import CONTENT_LIMIT

__all__ = ["CHECK_OCTETS", "Deframer", "frame_packet"]

CHECK_OCTETS = 4
_NOT_EMPTY = re.compile(rb"[^\0]+\0")
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
    """Finds packets in octets that come in chunks of any size; never raises.

    What stands before the first zero is not counted: the line may have been opened in the middle
    of a packet.

    Attributes
    ----------
    octets : :class:`int`
        All that were fed.
    garbage : :class:`int`
        Octets between zeros that are too few or too many for a packet.
    damaged : :class:`int`
        Packets whose COBS or check is wrong.
    """

    def __init__(self):
        self.octets = self.garbage = self.damaged = 0
        self._pending = b""  # since the last zero
        self._overlong = False  # so much came without a zero that it cannot be a packet
        self._delimited = False  # a zero has come

    def feed(self, octets):
        """Contents of the packets that end in ``octets``, without their checks, in a list."""
        return [content for _, content in self.packets(octets)]

    def packets(self, octets):
        """Yield each packet that ends in ``octets``.

        Yields
        ------
        (:class:`int`, :class:`bytes`)
            How many of ``octets`` end with the packet's closing zero; its content without the
            check.
        """
        octets = bytes(octets)
        self.octets += len(octets)
        end = octets.rfind(b"\0") + 1
        if not end:
            self._keep(octets)
            return
        data, before = self._pending + octets[:end], len(self._pending)
        self._pending = b""
        start = 0
        if self._overlong:
            start = data.find(b"\0")
            self.garbage += start
            self._overlong = False
        for match in _NOT_EMPTY.finditer(data, start):
            content = self._content(match[0][:-1], self._delimited or match.start() > 0)
            if content is not None:
                yield match.end() - before, content
        self._delimited = True
        self._keep(octets[end:])

    def _keep(self, rest):
        """Wait for the zero that ends ``rest``, unless that is too long."""
        if self._overlong or len(self._pending) + len(rest) > CONTENT_LIMIT + 1:
            self.garbage += len(self._pending) + len(rest)
            self._overlong = True
            self._pending = b""
        else:
            self._pending += rest

    def _content(self, piece, counted):
        if not _SHORTEST < len(piece) <= CONTENT_LIMIT + 1:
            self.garbage += counted * len(piece)
            return None
        # Each code octet stands at the position of a zero, and holds the distance to the next
        # one; the first one is extra.
        content, position = bytearray(piece), 0
        while position < len(piece):
            step = piece[position]
            content[position] = 0
            position += step
        body, check = bytes(content[1:-CHECK_OCTETS]), content[-CHECK_OCTETS:]
        if position != len(piece) or zlib.crc32(body) != int.from_bytes(check, "little"):
            self.damaged += counted
            return None
        return body
