"""A pattern frame's points and counts as the contents of its packets; the numbers of fields and
kinds are those of ``hdl/protocol.py``, stated here once more."""

from dataclasses import dataclass, field

import numpy as np

from model.preprocessing.area import area_code

__all__ = ["POINT", "POINTS", "POINTS_LAST", "RECORDS", "RECORDS_LAST", "UNMATCHED", "PatternFrame",
           "check_word", "compact", "flags", "packets", "records"]

#: A point as the stereo unit gives it; beam and inverse_z are 0 unless it is ok, and inverse_z is
#: not 0 where it is.
POINT = np.dtype([("status", np.uint8), ("beam", np.uint16), ("area", np.uint16),
                  ("saturated", np.bool_), ("border", np.bool_), ("u", np.uint32),
                  ("v", np.uint32), ("inverse_z", np.uint32)])
POINTS, POINTS_LAST, RECORDS, RECORDS_LAST, UNMATCHED = range(0x50, 0x55)

_OK, _NOISE, _AMBIGUOUS, _REJECTED = range(4)
_CONTENT = 97 - 1 - 4  # of a packet, without its sequence number and its check
_HEAD = 2  # kind, number
_UNMATCHED_MOST = 9
_FLAGS = ("saturated", "border")


@dataclass(frozen=True)
class PatternFrame:
    """What the chip reports of a pattern frame.

    Parameters
    ----------
    points : structured array
        Fields of :data:`POINT`, in the order of their labels.
    number, level, every, grey_noise, saturated, skipped, exposure_us, timestamp_us : :class:`int`
        16, 12, 4, 9, 19, 8, 16 and 24 bits: frame number, level from which on a pixel is lit
        (unsigned Q8.4), which share of pattern frames is measured, the noise that the level is a
        multiple of (eighths of a grey value), pixels of grey value 255, frames that were skipped
        before this one, integration time and its start in microseconds. Preset ``paper`` has no
        noise and does not count saturated pixels: 0.
    learning, broken, laser, capture, tripped, tables_valid : :class:`bool`
        The noise was not learnt yet; the frame lost synchronism; the laser was lit; taken in
        calibration capture; the laser guard holds a cause; the tables are valid.
    spots, rejected, dropped : :class:`int`
        16 bits each: all components; those that were rejected or found no room before they
        became points.
    """

    points: np.ndarray = field(default_factory=lambda: np.zeros(0, POINT))
    number: int = 0
    level: int = 0
    every: int = 0
    grey_noise: int = 0
    saturated: int = 0
    skipped: int = 0
    exposure_us: int = 0
    timestamp_us: int = 0
    learning: bool = False
    broken: bool = False
    laser: bool = False
    capture: bool = False
    tripped: bool = False
    tables_valid: bool = False
    spots: int = 0
    rejected: int = 0
    dropped: int = 0


def check_word(points):
    """CRC-16/IBM-SDLC over beam and inverse_z of the ok points among ``points``."""
    register = 0xFFFF
    for point in points[points["status"] == _OK]:
        for bit in f"{int(point['inverse_z']):018b}{int(point['beam']):09b}"[::-1]:
            low = register & 1 ^ (bit == "1")
            register = register >> 1 ^ (0x8408 if low else 0)
    return register ^ 0xFFFF


def compact(point, v_before):
    """The bits of an ok point, the first one first, as a text of 0 and 1."""
    def field_bits(value, bits):
        return f"{int(value):0{bits}b}"[::-1]

    u, v, area = (int(point[name]) for name in ("u", "v", "area"))
    marked = bool(point["saturated"] or point["border"])
    step = v - v_before + 512
    if 0 <= step < 1 << 12 and area < 1 << 6 and not marked:
        return "0" + field_bits(step, 12) + field_bits(u, 18) + field_bits(area, 6)
    return ("1" + field_bits(v, 18) + field_bits(u, 18) + field_bits(area_code(area), 9)
            + "".join(field_bits(point[name], 1) for name in _FLAGS))


