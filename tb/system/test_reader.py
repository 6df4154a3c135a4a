"""``cyclope load``, ``status`` and ``receive`` across a pseudo-terminal."""

import csv
import os
import re
import signal
import threading
import time
from contextlib import contextmanager

import cv2
import numpy as np
import pytest

from calibration import file
from hdl.protocol import TABLE_VERSION, Command, Mode, Reason
from model.errors import UserError
from scripts.cyclope import cli
from scripts.host import port
from scripts.host.chip import REGISTERS, SENTENCES, Commands, RefusedError
from scripts.host.messages import POINT
from scripts.host.recorder import MISMATCH, Texture
from scripts.results.points import locate
from scripts.simulation.terminal import Terminal
from tb.link.wire import Wire, make_frame
from tb.system.fake_instrument import FakeInstrument, any_calibration, images
from tb.system.played_instrument import PlayedInstrument

TEXTURE = np.random.default_rng(1).integers(0, 256, (64, 64), np.uint8)


@contextmanager
def open_fake(calibration, shown, speed=8.0, **choices):
    """A fake instrument behind a pseudo-terminal."""
    fake = FakeInstrument(shown, len(calibration.settings.line), TEXTURE, **choices)
    with Terminal(fake, speed=speed) as terminal:
        yield terminal


@contextmanager
def open_rtl(calibration, shown):
    """The Verilated instrument behind a pseudo-terminal, as fast as it goes."""
    with Terminal(PlayedInstrument(shown, TEXTURE), step_us=250, speed=None) as terminal:
        yield terminal


#: The shortest period that the laser guard bears: less to simulate.
QUICK = ("--period-us", "20000")
#: What the reader is tested against: a context manager, given the calibration and the frames to
#: show, of something with the members of :class:`scripts.simulation.terminal.Terminal`.
INSTRUMENTS = {"fake": open_fake, "rtl": open_rtl}


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Calibration of a small sensor, and the file that holds it."""
    calibration = any_calibration(rows=4, columns=4)
    path = tmp_path_factory.mktemp("rig") / "calibration.json"
    file.save(calibration, path)
    return calibration, path


@pytest.fixture
def terminal(rig):
    """A fake instrument that nothing was loaded into."""
    with open_fake(rig[0], images()) as opened:
        yield opened


@pytest.fixture(params=INSTRUMENTS)
def each_terminal(request, rig):
    """Each of the instruments in turn; nothing was loaded into it."""
    with INSTRUMENTS[request.param](rig[0], images()) as opened:
        yield opened


def run(*words):
    """Exit status of a ``cyclope`` command."""
    return cli.main(list(words))


def rows(path):
    """Rows of a table."""
    with open(path) as text:
        return list(csv.DictReader(text))


def said(capsys):
    """The sentence on the error output."""
    error = capsys.readouterr().err
    assert error.startswith("cyclope: ") and error.count("\n") == 1, error
    return error[9:].strip()


def contents(folder):
    """All files below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes()
            for path in folder.rglob("*") if path.is_file()}


def expected(points, index, calibration):
    """Rows of points.csv for a frame; intensity does not show there."""
    located = locate(points, index, calibration, np.zeros((64, 64), np.uint8))
    return [(str(index), str(point["beam"]), f"{point['u']:.4f}", f"{point['v']:.4f}",
             str(point["area"]), *(f"{point[name]:.4f}" for name in "xyz")) for point in located]


def truth(instrument, numbers, calibration):
    """What the model finds in frames: rows of points.csv, by the frame."""
    from model.capsule import Capsule
    model = Capsule(calibration.settings, 64, 64)
    found = [model.frame(image).points for image in instrument.shown]
    found = [points[points["status"] == 0] for points in found]
    return {number: expected(found[instrument.pattern(number)], number, calibration)
            for number in numbers}


