"""``cyclope view`` as a process: it prints its address, serves, records, and ends when asked."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.sync.client import connect

from calibration import file
from scripts.cyclope import cli
from scripts.host.history import read_history
from scripts.paths import ROOT
from scripts.results.points import OK
from scripts.view.session import ReplaySession
from tb.host.bench import open_fake, record, run
from tb.system.fake_instrument import images


@contextmanager
def viewing(*words):
    """The process of a command that serves, and its address."""
    process = subprocess.Popen(
        [sys.executable, "-m", "scripts.cyclope.cli", "view", "--no-browser", *map(str, words)],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        for line in process.stdout:
            if line.startswith("The page is at "):
                yield process, line.removeprefix("The page is at ").partition(";")[0]
                break
        else:
            raise AssertionError(process.stderr.read())
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


@contextmanager
def socket(address):
    place = urlsplit(address)
    with connect(f"ws://{place.netloc}/socket?{place.query}", origin=f"http://{place.netloc}",
                 max_size=None, compression=None) as opened:
        yield opened


def messages(opened, kind, count):
    """So many messages of a kind."""
    found, end = [], time.monotonic() + 300
    while len(found) < count:
        assert time.monotonic() < end
        text = opened.recv(timeout=300)
        if isinstance(text, str) and json.loads(text)["type"] == kind:
            found.append(json.loads(text))
            if kind == "frame":
                opened.send('{"do": "seen"}')
    return found


def end(process, number=signal.SIGINT):
    """What it printed until it ended by a signal."""
    process.send_signal(number)
    output, error = process.communicate(timeout=60)
    assert "Traceback" not in error, error
    return process.returncode, output, error


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A folder of `cyclope receive` from a chip that the calibration was loaded into."""
    folder = tmp_path_factory.mktemp("recording")
    record(folder, 8)
    return folder


def test_a_recording(recording):
    with viewing(recording / "out" / "link.raw", "--calibration",
                 recording / "calibration.json") as (process, address):
        assert address.startswith("http://127.0.0.1:")
        with socket(address) as opened:
            hello, = messages(opened, "hello", 1)
            assert hello["live"] is False and hello["rig"]["beams"] == 16
            state, = messages(opened, "state", 1)
            assert state["count"] >= 7 and state["trouble"] is None
        assert end(process)[0] == 0


