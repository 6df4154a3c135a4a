"""A frame's points and counts as the bytes that leave the chip; the format is in
``hdl/link/README.md``."""

import binascii
from dataclasses import dataclass, field

import numpy as np

__all__ = ["POINT", "FLAG", "ESCAPE", "ESCAPE_XOR", "WIRE_LIMIT", "CRC_BYTES", "FORMAT_VERSION",
           "POINTS", "FRAME", "Frame", "crc", "pack_points", "encode"]

#: A point as the stereo unit gives it.
POINT = np.dtype([("status", np.uint8), ("beam", np.uint8), ("area", np.uint8), ("u", np.uint32),
                  ("v", np.uint32), ("inverse_z", np.uint32)])

FLAG, ESCAPE, ESCAPE_XOR = 0x7E, 0x7D, 0x20
#: Bytes of a packet on the wire, flags and escapes included.
WIRE_LIMIT = 100
CRC_BYTES = 2
FORMAT_VERSION = 1
POINTS, FRAME = 0x50, 0x46
_POINT_BYTES = 9


@dataclass(frozen=True)
class Frame:
    """What the chip tells of one frame.

    Parameters
    ----------
    points : structured array
        Fields of :data:`POINT`, in the order of their labels.
    number, level, skipped : :class:`int`
        16, 8 and 8 bits: frame number, threshold, frames that were skipped before this one.
    learning, broken : :class:`bool`
        The threshold was not learnt yet; the frame lost synchronism.
    spots, rejected, dropped : :class:`int`
        16 bits each: all components; those that were rejected or found no room before they
        became points.
    bad_sync, overrun : :class:`int`
        8 bits each, the camera's counters.
    """

    points: np.ndarray = field(default_factory=lambda: np.zeros(0, POINT))
    number: int = 0
    level: int = 0
    learning: bool = False
    skipped: int = 0
    spots: int = 0
    rejected: int = 0
    dropped: int = 0
    broken: bool = False
    bad_sync: int = 0
    overrun: int = 0


def crc(content):
    """CRC-16/IBM-SDLC (RFC 1662's FCS-16) of ``content``."""
    # Bits go least significant first, hence the mirrored CCITT register.
    mirror = bytes(int(f"{byte:08b}"[::-1], 2) for byte in content)
    return int(f"{binascii.crc_hqx(mirror, 0xFFFF):016b}"[::-1], 2) ^ 0xFFFF


def pack_points(points):
    """Bytes of points, as an array (points, 9)."""
    low = (points["status"].astype(np.uint64)
           | points["beam"].astype(np.uint64) << np.uint64(2)
           | points["area"].astype(np.uint64) << np.uint64(9)
           | points["u"].astype(np.uint64) << np.uint64(17)
           | points["v"].astype(np.uint64) << np.uint64(35)
           | points["inverse_z"].astype(np.uint64) << np.uint64(53))
    high = points["inverse_z"].astype(np.uint64) >> np.uint64(11)
    octets = np.empty((len(points), _POINT_BYTES), np.uint8)
    octets[:, :8] = np.ascontiguousarray(low, dtype="<u8").view(np.uint8).reshape(-1, 8)
    octets[:, 8] = high
    return octets


def _escaped(content):
    return content.replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e")


def _closed(content):
    content += crc(content).to_bytes(CRC_BYTES, "little")
    return bytes([FLAG]) + _escaped(content) + bytes([FLAG])


def encode(frame, sequence=0):
    """Everything that is sent for ``frame``, exactly as the hardware does.

    Points go into packets in their order; a packet is closed when one more point might take it
    beyond :data:`WIRE_LIMIT` bytes on the wire. The frame's summary follows.

    Parameters
    ----------
    frame : :class:`Frame`
        The frame.
    sequence : :class:`int`
        Number of the first packet, 8 bits; zero after a reset.

    Returns
    -------
    tuple of :class:`bytes` and :class:`int`
        The bytes, and the number of the packet that comes next.
    """
    def header(kind):
        return bytes([kind, sequence]) + int(frame.number).to_bytes(2, "little")

    # The largest count at which a point that is all escapes, such a CRC and a flag still fit.
    room = WIRE_LIMIT - 2 * _POINT_BYTES - 2 * CRC_BYTES - 1
    wire, content, used = b"", b"", 0
    for octets in pack_points(frame.points):
        point = octets.tobytes()
        if content and used > room:
            wire += _closed(content)
            sequence = (sequence + 1) & 0xFF
            content = b""
        if not content:
            content = header(POINTS)
            used = 1 + len(_escaped(content))
        content += point
        used += len(_escaped(point))
    if content:
        wire += _closed(content)
        sequence = (sequence + 1) & 0xFF

    statuses = np.bincount(frame.points["status"], minlength=4)
    flags = int(frame.learning) | int(frame.broken) << 1
    content = header(FRAME) + bytes([frame.level, flags, frame.skipped, FORMAT_VERSION])
    for count in (frame.spots, *statuses[:3], frame.rejected + statuses[3], frame.dropped):
        content += (int(count) & 0xFFFF).to_bytes(2, "little")
    content += bytes([frame.bad_sync, frame.overrun])
    return wire + _closed(content), (sequence + 1) & 0xFF
