"""The host's decoder: vectors, pieces of any size, damage."""

import random
import time

import numpy as np
import pytest

from model.link.packet import Frame, encode
from scripts.decoder import Decoder
from tb.link.vectors import random_frame, vectors


def assert_same(got, frame):
    """A decoded frame tells what the chip told."""
    statuses = np.bincount(frame.points["status"], minlength=4)
    for name in ("number", "level", "learning", "broken", "skipped", "spots", "dropped",
                 "bad_sync", "overrun"):
        assert getattr(got, name) == getattr(frame, name), name
    assert (got.ok, got.noise, got.ambiguous) == tuple(statuses[:3])
    assert got.rejected == frame.rejected + statuses[3]
    assert np.array_equal(got.points, frame.points)
    assert got.complete and got.balanced and got.lost == 0


@pytest.mark.parametrize("vector", vectors(), ids=lambda vector: vector[0])
def test_vector(vector):
    _, frames, _, octets = vector
    decoder = Decoder()
    got = decoder.feed(octets)
    assert len(got) == len(frames)
    for mine, frame in zip(got, frames, strict=True):
        assert_same(mine, frame)
    assert not (decoder.garbage or decoder.damaged or decoder.unknown or decoder.lost
                or decoder.unbalanced)
    assert decoder.finish() == []


@pytest.mark.parametrize("seed", [1, 2])
def test_pieces_of_any_size(seed):
    """However the octets are cut, the frames are the same."""
    rng = random.Random(seed)
    octets = b"".join(entry[3] for entry in vectors())
    whole = Decoder().feed(octets)
    decoder, got = Decoder(), []
    while octets:
        size = rng.choice([1, 1, 2, 7, 100])
        got += decoder.feed(octets[:size])
        octets = octets[size:]
    assert len(got) == len(whole)
    for mine, other in zip(got, whole, strict=True):
        assert np.array_equal(mine.points, other.points) and mine.number == other.number


def stream(rng, count, points=30):
    """Frames and the octets of each."""
    frames, pieces, sequence = [], [], 0
    for number in range(count):
        frames.append(random_frame(rng, number, rng.randrange(points)))
        octets, sequence = encode(frames[-1], sequence)
        pieces.append(octets)
    return frames, pieces


def test_joins_anywhere():
    """A reader that comes late loses the packet it came into, and no other."""
    frames, pieces = stream(random.Random(4), 3)
    octets = b"".join(pieces)
    for begin in range(len(pieces[0])):
        got = Decoder().feed(octets[begin:])
        for mine, frame in zip(got[-2:], frames[-2:], strict=True):
            assert_same(mine, frame)


def test_lost_packets_are_counted():
    """A packet that is cut out is missed: by number, and by the balance of its frame."""
    frame = random_frame(random.Random(5), 9, 30)
    octets, sequence = encode(frame)
    packets = [b"\x7e" + packet + b"\x7e" for packet in octets.split(b"\x7e") if packet]
    after, _ = encode(Frame(number=10), sequence)
    for missing in range(1, len(packets) - 1):
        decoder = Decoder()
        got = decoder.feed(b"".join(packets[:missing] + packets[missing + 1:]) + after)
        assert len(got) == 2 and got[0].lost == 1 == decoder.lost
        assert not got[0].complete and got[0].balanced and got[1].complete
    decoder = Decoder()
    got = decoder.feed(b"".join(packets[:-1]) + after)
    assert [frame.summarised for frame in got] == [False, True]
    assert np.array_equal(got[0].points, frame.points) and not got[0].complete
    assert decoder.finish() == []
    assert Decoder().feed(b"".join(packets[:-1])) == []
    late = Decoder()
    late.feed(b"".join(packets[:-1]))
    assert len(late.finish()) == 1 and late.finish() == []


def test_counts_that_do_not_add_up():
    octets, _ = encode(Frame(number=1, spots=3, dropped=2))
    decoder = Decoder()
    assert not decoder.feed(octets)[0].balanced and decoder.unbalanced == 1


