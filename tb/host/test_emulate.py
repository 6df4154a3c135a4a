"""``cyclope emulate``: its truth is kept, and a host cannot fill its memory."""

import csv
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest

from hdl.protocol import Mode
from model.optics.capture import TRUTH_HEADER
from model.optics.rigs import RIGS
from scripts.host import port
from scripts.host.commands import Commands
from scripts.paths import ROOT
from scripts.simulation import emulator, terminal
from scripts.simulation.emulator import Emulator
from scripts.simulation.terminal import Terminal
from tb.host.bench import run, said


@contextmanager
def emulating(path):
    """A process that emulates the small rig, and the port it named."""
    process = subprocess.Popen(
        [sys.executable, "-m", "scripts.cyclope.cli", "emulate", "plane", path, "--rig", "small",
         "--scenes", "2"], cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        assert process.stdout.readline().startswith("Preparing 2 scenes and the RTL, which takes")
        yield process, process.stdout.readline().split()[4].rstrip(";")
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        process.stderr.close()


@pytest.mark.parametrize("number, status", [
    (signal.SIGINT, 0), (signal.SIGTERM, 0), (signal.SIGKILL, -signal.SIGKILL)])
def test_truth_is_written_as_it_is_shown(number, status, tmp_path):
    """Whatever ends it."""
    path = tmp_path / "truth.csv"
    with emulating(path) as (process, name):
        assert path.read_text() == TRUTH_HEADER + "\n"
        with port.open_port(name) as opened:
            commands = Commands(opened, timeout=5)
            commands.capture(60_000)
            commands.write("mode", Mode.CONTINUOUS)
            end = time.monotonic() + 60
            while path.read_text().count("\n") < 40 and time.monotonic() < end:
                commands.status()
        process.send_signal(number)
        printed, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (status, "")
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 39 and {row["beam"] for row in rows} == {str(beam) for beam in range(16)}
    if not status:
        assert f"frames were shown; the truth of the lit ones is in {path}\n" in printed


@pytest.mark.parametrize("where, sentence", [
    ("there", "is there already"), ("missing/truth.csv", "No such file or directory"),
    ("there/truth.csv", "Not a directory"), (".", "is there already"),
    ("nowhere", "File exists")])
def test_bad_places_for_the_truth(where, sentence, tmp_path, capsys, monkeypatch):
    """They are refused before anything takes time."""
    monkeypatch.setattr(emulator, "Emulator", None)
    (tmp_path / "there").touch()
    (tmp_path / "nowhere").symlink_to(tmp_path / "missing")
    assert run("emulate", "plane", tmp_path / where) == 2
    assert sentence in said(capsys)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_it_builds(number, tmp_path, capsys, monkeypatch):
    def build(*_, **__):
        os.kill(os.getpid(), number)
        time.sleep(9)

    monkeypatch.setattr(emulator, "Emulator", build)
    assert run("emulate", "plane", tmp_path / "truth.csv") == 130
    assert said(capsys) == "interrupted." and list(tmp_path.iterdir()) == []


class Slow:
    """An instrument whose line takes an octet in a millisecond."""

    def __init__(self):
        self.unsent = self.most = 0

    def send(self, octets):
        """Octets from the host."""
        self.unsent += len(octets)
        self.most = max(self.most, self.unsent)

    def run(self, _):
        """A millisecond."""
        self.unsent = max(0, self.unsent - 1)

    def receive(self):
        """Nothing."""
        return b""


def test_a_host_cannot_send_without_end():
    """What the instrument has not taken waits in the host, which sees its writes fail."""
    slow = Slow()
    with Terminal(slow, speed=1.0) as line:
        handle = os.open(line.path, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        sent = blocked = 0
        while blocked < 20:
            try:
                sent += os.write(handle, bytes(4096))
            except BlockingIOError:
                blocked += 1
                time.sleep(0.01)
            assert sent < 1 << 20
        os.close(handle)
    assert slow.most <= terminal._INPUT_LIMIT + 4096 and sent > slow.most


def test_an_emulator_forgets_what_it_need_not_know():
    """Hours of it fit into memory."""
    rows = []
    instrument = Emulator("plane", RIGS["small"], 0, 1, record=rows.extend, keep=False)
    kept = Emulator("plane", RIGS["small"], 0, 1)
    for each in (instrument, kept):
        for lit in (0, 400, 0, 400):
            assert isinstance(each._picture(500.0, lit), np.ndarray)
    assert instrument.shown == [] and instrument.count == kept.count == 4
    assert [TRUTH_HEADER, *rows] == kept.truth() and len(rows) == 32
    assert instrument.unsent == 0
