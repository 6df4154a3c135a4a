"""``cyclope receive`` from a port: what it writes, shows and reports."""

import os
import re
import signal
import threading
import time
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from calibration import file
from scripts.cyclope import live_line
from scripts.host.commands import Commands
from scripts.host.history import read_history
from scripts.host.image_assembly import ImageAssembly
from scripts.host.messages import POINT, Frame
from scripts.host.recorder import MISMATCH
from scripts.measure.formats import ply
from scripts.measure.surface import Surface
from scripts.results.drift import Drift
from scripts.results.points import OK
from tb.host.bench import (
    QUICK,
    TEXTURE,
    babbling,
    contents,
    load_chip,
    open_fake,
    open_rtl,
    rows,
    run,
    said,
    spots_sent,
    truth,
)
from tb.host.clouds import read_pcd, read_ply
from tb.system.fake_instrument import any_calibration, images


def test_load_run_receive_replay(each_terminal, rig, tmp_path, capsys):
    """All of it: what arrives is what the model makes of the same frames with the same tables."""
    (calibration, path), terminal = rig, each_terminal
    out, again = tmp_path / "out", tmp_path / "again"
    assert run("load", terminal.path, path, "--start", "--pattern-us", "400", *QUICK) == 0
    printed = capsys.readouterr().out
    for words in ("tables: valid", "laser: armed", "mode: continuous"):
        assert words in printed
    assert run("status", terminal.path, "--registers") == 0
    printed = capsys.readouterr().out
    assert "64 x 64" in printed and "continuous" in printed and "armed" in printed
    count = 30
    assert run("receive", terminal.path, "--calibration", path, "-o", out, "--frames", count) == 0
    assert f"{count} frames" in capsys.readouterr().out
    frames = rows(out / "frames.csv")
    patterns = [row for row in frames if row["kind"] == "pattern"]
    assert len(patterns) == count and len(frames) >= 2 * count - 2
    numbers = [int(row["number"]) for row in patterns]
    assert numbers == list(range(numbers[0], numbers[0] + 2 * count, 2))
    assert {(row["laser"], row["exposure_us"], row["check"], row["lost_packets"])
            for row in patterns} == {("on", "400", "ok", "0")}
    assert {row["laser"] for row in frames if row["kind"] == "texture"} == {"off"}
    times = [int(row["timestamp_us"]) for row in frames]
    assert times == sorted(times)

    wanted = truth(terminal.instrument, numbers, calibration)
    got = [tuple(row.values()) for row in rows(out / "points.csv")
           if row["status"] in ("ok", "doubtful")]
    assert len(got) > 100 and [row[:8] for row in got] == wanted
    at = {row["number"]: row["timestamp_us"] for row in patterns}
    assert {(row["frame"], row["time_us"]) for row in rows(out / "points.csv")} <= set(at.items())
    assert len(read_ply((out / "points.ply").read_bytes())[0]["x"]) == len(got)
    textures = sorted((out / "texture").iterdir())
    assert len(textures) >= 3
    for picture in [*textures, out / "texture.png"]:
        seen = cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE)
        assert np.abs(seen - TEXTURE.astype(int)).max() <= 2

    assert run("receive", out / "link.raw", "--calibration", path, "-o", again) == 0
    assert contents(out) == contents(again)


def test_a_capture_lights_the_laser(rig, tmp_path, capsys):
    """Without tables there is light only for as long as the capture was allowed to last."""
    with open_rtl(rig[0], images()) as terminal:
        assert run("load", terminal.path, "--capture-ms", "60000", "--start", *QUICK) == 0
        assert "laser: armed by the calibration capture" in capsys.readouterr().out
        out = tmp_path / "out"
        # Points need tables, which the chip does not have.
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames",
                   "6") == 3
        assert "! the chip had no valid tables in any frame that was lit" in (
            capsys.readouterr().out)
        last = [row for row in rows(out / "frames.csv") if row["kind"] == "pattern"][-1]
        assert last["laser"] == "on" and last["flags"] == "capture"
        assert run("load", terminal.path, "--capture-ms", "0", "--stop") == 0
        printed = capsys.readouterr().out
        assert "laser: disarmed: there are no valid tables" in printed
        assert "tables: none that are valid" in printed