def test_load_run_receive_replay(each_terminal, rig, tmp_path, capsys):
    """All of it: what arrives is what the model makes of the same frames with the same tables."""
    (calibration, path), terminal = rig, each_terminal
    out, again = tmp_path / "out", tmp_path / "again"
    assert run("load", terminal.path, path, "--start", "--pattern-us", "400", *QUICK) == 0
    told = capsys.readouterr().out
    assert "tables: valid" in told and "laser: armed" in told and "mode: continuous" in told
    assert run("status", terminal.path, "--registers") == 0
    told = capsys.readouterr().out
    assert "64 x 64" in told and "continuous" in told and "armed" in told
    count = 30
    assert run("receive", terminal.path, "--calibration", path, "-o", out, "--frames", count) == 0
    assert f"{count} frames" in capsys.readouterr().out
    frames = rows(out / "frames.csv")
    patterns = [row for row in frames if row["kind"] == "pattern"]
    assert len(patterns) == count and len(frames) >= 2 * count - 2
    numbers = [int(row["number"]) for row in patterns]
    assert numbers == list(range(numbers[0], numbers[0] + 2 * count, 2))
    assert {(row["laser"], row["exposure_us"], row["check"], row["lost_packets"])
            for row in patterns[1:]} == {("on", "400", "ok", "0")}
    assert {row["laser"] for row in frames if row["kind"] == "texture"} == {"off"}
    times = [int(row["timestamp_us"]) for row in frames]
    assert times == sorted(times)

    # The reader may come in the middle of the first frame.
    first = numbers[0] if patterns[0]["check"] == "ok" else numbers[1]
    wanted = sum(truth(terminal.instrument, numbers, calibration).values(), [])
    got = [tuple(row.values()) for row in rows(out / "points.csv") if row["status"] == "ok"]
    assert len(got) > 100 and [row[:-1] for row in got if int(row[0]) >= first] == [
        row for row in wanted if int(row[0]) >= first]
    header = (out / "points.ply").read_text().split("end_header\n")
    assert f"element vertex {len(got)}" in header[0] and header[1].count("\n") == len(got)
    textures = sorted((out / "texture").iterdir())
    assert len(textures) >= 3
    for picture in [*textures, out / "texture.png"]:
        assert np.array_equal(cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE), TEXTURE)

    assert run("receive", out / "link.raw", "--calibration", path, "-o", again) == 0
    assert contents(out) == contents(again)


def test_load_stops_and_goes_on(each_terminal, rig, capsys):
    """Without a mode the chip goes on as it was; without a calibration only the rest is done."""
    terminal = each_terminal

    def registers(*names):
        with port.open_port(terminal.path) as opened:
            asking = Commands(opened)
            return [asking.read(name) for name in names]

    assert run("load", terminal.path, rig[1]) == 0
    assert registers("mode") == [Mode.STOP]
    assert "mode: stopped" in capsys.readouterr().out
    assert run("load", terminal.path, "--pattern-only") == 0
    assert registers("mode") == [Mode.PATTERN]
    assert run("load", terminal.path, rig[1], "--register", "full_records=1") == 0
    assert registers("mode", "full_records") == [Mode.PATTERN, 1]
    wanted = rig[0].settings.registers()
    for (name, value), got in zip(wanted.items(), registers(*wanted), strict=True):
        assert got & 0x3FFFF == value, name
    assert run("load", terminal.path, "--single") == 0
    assert run("load", terminal.path, "--stop", "--texture-us", "1234", "--period-us",
               "50000") == 0
    assert "texture_us = 1234" in capsys.readouterr().out
    assert registers("mode", "texture_us", "period_us") == [Mode.STOP, 1234, 50_000]


def test_the_guard_s_causes_are_told(rig, tmp_path, capsys):
    """Light for longer than the ceiling is cut, flagged in the frames, and told until cleared."""
    with open_rtl(rig[0], images()) as terminal:
        loaded(terminal, rig, "--start", "--pattern-us", "2500", *QUICK)
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", tmp_path / "out",
                   "--frames", "6") == 0
        last = rows(tmp_path / "out" / "frames.csv")[-1]
        assert "tripped" in last["flags"].split()
        capsys.readouterr()
        assert run("status", terminal.path) == 0
        assert "a pulse longer than the ceiling" in " ".join(capsys.readouterr().out.split())
        assert run("load", terminal.path, "--pattern-us", "500", "--stop") == 0
        assert "the guard saw" in capsys.readouterr().out
        # The guard misses its heartbeat a while after the stop; that is the last that it notes.
        for _ in range(100):
            assert run("status", terminal.path) == 0
            if "frames that stopped coming" in " ".join(capsys.readouterr().out.split()):
                break
        assert run("load", terminal.path, "--clear", "--start") == 0
        assert "laser: armed\n" in capsys.readouterr().out


