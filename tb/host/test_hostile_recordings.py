"""Recordings that nobody would send: one sentence or a report, soon, in little memory."""

import os
import random

import numpy as np
import pytest

from hdl.protocol import Command, PacketKind, Reason
from scripts.host.decoder import Decoder
from scripts.host.messages import POINT, Frame
from scripts.host.recorder import Recorder
from scripts.host.replay import Replay
from tb.host.bench import rows, run
from tb.host.hostile import bounded, identity, status
from tb.link.wire import Wire, make_frame

NOTHING = "holds no packet of the chip: name a link.raw"


def points(count=1, **fields):
    """Records of ok points."""
    some = np.zeros(count, POINT)
    for name, value in {"u": 9999, "v": 9999, "beam": 3, "area": 9, "inverse_z": 5000,
                        **fields}.items():
        some[name] = value
    return some


def good(number=2, count=1, full=True, **fields):
    """Packets of a frame with nothing wrong."""
    return lambda wire: b"".join(wire.frame(make_frame(points(count), number, **fields), full))


def pixel(number):
    """A packet of one pixel of texture."""
    return lambda wire: wire.texture(number, 0, 0, b"a")[0]


def reply(command, data, reason=Reason.OK):
    return lambda wire: wire.reply(7, command, reason, data)


def asked(**fields):
    return reply(Command.IDENTIFY, identity(**fields))


def together(*parts):
    return lambda wire: b"".join(part(wire) for part in parts)


def packets(kind, bodies):
    return lambda wire: b"".join(wire.packet(kind, body) for body in bodies)


def noise(count):
    return lambda _: random.Random(count).randbytes(count)


def all_kinds(wire):
    """Each kind of packet with bodies of each length."""
    rng = random.Random(1)
    return b"".join(wire.packet(kind, rng.randbytes(length)) for kind in (*PacketKind, 0, 99, 255)
                    for length in range(0, 91) for _ in range(3))


def wide(wire):
    """Counts of 65,535 and not one point."""
    return wire.packet(0x53, b"\4" + bytes([4, 0]) + bytes(15) + b"\xff" * 14 + b"\x49")


def never_ending(wire):
    """Points of one frame, more than its trailer could count."""
    return b"".join(wire.packet(0x52, b"\2" + (1).to_bytes(10, "little") * 8)
                    for _ in range(8500))