def test_images_of_the_pattern(rig, tmp_path, capsys):
    """As they are wanted for a calibration: no table is there, and the laser is on."""
    shown = images()[:1]
    with open_rtl(rig[0], shown) as terminal:
        assert run("load", terminal.path, "--capture-ms", "60000", "--pattern-images", *QUICK) == 0
        assert "mode: pattern only, as images" in capsys.readouterr().out
        assert run("receive", terminal.path, "-o", tmp_path / "out", "--images", "1") == 0
        printed = capsys.readouterr().out
        assert "0 complete textures and 1 complete pattern in" in printed
        assert "no frame came" not in printed
        assert run("load", terminal.path, "--start", "--capture-ms", "0") == 3
        assert run("status", terminal.path, "--registers") == 3
        assert re.search(r"pattern_as_texture +0 ", capsys.readouterr().out)
    assert run("receive", tmp_path / "out" / "link.raw", "-o", tmp_path / "again") == 0
    whole, = (tmp_path / "out" / "pattern").iterdir()
    for picture in (whole, tmp_path / "out" / "pattern.png", tmp_path / "again" / "pattern.png"):
        assert np.array_equal(cv2.imread(picture, cv2.IMREAD_GRAYSCALE), shown[0])
    last = rows(tmp_path / "out" / "frames.csv")[-1]
    assert (last["kind"], last["laser"], last["flags"]) == ("texture", "on", "capture")
    # It was over too soon.
    octets = (tmp_path / "out" / "link.raw").read_bytes()
    (tmp_path / "raw").write_bytes(octets[:len(octets) * 2 // 3])
    capsys.readouterr()
    assert run("receive", tmp_path / "raw", "-o", tmp_path / "short", "--images", "1") == 3
    assert "! pattern.png is not complete: only " in capsys.readouterr().out


def test_images_in_the_dark(rig, tmp_path, capsys):
    """The capture was forgotten."""
    with open_rtl(rig[0], images()[:1]) as terminal:
        assert run("load", terminal.path, "--pattern-images", *QUICK) == 3
        assert run("receive", terminal.path, "-o", tmp_path / "dark", "--seconds", "2") == 3
        printed = capsys.readouterr().out
        assert "! no pattern came, only images without the laser: `cyclope load PORT --p" in printed
        assert run("status", terminal.path) == 3
        assert "pattern only, as images" in capsys.readouterr().out
        # A calibration is loaded to measure with.
        assert run("load", terminal.path, rig[1]) == 0
        assert "mode: pattern only\n" in capsys.readouterr().out


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_it_cleanly(number, terminal, rig, tmp_path, capsys):
    load_chip(terminal, rig)
    timer = threading.Timer(0.5, os.kill, (os.getpid(), number))
    timer.start()
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out) == 0
    assert "interrupted." in capsys.readouterr().out
    assert len(rows(out / "frames.csv")) > 2
    assert run("receive", out / "link.raw", "--calibration", rig[1], "-o", tmp_path / "two") == 0
    assert contents(out) == contents(tmp_path / "two")


def test_a_device_that_vanishes(rig, tmp_path, capsys):
    with open_fake(rig[0], images()) as terminal:
        load_chip(terminal, rig)
        timer = threading.Timer(0.5, terminal.close)
        timer.start()
        out = tmp_path / "out"
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", out) == 0
        timer.join()
        assert f"{terminal.path} is gone." in capsys.readouterr().out
    assert len(rows(out / "frames.csv")) > 2 and (out / "points.ply").exists()


def test_seconds(terminal, rig, tmp_path):
    """By the host's clock on a port, by the chip's in a recording."""
    load_chip(terminal, rig)
    begin = time.monotonic()
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--seconds",
               "0.6") == 0
    assert 0.5 < time.monotonic() - begin < 10
    frames = rows(out / "frames.csv")
    first = int(frames[0]["timestamp_us"])
    assert run("receive", out / "link.raw", "--calibration", rig[1], "-o", tmp_path / "two",
               "--seconds", "0.4") == 0
    short = rows(tmp_path / "two" / "frames.csv")
    assert short == frames[:len(short)] and len(short) < len(frames)
    assert int(short[-1]["timestamp_us"]) - first >= 400_000
    assert int(short[-2]["timestamp_us"]) - first < 400_000


