"""The host's decoder of the link: every kind of packet, pieces of any size, damage, noise."""

import random
import time

import numpy as np
import pytest

from model.link import framer
from model.link import points as points_model
from scripts.host.decoder import Decoder
from scripts.host.framing import Deframer, frame_packet
from scripts.host.messages import POINT, Frame, Reply, TextureFrame, TexturePiece
from scripts.host.rebuild import Rebuilder, point_check
from tb.link.frames import EXTREMES
from tb.link.noise import measure
from tb.link.wire import (
    Wire,
    bits_of_check,
    make_frame,
    packet,
    random_frame,
    random_points,
    stream,
)
from tb.system.stimuli import any_settings

FIELDS = ("number", "level", "every", "grey_noise", "saturated", "skipped", "exposure_us",
          "timestamp_us", "check", "spots", "ok", "noise", "ambiguous", "rejected", "dropped")


def clean(decoder):
    """Nothing was wrong with what the decoder saw."""
    return not (decoder.garbage or decoder.damaged or decoder.unknown or decoder.lost
                or decoder.unbalanced)


def same_points(got, points, full):
    """Ok points in their order without beam and depth, then the others."""
    if full:
        return np.array_equal(got, points)
    ok, others = points[points["status"] == 0].copy(), points[points["status"] != 0][:9]
    ok["beam"] = ok["inverse_z"] = 0
    return np.array_equal(got, np.concatenate([ok, others]))


def assert_same(got, frame, full=False):
    """A decoded frame tells what was sent."""
    for name in FIELDS:
        assert getattr(got, name) == frame[name], name
    assert got.flags & 0xFE == frame["flags"] & 0xFE
    assert same_points(got.points, frame["points"], full)
    assert got.complete and got.balanced and got.lost == 0 and got.compact is not full


@pytest.mark.parametrize("text", [
    b"", b"\0", b"\0\0", b"a", b"a\0", b"\0a", b"abc\0\0def", bytes(91), b"\xff" * 91,
    bytes(range(91)), b"\x01" * 91])
def test_framing(text):
    """The reader's packets are those of the tests' own encoder, and come back."""
    content = b"\x50\x07" + text
    octets = frame_packet(content)
    assert octets == packet(content)
    assert len(octets) <= 100 and octets[0] == octets[-1] == 0 and 0 not in octets[1:-1]
    assert Deframer().feed(octets) == [content]