#: What a recording holds, in a function of a wire; with the calibration; status; words of the
#: sentence, or of the report.
RECORDINGS = {
    "nothing": (lambda _: b"", False, 2, NOTHING),
    "one zero": (lambda _: b"\0", False, 2, NOTHING),
    "zeros": (lambda _: bytes(1 << 20), False, 2, NOTHING),
    "more zeros than any line sends": (lambda _: bytes(9 << 20), False, 2, NOTHING),
    "no zero": (lambda _: b"\xff" * (9 << 20), False, 2, NOTHING),
    "zeros by turns": (lambda _: b"\1\0" * (1 << 20), False, 2, NOTHING),
    "noise": (noise(9 << 20), False, 2, NOTHING),
    "text": (lambda _: b"frame,beam,u_px\n" * 9999, False, 2, NOTHING),
    "a damaged packet": (lambda wire: wire.reply(1, 1, 0)[:-3] + b"xx\0", False, 2, NOTHING),
    "a packet, then zeros": (together(good(), lambda _: bytes(9 << 20)), False, 0, "1 frame"),
    "a packet, then noise": (together(good(), noise(1 << 20)), False, 0, "octets of garbage."),
    "a packet, then no zero": (together(good(), lambda _: b"a" * (1 << 20)), False, 0,
                               f"! {1 << 20} octets of garbage."),
    "a frame cut short": (lambda wire: good()(wire)[:-4], False, 2, NOTHING),
    "65535 x 65535 pixels": (asked(width=65535, height=65535), False, 2, "65535 x 65535 pixels"),
    "65535 x 16 pixels": (asked(width=65535, height=16), False, 2, "65535 x 16 pixels"),
    "0 x 0 pixels": (asked(width=0, height=0), False, 2, "0 x 0 pixels"),
    "1025 rows": (asked(height=1025), False, 2, "64 x 1025 pixels"),
    "0 beams": (asked(beams=0), False, 2, "and 0 beams"),
    "513 beams": (asked(beams=513), False, 2, "and 513 beams"),
    "the largest chip": (asked(width=1024, height=1024, beams=512), False, 3, "no frame came"),
    "another sensor": (asked(width=65), True, 2, "the chip has one of 65 x 64"),
    "other beams": (asked(beams=17), True, 2, "the chip is made for 17"),
    "another preset": (asked(preset=1), True, 2, "corrects whole images"),
    "an unknown preset": (asked(preset=200, clock=0, lanes=0), True, 3, "no frame came"),
    "another protocol": (asked(protocol=255), False, 2, "speaks version 255"),
    "no protocol": (asked(protocol=0), False, 2, "speaks version 0"),
    "other tables": (asked(tables=9), False, 2, "tables of version 9"),
    "an identity that is too short": (reply(Command.IDENTIFY, identity()[:-1]), False, 2,
                                      "has 11 octets, not 12"),
    "an identity that is too long": (reply(Command.IDENTIFY, identity() + bytes(70)), False, 2,
                                     "has 82 octets, not 12"),
    "an identity without octets": (reply(Command.IDENTIFY, b""), False, 2, "speaks version 0"),
    "two identities": (together(asked(), asked(width=512), good()), False, 0, "1 frame"),
    "a short status": (together(reply(Command.STATUS, b"\1"), good()), False, 0, "1 frame"),
    "a long status": (together(reply(Command.STATUS, bytes(80)), good()), False, 0, "1 frame"),
    "a trip without a cause": (together(reply(Command.STATUS, status(causes=0)), good(flags=0x68)),
                               False, 3, "had tripped in 1 frame; `cyclope"),
    "all causes of a trip": (together(reply(Command.STATUS, status(causes=255)), good(flags=0x68)),
                             False, 3, "it saw a pulse longer than the ceiling, a pulse too soon"),
    "unknown replies": (together(*(reply(command, bytes(9), reason) for command in (0, 5, 255)
                                   for reason in (0, 11, 200)), good()), False, 0, "1 frame"),
    "empty replies": (together(packets(0x5A, [b"", b"\1", b"\1\1"]), good()), False, 0,
                      "! 3 unknown packets."),
    "packets without a body": (together(packets(0x50, [b""]), packets(0, [b""]), good()), False, 0,
                               "! 2 unknown packets."),
    "all kinds in all lengths": (all_kinds, False, 2, "The points come in their compact form"),
    "all kinds, calibrated": (all_kinds, True, 3, "unknown packets."),
    "counts without points": (together(good(), wide), False, 0, "2 frames, 1 point"),
    "counts without points, calibrated": (wide, True, 3, ""),
    "a frame without an end": (never_ending, False, 3, ""),
    "trailers without a body": (together(packets(0x51, [bytes(9)]), packets(0x53, [bytes(9)]),
                                         good()), False, 0, "! 2 unknown packets."),
    "a trailer of another frame": (together(packets(0x53, [b"\7" + bytes(20)]), good()), False, 0,
                                   "! 1 unknown packet."),
    "beams that no table has": (good(beam=0), True, 3, "check failed, and none whose check is"),
    "beam 511": (lambda wire: b"".join(wire.frame(make_frame(points(beam=511), 2), True)), False, 0,
                 "1 frame, 1 point"),
    "a thousand points of one beam": (good(count=1000), False, 0, "1 frame, 1 point"),
    "points off the sensor": (lambda wire: b"".join(wire.frame(make_frame(
        points(9, u=(1 << 18) - 1, v=(1 << 18) - 1, area=255), 2), True)), True, 3, "check failed"),
    "compact points off the sensor": (lambda wire: b"".join(wire.frame(make_frame(
        points(9, u=(1 << 18) - 1, v=(1 << 18) - 1, area=255), 2))), True, 3, "check failed"),
    "compact points without a calibration": (good(full=False), False, 2, "--calibration"),
    "frame numbers in any order": (together(*(good(number) for number in (
        65535, 0, 32768, 1, 65534, 7, 40000))), False, 0, "7 frames"),
    "one frame many times": (together(*[good()] * 300), False, 0, "300 frames"),
    "gaps in the numbers of packets": (lambda wire: b"".join(
        good()(Wire(sequence)) for sequence in (0, 200, 100, 0, 255)), False, 0, "packets lost."),
    "fragments off the sensor": (lambda wire: b"".join([
        wire.texture_frame(3), *wire.texture(3, 1023, 1023, b"ab"),
        *wire.texture(3, 5, 1020, bytes(9)), *wire.texture(3, 0, 1023, b"ab"), good()(wire)]),
        False, 0,
        "! 3 image fragments dropped: they lie outside of the sensor."),
    "fragments in all corners": (lambda wire: b"".join([
        wire.texture_frame(3), *wire.texture(3, 1023, 1023, b"a"), *wire.texture(3, 0, 0, b"a"),
        good()(wire)]), False, 0, "1 frame"),
    "fragments that nobody announced": (together(good(), lambda wire: b"".join(
        wire.texture(9, row % 64, 0, bytes(80))[0] for row in range(500))), False, 0,
        "! 500 image fragments dropped: their frames were never announced."),
    "a fragment that nobody announced": (together(good(), pixel(9)), False, 0,
                                         "! 1 image fragment dropped: its frame was never announ"),
    "fragments without pixels": (together(packets(0x58, [bytes(4)]), good()), False, 0,
                                 "! 1 unknown packet."),
    "announced again and again": (lambda wire: good()(wire) + b"".join(
        wire.texture_frame(number & 0xFFFF) for number in range(0, 300_000, 300)), False, 0,
        "1 frame"),
    "images only, in the dark": (lambda wire: wire.texture_frame(3) + pixel(3)(wire),
                                 False, 3, "no pattern came, only images without the laser"),
    "packets that are too long": (together(good(), lambda _: b"\0" + b"\xfe" * 254 + b"\0"), False,
                                  0, "! 254 octets of garbage."),
}


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_recording(name, rig, tmp_path, capsys):
    content, calibrated, wanted, words = RECORDINGS[name]
    (tmp_path / "raw").write_bytes(content(Wire()))
    calibration = ["--calibration", rig[1]] if calibrated else []
    with bounded():
        code = run("receive", tmp_path / "raw", "-o", tmp_path / "out", *calibration)
    printed, error = capsys.readouterr()
    assert "Traceback" not in error and "fault of the program" not in error, error
    assert code == wanted, printed + error
    if code == 2:
        assert error.startswith("cyclope: ") and error.count("\n") == 1 and words in error
        assert [path.name for path in tmp_path.iterdir()] == ["raw"]
    else:
        assert error == "" and words in printed
        assert ("The result is not to be used." in printed) == (code == 3)
        for table in ("points.csv", "frames.csv"):
            assert all(None not in row.values() and None not in row
                       for row in rows(tmp_path / "out" / table))