def test_noise_is_counted_and_hurts_nothing(each_terminal, rig, tmp_path, capsys):
    """Whatever arrives through a bad line was sent."""
    terminal = each_terminal
    load_chip(terminal, rig, "--start", *QUICK)
    terminal.instrument.noise = 5e-4
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames", "24") == 0
    assert "packets lost" in capsys.readouterr().out
    lost = sum(int(row["lost_packets"] or 0) for row in rows(out / "frames.csv"))
    assert lost > 5
    got = [tuple(row.values()) for row in rows(out / "points.csv")]
    ok = [row[:8] for row in got if row[8] == "ok"]
    sent = spots_sent(terminal.instrument, {int(row[0]) for row in ok}, rig[0])
    assert len(ok) > 50 and set(ok) <= sent
    assert run("receive", out / "link.raw", "--calibration", rig[1], "-o", tmp_path / "two") == 0
    assert contents(out) == contents(tmp_path / "two")


def test_records_need_no_calibration(each_terminal, rig, tmp_path, capsys):
    """With records beam and check are there, and with the calibration so is the place."""
    terminal = each_terminal
    load_chip(terminal, rig, "--pattern-only", "--register", "full_records=1", "--register",
           "report_rejected=1", *QUICK)
    out = tmp_path / "out"
    assert run("receive", terminal.path, "-o", out, "--frames", "16") == 0
    got = rows(out / "points.csv")
    assert {row["status"] for row in got} > {"ok", "rejected"}
    assert all(row["beam"] and not row["z_mm"] for row in got if row["status"] == "ok")
    assert {row["check"] for row in rows(out / "frames.csv")} == {"ok"}
    assert {row["kind"] for row in rows(out / "frames.csv")} == {"pattern"}
    assert not (out / "texture.png").exists()
    again = tmp_path / "again"
    assert run("receive", out / "link.raw", "--calibration", rig[1], "-o", again) == 0
    places = [row for row in rows(again / "points.csv") if row["status"] == "ok"]
    assert places and all(row["z_mm"] for row in places)


def test_another_calibration_is_noticed(each_terminal, rig, tmp_path, capsys):
    """Points of a chip that was loaded with something else have no place."""
    terminal = each_terminal
    load_chip(terminal, rig, "--start", *QUICK)
    other = tmp_path / "other.json"
    file.save(any_calibration(rows=4, columns=4, seed=2), other)
    out = tmp_path / "out"
    capsys.readouterr()
    assert run("receive", terminal.path, "--calibration", other, "-o", out, "--frames", "10") == 3
    assert (f"! 10 frames whose check failed, and none whose check is right: {MISMATCH}."
            in capsys.readouterr().out)
    assert {row["check"] for row in rows(out / "frames.csv") if row["ok"]} == {"failed"}
    assert {(row["status"], row["beam"], row["z_mm"]) for row in rows(out / "points.csv")} <= {
        ("unverified", "", ""), ("noise", "", ""), ("ambiguous", "", ""), ("rejected", "", "")}
    assert "element vertex 0" in (out / "points.ply").read_text()