def test_a_capture_lights_the_laser(rig, tmp_path, capsys):
    """Without tables there is light only for as long as the capture was allowed to last."""
    with open_rtl(rig[0], images()) as terminal:
        assert run("load", terminal.path, "--capture-ms", "60000", "--start", *QUICK) == 0
        assert "laser: armed by the calibration capture" in capsys.readouterr().out
        out = tmp_path / "out"
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames",
                   "6") == 0
        last = [row for row in rows(out / "frames.csv") if row["kind"] == "pattern"][-1]
        assert last["laser"] == "on" and last["flags"] == "capture"
        capsys.readouterr()
        assert run("load", terminal.path, "--capture-ms", "0", "--stop") == 0
        told = capsys.readouterr().out
        assert "laser: disarmed: there are no valid tables" in told
        assert "tables: none that are valid" in told


def test_pictures_of_the_pattern(rig, tmp_path, capsys):
    """As they are wanted for a calibration: no table is there, and the laser is on."""
    shown = images()[:1]
    with open_rtl(rig[0], shown) as terminal:
        assert run("load", terminal.path, "--capture-ms", "60000", "--pattern-images", *QUICK) == 0
        assert "mode: pattern only, as pictures" in capsys.readouterr().out
        assert run("receive", terminal.path, "-o", tmp_path / "out", "--images", "1") == 0
        told = capsys.readouterr().out
        assert "0 whole textures and 1 whole pattern in" in told and "no frame came" not in told
        assert run("load", terminal.path, "--start", "--capture-ms", "0") == 0
        assert run("status", terminal.path, "--registers") == 0
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
    assert run("receive", tmp_path / "raw", "-o", tmp_path / "short", "--images", "1") == 0
    assert "! pattern.png is not whole, only " in capsys.readouterr().out


def test_pictures_in_the_dark(rig, tmp_path, capsys):
    """The capture was forgotten."""
    with open_rtl(rig[0], images()[:1]) as terminal:
        assert run("load", terminal.path, "--pattern-images", *QUICK) == 0
        assert run("receive", terminal.path, "-o", tmp_path / "dark", "--images", "1") == 0
        told = capsys.readouterr().out
        assert "! no pattern came, only pictures without the laser: `cyclope load PORT --p" in told
        assert run("status", terminal.path) == 0
        assert "pattern only, as pictures" in capsys.readouterr().out
        # A calibration is loaded to measure with.
        assert run("load", terminal.path, rig[1]) == 0
        assert "mode: pattern only\n" in capsys.readouterr().out


def test_pieces_wait_for_what_tells_of_their_frame(tmp_path):
    """Whether the laser was on. Where that was lost they are left out, and counted."""
    from scripts.host.messages import TextureFrame, TexturePiece
    from scripts.host.recorder import Recorder

    def frame(index, laser):
        return TextureFrame(index, 0, 500, 0, 0, 0, 0x80 | laser << 3, index)

    def piece(index, row):
        return TexturePiece(index, row, 0, np.full(2, 10 * index + row, np.uint8))

    with Recorder(tmp_path) as recorder:
        for event in (piece(1, 0), piece(2, 0), frame(2, True), piece(2, 1), frame(3, False),
                      piece(3, 1), piece(4, 0), frame(4, True), piece(5, 1)):
            recorder.take(event)
        recorder.finish()
        images = {kind: picture.image.tolist() for kind, picture in recorder.pictures.items()}
        assert images == {"pattern": [[40, 40], [21, 21]], "texture": [[0, 0], [31, 31]]}
        assert recorder.unplaced == 2
        for number in range(1000):
            recorder.take(piece(9, number % 2))
        assert 900 < recorder.unplaced < 1002


def test_capture_and_causes(terminal, capsys):
    terminal.instrument.guard_causes = 0b10010
    assert run("load", terminal.path, "--capture-ms", "60000", "--start") == 0
    told = capsys.readouterr().out
    assert ("laser: armed by the calibration capture; the guard saw a pulse too soon after "
            "another, frames that stopped coming") in told
    assert "tables: none that are valid" in told
    assert run("load", terminal.path, "--clear", "--capture-ms", "0", "--stop") == 0
    assert "laser: disarmed: there are no valid tables\n" in capsys.readouterr().out
    assert terminal.instrument.guard_causes == 0