def test_unknown_packets_are_passed_over():
    """A type, a version or a length that is not known here hurts nobody."""
    from model.link.packet import crc
    decoder = Decoder()
    decoder.feed(encode(Frame())[0])
    for content in (b"\x54\x01\x00\x00hello", b"\x46\x02\x00\x00" + b"\x02" * 18,
                    b"\x50\x03\x00\x00" + b"\x01" * 8, b"\x50\x04\x00\x00"):
        assert decoder.feed(b"\x7e" + content + crc(content).to_bytes(2, "little") + b"\x7e") == []
    assert decoder.unknown == 4 and decoder.lost == 0 and decoder.damaged == 0
    got = decoder.feed(encode(Frame(number=7), 5)[0])
    assert got[0].number == 7 and got[0].lost == 0


def known(frames):
    """All points of all frames, and all summaries, to look up."""
    points = {frame.number: [point.tobytes() for point in frame.points] for frame in frames}
    return points, {frame.number: frame for frame in frames}


def assert_nothing_wrong(got, frames):
    """Whatever arrived was sent."""
    points, summaries = known(frames)
    for frame in got:
        assert frame.number in points
        sent = iter(points[frame.number])
        assert all(point.tobytes() in sent for point in frame.points), "a wrong point"
        if frame.summarised:
            truth = summaries[frame.number]
            assert (frame.level, frame.spots, frame.dropped) == (
                truth.level, truth.spots, truth.dropped)


@pytest.mark.parametrize("rate", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bit_errors(seed, rate):
    """No wrong packet is accepted, at most one good one is lost for an error, never stuck."""
    rng = random.Random(f"{seed} {rate}")
    frames, pieces = stream(rng, 200)
    clean = b"".join(pieces)
    packets = sum(1 for packet in clean.split(b"\x7e") if packet)
    noise = np.random.default_rng([seed, round(1 / rate)])
    flips = np.packbits(noise.random(8 * len(clean)) < rate)
    octets = (np.frombuffer(clean, np.uint8) ^ flips).tobytes()
    decoder = Decoder()
    got = decoder.feed(octets)
    errors = int(np.unpackbits(flips).sum())
    assert_nothing_wrong(got, frames)
    assert packets - decoder.packets <= errors
    assert decoder.packets > packets * (1 - rate) ** 800 - 30
    after, _ = encode(Frame(number=65535))
    assert decoder.feed(after + after)[-1].number == 65535


@pytest.mark.parametrize("seed", [1, 2])
def test_truncation_and_insertion(seed):
    """Runs of octets go missing or come from nowhere."""
    rng = random.Random(seed)
    frames, pieces = stream(rng, 200)
    octets = bytearray()
    cuts = 0
    for piece in pieces:
        if rng.random() < 0.3:
            at = rng.randrange(len(piece))
            length = rng.choice([1, 2, 5, 50, 300])
            if rng.random() < 0.5:
                piece = piece[:at] + piece[at + length:]
            else:
                piece = piece[:at] + rng.randbytes(length) + piece[at:]
            cuts += 1
        octets += piece
    decoder = Decoder()
    got = decoder.feed(octets)
    assert cuts > 30
    assert_nothing_wrong(got, frames)
    assert sum(frame.complete for frame in got) >= len(frames) - 2 * cuts
    after, _ = encode(Frame(number=65535))
    assert decoder.feed(after + after)[-1].number == 65535


@pytest.mark.parametrize("filler", [b"\x00", b"\x7e", b"\x7d", b"\x7d\x7e", b"\xff" * 99 + b"\x7e"])
def test_garbage_is_harmless(filler):
    decoder = Decoder()
    assert decoder.feed(filler * 20000) == []
    for _ in range(300):
        assert decoder.feed(filler) == []
    assert decoder.packets == 0
    got = decoder.feed(encode(Frame(number=3))[0])
    assert [frame.number for frame in got] == [3]


def test_random_garbage():
    """Octets at random rarely make a packet, and never an exception."""
    decoder = Decoder()
    octets = np.random.default_rng(1).integers(0, 256, 1_000_000, np.uint8).tobytes()
    assert decoder.feed(octets) == []
    assert decoder.garbage + decoder.damaged > 1000 and decoder.lost <= 255 * decoder.packets


def test_ten_megabytes():
    """Fast enough to replay a long recording."""
    frames, pieces = stream(random.Random(6), 64, 50)
    octets = b"".join(pieces)
    octets *= 10_000_000 // len(octets)
    decoder = Decoder()
    begin = time.perf_counter()
    got = decoder.feed(octets)
    took = time.perf_counter() - begin
    assert len(got) == 64 * (len(octets) // len(b"".join(pieces)))
    assert took < 15, f"{took:.1f} s"