def test_last_frame_only(terminal, rig, tmp_path):
    load_chip(terminal, rig)
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames", "12",
               "--ply", "last") == 0
    found, _ = read_ply((out / "points.ply").read_bytes())
    last = [row for row in rows(out / "points.csv") if row["z_mm"]][-1]["frame"]
    assert set(found["frame"]) == {int(last)}


def test_compact_points_need_a_calibration(terminal, rig, tmp_path, capsys):
    """What came until that was found out can be replayed with it."""
    load_chip(terminal, rig)
    out = tmp_path / "out"
    assert run("receive", terminal.path, "-o", out) == 2
    sentence = said(capsys)
    assert sentence.startswith("The points come in their compact form, which needs the")
    assert sentence.endswith(f"`cyclope receive {out / 'link.raw'} -o OTHER --calibration FILE` "
                             "does it again.")
    assert run("receive", out / "link.raw", "-o", tmp_path / "two") == 2
    said(capsys)
    assert not (tmp_path / "two").exists()
    assert run("receive", out / "link.raw", "-o", tmp_path / "two", "--calibration", rig[1]) == 0


def test_a_wrong_speed_is_noticed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("scripts.cyclope.ending._GARBAGE_SECONDS", 0.4)
    with babbling(b"\xe0\x00\x1c\xff\x80") as path:
        begin = time.monotonic()
        assert run("receive", path, "-o", tmp_path / "out", "--baud", "9600") == 2
        assert time.monotonic() - begin < 10
    assert "is no packet: is --baud 9600 right, and is this the chip's port?" in said(capsys)
    assert list(tmp_path.iterdir()) == []


def test_silence_is_reported(tmp_path, capsys):
    with babbling(b"") as path:
        assert run("receive", path, "-o", tmp_path / "out", "--seconds", "0.2") == 2
        assert said(capsys).startswith(f"Nothing came from {path}: is the chip powered")
    assert list(tmp_path.iterdir()) == []


def test_a_stopped_chip_is_reported(each_terminal, tmp_path, capsys):
    assert run("receive", each_terminal.path, "-o", tmp_path / "out", "--seconds", "0.5") == 3
    assert "no frame came: `cyclope load PORT --start` starts the chip" in capsys.readouterr().out


def test_outputs_are_not_overwritten(terminal, tmp_path, capsys):
    (tmp_path / "mine").touch()
    assert run("receive", terminal.path, "-o", tmp_path) == 2
    assert "already holds files" in said(capsys)
    for words in (["--frames", "0"], ["--seconds", "-1"]):
        assert run("receive", terminal.path, "-o", tmp_path / "out", *words) == 2
        assert said(capsys).startswith(f"{words[0]} must be more than 0, not ")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_live_line(rig, monkeypatch):
    """Frame rate by the chip's clock, points, lost packets, laser, and what is wrong."""
    now = 100.0
    monkeypatch.setattr(live_line.time, "monotonic", lambda: now)
    line = live_line.LiveLine("tty")
    decoder = SimpleNamespace(octets=0, packets=0, lost=0)
    images = {kind: ImageAssembly((4, 2)) for kind in ("texture", "pattern")}
    recorder = SimpleNamespace(
        frames=0, last=None, complete={"texture": 2, "pattern": 1}, seen=set(), images=images,
        drift=None)
    assert str(line.text(decoder, recorder)) == "tty  nothing arrives"
    decoder.octets = 9
    assert str(line.text(decoder, recorder)) == "tty  nothing but garbage"
    decoder.packets = 1
    assert "`cyclope load PORT --start`" in str(line.text(decoder, recorder))
    recorder.seen.add("pattern")
    assert str(line.text(decoder, recorder)) == "tty  pattern: 1 complete images, 0% of the next"
    for frames in range(1, 20, 3):
        now += 0.2
        recorder.frames = frames
        recorder.last = Frame(7, spots=5, flags=0x48, index=7, timestamp_us=40_000 * frames,
                              points=np.zeros(4, POINT), verified=True)
        words = str(line.text(decoder, recorder))
    assert words == "tty  frame 7  25.0 frames/s   4 of 5 spots ok  2 textures  lost packets 0  " \
                    "laser on"
    recorder.drift = Drift(0.41, 0.2, ("focus", "base"))
    assert str(line.text(decoder, recorder)) == (
        f"{words}  across lines 0.41 px, moved: focus or base")
    now += 3
    recorder.last = Frame(8, flags=0x30, verified=False)
    decoder.lost = 3
    words = str(line.text(decoder, recorder))
    assert " 0.0 frames/s" in words and "lost packets 3" in words and MISMATCH in words
    assert "laser off, no valid tables, calibration capture, tripped: see `cyclope status`" in words


