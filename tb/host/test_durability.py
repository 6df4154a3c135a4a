"""What was received is there under its name, whatever happens."""

import errno
import os
import re
import resource
import signal
import subprocess
import sys
import threading
import time

import pytest

from model.errors import UserError
from scripts.host.link_file import LinkFile
from scripts.host.recorder import Recorder
from scripts.paths import ROOT
from scripts.results.outputs import new_folder, take_folder, whole_file
from scripts.results.row_file import RowFile
from tb.host.bench import contents, load_chip, rows, run, said


def start(*words, **options):
    """A process of the command."""
    return subprocess.Popen([sys.executable, "-m", "scripts.cyclope.cli", *map(str, words)],
                            cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            **options)


def wait_for(what, process=None, seconds=60):
    """Wait until ``what()`` is true."""
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end and (process is None or process.poll() is None)
        time.sleep(0.01)


def whole_rows(path):
    """Rows of a table, every one of which is complete."""
    text = path.read_text()
    assert text.endswith("\n") and len({line.count(",") for line in text.splitlines()}) == 1
    return rows(path)


def assert_replay(out, rig, again):
    """The recording gives at least the rows that are there, and they are the same."""
    assert run("receive", out / "link.raw", "--calibration", rig[1], "-o", again) == 0
    for name in ("frames.csv", "points.csv"):
        kept, made = whole_rows(out / name), whole_rows(again / name)
        assert len(made) >= len(kept) > 3 and made[:len(kept)] == kept
    assert (again / "link.raw").read_bytes() == (out / "link.raw").read_bytes()


def test_a_killed_receiver_leaves_all_that_came(terminal, rig, tmp_path):
    """Without a chance to do anything about it, under the names that were asked for."""
    load_chip(terminal, rig)
    out = tmp_path / "out"
    process = start("receive", terminal.path, "--calibration", rig[1], "-o", out)
    wait_for(lambda: (out / "frames.csv").exists()
             and (out / "frames.csv").read_text().count("\n") > 30, process)
    process.kill()
    process.wait()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]
    assert {path.name for path in out.iterdir()} <= {
        "link.raw", "points.csv", "frames.csv", "texture", "pattern"}
    assert (out / "link.raw").stat().st_size > 5000
    assert_replay(out, rig, tmp_path / "again")


def test_a_full_disk_keeps_what_fits(terminal, rig, tmp_path):
    """The limit of a file's size stands for it."""
    load_chip(terminal, rig)
    out = tmp_path / "out"
    limit = 20_000
    process = start("receive", terminal.path, "--calibration", rig[1], "-o", out,
                    preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    _, error = process.communicate(timeout=60)
    assert process.returncode == 2
    kept = max(out.iterdir(), key=lambda path: path.stat().st_size)
    assert error.startswith(f"cyclope: {kept} cannot be written: File too large. "
                            f"{out / 'link.raw'} keeps all ")
    assert error.count("\n") == 1 and "Traceback" not in error
    assert_replay(out, rig, tmp_path / "again")


def writes_that_fail(monkeypatch, wanted, after, part=0):
    """Let the disk be full for the files of one name, after so many writes to them."""
    real, paths, count = os.write, {}, 0
    real_open = os.open

    def opening(path, *arguments, **options):
        handle = real_open(path, *arguments, **options)
        paths[handle] = os.path.basename(path)
        return handle

    def writing(handle, octets):
        nonlocal count
        if paths.get(handle) == wanted:
            count += 1
            if count == after and part:
                return real(handle, octets[:part])
            if count >= after:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(handle, octets)

    monkeypatch.setattr(os, "open", opening)
    monkeypatch.setattr(os, "write", writing)


@pytest.mark.parametrize("name", ["link.raw", "points.csv", "frames.csv"])
@pytest.mark.parametrize("part", [0, 1, 70])
def test_a_full_disk_leaves_whole_rows(name, part, terminal, rig, tmp_path, capsys, monkeypatch):
    load_chip(terminal, rig)
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        writes_that_fail(patch, name, 12, part)
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", out) == 2
    sentence = said(capsys)
    assert sentence.startswith(f"{out / name} cannot be written: No space left on device. ")
    size = (out / "link.raw").stat().st_size
    again = re.search(f"link.raw keeps all {size} octets .*`cyclope (.*)` does it again", sentence)
    for table in ("points.csv", "frames.csv"):
        assert whole_rows(out / table)
    assert run(*again[1].replace("OTHER", str(tmp_path / "again")).split()) == 0


def test_a_full_disk_ends_a_replay_without_remains(terminal, rig, tmp_path, capsys, monkeypatch):
    """The recording is where it was."""
    load_chip(terminal, rig)
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", tmp_path / "out",
               "--frames", "20") == 0
    writes_that_fail(monkeypatch, "points.csv", 2)
    assert run("receive", tmp_path / "out" / "link.raw", "--calibration", rig[1], "-o",
               tmp_path / "two") == 2
    assert said(capsys) == f"{tmp_path / 'two' / 'points.csv'} cannot be written: No space left " \
                           "on device."
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]


