"""Recordings: what is made of their octets, whatever these are."""

import numpy as np
import pytest

from scripts.host.image_assembly import ImageAssembly
from scripts.host.messages import POINT, TextureFrame, TexturePiece
from scripts.host.rebuild import Rebuilder
from scripts.host.recorder import Recorder
from tb.host.bench import load_chip, rows, run
from tb.link.wire import Wire, make_frame


def test_fragments_wait_until_their_frame_is_announced(tmp_path):
    """Which has the state of the laser. If that was lost they are left out, and counted; not so
    those of frames from before the recording."""

    def frame(index, laser):
        return TextureFrame(index, 0, 500, 0, 0, 0, 0x80 | laser << 3, index)

    def fragment(index, row):
        return TexturePiece(index, row, 0, np.full(2, 10 * index + row, np.uint8))

    with Recorder(tmp_path) as recorder:
        for event in (fragment(1, 0), fragment(2, 0), frame(2, True), fragment(2, 1),
                      frame(3, False), fragment(3, 1), fragment(4, 0), frame(4, True),
                      fragment(5, 1)):
            recorder.take(event)
        recorder.finish()
        images = {kind: each.image.tolist() for kind, each in recorder.images.items()}
        assert images == {"pattern": [[40, 40], [21, 21]], "texture": [[0, 0], [31, 31]]}
        assert recorder.orphans == 1
        for number in range(1000):
            recorder.take(fragment(9, number % 2))
        assert 900 < recorder.orphans < 1001


def ok_points(calibration, count=40):
    """Points that the chip would find, with beam and depth."""
    u, v = np.random.default_rng(1).integers(0, 512 * 64, (2, 4000))
    status, beam, inverse_z = Rebuilder(calibration.settings, 64, 64)(u, v)
    points = np.zeros(np.count_nonzero(status == 0), POINT)[:count]
    for name, values in (("u", u), ("v", v), ("beam", beam), ("inverse_z", inverse_z)):
        points[name] = values[status == 0][:count]
    return points


def test_points_are_trusted_once_a_check_was_right(rig, tmp_path):
    """Of a frame that lost a packet they count if the frames before agreed; an empty one does
    not agree to anything."""
    calibration, path = rig
    points = ok_points(calibration)
    wire = Wire()
    frames = [wire.frame(make_frame(some, 2 * number)) for number, some in enumerate(
        (points[:0], points, points[:9], points))]
    octets = b"".join(packet for number, packets in enumerate(frames) for packet in (
        packets[1:] if number in (1, 3) else packets))
    (tmp_path / "raw").write_bytes(octets)
    assert run("receive", tmp_path / "raw", "--calibration", path, "-o", tmp_path / "out") == 0
    assert [row["check"] for row in rows(tmp_path / "out" / "frames.csv")] == ["ok", "", "ok", ""]
    got = {(row["frame"], row["status"]) for row in rows(tmp_path / "out" / "points.csv")
           if row["status"] not in ("duplicate", "doubtful")}
    assert got == {("2", "unverified"), ("4", "ok"), ("6", "ok")}


def test_a_damaged_recording(terminal, rig, tmp_path):
    """Octets at random in place of some: it is read as far as it goes."""
    load_chip(terminal, rig)
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames", "20") == 0
    octets = bytearray((out / "link.raw").read_bytes())
    middle = len(octets) // 2
    octets[middle:middle + 500] = np.random.default_rng(1).bytes(700)
    (tmp_path / "raw").write_bytes(octets[:-7])
    assert run("receive", tmp_path / "raw", "--calibration", rig[1], "-o", tmp_path / "two") == 0
    # The time of a frame is in its last packet, which may be missing.
    good = {tuple(row.values())[:-1] for row in rows(out / "points.csv")}
    read = [tuple(row.values())[:-1] for row in rows(tmp_path / "two" / "points.csv")]
    assert len(read) > len(good) / 3 and set(read) <= good