def test_a_single_pair(each_terminal, rig, tmp_path, capsys):
    """It is taken when the port is open, and received whole."""
    load_chip(each_terminal, rig, "--stop")
    out = tmp_path / "out"
    assert run("receive", each_terminal.path, "--single", "--calibration", rig[1], "-o", out) == 0
    assert "the pair is over." in capsys.readouterr().out
    kinds = [(row["kind"], row["laser"]) for row in rows(out / "frames.csv")]
    assert kinds[-2:] == [("pattern", "on"), ("texture", "off")] and kinds.count(kinds[-2]) == 1
    assert run("receive", out / "link.raw", "--calibration", rig[1], "-o", tmp_path / "two") == 0
    assert contents(out) == contents(tmp_path / "two")


def test_a_single_pair_that_does_not_come(rig, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Commands.__init__, "__defaults__", (0.05, 5, 0.2))
    with open_fake(rig[0], images()) as terminal:
        terminal.instrument.deaf = 99
        assert run("receive", terminal.path, "--single", "-o", tmp_path / "out") == 2
    assert said(capsys).startswith(
        f"The chip on {terminal.path} does not answer the command to take a single pair")
    (tmp_path / "raw").write_bytes(bytes(9))
    assert run("receive", tmp_path / "raw", "--single", "-o", tmp_path / "out") == 2
    assert "--single is for a chip" in said(capsys)


def test_a_chip_that_hears_nothing_is_received_from(terminal, rig, tmp_path, monkeypatch):
    """Frames are recorded, and counted, while answers are waited for in vain."""
    monkeypatch.setattr(Commands.__init__, "__defaults__", (30.0, 5, 0.2))
    load_chip(terminal, rig)
    terminal.instrument.deaf = 99
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames", "5") == 0
    numbers = [int(row["number"]) for row in rows(out / "frames.csv") if row["kind"] == "pattern"]
    assert numbers == list(range(numbers[0], numbers[0] + 10, 2))


def test_dark_frames_are_of_no_use(terminal, rig, tmp_path, capsys):
    """The chip runs, but nothing was loaded."""
    assert run("load", terminal.path, "--start") == 3
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", tmp_path / "out",
               "--frames", "5") == 3
    printed = capsys.readouterr().out
    assert "! the laser was off in all frames: the chip has no valid tables; `cyclope load PO" in (
        printed)
    assert printed.endswith("The result is not to be used.\n")
    assert len(rows(tmp_path / "out" / "frames.csv")) >= 5


def test_frames_without_points_are_of_no_use(rig, tmp_path, capsys):
    with open_fake(rig[0], [np.full((64, 64), 9, np.uint8)]) as terminal:
        load_chip(terminal, rig)
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", tmp_path / "out",
                   "--frames", "5") == 3
    assert "! no point in any frame: is anything in the range" in capsys.readouterr().out


def test_a_texture_needs_no_light(terminal, tmp_path, capsys):
    """As it is wanted for the photographs of a chessboard."""
    assert run("load", terminal.path, "--start") == 3
    capsys.readouterr()
    assert run("receive", terminal.path, "-o", tmp_path / "out", "--images", "1") == 0
    assert "!" not in capsys.readouterr().out
    picture = cv2.imread(str(tmp_path / "out" / "texture.png"), cv2.IMREAD_GRAYSCALE)
    assert np.array_equal(picture, TEXTURE)


