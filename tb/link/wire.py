"""A small encoder of the link for tests of the reader, slow and plain.

Written from the packets' description alone; shares nothing with the chip's model or the reader.
"""

import random
import zlib

import numpy as np

from scripts.host.messages import POINT
from tb.link.texture_bits import packets_of_row

__all__ = ["Wire", "bits_of_check", "make_frame", "packet"]

_LIMIT = 97


def cobs(octets):
    """COBS of less than 254 octets: each zero becomes the distance to the next one."""
    stuffed, places = [0, *octets, 0], []
    for place, octet in enumerate(stuffed):
        if octet == 0:
            places.append(place)
    for first, second in zip(places, places[1:], strict=False):
        stuffed[first] = second - first
    return bytes(stuffed[:-1])


def packet(content):
    """Content with check, COBS and both delimiters."""
    checked = content + zlib.crc32(content).to_bytes(4, "little")
    assert len(checked) <= _LIMIT
    return b"\0" + cobs(checked) + b"\0"


def bits_of_check(points):
    """CRC-16/IBM-SDLC over beam and inverse depth of ok points, bit by bit."""
    value = 0xFFFF
    for point in points:
        if point["status"] == 0:
            word = int(point["beam"]) | int(point["inverse_z"]) << 9
            for place in range(27):
                odd = (value ^ word >> place) & 1
                value = value >> 1 ^ (0x8408 if odd else 0)
    return value ^ 0xFFFF


def _record(point):
    word, place = int(point["status"]) | _code(int(point["area"])) << 9, 0
    for name, bits in (("beam", 18), ("saturated", 1), ("border", 1), ("u", 18), ("v", 18),
                       ("inverse_z", 18)):
        word |= int(point[name]) << place
        place += bits
    return word.to_bytes(10, "little")


def _code(area):
    """Nine bits of an area."""
    for least, step, first in ((512, 4, 384), (256, 2, 256)):
        if area >= least:
            return first + (area - least) // step
    return area


def _short(point, before):
    """Bits of a compact point and how many, `before` the v of the one before."""
    v, u, area = int(point["v"]), int(point["u"]), int(point["area"])
    step = v - before + 512
    flags = int(point["saturated"]) | int(point["border"]) << 1
    if 0 <= step < 1 << 12 and area < 64 and not flags:
        return 0 | step << 1 | u << 13 | area << 31, 37
    return 1 | v << 1 | u << 19 | _code(area) << 37 | flags << 46, 48


def make_frame(points, number=0, *, rejected=0, dropped=0, **fields):
    """A dictionary of a frame as the chip would tell it; `rejected` are those not passed on."""
    counts = [int(np.count_nonzero(points["status"] == status)) for status in range(4)]
    return {
        "number": number, "level": 640, "every": 1, "grey_noise": 284, "saturated": 77,
        "skipped": 0, "exposure_us": 500, "timestamp_us": 0,
        "check": bits_of_check(points), "spots": len(points) + rejected + dropped,
        "ok": counts[0], "noise": counts[1], "ambiguous": counts[2],
        "rejected": counts[3] + rejected, "dropped": dropped, "flags": 0x48, "points": points,
        **fields}


def random_points(rng, count, statuses=(0, 0, 0, 0, 1, 2, 3)):
    """Points of any value, in the order of v mostly."""
    points = np.zeros(count, POINT)
    v = 0
    for point in points:
        v = rng.randrange(1 << 18) if rng.random() < 0.1 else min(
            max(v + rng.randrange(-520, 4000), 0), (1 << 18) - 1)
        status = rng.choice(statuses)
        point["status"], point["u"], point["v"] = status, rng.getrandbits(18), v
        point["area"] = rng.choice([rng.randrange(64), rng.randrange(256),
                                    256 + 2 * rng.randrange(128), 512 + 4 * rng.randrange(128)])
        point["saturated"], point["border"] = rng.random() < 0.1, rng.random() < 0.1
        if status == 0:
            point["beam"], point["inverse_z"] = rng.getrandbits(7), rng.randrange(1, 1 << 18)
    return points


def random_frame(rng, number, count, **fields):
    """A frame of random points."""
    return make_frame(
        random_points(rng, count), number, level=rng.getrandbits(12), every=rng.getrandbits(4),
        grey_noise=rng.getrandbits(9), saturated=rng.getrandbits(19), skipped=rng.getrandbits(8),
        exposure_us=rng.getrandbits(16), rejected=rng.choice([0, rng.randrange(9)]),
        dropped=rng.choice([0, rng.randrange(400)]), **fields)