@pytest.mark.parametrize("words, sentence", [
    (["--pattern-us", "70000"], "pattern_us must be 1 to 65535, not 70000."),
    (["--register", "threshold_alpha=0x100"], "threshold_alpha must be 0 to 255, not 256."),
    (["--register", "tangential_1=-131073"],
     "tangential_1 must be -131072 to 131071, not -131073."),
    (["--register", "erosion_mode=3"], "erosion_mode must be 0 to 2, not 3."),
    (["--register", "threshold_alpha"],
     "--register takes NAME=VALUE with a whole number, not 'threshold_alpha'."),
    (["--register", "beta=1"], "There is no register 'beta'; there are: mode, "),
    (["--register", "mode=1"],
     "Choose the mode by one of --start, --stop, --single, --pattern-only, --pattern-images."),
    (["--register", "divisor=16"],
     "divisor is the speed of this very line, which this program does not change."),
    (["--capture-ms", "65536"], "--capture-ms must be 0 to 65535, not 65536.")])
def test_bad_values_never_reach_the_chip(words, sentence, terminal, capsys):
    assert run("load", terminal.path, *words) == 2
    assert said(capsys).startswith(sentence)
    assert terminal.instrument.counters["accepted"] == 0


@pytest.mark.parametrize("beams, size, versions, sentence", [
    (16, (64, 48), (3, 1), "The calibration is for a sensor of 64 x 64 pixels, the chip has one of "
     "48 x 64: calibrate this rig."),
    (9, (64, 64), (3, 1), "The calibration has 16 beams, the chip is made for 9: calibrate this "
     "rig."),
    (16, (64, 64), (2, 1), "The chip speaks version 2 of the protocol, this program version 3: use "
     "the program of the chip's version."),
    (16, (64, 64), (3, 9), "The chip takes tables of version 9, this program has those of version "
     "1: use the program of the chip's version.")])
def test_other_chips_are_refused(beams, size, versions, sentence, rig, tmp_path, capsys):
    """Before anything is changed, and by the receiver before anything is written."""
    fake = FakeInstrument([np.zeros(size, np.uint8)], beams, None, *versions)
    with Terminal(fake, speed=8.0) as terminal:
        assert run("load", terminal.path, rig[1], "--start") == 2
        assert said(capsys) == sentence
        assert fake.registers["mode"] == Mode.STOP and not fake.machine.begun
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", tmp_path / "out") == 2
        assert said(capsys) == sentence
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("choices, sentence", [
    ({"width": 48}, "The calibration is for a sensor of 48 x 64 pixels, the chip has one of "
     "64 x 64: calibrate this rig."),
    ({"rows": 3}, "The calibration has 12 beams, the chip is made for 16: calibrate this rig."),
    ({"remap": tuple(range(64 * 64))},
     "The calibration is for a chip that corrects whole images")])
def test_calibrations_for_other_chips_are_refused(choices, sentence, each_terminal, tmp_path,
                                                  capsys):
    """Before anything is changed, and by the receiver before anything is written."""
    path = tmp_path / "calibration.json"
    file.save(any_calibration(**{"rows": 4, "columns": 4, **choices}), path)
    assert run("load", each_terminal.path, path, "--start") == 2
    assert said(capsys).startswith(sentence)
    assert run("receive", each_terminal.path, "--calibration", path, "-o", tmp_path / "out") == 2
    assert said(capsys).startswith(sentence)
    assert run("status", each_terminal.path) == 0
    told = capsys.readouterr().out.split()
    assert "stopped" in told and "none" in told and not (tmp_path / "out").exists()


def test_versions_agree():
    """A calibration file of this version is made for tables of this version."""
    assert file.VERSION == TABLE_VERSION
    assert set(any_calibration().settings.registers()) < set(REGISTERS)


@contextmanager
def commands(terminal, **choices):
    """Commands to an instrument, that do not wait long."""
    with port.open_port(terminal.path) as opened:
        yield Commands(opened, **{"timeout": 0.15, "patience": 0.3, **choices})


@pytest.mark.parametrize("kind, fault, at", [
    *(("fake", fault, at) for fault in ("deaf", "damaging", "mute", "busy")
      for at in (0, 1, 40, 80, *range(111, 115))),
    *(("rtl", fault, at) for fault in ("deaf", "damaging", "mute") for at in (40, 113))])
def test_a_lost_command_or_answer_is_sent_again(kind, fault, at, rig):
    """Whichever it is, the tables are loaded in the end."""
    calibration, _ = rig
    with INSTRUMENTS[kind](calibration, images()) as terminal:
        instrument, count = terminal.instrument, 0
        hear = instrument._take

        def counted(content):
            nonlocal count
            if count == at:
                setattr(instrument, fault, 2)
            count += 1
            hear(content)

        instrument._take = counted
        from scripts.host.loading import load
        with commands(terminal, timeout=0.08 if kind == "fake" else 0.5, patience=5.0) as asking:
            load(asking, calibration)
            asking.write("mode", Mode.CONTINUOUS)
            end = time.monotonic() + 5
            while not (valid := asking.status()["state"].tables_valid) and time.monotonic() < end:
                pass
        assert valid and getattr(instrument, fault) == 0 and count > at + 2