def _by_frame(found):
    """Columns of each frame, by its number."""
    return {int(frame): {name: column[found["frame"] == frame] for name, column in found.items()}
            for frame in np.unique(found["frame"])}


def test_point_clouds_are_what_is_shown(terminal, rig, tmp_path):
    """Colour, normal and time of each point, in all files; replayed, the same octets again."""
    load_chip(terminal, rig)
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames", "30",
               "--pcd") == 0
    found, faces = read_ply((out / "points.ply").read_bytes())
    assert not len(faces)
    where = [row for row in rows(out / "points.csv") if row["z_mm"]]
    for name, kind in (("x", "x_mm"), ("y", "y_mm"), ("z", "z_mm"), ("beam", "beam"),
                       ("frame", "frame")):
        assert np.allclose(found[name], [float(row[kind]) for row in where], atol=1e-5)
    time_us = np.array([int(row["time_us"]) for row in where])
    assert len(set(np.round(found["time"] * 1e6) - time_us)) == 1
    # Grey until the pixel came, then the texture's.
    u, v = (np.array([round(float(row[name])) for row in where]) for name in ("u_px", "v_px"))
    came = found["red"] == TEXTURE[v, u]
    assert ((found["red"] == 128) | came).all() and came[-1] and not came.all()
    history = read_history(out / "link.raw", rig[0])
    for frame, shown in _by_frame(found).items():
        position = history.position(frame)
        moment, (grey, when) = history.moment(position), history.texture(position)
        same, _ = read_ply(ply(Surface(moment.points, rig[0]), grey, np.isfinite(when),
                               moment.seconds))
        order = np.argsort(shown["beam"], kind="stable")
        ok = order[shown["status"][order] == OK]
        for name, column in same.items():
            assert np.array_equal(column, shown[name][ok]), (frame, name)
    cloud = read_pcd((out / "points.pcd").read_bytes())
    assert all(np.array_equal(cloud[name], column) for name, column in found.items())

    words = ["receive", out / "link.raw", "--calibration", rig[1], "--pcd", "-o"]
    assert run(*words, tmp_path / "again") == 0
    assert contents(out) == contents(tmp_path / "again")
    for name in ("one", "two"):
        assert run(*words, tmp_path / name, "--ply", "each") == 0
    each = contents(tmp_path / "one")
    assert each == contents(tmp_path / "two") and "points.ply" not in each
    for frame, shown in _by_frame(found).items():
        single, _ = read_ply(each[f"points/{frame:04}.ply"])
        cloud = read_pcd(each[f"points/{frame:04}.pcd"])
        for name, column in shown.items():
            assert np.array_equal(single[name], column) and np.array_equal(cloud[name], column)


def test_an_interrupted_replay(terminal, rig, tmp_path, capsys, monkeypatch):
    """What was replayed until then is complete, and the exit status says that it is not all."""
    from scripts.host.replay import Replay
    load_chip(terminal, rig)
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames", "20") == 0
    real = Replay.read

    def read_and_interrupt(self):
        if self.done:
            os.kill(os.getpid(), signal.SIGINT)
        return real(self)

    monkeypatch.setattr("scripts.host.replay._CHUNK", 2000)
    monkeypatch.setattr(Replay, "read", read_and_interrupt)
    assert run("receive", out / "link.raw", "--calibration", rig[1], "-o", tmp_path / "two") == 130
    assert "interrupted." in capsys.readouterr().out
    some, all_rows = (rows(folder / "frames.csv") for folder in (tmp_path / "two", out))
    assert 0 < len(some) < len(all_rows) and some == all_rows[:len(some)]
    assert (tmp_path / "two" / "points.ply").exists()
