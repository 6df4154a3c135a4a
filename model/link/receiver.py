"""Packets from the host: what the chip makes of the octets on its line."""

import zlib

from hdl.protocol import CONTENT_LIMIT

__all__ = ["PacketReceiver", "encode"]

_CRC_OCTETS = 4
_SHORTEST = 2


def encode(content):
    """Octets on the wire of a packet: delimiter, COBS over content and CRC-32, delimiter."""
    checked = bytes(content) + zlib.crc32(bytes(content)).to_bytes(_CRC_OCTETS, "little")
    wire = bytearray([0])
    for piece in checked.split(b"\0"):
        wire += bytes([len(piece) + 1]) + piece
    return bytes(wire) + b"\0"


def _decode(octets):
    """Content of what stood between two delimiters, or None if it is damaged."""
    content, at = bytearray(), 0
    while at < len(octets):
        code = octets[at]
        if at:
            content.append(0)
        if at + code > len(octets):
            return None
        content += octets[at + 1:at + code]
        at += code
    if not _SHORTEST + _CRC_OCTETS <= len(content) <= CONTENT_LIMIT:
        return None
    body, check = content[:-_CRC_OCTETS], content[-_CRC_OCTETS:]
    return bytes(body) if zlib.crc32(body) == int.from_bytes(check, "little") else None


class PacketReceiver:
    """The receiver octet by octet.

    :meth:`receive` returns the content of a packet that ended with that octet, False if a damaged
    one did, else None. An octet that comes while the packet before is ``held`` is lost.
    """

    def __init__(self):
        self._octets = bytearray()
        self._lost = False

    def receive(self, octet, held=False):
        if octet:
            self._octets.append(octet)
            self._lost = self._lost or held
            return None
        octets, lost = bytes(self._octets), self._lost
        self._octets.clear()
        self._lost = False
        if not octets:
            return None
        content = None if lost else _decode(octets)
        return False if content is None else content