def test_every_single_bit_counts():
    """A packet with any one bit turned over is refused, the check's own bits among them."""
    octets = packet(bytes([0x50, 0, 0, 7, 0, 255]))
    for bit in range(8, 8 * (len(octets) - 1)):
        wrong = bytearray(octets)
        wrong[bit // 8] ^= 1 << bit % 8
        assert Deframer().feed(wrong) == [], bit


def test_packet_of_known_octets():
    """The check of "123456789" is CBF43926, and COBS of zeros is as in the paper."""
    assert packet(b"123456789") == b"\0\x0e123456789\x26\x39\xf4\xcb\0"
    assert packet(bytes.fromhex("0011000000"))[:7] == bytes.fromhex("00010211010105")
    with pytest.raises(ValueError, match="at most 93 octets, not 94"):
        frame_packet(bytes(94))


@pytest.mark.parametrize("full", [False, True], ids=["compact", "records"])
@pytest.mark.parametrize("case", EXTREMES, ids=lambda case: case[0])
def test_frames_of_the_model(case, full):
    """What the chip's model sends arrives, and is what the tests' own encoder sends."""
    _, frame = case
    names = ("learning", "broken", "laser", "capture", "tripped", "tables_valid")
    flags = sum(getattr(frame, name) << bit for bit, name in enumerate(names, 1))
    wanted = make_frame(
        frame.points, frame.number, rejected=frame.rejected, dropped=frame.dropped, flags=flags,
        **{name: getattr(frame, name) for name in (
            "level", "every", "grey_noise", "saturated", "skipped", "exposure_us",
            "timestamp_us")})
    wanted["spots"] = frame.spots
    octets, _ = framer.frame(points_model.packets(frame, full), 250)
    assert octets == Wire(250).frame(wanted, full)
    decoder = Decoder()
    got, = decoder.feed(b"".join(octets))
    assert_same(got, wanted, full)
    assert clean(decoder) and [getattr(got, name) for name in names] == [
        getattr(frame, name) for name in names]


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_frames(seed, full):
    frames, pieces = stream(random.Random(seed), 60, 70, full)
    decoder = Decoder()
    got = decoder.feed(b"".join(octets for piece in pieces for octets in piece))
    assert len(got) == len(frames)
    for mine, frame in zip(got, frames, strict=True):
        assert_same(mine, frame, full)
        assert mine.verified is (True if full or not mine.ok else None)
    assert clean(decoder) and decoder.finish() == [] and decoder.mismatched == 0


def test_boundary_points():
    """All zeros, all ones, and steps of v at the limits of the short form."""
    for v in ([0, 0, 0], [262143] * 3, [1000, 488, 487], [0, 3583, 3583 + 3584], [511, 0, 262143]):
        for area in (0, 63, 64, 255, 256, 510, 512, 1020):
            points = np.zeros(3, POINT)
            points["v"], points["area"] = v, area
            points["u"] = [0, 1, 262143]
            wire = Wire()
            got, = Decoder().feed(b"".join(wire.frame(make_frame(points))))
            assert np.array_equal(got.points, points)


@pytest.mark.parametrize("count", [0, 1, 17, 18, 19, 20, 38, 48, 49, 50, 300])
def test_any_number_of_points(count):
    """Where points and trailer divide into packets does not matter."""
    rng = random.Random(count)
    for statuses in ((0,), (0, 1)):
        frame = make_frame(random_points(rng, count, statuses), 70)
        packets = Wire().frame(frame)
        assert max(map(len, packets)) <= 100
        decoder = Decoder()
        got, = decoder.feed(b"".join(packets))
        assert_same(got, frame)
        assert clean(decoder)


def test_flags():
    for bit, name in enumerate(("", "learning", "broken", "laser", "capture", "tripped",
                                "tables_valid")):
        if bit:
            frame = make_frame(np.zeros(0, POINT), 5, flags=1 << bit)
            got, = Decoder().feed(b"".join(Wire().frame(frame)))
            assert [name] == [each for each in ("learning", "broken", "laser", "capture", "tripped",
                                                "tables_valid") if getattr(got, each)]


def test_other_packets():
    wire = Wire(250)
    octets = (wire.texture_frame(0x1234, skipped=3, exposure_us=9000, timestamp_us=70_000,
                                 bad_sync=4, overrun=5, flags=0xC0)
              + wire.texture(0x1234, 287, 300, [1, 0, 255])[0] + wire.reply(7, 8, 9, b"\0data"))
    frame, piece, reply = Decoder().events(octets)
    assert frame == TextureFrame(0x1234, 3, 9000, 70_000, 4, 5, 0xC0, 0x1234)
    assert frame.tables_valid and not frame.laser
    assert isinstance(piece, TexturePiece)
    assert (piece.index, piece.row, piece.column) == (0x1234, 287, 300)
    assert piece.pixels.tolist() == [1, 0, 255]
    assert reply == Reply(7, 8, 9, b"\0data")


def test_counters_of_the_camera_come_with_the_next_frame():
    wire, empty = Wire(), np.zeros(0, POINT)
    octets = b"".join(wire.frame(make_frame(empty, 1)) + [
        wire.texture_frame(2, bad_sync=4, overrun=5)] + wire.frame(make_frame(empty, 3)))
    got = Decoder().feed(octets)
    assert [(frame.bad_sync, frame.overrun) for frame in got] == [(0, 0), (4, 5)]


def test_frame_waits_for_its_other_spots():
    """A frame ends with its last packet, or with the next packet where that is not it."""
    points = np.zeros(3, POINT)
    points["status"] = [0, 1, 3]
    frame = make_frame(points, 4)
    last, others = Wire().frame(frame)
    after = Wire(2).reply(1, 1, 0)
    decoder = Decoder()
    assert decoder.events(last) == []
    got, = decoder.events(others)
    assert got.complete
    decoder = Decoder()
    assert decoder.events(last) == []
    got, reply = decoder.events(after)
    assert isinstance(got, Frame) and not got.complete and got.balanced and got.ok == 1
    assert isinstance(reply, Reply) and decoder.lost == 1
    decoder = Decoder()
    decoder.feed(last)
    got, = decoder.finish()
    assert not got.complete and decoder.finish() == []


def test_pieces_of_any_size():
    """However the octets are cut, what they tell is the same."""
    rng = random.Random(2)
    _, pieces = stream(rng, 30)
    octets = b"".join(one for piece in pieces for one in piece)
    whole = list(map(repr, Decoder().events(octets)))
    decoder, got = Decoder(), []
    while octets:
        size = rng.choice([1, 1, 2, 7, 100])
        got += map(repr, decoder.events(octets[:size]))
        octets = octets[size:]
    assert got == whole


def test_joins_anywhere():
    """A reader that comes late loses the frame it came into, and no other."""
    frames, pieces = stream(random.Random(4), 3)
    pieces = [b"".join(piece) for piece in pieces]
    octets = b"".join(pieces)
    for begin in range(len(pieces[0])):
        got = Decoder().feed(octets[begin:])
        for mine, frame in zip(got[-2:], frames[-2:], strict=True):
            assert same_points(mine.points, frame["points"], False) and mine.complete


def test_lost_packets_are_counted():
    """A packet that is cut out is missed: by number, and by the counts of its frame."""
    rng = random.Random(5)
    frame = random_frame(rng, 0x109, 60)
    wire = Wire(200)
    packets = wire.frame(frame)
    after = b"".join(wire.frame(make_frame(np.zeros(0, POINT), 0x10A)))
    for missing in range(len(packets)):
        decoder = Decoder()
        decoder.feed(Wire(199).texture_frame(0x108))
        got = decoder.feed(b"".join(packets[:missing] + packets[missing + 1:]) + after)
        assert len(got) == 2 and decoder.lost == 1 and sum(each.lost for each in got) == 1
        assert not got[0].complete and got[0].balanced and got[1].complete
        assert got[0].number == 0x109 and got[0].verified is None
        assert got[0].summarised is (missing != len(packets) - 2)


def test_numbers_and_times_go_on():
    """Beyond 16 and 24 bits, with a texture frame that is late."""
    wire, decoder = Wire(), Decoder()
    empty = np.zeros(0, POINT)
    step, first = 20_000, 0xFFFF00
    got = []
    for position in range(0, 140_000, 16):
        octets = wire.frame(make_frame(
            empty, position & 0xFFFF, timestamp_us=first + position * step))
        if position:
            octets.append(wire.texture_frame(
                position - 1, timestamp_us=first + (position - 1) * step))
        got += [(event.index, event.timestamp_us) for event in decoder.events(b"".join(octets))]
    assert got == [
        (position, first + position * step) for index in range(0, 140_000, 16)
        for position in (index, index - 1) if position >= 0]


@pytest.mark.parametrize("beams, size", [(49, (352, 288)), (4, (64, 64))])
def test_rebuilt_points(beams, size):
    """Beam and depth come back bit for bit; the check tells what is not so."""
    settings = any_settings(*size, beams)
    rebuild = Rebuilder(settings, *size)
    rng = np.random.default_rng(1)
    u, v = (rng.integers(0, 512 * extent, 3000) for extent in size)
    status, beam, inverse_z = rebuild(u, v)
    ok = status == 0
    points = np.zeros(np.count_nonzero(ok), POINT)
    for name, values in (("u", u), ("v", v), ("beam", beam), ("inverse_z", inverse_z)):
        points[name] = values[ok]
    points = points[:49]
    assert len(points) > 40 and len(np.unique(points["beam"])) > min(beams, 20) // 2
    octets = b"".join(Wire().frame(make_frame(points)))
    decoder = Decoder(rebuild)
    got, = decoder.feed(octets)
    assert got.verified is True and np.array_equal(got.points, points)
    assert decoder.mismatched == 0

    # One unit of one depth, another beam of a point, another point, another calibration.
    for name in ("inverse_z", "beam"):
        wrong = points.copy()
        wrong[name][7] ^= 1
        got, = decoder.feed(b"".join(Wire().frame(make_frame(wrong))))
        assert got.verified is False
    off = points.copy()
    off["u"][3] ^= 64
    got, = decoder.feed(b"".join(Wire().frame(make_frame(off, check=bits_of_check(points)))))
    assert got.verified is False and decoder.mismatched == 3
    # A point that the calibration does not call ok, with a check that would fit it.
    off = points[:1].copy()
    off["u"], off["v"] = u[~ok][0], v[~ok][0]
    off["beam"] = off["inverse_z"] = 0
    got, = decoder.feed(b"".join(Wire().frame(make_frame(off))))
    assert got.verified is False and decoder.mismatched == 4
    other = Decoder(Rebuilder(any_settings(*size, beams, seed=2), *size))
    got, = other.feed(octets)
    assert got.verified is False and other.mismatched == 1


def test_point_check():
    """CRC-16/IBM-SDLC: the catalogue's check value, and the tests' own slow form."""
    text = int.from_bytes(b"123456789\0", "little")
    beam, inverse_z = ([text >> 25 * n & 0x7F for n in range(3)],
                       [text >> 25 * n + 7 & 0x3FFFF for n in range(3)])
    points = np.zeros(3, POINT)
    points["beam"], points["inverse_z"] = beam, inverse_z
    assert point_check(beam, inverse_z) == bits_of_check(points)
    rng = random.Random(1)
    for count in range(20):
        points = np.zeros(count, POINT)
        points["beam"] = [rng.getrandbits(7) for _ in range(count)]
        points["inverse_z"] = [rng.getrandbits(18) for _ in range(count)]
        assert point_check(points["beam"], points["inverse_z"]) == bits_of_check(points)
    assert point_check([], []) == 0


def test_counts_that_do_not_add_up():
    decoder = Decoder()
    got, = decoder.feed(b"".join(Wire().frame(make_frame(np.zeros(0, POINT), dropped=2, spots=3))))
    assert not got.balanced and decoder.unbalanced == 1


def test_unknown_packets_are_passed_over():
    """A kind or a length that is not known here hurts nobody."""
    wire, decoder = Wire(), Decoder()
    trailer = Wire().frame(make_frame(np.zeros(0, POINT), 1))
    decoder.feed(wire.frame(make_frame(np.zeros(0, POINT)))[0])
    bodies = [(0x57, b"hello"), (0x50, b""), (0x50, b"\1"), (0x50, b"\1\0\0\0\0"),
              (0x50, b"\1" + bytes(6)), (0x50, b"\1" + b"\xfe\x07" + bytes(7)), (0x51, b"\1"),
              (0x51, b"\1" + bytes(18)), (0x51, b"\1" + bytes(19)),
              (0x51, b"\0" + bytes(18) + b"\1"),
              (0x52, b"\1" + bytes(8)), (0x52, b"\1"), (0x53, b"\0" + bytes(20)),
              (0x54, b"\1"), (0x54, b"\1" + bytes(10)), (0x58, bytes(5)),
              (0x59, bytes(11)), (0x59, bytes(13)),
              (0x59, b"\1" + bytes(11)), (0x5A, bytes(2)), (0x5A, b"")]
    for kind, body in bodies:
        assert decoder.events(wire.packet(kind, body)) == [], (hex(kind), body)
    assert decoder.unknown == len(bodies) and decoder.lost == 0 and decoder.damaged == 0
    assert len(trailer) == 1
    got, = decoder.feed(b"".join(wire.frame(make_frame(np.zeros(0, POINT), 7))))
    assert got.number == 7 and got.lost == 0


@pytest.mark.parametrize("seed", [1, 2])
def test_packets_of_random_content_do_no_harm(seed):
    """Well formed packets that make no sense: nothing raises, and what follows is right."""
    rng = random.Random(seed)
    wire, decoder = Wire(), Decoder(Rebuilder(any_settings(352, 288, 49), 352, 288))
    for _ in range(3000):
        decoder.events(wire.packet(rng.choice([*range(0x50, 0x5B), rng.randrange(256)]),
                                   rng.randbytes(rng.choice([rng.randrange(30),
                                                             rng.randrange(92)]))))
    assert decoder.packets == 3000 and decoder.lost == 0
    decoder.feed(wire.texture_frame(1))
    frame = random_frame(rng, 2, 5)
    got = decoder.feed(b"".join(wire.frame(frame)))[-1]
    assert got.number == 2 and got.complete


def assert_harmless(figures):
    """Nothing wrong was accepted, no error cost more than the packet it hit, never stuck."""
    assert figures.wrong == 0 and figures.recovered
    assert figures.bystanders == 0 and figures.lost <= figures.hit <= figures.errors


@pytest.mark.parametrize("seed", range(1, 6))
def test_noise_on_the_line(seed):
    """A bit-error rate of 1e-4 over a million octets, on the bits of the octets."""
    figures = measure(1_000_000, 1e-4, seed)
    assert figures.octets >= 1_000_000 and figures.errors > 700
    assert_harmless(figures)


@pytest.mark.parametrize("seed", range(1, 6))
def test_noise_on_start_and_stop_bits(seed):
    """The same on the line itself, where an error may also shift the characters that follow."""
    figures = measure(300_000, 1e-4, seed, characters=True)
    assert figures.errors > 250
    assert_harmless(figures)


@pytest.mark.parametrize("characters", [False, True])
@pytest.mark.parametrize("rate", [1e-3, 1e-2])
def test_more_noise(rate, characters):
    assert_harmless(measure(200_000, rate, 1, characters))


@pytest.mark.parametrize("seed", [1, 2])
def test_truncation_and_insertion(seed):
    """Runs of octets go missing or come from nowhere."""
    rng = random.Random(seed)
    frames, pieces = stream(rng, 200)
    octets, cuts = bytearray(), 0
    for piece in map(b"".join, pieces):
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
    sent = {frame["number"]: frame for frame in frames}
    assert cuts > 30
    complete = [frame for frame in got if frame.complete]
    for frame in complete:
        assert same_points(frame.points, sent[frame.number]["points"], False)
    assert len(complete) >= len(frames) - 2 * cuts
    after = b"".join(Wire().frame(make_frame(np.zeros(0, POINT), 65535)))
    assert decoder.feed(after)[-1].number == 65535


@pytest.mark.parametrize("filler", [b"\0", b"\1\0", b"\xff", b"\xff" * 99 + b"\0", b"\x50" * 50])
def test_garbage_is_harmless(filler):
    decoder = Decoder()
    assert decoder.events(filler * 20000) == []
    for _ in range(300):
        assert decoder.events(filler) == []
    assert decoder.packets == 0
    got, = decoder.feed(b"".join(Wire().frame(make_frame(np.zeros(0, POINT), 3))))
    assert got.number == 3


def test_random_garbage():
    """Octets at random never make a packet, nor an exception."""
    decoder = Decoder()
    octets = np.random.default_rng(1).integers(0, 256, 1_000_000, np.uint8).tobytes()
    assert decoder.events(octets) == [] and decoder.packets == 0
    assert decoder.garbage + decoder.damaged > 1000


def test_long_recordings():
    """Fast enough to replay them: two minutes of the line at 115,200 baud."""
    _, pieces = stream(random.Random(6), 128, 50)
    octets = b"".join(one for piece in pieces for one in piece)
    octets *= 1_382_400 // len(octets)
    decoder = Decoder(Rebuilder(any_settings(352, 288, 49), 352, 288))
    begin = time.perf_counter()
    decoder.events(octets)
    took = time.perf_counter() - begin
    assert took < 30, f"{took:.1f} s"


@pytest.mark.parametrize("behind", [0, 1, 17, 60])
def test_texture_may_come_long_after_its_frame(behind):
    """Its packets wait in the chip while frames go on: their 8 bits of a number are of the past."""
    wire, decoder = Wire(), Decoder()
    for number in range(0, 400, 2):
        decoder.feed(b"".join(wire.frame(make_frame(np.zeros(0, POINT), number))))
    (piece,) = decoder.events(wire.texture(398 - behind, 3, 0, [1, 2, 3])[0])
    assert (piece.index, piece.row, piece.pixels.tolist()) == (398 - behind, 3, [1, 2, 3])
