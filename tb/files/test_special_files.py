"""What is no regular file, never ends, blocks or cannot be read, wherever a file is named."""

import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.cyclope import cli
from scripts.paths import ROOT
from tb.files.test_captures import PLANES, TOML


def gigabyte(path):
    """A sparse file of a gigabyte."""
    with open(path, "wb") as file:
        file.truncate(1 << 30)


def bind(path):
    """A socket, whose name must be short."""
    here = os.open(path.parent, os.O_RDONLY)
    try:
        socket.socket(socket.AF_UNIX).bind(f"/proc/self/fd/{here}/{path.name}")
    finally:
        os.close(here)


#: How a name comes to stand for something that cannot be read, and words of the sentence.
KINDS = {
    "pipe": (os.mkfifo, "is not a file"),
    "endless": (lambda path: path.symlink_to("/dev/zero"), "is not a file"),
    "nothing": (lambda path: path.symlink_to("/dev/null"), "is not a file"),
    "folder": (Path.mkdir, "is not a file"),
    "socket": (bind, "is not a file"),
    "loop": (lambda path: path.symlink_to(path.name), ""),
    "dangling": (lambda path: path.symlink_to("nowhere"), "does not exist"),
    "gigabyte": (gigabyte, "has 1073741824 octets, more than the"),
    "unreadable": (lambda path: path.symlink_to("/proc/self/mem"), "cannot be read (Input/output"),
}


def _run(tmp_path, prepared, frames=None, calibration=None):
    return ("run", frames or prepared[0] / "frames", "--calibration", calibration or prepared[1],
            "--engine", "model", "-o", tmp_path / "out")


@pytest.mark.parametrize("kind", KINDS)
def test_frames(kind, prepared, tmp_path, refused):
    folder = tmp_path / "in"
    folder.mkdir()
    shutil.copy(next((prepared[0] / "frames").glob("*_ir.png")), folder / "0000.png")
    KINDS[kind][0](folder / "0001.png")
    message = refused(*_run(tmp_path, prepared, folder))
    assert str(folder / "0001.png") in message and KINDS[kind][1] in message


@pytest.mark.parametrize("kind", KINDS)
def test_calibrations(kind, prepared, tmp_path, refused):
    KINDS[kind][0](tmp_path / "calibration.json")
    message = refused(*_run(tmp_path, prepared, calibration=tmp_path / "calibration.json"))
    assert f"The calibration {tmp_path / 'calibration.json'} " in message
    assert KINDS[kind][1] in message


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["capture.toml", "planes/planes.csv", "lens/0.png"])
def test_captures(name, kind, tmp_path, refused):
    folder = tmp_path / "capture"
    for part in ("lens", "planes"):
        (folder / part).mkdir(parents=True)
    (folder / "capture.toml").write_text(TOML)
    (folder / "planes" / "planes.csv").write_text(PLANES)
    for image in ("lens/0.png", "planes/0.png", "planes/1.png"):
        (folder / image).touch()
    (folder / name).unlink()
    KINDS[kind][0](folder / name)
    message = refused("calibrate", folder, "-o", tmp_path / "out")
    assert str(folder / name) in message and KINDS[kind][1] in message


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"loop", "dangling"}))
def test_truths(kind, prepared, tmp_path, refused):
    folder = tmp_path / "in" / "frames"
    folder.mkdir(parents=True)
    shutil.copy(next((prepared[0] / "frames").glob("*_ir.png")), folder / "0000.png")
    KINDS[kind][0](tmp_path / "in" / "truth.csv")
    message = refused(*_run(tmp_path, prepared, folder))
    assert str(tmp_path / "in" / "truth.csv") in message and KINDS[kind][1] in message


@pytest.mark.parametrize("command, kind", [
    (command, kind) for command in ("run", "simulate", "calibrate")
    for kind in ("pipe", "endless", "nothing", "socket", "loop", "dangling")
    if (command, kind) != ("calibrate", "dangling")])  # that makes what the link leads to
def test_outputs(command, kind, prepared, tmp_path, refused):
    """What is there stays as it is."""
    path = tmp_path / "result"
    KINDS[kind][0](path)
    before = path.lstat()
    words = {"run": [*_run(tmp_path, prepared)[:-1], path],
             "simulate": ["simulate", "plane", path, "--frames", "1", "--rig", "small"],
             "calibrate": ["calibrate", prepared[0], "-o", path]}[command]
    assert str(path) in refused(*words)
    assert (path.lstat().st_ino, path.lstat().st_mode) == (before.st_ino, before.st_mode)
    assert [each.name for each in tmp_path.iterdir()] == ["result"]


NAMES = {"blank": "a b", "umlaut": "größe", "line feed": "a\nb", "escape": "a\x1b[31mb",
         "no letters": b"a\xff\xfe", "quote": "a'b\"c", "dash": "-a", "markup": "[red]a",
         "long": "a" * 240}


@pytest.mark.parametrize("kind", NAMES)
def test_names_of_any_kind(kind, prepared, tmp_path, capfd):
    """Folders and files of such names are measured, and written, like any other."""
    name = os.fsdecode(NAMES[kind])
    folder = tmp_path / name
    folder.mkdir()
    shutil.copy(next((prepared[0] / "frames").glob("*_ir.png")), folder / f"{name}.png")
    shutil.copy(prepared[1], folder / f"{name}.json")
    assert cli.main(["run", folder / f"{name}.png", "--calibration", folder / f"{name}.json",
                     "--engine", "model", "-o", folder / "out"]) == 0
    assert "element vertex 49" in (folder / "out" / "points.ply").read_text("ascii")
    assert (folder / "out" / "summary.txt").read_text("utf-8") and capfd.readouterr().err == ""


@pytest.mark.parametrize("locale", [
    {"LC_ALL": "POSIX", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    {"PYTHONIOENCODING": "ascii"}, {"PYTHONIOENCODING": "latin-1"}], ids=["POSIX", "ascii", "1"])
def test_any_locale_prints_the_report(locale, prepared, tmp_path):
    """Tables have lines and dots that some locales lack, and so may the names."""
    folder = tmp_path / "größe 目"
    folder.mkdir()
    shutil.copy(next((prepared[0] / "frames").glob("*_ir.png")), folder / "0.png")
    done = subprocess.run(
        [sys.executable, "-m", "scripts.cyclope.cli", "run", folder / "0.png", "--calibration",
         prepared[1], "--engine", "model", "--no-pictures", "-o", folder / "out"],
        cwd=ROOT, env={**os.environ, **locale}, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"") and b"49 spots of 1 frame in" in done.stdout
    assert "─" in (folder / "out" / "summary.txt").read_text("utf-8")


def test_a_loop_of_folders_ends(prepared, tmp_path, refused):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "frames").symlink_to(tmp_path / "in")
    assert "holds no images" in refused(*_run(tmp_path, prepared, tmp_path / "in"))
