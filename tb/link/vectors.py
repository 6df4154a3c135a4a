"""Test vectors of the link: frames and the octets that they become.

``vectors.json`` is what the hardware, its model and the decoder are held to. The frames of all
vectors follow each other from a reset on, so the packets are numbered throughout. The file was
written by ``python -m tb.link.vectors`` and is not made anew by any test.
"""

import json
import random
from pathlib import Path

import numpy as np

from model.link.packet import POINT, Frame, encode

__all__ = ["FIELDS", "escaped_point", "random_frame", "vectors"]

PATH = Path(__file__).with_name("vectors.json")
#: Fields of a point on the wire: name, place, bits.
FIELDS = [("status", 0, 2), ("beam", 2, 7), ("area", 9, 8), ("u", 17, 18), ("v", 35, 18),
          ("inverse_z", 53, 18)]
_PLAIN = ["number", "level", "learning", "skipped", "spots", "rejected", "dropped", "broken",
          "bad_sync", "overrun"]


def escaped_point(rng, octets=9):
    """Fields of a point of which so many octets need an escape; the others are zero."""
    word = int.from_bytes(bytes(rng.choice([0x7D, 0x7E]) for _ in range(octets)), "little")
    return {name: word >> place & ((1 << bits) - 1) for name, place, bits in FIELDS}


def random_frame(rng, number, points, escapes=False):
    """A frame of ``points`` random points; with ``escapes`` all their octets need one."""
    table = np.zeros(points, POINT)
    for point in table:
        values = escaped_point(rng) if escapes else {
            name: rng.getrandbits(bits) for name, _, bits in FIELDS}
        for name, value in values.items():
            point[name] = value
    rejected, dropped = rng.randrange(1000), rng.randrange(1000)
    return Frame(
        points=table, number=number & 0xFFFF, level=rng.getrandbits(8),
        learning=bool(rng.getrandbits(1)), skipped=rng.getrandbits(8),
        spots=points + rejected + dropped, rejected=rejected, dropped=dropped,
        broken=bool(rng.getrandbits(1)))


def vectors():
    """Tuples of a name, the frames, the number of the first packet and the octets."""
    found = []
    for entry in json.loads(PATH.read_text())["vectors"]:
        frames = [
            Frame(points=np.array([tuple(point) for point in frame["points"]], POINT),
                  **{name: frame[name] for name in _PLAIN}) for frame in entry["frames"]]
        found.append((entry["name"], frames, entry["sequence"], bytes.fromhex(entry["octets"])))
    return found


def _write():
    rng = random.Random(2010)

    full = np.zeros(9, POINT)
    for name, _, bits in FIELDS:
        full[name] = (1 << bits) - 1
    cases = [
        ("a frame without spots", [Frame(number=1, level=40)]),
        ("a learning frame", [Frame(number=0, learning=True)]),
        ("one point of each status", [Frame(
            number=2, level=41, spots=5, rejected=1, points=np.array(
                [(0, 24, 17, 90112, 73728, 5120), (1, 0, 4, 512, 1024, 0),
                 (2, 0, 30, 100000, 4095, 0), (3, 0, 9, 180223, 147455, 0)], POINT))]),
        ("all bits set", [Frame(
            number=0xFFFF, level=255, learning=True, skipped=255, spots=0xFFFF, rejected=0xFFF6,
            dropped=0, broken=True, bad_sync=255, overrun=255, points=full)]),
        ("everything escaped", [random_frame(rng, 0x7E7D, 6, escapes=True)]),
        ("a full packet and one point more", [random_frame(rng, 300, 10)]),
        ("a broken frame between two good ones", [
            random_frame(rng, 10, 3), Frame(number=11, level=50, broken=True, spots=1, dropped=1,
                                            bad_sync=1), random_frame(rng, 12, 2)]),
        ("a frame of 49 points", [random_frame(rng, 4660, 49)]),
    ]
    entries, sequence = [], 0
    for name, frames in cases:
        octets, first = b"", sequence
        for one in frames:
            more, sequence = encode(one, sequence)
            octets += more
        entries.append({
            "name": name, "sequence": first,
            "frames": [{**{key: getattr(one, key) for key in _PLAIN},
                        "points": [[int(value) for value in point] for point in one.points]}
                       for one in frames],
            "octets": octets.hex()})
    lines = ",\n".join(json.dumps(entry) for entry in entries)
    PATH.write_text(f'{{"point": {json.dumps([name for name, _, _ in FIELDS])}, "vectors": [\n'
                    f"{lines}\n]}}\n")


if __name__ == "__main__":
    _write()
