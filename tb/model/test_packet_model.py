"""Model of the link: vectors, size of packets, counts."""

import random

import numpy as np
import pytest

from hdl.link.packet import CRC
from model.link.packet import CRC_BYTES, POINT, WIRE_LIMIT, Frame, crc, encode, pack_points
from tb.link.vectors import FIELDS, random_frame, vectors


@pytest.mark.parametrize("vector", vectors(), ids=lambda vector: vector[0])
def test_vector(vector):
    _, frames, sequence, octets = vector
    got = b""
    for frame in frames:
        more, sequence = encode(frame, sequence)
        got += more
    assert got == octets


def test_crc():
    """The catalogued check value, and the hardware's algorithm on random octets."""
    assert crc(b"123456789") == 0x906E
    reference = CRC(8)
    assert reference.algorithm.crc_width == 8 * CRC_BYTES
    rng = random.Random(1)
    for size in (0, 1, 2, 22, 100):
        content = rng.randbytes(size)
        assert crc(content) == reference.compute(content)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("escapes", [False, True])
def test_no_packet_is_longer_than_a_radio_frame(seed, escapes):
    rng = random.Random(seed)
    for number in range(40):
        octets, _ = encode(random_frame(rng, 0x7D7E, number, escapes))
        assert octets.startswith(b"\x7e") and octets.endswith(b"\x7e")
        packets = [packet for packet in octets.split(b"\x7e") if packet]
        assert max(len(packet) for packet in packets) + 2 <= WIRE_LIMIT
        if not escapes:  # eight points at least, but for the last packet of points
            assert all(len(packet) + 2 >= 4 + 72 + 4 for packet in packets[:-2])


def test_each_field_has_its_bits():
    for name, place, bits in FIELDS:
        point = np.zeros(1, POINT)
        point[name] = (1 << bits) - 1
        word = int.from_bytes(pack_points(point).tobytes(), "little")
        assert word == ((1 << bits) - 1) << place


def test_packet_numbers_wrap():
    octets, sequence = encode(random_frame(random.Random(3), 1, 30), 254)
    assert [packet[1] for packet in octets.split(b"\x7e") if packet][:3] == [254, 255, 0]
    assert sequence < 10


def test_points_may_have_more_fields():
    points = np.zeros(3, [("other", float), *POINT.descr])
    points["u"] = 5
    assert encode(Frame(points=points))[0] == encode(
        Frame(points=np.array([(0, 0, 0, 5, 0, 0)] * 3, POINT)))[0]