def records(points):
    """Points as records, an array (points, 10) of octets."""
    words = [int(point["status"]) | int(area_code(point["area"])) << 9
             | sum(int(point[name]) << place for name, place in (
                 ("beam", 0), ("saturated", 18), ("border", 19), ("u", 20), ("v", 38),
                 ("inverse_z", 56)))
             for point in points]
    return np.array([list(word.to_bytes(10, "little")) for word in words],
                    np.uint8).reshape(-1, 10)


def flags(wide=False, learning=False, broken=False, laser=False, capture=False, tripped=False,
          tables_valid=False, texture=False):
    """The octet ``flags``."""
    return sum(int(flag) << place for place, flag in enumerate(
        (wide, learning, broken, laser, capture, tripped, tables_valid, texture)))


def _octets(bits):
    bits += "0" * (-len(bits) % 8)
    return bytes(int(bits[at:at + 8][::-1], 2) for at in range(0, len(bits), 8))


def _in_packets(points, full_records):
    """Bodies that hold all points, as many in each as fit."""
    room = 8 * (_CONTENT - _HEAD)
    bodies, bits, v_before = [], "", 0
    for index, point in enumerate(points):
        if full_records:
            more = "".join(f"{octet:08b}"[::-1] for octet in records(points[index:index + 1])[0])
        else:
            more = compact(point, v_before)
        if len(bits) + len(more) > room:
            bodies.append(_octets(bits))
            bits, more = "", more if full_records else compact(point, 0)
        bits += more
        v_before = int(point["v"])
    return [*bodies, _octets(bits)]


def _trailer(frame, unlisted):
    statuses = np.bincount(frame.points["status"], minlength=4)
    counts = [frame.spots, *statuses[:_REJECTED], frame.rejected + statuses[_REJECTED],
              frame.dropped, unlisted]
    wide = max(counts) > 255
    fixed = b"".join(int(value).to_bytes(octets, "little") for value, octets in (
        (frame.number, 2), (frame.level | frame.every << 12, 2), (frame.grey_noise, 2),
        (frame.saturated, 3),
        (frame.skipped, 1), (frame.exposure_us, 2), (frame.timestamp_us, 3),
        (check_word(frame.points), 2)))
    return (fixed + b"".join(int(count).to_bytes(1 + wide, "little") for count in counts)
            + bytes([flags(wide, frame.learning, frame.broken, frame.laser, frame.capture,
                           frame.tripped, frame.tables_valid)]))


def packets(frame, full_records=False):
    """Contents of all packets of ``frame``: kind and body, without sequence number and check.

    Parameters
    ----------
    frame : :class:`PatternFrame`
        The frame; its counts must add up: spots = points + rejected + dropped.
    full_records : :class:`bool`
        All points in records of 9 octets, instead of the ok ones in the compact form.

    Returns
    -------
    list of :class:`bytes`
        In the order in which they are sent.
    """
    head = bytes([frame.number & 0xFF])
    ok = frame.points["status"] == _OK
    listed = frame.points if full_records else frame.points[ok]
    unmatched = frame.points[:0] if full_records else frame.points[~ok][:_UNMATCHED_MOST]
    unlisted = frame.rejected + (0 if full_records else np.count_nonzero(~ok) - len(unmatched))

    more, last = (RECORDS, RECORDS_LAST) if full_records else (POINTS, POINTS_LAST)
    bodies = _in_packets(listed, full_records)
    trailer = _trailer(frame, int(unlisted))
    if _HEAD + len(bodies[-1]) + len(trailer) > _CONTENT:
        bodies.append(b"")
    contents = [bytes([more]) + head + body for body in bodies[:-1]]
    contents.append(bytes([last]) + head + bodies[-1] + trailer)
    if len(unmatched):
        contents.append(bytes([UNMATCHED]) + head + records(unmatched).tobytes())
    return contents