def test_no_answer_is_told_apart(rig):
    """A chip that is not there, one that does not hear, one that is damaged, garbage."""
    with open_fake(rig[0], images()) as terminal, commands(terminal, tries=2) as asking:
        fake = terminal.instrument
        fake.deaf = 99
        with pytest.raises(UserError, match="does not answer the command STATUS: is it powered"):
            asking.status()
        fake.deaf = 0
        asking.write("mode", Mode.CONTINUOUS)
        fake.deaf = 99
        with pytest.raises(UserError, match="it sends packets, but hears nothing"):
            asking.status()
        fake.deaf, fake.damaging = 0, 99
        with pytest.raises(RefusedError, match="commands arrive damaged"):
            asking.status()
        fake.damaging, fake.busy = 0, 9999
        with pytest.raises(RefusedError, match="still waits for its frame") as refused:
            asking.status()
        assert refused.value.reason == Reason.BUSY
        fake.busy = 0
        assert asking.status()["state"].mode == Mode.CONTINUOUS
        asking.port.write(b"\x55" * 30)  # garbage on the line hurts no command
        assert asking.read("threshold_alpha") == REGISTERS["threshold_alpha"].reset


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_has_a_sentence(reason):
    if reason:
        text = str(RefusedError("this", reason))
        assert text.startswith("The chip refused this: ") and text[-1] in ".?"
        assert text == f"The chip refused this: {SENTENCES[reason]}"
    assert "reason 99, which this program does not know." in str(RefusedError("this", 99))


def test_reasons_come_through(each_terminal):
    """Each refusal that a host can provoke, from the chip to the sentence."""
    with commands(each_terminal, timeout=0.5) as asking:
        words = {name: [0] * 9 for name in ("depth", "reciprocal", "radial", "beams")}
        table = next(each for each, _, _ in asking.chunks(words) if each.name == "reciprocal")
        for reason, provoke in {
                Reason.UNKNOWN_COMMAND: lambda: asking.ask(99, what="this"),
                Reason.WRONG_LENGTH: lambda: asking.ask(Command.READ),
                Reason.UNKNOWN_REGISTER: lambda: asking.ask(Command.READ, b"\xff"),
                Reason.OUT_OF_RANGE: lambda: asking.write("area_min", 0),
                Reason.NO_BEGIN: lambda: asking.commit(words),
                Reason.OTHER_SENSOR: lambda: asking.begin(64, 64, 15),
                Reason.DAMAGED_TABLE: lambda: (asking.begin(64, 64, 16), asking.commit(words)),
                Reason.UNKNOWN_TABLE: lambda: asking.ask(Command.READ_TABLE, b"\x09\0\0\1"),
                Reason.NOT_STOPPED: lambda: (asking.write("mode", 1),
                                             asking.write_table(table, 0, [1]))}.items():
            try:
                provoke()
            except RefusedError as refused:
                assert refused.reason == reason and SENTENCES[reason] in str(refused)
            else:
                pytest.fail(f"{reason.name} was not told")


def test_a_memory_at_fault_is_found(terminal, rig, capsys):
    terminal.instrument.forgetful = True
    words = rig[0].settings.radial
    terminal.instrument.shown = images()
    assert run("load", terminal.path, rig[1], "--start") == (0 if words[100] & 1 else 2)
    if not words[100] & 1:
        assert said(capsys).startswith(
            "The table radial reads back other than it was written, from word 100 on:")
    assert words[100] & 1 or not terminal.instrument.valid


def loaded(terminal, rig, *words):
    """Load and start, or whatever is asked for."""
    assert run("load", terminal.path, rig[1], *(words or ["--start"])) == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_it_cleanly(number, terminal, rig, tmp_path, capsys):
    loaded(terminal, rig)
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
        loaded(terminal, rig)
        timer = threading.Timer(0.5, terminal.close)
        timer.start()
        out = tmp_path / "out"
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", out) == 0
        timer.join()
        assert f"{terminal.path} is gone." in capsys.readouterr().out
    assert len(rows(out / "frames.csv")) > 2 and (out / "points.ply").exists()


