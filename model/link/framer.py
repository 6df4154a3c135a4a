"""Contents of packets to the octets on the line."""

import zlib

__all__ = ["CONTENT_LIMIT", "cobs", "frame", "wire_octets"]

#: Octets of a packet before COBS, sequence number and check included.
CONTENT_LIMIT = 97
_GAP = 3


def cobs(content):
    """Consistent Overhead Byte Stuffing (Cheshire and Baker, 1999) of fewer than 254 octets.

    Pieces between zeros, each behind its length plus one.
    """
    if len(content) >= 254:
        raise ValueError(f"Content must have fewer than 254 octets, not {len(content)}")
    return b"".join(bytes([len(piece) + 1]) + piece for piece in content.split(b"\0"))


def frame(contents, sequence=0):
    """Octets on the line of packets that follow each other.

    Parameters
    ----------
    contents : iterable of :class:`bytes`
        Kind and body of each packet.
    sequence : :class:`int`
        Sequence number of the first; zero after a reset.

    Returns
    -------
    list of :class:`bytes` and :class:`int`
        Each packet's octets, delimiters included, and the number of the packet that comes next.
    """
    packets = []
    for content in contents:
        content = content[:1] + bytes([sequence]) + content[1:]
        content += zlib.crc32(content).to_bytes(4, "little")
        packets.append(b"\0" + cobs(content) + b"\0")
        sequence = (sequence + 1) & 0xFF
    return packets, sequence


def wire_octets(contents):
    """Octet times that packets take of the line, the pause behind each included."""
    return sum(len(packet) + _GAP for packet in frame(contents)[0])