@pytest.mark.parametrize("error", [OSError(errno.EIO, "Input/output error"), RuntimeError("what?"),
                                   MemoryError(), KeyboardInterrupt()])
def test_a_failure_at_the_end(error, terminal, rig, tmp_path, capsys, monkeypatch):
    """Whatever it is, tables and recording are there."""
    def fail(self):
        raise error

    load_chip(terminal, rig)
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(Recorder, "finish", fail)
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--frames",
                   "9") != 0
    assert f"{out / 'link.raw'} keeps all " in said(capsys)
    assert_replay(out, rig, tmp_path / "again")


def test_others_may_use_the_folder_meanwhile(terminal, rig, tmp_path, capsys):
    """Nothing of theirs is touched, and all of ours is there."""
    load_chip(terminal, rig)
    out = tmp_path / "out"

    def interfere():
        wait_for((out / "frames.csv").exists)
        (out / "theirs").write_text("mine")
        (out / "points.ply").write_text("theirs")

    thread = threading.Thread(target=interfere)
    thread.start()
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", out, "--seconds", "1") == 2
    thread.join()
    assert said(capsys).startswith(f"{out / 'points.ply'} is there already, from something else: "
                                   f"move it away. {out / 'link.raw'} keeps all ")
    assert (out / "points.ply").read_text() == "theirs"
    assert_replay(out, rig, tmp_path / "again")


def test_a_link_as_a_folder(terminal, rig, tmp_path, capsys):
    load_chip(terminal, rig)
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    (tmp_path / "nowhere").symlink_to(tmp_path / "missing")
    assert run("receive", terminal.path, "--calibration", rig[1], "-o", tmp_path / "link",
               "--frames", "9") == 0
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real" / "points.ply").exists()
    assert run("receive", tmp_path / "link" / "link.raw", "-o", tmp_path / "nowhere") == 2
    assert said(capsys) == f"{tmp_path / 'nowhere'} is a link to nowhere: name a new or an " \
                           "empty folder."


def test_octets_are_on_the_disk_within_a_second(tmp_path, monkeypatch):
    """They are written as they come, and the system is asked to keep them."""
    synced, real = [], os.fdatasync
    monkeypatch.setattr(os, "fdatasync", lambda handle: synced.append(real(handle)))
    link = LinkFile(tmp_path / "link.raw", sync=True)
    for size in (3, 6):
        link.write(b"abc")
        assert (tmp_path / "link.raw").stat().st_size == size
        wait_for(lambda size=size: len(synced) * 3 >= size)
    link.close()
    assert len(synced) == 2 and (tmp_path / "link.raw").read_bytes() == b"abcabc"


def test_a_disk_that_fails_later_is_noticed(tmp_path, monkeypatch):
    def fail(_):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fdatasync", fail)
    link = LinkFile(tmp_path / "link.raw", sync=True)
    with pytest.raises(UserError, match="link.raw cannot be written: Input/output error."):
        for _ in range(1000):
            link.write(b"a")
            time.sleep(0.01)
    link.close()