def test_seconds(terminal, rig, tmp_path):
    """By the host's clock on a port, by the chip's in a recording."""
    loaded(terminal, rig)
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
    loaded(terminal, rig, "--start", *QUICK)
    terminal.instrument.noise = 5e-4
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames", "24") == 0
    assert "packets lost" in capsys.readouterr().out
    lost = sum(int(row["lost_packets"] or 0) for row in rows(out / "frames.csv"))
    assert lost > 5
    got = [tuple(row.values()) for row in rows(out / "points.csv")]
    ok = [row[:-1] for row in got if row[-1] == "ok"]
    sent = truth(terminal.instrument, {int(row[0]) for row in ok}, rig[0])
    assert len(ok) > 50 and set(ok) <= set(sum(sent.values(), []))
    assert run("receive", out / "link.raw", "--calibration", rig[1], "-o", tmp_path / "two") == 0
    assert contents(out) == contents(tmp_path / "two")


def test_records_need_no_calibration(each_terminal, rig, tmp_path, capsys):
    """With records beam and check are there, and with the calibration so is the place."""
    terminal = each_terminal
    loaded(terminal, rig, "--pattern-only", "--register", "full_records=1", "--register",
           "report_rejected=1", *QUICK)
    out = tmp_path / "out"
    assert run("receive", terminal.path, "-o", out, "--frames", "16") == 0
    got = rows(out / "points.csv")
    assert {row["status"] for row in got} > {"ok", "rejected"}
    assert all(row["beam"] and not row["z_mm"] for row in got if row["status"] == "ok")
    # The reader may come in the middle of the first frame.
    assert {row["check"] for row in rows(out / "frames.csv")[1:]} == {"ok"}
    assert {row["kind"] for row in rows(out / "frames.csv")} == {"pattern"}
    assert not (out / "texture.png").exists()
    again = tmp_path / "again"
    assert run("receive", out / "link.raw", "--calibration", rig[1], "-o", again) == 0
    places = [row for row in rows(again / "points.csv") if row["status"] == "ok"]
    assert places and all(row["z_mm"] for row in places)


def test_another_calibration_is_noticed(each_terminal, rig, tmp_path, capsys):
    """Points of a chip that was loaded with something else have no place."""
    terminal = each_terminal
    loaded(terminal, rig, "--start", *QUICK)
    other = tmp_path / "other.json"
    file.save(any_calibration(rows=4, columns=4, seed=2), other)
    out = tmp_path / "out"
    capsys.readouterr()
    assert run("receive", terminal.path, "--calibration", other, "-o", out, "--frames", "10") == 0
    told = capsys.readouterr().out
    # The reader may come in the middle of the first frame, whose check then says nothing.
    assert any(f"! {count} frames whose check failed: {MISMATCH}." in told for count in (9, 10))
    assert {row["check"] for row in rows(out / "frames.csv") if row["ok"]} == {"failed"}
    assert {(row["status"], row["beam"], row["z_mm"]) for row in rows(out / "points.csv")} <= {
        ("unverified", "", ""), ("noise", "", ""), ("ambiguous", "", ""), ("rejected", "", "")}
    assert "element vertex 0" in (out / "points.ply").read_text()


def test_points_are_trusted_once_a_check_was_right(rig, tmp_path):
    """Of a frame that lost a packet they count if the frames before agreed; an empty one does
    not agree to anything."""
    calibration, path = rig
    from scripts.host.rebuild import Rebuilder
    rng = np.random.default_rng(1)
    u, v = rng.integers(0, 512 * 64, (2, 4000))
    status, beam, inverse_z = Rebuilder(calibration.settings, 64, 64)(u, v)
    points = np.zeros(np.count_nonzero(status == 0), POINT)[:40]
    for name, values in (("u", u), ("v", v), ("beam", beam), ("inverse_z", inverse_z)):
        points[name] = values[status == 0][:40]
    wire = Wire()
    frames = [wire.frame(make_frame(some, 2 * number)) for number, some in enumerate(
        (points[:0], points, points[:9], points))]
    octets = b"".join(packet for number, packets in enumerate(frames) for packet in (
        packets[1:] if number in (1, 3) else packets))
    (tmp_path / "raw").write_bytes(octets)
    assert run("receive", tmp_path / "raw", "--calibration", path, "-o", tmp_path / "out") == 0
    assert [row["check"] for row in rows(tmp_path / "out" / "frames.csv")] == ["ok", "", "ok", ""]
    got = {(row["frame"], row["status"]) for row in rows(tmp_path / "out" / "points.csv")}
    assert got == {("2", "unverified"), ("4", "ok"), ("6", "ok")}