def test_frames_with_faults(tmp_path):
    """The row of a frame has what is known of it; without its trailer that is incomplete."""
    points = np.zeros(30, POINT)
    points["v"], points["beam"], points["inverse_z"] = 999, 3, 5000
    wire = Wire()
    octets = b"".join(wire.frame(make_frame(points, 4, flags=0x18), full=True))
    broken = wire.frame(make_frame(points, 6, flags=0x24), full=True)
    octets += b"".join(broken[:-1])
    octets += b"".join(wire.frame(make_frame(points[:0], 8, flags=0x02, skipped=2), full=True))
    (tmp_path / "raw").write_bytes(octets)
    # The chip has no valid tables.
    assert run("receive", tmp_path / "raw", "-o", tmp_path / "out") == 3
    first, second, third = rows(tmp_path / "out" / "frames.csv")
    assert (first["number"], first["laser"], first["flags"]) == ("4", "on", "capture")
    assert (second["number"], second["flags"], second["laser"]) == ("6", "incomplete", "")
    assert (third["flags"], third["skipped"], third["lost_packets"]) == ("learning", "2", "0")
    assert second["lost_packets"] == "1"


def test_textures_of_unknown_size():
    """They grow with what comes; once the size is known they can be complete."""
    texture = ImageAssembly()

    def fragment(row, column, *pixels):
        return TexturePiece(0, row, column, np.array(pixels, np.uint8))

    assert not texture.add(fragment(1, 2, 7, 8))
    assert texture.image.tolist() == [[0, 0, 0, 0], [0, 0, 7, 8]]
    assert not texture.add(fragment(0, 0, 1, 2, 3, 4)) and texture.image.shape == (2, 4)
    assert not texture.add(fragment(1100, 0, 1)) and texture.outside == 1
    texture.resize((4, 2))
    assert not texture.add(fragment(0, 4, 1)) and not texture.add(fragment(2, 0, 1))
    assert texture.outside == 3
    assert texture.add(fragment(1, 0, 5, 6))
    assert texture.image.tolist() == [[1, 2, 3, 4], [5, 6, 7, 8]]
    assert not texture.add(fragment(0, 0, 1, 2, 3, 4)) and texture.add(fragment(1, 0, 5, 6, 7, 8))


@pytest.mark.parametrize("packets, more", [(0, 5), (0, 60), (1, 0), (1, 7), (2, 9)])
def test_the_frame_under_way_is_left_out(packets, more, rig, tmp_path, capsys):
    """The recording starts in the middle of a packet of a frame: neither counts as lost."""
    wire, points = Wire(), ok_points(rig[0])
    frames = [wire.frame(make_frame(points, number)) for number in (4, 6, 8)]
    assert len(frames[0]) == 3
    octets = b"".join(sum(frames, []))[len(b"".join(frames[0][:packets])) + more:]
    (tmp_path / "raw").write_bytes(octets)
    assert run("receive", tmp_path / "raw", "--calibration", rig[1], "-o", tmp_path / "out") == 0
    assert "!" not in capsys.readouterr().out
    got = rows(tmp_path / "out" / "frames.csv")
    assert [(row["number"], row["check"]) for row in got] == [("6", "ok"), ("8", "ok")]
    assert {row["frame"] for row in rows(tmp_path / "out" / "points.csv")} == {"6", "8"}


def test_a_frame_that_lost_packets_is_not_left_out(rig, tmp_path, capsys):
    """Not even the first one: the numbers of the packets tell."""
    wire, points = Wire(), ok_points(rig[0])
    first = wire.frame(make_frame(points, 4))
    octets = b"".join([first[0], first[2], *wire.frame(make_frame(points, 6))])
    (tmp_path / "raw").write_bytes(octets)
    assert run("receive", tmp_path / "raw", "--calibration", rig[1], "-o", tmp_path / "out") == 0
    assert "! 1 packet lost.\n" in capsys.readouterr().out
    assert [row["number"] for row in rows(tmp_path / "out" / "frames.csv")] == ["4", "6"]