@pytest.mark.parametrize("seed", range(12))
def test_packets_at_random(seed, rig, tmp_path, capsys):
    """Valid checks around anything, and changed octets in what is valid."""
    rng = random.Random(seed)
    wire = Wire()
    octets = b""
    for _ in range(400):
        some = rng.choice([
            lambda: wire.packet(rng.choice([*PacketKind]), rng.randbytes(rng.randrange(91))),
            lambda: good(rng.randrange(65536), rng.randrange(1, 9), rng.random() < 0.7)(wire),
            lambda: wire.texture_frame(rng.randrange(65536), flags=rng.randrange(256)),
            lambda: wire.reply(1, rng.randrange(12), rng.randrange(14),
                               rng.randbytes(rng.randrange(40))),
            lambda: rng.randbytes(rng.randrange(200))])()
        if rng.random() < 0.2:
            some = bytes(octet if rng.random() < 0.99 else rng.randrange(256) for octet in some)
        octets += some
    (tmp_path / "raw").write_bytes(octets)
    with bounded():
        code = run("receive", tmp_path / "raw", "-o", tmp_path / "out", "--calibration", rig[1])
    error = capsys.readouterr().err
    assert code in (0, 2, 3) and error.count("\n") == (code == 2)
    assert "Traceback" not in error and "fault of the program" not in error


def test_a_gigabyte_of_nothing(tmp_path, capsys, monkeypatch):
    """It is not read to its end."""
    real, done = Replay.read, []

    def read(self):
        octets = real(self)
        done.append(self.done)
        return octets

    monkeypatch.setattr(Replay, "read", read)
    with open(tmp_path / "raw", "wb") as file:
        os.truncate(file.fileno(), 1 << 30)
    with bounded():
        assert run("receive", tmp_path / "raw", "-o", tmp_path / "out") == 2
    assert NOTHING in capsys.readouterr().err and 0 < done[-1] < 1 << 23


def test_a_frame_without_an_end_is_cut():
    """No more points wait in memory than the counts of a trailer can hold."""
    octets = never_ending(Wire())
    sizes = [len(frame.points) for frame in Decoder().feed(octets + good(9)(Wire()))]
    assert sum(sizes) == 8 * 8500 + 1 and max(sizes) <= (1 << 16) + 8


def test_frames_of_years(rig, tmp_path):
    """Numbers beyond 32 bits."""
    with Recorder(tmp_path, rig[0]) as recorder:
        for index in (2**31, 2**40):
            recorder.take(Frame(index & 0xFFFF, index=index, spots=1, ok=1, points=points(),
                                verified=True, flags=0x48))
        recorder.finish()
    assert [row["frame"] for row in rows(tmp_path / "points.csv")] == [str(2**31), str(2**40)]
    assert f" {2**40} 0 " in (tmp_path / "points.ply").read_text()