def test_last_frame_only(terminal, rig, tmp_path):
    loaded(terminal, rig)
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames", "12",
               "--ply", "last") == 0
    body = (out / "points.ply").read_text().split("end_header\n")[1].splitlines()
    last = [row for row in rows(out / "points.csv") if row["z_mm"]][-1]["frame"]
    assert body and {line.split()[4] for line in body} == {last}


def test_compact_points_need_a_calibration(terminal, rig, tmp_path, capsys):
    loaded(terminal, rig)
    capsys.readouterr()
    assert run("receive", terminal.path, "-o", tmp_path / "out") == 2
    assert said(capsys).startswith("The points come in their compact form, which needs the")
    assert list(tmp_path.iterdir()) == []


@contextmanager
def babbling(octets):
    """A device that sends the same octets over and over."""
    class Babble:
        def send(self, _):
            pass

        def run(self, _):
            pass

        def receive(self):
            return octets

    with Terminal(Babble(), speed=1.0) as terminal:
        yield terminal.path


def test_a_wrong_speed_is_noticed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("scripts.cyclope.receive._GARBAGE_SECONDS", 0.4)
    with babbling(b"\xe0\x00\x1c\xff\x80") as path:
        begin = time.monotonic()
        assert run("receive", path, "-o", tmp_path / "out", "--baud", "9600") == 2
        assert time.monotonic() - begin < 10
    assert "is no packet: is --baud 9600 right, and is this the chip's port?" in said(capsys)
    assert list(tmp_path.iterdir()) == []


def test_silence_is_told(tmp_path, capsys):
    with babbling(b"") as path:
        assert run("receive", path, "-o", tmp_path / "out", "--seconds", "0.2") == 2
        assert said(capsys).startswith(f"Nothing came from {path}: is the chip powered")
    assert list(tmp_path.iterdir()) == []


def test_a_stopped_chip_is_told(each_terminal, tmp_path, capsys):
    assert run("receive", each_terminal.path, "-o", tmp_path / "out", "--seconds", "0.5") == 0
    assert "no frame came: `cyclope load PORT --start` starts the chip" in capsys.readouterr().out