def test_rows_are_written_whole(tmp_path, monkeypatch):
    """Row by row, also where the disk takes only a part, and whatever comes after that."""
    table = RowFile(tmp_path / "table", "a,b\n")
    with monkeypatch.context() as patch:
        real = os.write
        patch.setattr(os, "write", lambda handle, octets: real(handle, octets[:2]))
        table.append("1,2\n")
        table.flush()
    assert (tmp_path / "table").read_text() == "a,b\n1,2\n"
    with monkeypatch.context() as patch:
        left = [6]

        def few(handle, octets):
            if not left[0]:
                raise OSError(errno.ENOSPC, "full")
            left[0] -= 1
            return real(handle, octets[:1])

        patch.setattr(os, "write", few)
        table.append("3,4\n")
        table.append("5,6\n")
        with pytest.raises(UserError, match="cannot be written: full."):
            table.flush()
    assert (tmp_path / "table").read_text() == "a,b\n1,2\n3,4\n"
    table.append("7,8\n")
    table.close()
    assert (tmp_path / "table").read_text() == "a,b\n1,2\n3,4\n7,8\n"
    with pytest.raises(UserError, match="table cannot be written: File exists."):
        RowFile(tmp_path / "table", "")


def test_files_appear_whole(tmp_path):
    with pytest.raises(RuntimeError), whole_file(tmp_path / "file") as file:
        file.write(b"half")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    with whole_file(tmp_path / "file") as file:
        file.write(b"all")
        assert not (tmp_path / "file").exists()
    assert contents(tmp_path) == {"file": b"all"}
    with pytest.raises(UserError, match="is there already"), whole_file(tmp_path / "file") as file:
        file.write(b"more")
    assert contents(tmp_path) == {"file": b"all"}


def test_a_folder_that_is_filled_meanwhile(tmp_path):
    """The results are beside it, and a sentence says where."""
    (tmp_path / "out-2").mkdir()
    with pytest.raises(UserError, match="out was filled by something else meanwhile: the results "
                                        "are in .*/out-3.$"), new_folder(tmp_path / "out") as part:
        (part / "result").write_text("mine")
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "theirs").write_text("theirs")
    assert contents(tmp_path) == {"out/theirs": b"theirs", "out-3/result": b"mine"}


def test_a_link_takes_results(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    with new_folder(tmp_path / "link") as part:
        (part / "result").write_text("mine")
    assert (tmp_path / "link").is_symlink() and contents(tmp_path / "real") == {"result": b"mine"}


def test_a_mount_point_takes_results(tmp_path, monkeypatch):
    """It cannot be renamed: the results move into it, unless something else is there by then."""
    (tmp_path / "out").mkdir()
    monkeypatch.setattr(os.path, "ismount", lambda path: str(path) == str(tmp_path / "out"))
    with new_folder(tmp_path / "out") as part:
        assert part.parent == tmp_path / "out"
        (part / "folder").mkdir()
        (part / "folder" / "result").write_text("mine")
    assert contents(tmp_path) == {"out/folder/result": b"mine"}
    for path in ("folder/result", "folder"):
        path = tmp_path / "out" / path
        path.rmdir() if path.is_dir() else path.unlink()
    with pytest.raises(UserError, match="meanwhile: the results are in .*/out/out-2.$"), \
            new_folder(tmp_path / "out") as part:
        (part / "result").write_text("mine")
        (tmp_path / "out" / "theirs").write_text("theirs")
    assert contents(tmp_path) == {"out/theirs": b"theirs", "out/out-2/result": b"mine"}


def test_an_interrupt_leaves_nothing_of_a_new_folder(tmp_path):
    with pytest.raises(KeyboardInterrupt) as interrupt, new_folder(tmp_path / "out"):
        raise KeyboardInterrupt
    assert interrupt.value.__notes__ == ["Nothing was written."]
    assert list(tmp_path.iterdir()) == []


def test_a_taken_folder_is_refused(tmp_path):
    assert take_folder(tmp_path / "a" / "b") == (tmp_path / "a" / "b", True)
    assert take_folder(tmp_path / "a" / "b") == (tmp_path / "a" / "b", False)
    with pytest.raises(UserError, match="already holds files"):
        take_folder(tmp_path / "a")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_signals_end_it_as_ctrl_c_does(number, terminal, rig, tmp_path):
    load_chip(terminal, rig)
    out = tmp_path / "out"
    process = start("receive", terminal.path, "--calibration", rig[1], "-o", out)
    wait_for(lambda: (out / "frames.csv").exists()
             and (out / "frames.csv").read_text().count("\n") > 9, process)
    process.send_signal(number)
    printed, error = process.communicate(timeout=60)
    assert process.returncode == 0 and error == "" and printed.startswith("interrupted.\n")
    assert (out / "points.ply").exists()
    assert_replay(out, rig, tmp_path / "again")