class Wire:
    """Packets numbered one after the other."""

    def __init__(self, sequence=0):
        self.sequence = sequence

    def packet(self, kind, body):
        """One packet."""
        octets = packet(bytes([kind, self.sequence]) + body)
        self.sequence = (self.sequence + 1) & 0xFF
        return octets

    def frame(self, frame, full=False):
        """Packets of a pattern frame, in a list."""
        points = frame["points"]
        listed = points if full else points[points["status"] != 0][:9]
        number = int(frame["number"])
        others = frame["noise"] + frame["ambiguous"] + frame["rejected"]
        unlisted = others - int(np.count_nonzero(listed["status"]))
        counts = [frame[name] for name in ("spots", "ok", "noise", "ambiguous", "rejected",
                                           "dropped")] + [unlisted]
        wide = max(counts) > 255
        trailer = (number.to_bytes(2, "little")
                   + (frame["level"] | frame["every"] << 12).to_bytes(2, "little")
                   + frame["grey_noise"].to_bytes(2, "little")
                   + frame["saturated"].to_bytes(3, "little") + bytes([frame["skipped"]])
                   + frame["exposure_us"].to_bytes(2, "little")
                   + (frame["timestamp_us"] & 0xFFFFFF).to_bytes(3, "little")
                   + frame["check"].to_bytes(2, "little")
                   + b"".join(int(count).to_bytes(1 + wide, "little") for count in counts)
                   + bytes([frame["flags"] & 0xFE | wide]))
        low = bytes([number & 0xFF])
        room = _LIMIT - 4 - 3
        packets = []
        if full:
            bodies = [b""]
            for point in points:
                if len(bodies[-1]) + 9 > room:
                    bodies.append(b"")
                bodies[-1] += _record(point)
            kinds = 0x52, 0x53
        else:
            bodies, word, size, before = [], 0, 0, 0
            for point in points[points["status"] == 0]:
                bits, length = _short(point, before)
                if size + length > 8 * room:
                    bodies.append(word.to_bytes(-(-size // 8), "little"))
                    word, size = 0, 0
                    bits, length = _short(point, 0)
                word |= bits << size
                size += length
                before = int(point["v"])
            bodies.append(word.to_bytes(-(-size // 8), "little"))
            kinds = 0x50, 0x51
        if len(bodies[-1]) + len(trailer) > room:
            bodies.append(b"")
        for body in bodies[:-1]:
            packets.append(self.packet(kinds[0], low + body))
        packets.append(self.packet(kinds[1], low + bodies[-1] + trailer))
        if not full and len(listed):
            packets.append(self.packet(0x54, low + b"".join(map(_record, listed))))
        return packets

    def texture(self, number, row, column, pixels):
        """Packets of a piece of a row of texture, without loss, in a list."""
        return [self.packet(0x58, body) for body in packets_of_row(number, row, column, pixels)]

    def texture_frame(self, number, *, skipped=0, exposure_us=10_000, timestamp_us=0, bad_sync=0,
                      overrun=0, flags=0xC0):
        """What is reported of a texture frame."""
        return self.packet(
            0x59, bytes([number & 0xFF]) + (number & 0xFFFF).to_bytes(2, "little")
            + bytes([skipped]) + exposure_us.to_bytes(2, "little")
            + (timestamp_us & 0xFFFFFF).to_bytes(3, "little") + bytes([bad_sync, overrun, flags]))

    def reply(self, tag, command, reason, data=b""):
        """The answer to a command."""
        return self.packet(0x5A, bytes([tag, command, reason]) + data)


def stream(rng, count, spots=40, full=False):
    """Frames with all other kinds of packets among them, and a list of packets of each."""
    wire, frames, pieces = Wire(), [], []
    for number in range(count):
        frame = random_frame(rng, 2 * number & 0xFFFF, rng.randrange(spots),
                             timestamp_us=40_000 * number)
        packets = wire.frame(frame, full)
        packets.append(wire.texture_frame(2 * number + 1, timestamp_us=40_000 * number + 20_000))
        for _ in range(2):
            packets += wire.texture(2 * number + 1, rng.randrange(288), 60 * rng.randrange(4),
                                    random.Random(number).randbytes(60))
        frames.append(frame)
        pieces.append(packets)
    return frames, pieces