@pytest.mark.parametrize("command", [["status"], ["load"], ["receive", "-o", "out"]])
def test_ports_that_cannot_be_opened(command, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text").write_text("nothing of the chip's")
    missing = tmp_path / "tty"
    assert run(*command, missing) == 2
    assert said(capsys) == f"There is no port {missing}: is the device plugged in?"
    assert run(*command, tmp_path) == 2
    assert said(capsys).startswith(f"{tmp_path} is ")
    assert run(*command, "/dev/null") == 2
    assert said(capsys) == "/dev/null is not a serial device."
    assert run(*command, "text") == 2
    wanted = {"receive": "text holds no packet of the chip: name a link.raw of `cyclope receive`."}
    assert said(capsys) == wanted.get(command[0], "text is not a serial device.")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["text"]


def test_a_port_in_use(terminal, tmp_path, capsys):
    with port.open_port(terminal.path):
        assert run("status", terminal.path) == 2
    assert said(capsys) == f"{terminal.path} is in use by another program: close that first."


def test_permission_is_explained(terminal, capsys, monkeypatch):
    import serial

    def refuse(self):
        raise serial.SerialException(13, "could not open port: Permission denied")

    monkeypatch.setattr(serial.Serial, "open", refuse)
    assert run("status", terminal.path) == 2
    assert "may not be opened by this user: join the group that owns it" in said(capsys)


def test_outputs_are_not_overwritten(terminal, tmp_path, capsys):
    (tmp_path / "mine").touch()
    assert run("receive", terminal.path, "-o", tmp_path) == 2
    assert "already holds files" in said(capsys)
    for words in (["--frames", "0"], ["--seconds", "-1"]):
        assert run("receive", terminal.path, "-o", tmp_path / "out", *words) == 2
        assert said(capsys).startswith(f"{words[0]} must be more than 0, not ")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_damaged_recording(terminal, rig, tmp_path):
    """Octets at random in place of some: it is read as far as it goes."""
    loaded(terminal, rig)
    out = tmp_path / "out"
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames", "20") == 0
    octets = bytearray((out / "link.raw").read_bytes())
    middle = len(octets) // 2
    octets[middle:middle + 500] = np.random.default_rng(1).bytes(700)
    (tmp_path / "raw").write_bytes(octets[:-7])
    assert run("receive", tmp_path / "raw", "--calibration", rig[1], "-o", tmp_path / "two") == 0
    good = {tuple(row.values()) for row in rows(out / "points.csv")}
    read = [tuple(row.values()) for row in rows(tmp_path / "two" / "points.csv")]
    assert len(read) > len(good) / 3 and set(read) <= good


def test_frames_that_are_not_as_they_should_be(tmp_path):
    """A row tells of every frame what is known of it; a lost trailer leaves it incomplete."""
    points = np.zeros(30, POINT)
    points["v"], points["beam"], points["inverse_z"] = 999, 3, 5000
    wire = Wire()
    octets = b"".join(wire.frame(make_frame(points, 4, flags=0x18), full=True))
    broken = wire.frame(make_frame(points, 6, flags=0x24), full=True)
    octets += b"".join(broken[:-1])
    octets += b"".join(wire.frame(make_frame(points[:0], 8, flags=0x02, skipped=2), full=True))
    (tmp_path / "raw").write_bytes(octets)
    assert run("receive", tmp_path / "raw", "-o", tmp_path / "out") == 0
    first, second, third = rows(tmp_path / "out" / "frames.csv")
    assert (first["number"], first["laser"], first["flags"]) == ("4", "on", "capture")
    assert (second["number"], second["flags"], second["laser"]) == ("6", "incomplete", "")
    assert (third["flags"], third["skipped"], third["lost_packets"]) == ("learning", "2", "0")
    assert second["lost_packets"] == "1"


def test_textures_of_unknown_size():
    """They grow with what comes; once the size is known they can be whole."""
    from scripts.host.messages import TexturePiece
    texture = Texture()

    def piece(row, column, *pixels):
        return TexturePiece(0, row, column, np.array(pixels, np.uint8))

    assert not texture.add(piece(1, 2, 7, 8))
    assert texture.image.tolist() == [[0, 0, 0, 0], [0, 0, 7, 8]]
    assert not texture.add(piece(0, 0, 1, 2, 3, 4)) and texture.image.shape == (2, 4)
    assert not texture.add(piece(600, 0, 1)) and texture.outside == 1
    texture.resize((4, 2))
    assert not texture.add(piece(0, 4, 1)) and not texture.add(piece(2, 0, 1))
    assert texture.outside == 3
    assert texture.add(piece(1, 0, 5, 6))
    assert texture.image.tolist() == [[1, 2, 3, 4], [5, 6, 7, 8]]
    assert not texture.add(piece(0, 0, 1, 2, 3, 4)) and texture.add(piece(1, 0, 5, 6, 7, 8))


def test_live_line(rig, monkeypatch):
    """Frame rate by the chip's clock, points, lost packets, laser, and what is wrong."""
    from types import SimpleNamespace

    from scripts.cyclope import receive
    from scripts.host.messages import Frame
    now = 100.0
    monkeypatch.setattr(receive.time, "monotonic", lambda: now)
    line = receive._Line("tty")
    decoder = SimpleNamespace(octets=0, packets=0, lost=0)
    pictures = {"texture": Texture((4, 2)), "pattern": Texture((4, 2))}
    recorder = SimpleNamespace(
        frames=0, last=None, whole={"texture": 2, "pattern": 1}, seen=set(), pictures=pictures)
    assert str(line.text(decoder, recorder)) == "tty  nothing arrives"
    decoder.octets = 9
    assert str(line.text(decoder, recorder)) == "tty  nothing but garbage"
    decoder.packets = 1
    assert "`cyclope load PORT --start`" in str(line.text(decoder, recorder))
    recorder.seen.add("pattern")
    assert str(line.text(decoder, recorder)) == "tty  pattern: 1 whole pictures, the next 0%"
    for frames in range(1, 20, 3):
        now += 0.2
        recorder.frames = frames
        recorder.last = Frame(7, spots=5, flags=0x48, index=7, timestamp_us=40_000 * frames,
                              points=np.zeros(4, POINT), verified=True)
        words = str(line.text(decoder, recorder))
    assert words == "tty  frame 7  25.0 frames/s   4 of 5 spots ok  2 textures  lost packets 0  " \
                    "laser on"
    now += 3
    recorder.last = Frame(8, flags=0x30, verified=False)
    decoder.lost = 3
    words = str(line.text(decoder, recorder))
    assert " 0.0 frames/s" in words and "lost packets 3" in words and MISMATCH in words
    assert "laser off, no valid tables, calibration capture, tripped: see `cyclope status`" in words