def test_a_port_is_recorded_while_it_is_shown(recording, tmp_path):
    calibration = file.load(recording / "calibration.json")
    with open_fake(calibration, images(), speed=1.0) as terminal, viewing(
            terminal.path, "--calibration", recording / "calibration.json", "--start", "-o",
            tmp_path / "out") as (process, address):
        with socket(address) as opened:
            frames = messages(opened, "frame", 5)
            assert [each["position"] for each in frames] == sorted(
                {each["position"] for each in frames})
            # A second program does not get the port, and says so.
            assert cli.main(["status", terminal.path]) == 2
            size = (tmp_path / "out" / "link.raw").stat().st_size
        status, output, _ = end(process, signal.SIGTERM)
        assert status == 0 and "frames" in output.splitlines()[-1], output
        assert (tmp_path / "out" / "link.raw").stat().st_size >= size > 500
        assert (tmp_path / "out" / "points.ply").exists()
    assert run("receive", tmp_path / "out" / "link.raw", "--calibration",
               recording / "calibration.json", "-o", tmp_path / "again") == 0
    for name in ("points.csv", "frames.csv", "points.ply"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()


def test_a_damaged_recording_shows_what_is_whole(recording, tmp_path):
    octets = bytearray((recording / "out" / "link.raw").read_bytes())
    rng = np.random.default_rng(1)
    for at in rng.integers(0, len(octets), len(octets) // 400):
        octets[at] ^= 1 << rng.integers(8)
    (tmp_path / "link.raw").write_bytes(octets[:-37])
    calibration = file.load(recording / "calibration.json")
    found = read_history(tmp_path / "link.raw", calibration)
    whole = read_history(recording / "out" / "link.raw", calibration)
    assert 0 < found.count <= whole.count
    sound = [position for position in range(found.count) if found.moment(position).frame.verified]
    assert 0 < len(sound) < whole.count
    for position in sound:
        moment = found.moment(position)
        same = whole.moment(whole.position(moment.frame.index))
        ok = moment.points["status"] == OK
        assert np.isin(moment.points["u"][ok], same.points["u"]).all()
    assert found.moment(10**9).lost > 0


@pytest.mark.parametrize("engine", ["model", "rtl"])
def test_a_simulated_rig(engine, tmp_path):
    with viewing("--simulate", "plane", "--rig", "small", "--engine", engine, "-o",
                 tmp_path / "out") as (process, address), socket(address) as opened:
        frame = messages(opened, "frame", 3)[-1]
        assert frame["strip"]["lit"] and frame["strip"]["ok"] > 8
        assert end(process)[0] == 0


@pytest.mark.parametrize("kind", ["ply", "glb", "pcd"])
def test_surfaces_are_what_the_page_downloads(recording, kind, tmp_path, capsys):
    """Each frame its own file, the same octets each time."""
    words = ["surface", recording / "out" / "link.raw", "--calibration",
             recording / "calibration.json", "--format", kind]
    for name in ("one", "two"):
        assert cli.main([*words, "-o", tmp_path / name]) == 0
    files = sorted((tmp_path / "one").iterdir())
    assert len(files) > 4 and all(each.suffix == f".{kind}" for each in files)
    assert [each.read_bytes() for each in files] == [
        (tmp_path / "two" / each.name).read_bytes() for each in files]
    session = ReplaySession(recording / "out" / "link.raw",
                            file.load(recording / "calibration.json"))
    with session:
        session.wait()
        for each in files:
            number = str(int(each.stem.partition("-")[2]))
            assert session.download(f"/frame.{kind}", {"frame": [number]})[0] == each.read_bytes()
    number = int(files[2].stem.partition("-")[2])
    assert cli.main([*words, "-o", tmp_path / "some", "--from", number, "--to", number]) == 0
    assert [each.name for each in (tmp_path / "some").iterdir()] == [files[2].name]
    capsys.readouterr()
    assert cli.main([*words, "-o", tmp_path / "none", "--from", 10**6]) == 2
    assert "there is no surface to write" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_a_report_is_the_same_each_time(recording, tmp_path, capsys):
    words = ["report", recording / "out" / "link.raw", "--calibration",
             recording / "calibration.json", "-o"]
    for name in ("one.html", "two.html"):
        assert cli.main([*words, tmp_path / name]) == 0
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "two.html").read_bytes()
    assert b"out/link.raw</title>" in (tmp_path / "one.html").read_bytes()
    capsys.readouterr()
    assert cli.main([*words, tmp_path]) == 2
    assert "is not a file" in capsys.readouterr().err


@pytest.mark.parametrize("words, sentence", [
    ((), "Name a port or a recording, or --simulate KIND"),
    (("x", "--simulate", "polyp"), "Name a port or a recording, or --simulate KIND"),
    (("x",), "The surface needs the calibration"),
    (("--simulate", "rain"), "There is no scene of the kind 'rain'; choose one of plane,"),
    (("--simulate", "polyp", "--rig", "big"), "There is no rig 'big'; there are endoscope,"),
    (("nothing", "--calibration", "CALIBRATION"), "There is no port nothing"),
    (("CALIBRATION", "--calibration", "CALIBRATION"), "holds no packet of the chip"),
    ((".", "--calibration", "CALIBRATION"), ". is a folder: name a serial device or a recording"),
    (("RAW", "--calibration", "CALIBRATION", "--start"), "--start and -o are for a port."),
    (("RAW", "--calibration", "RAW"), "is not a calibration"),
    (("RAW", "--calibration", "CALIBRATION", "--port", "99999"), "--port must be 0 to 65535"),
    (("RAW", "--calibration", "CALIBRATION", "--host", "192.0.2.1"), "cannot be listened at"),
])
def test_bad_input_is_one_sentence(recording, words, sentence, capsys, tmp_path, monkeypatch):
    places = {"CALIBRATION": recording / "calibration.json",
              "RAW": recording / "out" / "link.raw"}
    monkeypatch.chdir(tmp_path)
    assert cli.main(["view", "--no-browser", *(str(places.get(word, word)) for word in words)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and sentence in error, error
    assert os.listdir(tmp_path) == []
