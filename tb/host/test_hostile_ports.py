"""Ports, options and chips that nobody would want: one sentence, soon, in little memory."""

import os
import random
import socket
import threading

import pytest

from hdl.protocol import Command, Reason
from scripts.host.commands import Commands
from tb.host.bench import run, said
from tb.host.hostile import GOOD, bounded, forged, identity, status
from tb.system.fake_instrument import any_calibration

COMMANDS = {"status": [], "load": ["--start"], "receive": ["-o", "out"]}


@pytest.fixture(autouse=True)
def impatient(monkeypatch, tmp_path):
    """Nothing here answers later."""
    monkeypatch.setattr(Commands.__init__, "__defaults__", (0.1, 2, 0.2))
    monkeypatch.setattr("scripts.cyclope.ending._GARBAGE_SECONDS", 0.3)
    monkeypatch.setattr("scripts.host.load_plan._PATIENCE", 0.3)
    monkeypatch.setattr("scripts.host.replay._PATIENCE", 0.3)
    monkeypatch.chdir(tmp_path)


def refused(capsys, *words):
    """The sentence with which a command is refused."""
    with bounded():
        assert run(*words) == 2
    sentence = said(capsys)
    assert "Traceback" not in sentence and "fault of the program" not in sentence
    assert not os.path.exists("out")
    return sentence


def fifo(path):
    os.mkfifo(path)


def unix_socket(path):
    server = socket.socket(socket.AF_UNIX)
    server.bind(str(path))
    return server


def link_to_itself(path):
    path.symlink_to(path)


def closed_terminal(path):
    master, slave = os.openpty()
    path.symlink_to(os.ttyname(slave))
    os.close(slave)
    os.close(master)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("make", [fifo, unix_socket, link_to_itself, closed_terminal, os.mkdir])
def test_files_that_are_no_port(make, command, tmp_path, capsys):
    kept = make(tmp_path / "odd")
    sentence = refused(capsys, command, tmp_path / "odd", *COMMANDS[command])
    assert str(tmp_path / "odd") in sentence
    del kept


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("port", [
    "/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom", "-", "", ".", "..", "/",
    "x" * 300, "a\nb", "\udcff", "/dev/null/x", "foo://x", "socket://127.0.0.1:1", "socket://",
    "socket://127.0.0.1:99999999", "socket://a:b", "rfc2217://127.0.0.1:1", "rfc2217://x?y=z",
    "hwgrep://[", "hwgrep://no such device", "alt://nowhere?class=x", "spy://nowhere", "cp2110://x"])
def test_names_that_are_no_port(port, command, capsys):
    """Devices that never end, what pyserial would do with it, and names that are none."""
    sentence = refused(capsys, command, port, *COMMANDS[command])
    assert len(sentence) < 700


@pytest.mark.skipif(not os.access("/proc/kmsg", os.R_OK), reason="the log of the kernel is closed")
def test_a_file_that_makes_one_wait(capsys):
    """What the kernel logged has an end, but reading waits for more."""
    assert refused(capsys, "receive", "/proc/kmsg", "-o", "out").startswith("/proc/kmsg")


@pytest.mark.parametrize("words", [
    ["--baud", "0"], ["--baud", "-1"], ["--baud", str(10**12)], ["--baud", str(10**30)],
    ["--baud", "x"], ["--baud", "9" * 5000], ["--baud"]])
@pytest.mark.parametrize("command", COMMANDS)
def test_speeds(words, command, terminal, capsys):
    refused(capsys, command, terminal.path, *COMMANDS[command], *words)


@pytest.mark.parametrize("words", [
    ["--frames", "0"], ["--frames", "-1"], ["--frames", "1.5"], ["--images", "-9"],
    ["--seconds", "nan"], ["--seconds", "-inf"], ["--seconds", "0"], ["--seconds", "x"],
    ["--ply", "none"], ["--calibration", "nowhere"], ["--calibration", "."], ["-o", "taken"],
    ["-o", "file"], ["-o", "file/out"], ["-o", "x" * 300], ["-o", "/proc/out"],
    ["-o", "/dev/null"]])
def test_options_of_receive(words, terminal, tmp_path, capsys):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "mine").touch()
    (tmp_path / "file").touch()
    refused(capsys, "receive", terminal.path, "-o", "out", *words)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "taken"]


@pytest.mark.parametrize("words", [
    ["--register", ""], ["--register", "="], ["--register", "mode"], ["--register", "x=1"],
    ["--register", "area_min=" + "9" * 4000], ["--register", "area_min=" + "9" * 9000],
    ["--register", "area_min=1e3"], ["--register", "area_min=0x"], ["--register", "area_min=-1"],
    ["--register", "points_max=nan"], ["--period-us", "0"], ["--pattern-us", "-1"],
    ["--texture-us", "65536"], ["--capture-ms", "-1"], ["--capture-ms", str(10**20)],
    ["--start", "--stop"]])
def test_options_of_load(words, terminal, capsys):
    assert len(refused(capsys, "load", terminal.path, *words)) < 700
    assert terminal.instrument.counters["accepted"] == 0


def echo(wire, command, tag, data):
    """As a line that is short-circuited, with the packet in the form that a chip has."""
    return wire.packet(command, bytes([tag]) + data)


def busy(wire, command, tag, _):
    return wire.reply(tag, command, Reason.BUSY)


def unknown_reason(wire, command, tag, _):
    return wire.reply(tag, command, 200)


def damaged(wire, command, tag, _):
    return wire.reply(0, 0, Reason.DAMAGED_PACKET)


def other_tags(wire, command, tag, _):
    return b"".join(wire.reply(other, command, Reason.OK, GOOD.get(command, b""))
                    for other in range(256) if other != tag)


def other_commands(wire, command, tag, _):
    return b"".join(wire.reply(tag, other, Reason.OK, bytes(9))
                    for other in range(256) if other != command)


def silent(*_):
    return b""


#: Chips by what they do to commands: answers, what they send meanwhile, words of the sentence.
CHIPS = {
    "an echo": (echo, b"", "none arrives there"),
    "always busy": (busy, b"", "a set of tables still waits for its frame"),
    "unknown reasons": (unknown_reason, b"", "reason 200, which this program does not know"),
    "all is damaged": (damaged, b"", "commands arrive damaged"),
    "other tags": (other_tags, b"", "none arrives there"),
    "other commands": (other_commands, b"", "none arrives there"),
    "silence": (silent, b"", "is it powered"),
    "zeros": (silent, bytes(999), "what it sends is no packet"),
    "ones": (silent, b"\xff" * 999, "what it sends is no packet"),
    "noise": (silent, random.Random(1).randbytes(4000), "what it sends is no packet"),
    "65535 x 65535": ({**GOOD, Command.IDENTIFY: identity(width=65535, height=65535)}, b"",
                      "65535 x 65535 pixels"),
    "0 x 0": ({**GOOD, Command.IDENTIFY: identity(width=0, height=0)}, b"", "0 x 0 pixels"),
    "no identity": ({**GOOD, Command.IDENTIFY: b""}, b"", "speaks version 0"),
    "short identity": ({**GOOD, Command.IDENTIFY: identity()[:5]}, b"", "has 5 octets, not 12"),
    "long identity": ({**GOOD, Command.IDENTIFY: identity() + b"x"}, b"", "has 13 octets, not 12"),
    "no status": ({**GOOD, Command.STATUS: b""}, b"", "STATUS has 0 octets, not 19"),
    "long status": ({**GOOD, Command.STATUS: bytes(80)}, b"", "STATUS has 80 octets, not 19"),
    "no register": ({**GOOD, Command.READ: b""}, b"", "has 0 octets, not 4"),
    "long register": ({**GOOD, Command.READ: bytes(70)}, b"", "has 70 octets, not 4"),
}


@pytest.mark.parametrize("name", CHIPS)
@pytest.mark.parametrize("command", ["status", "load"])
def test_a_chip(name, command, capsys):
    answers, babble, words = CHIPS[name]
    with forged(answers, babble) as path:
        assert words in refused(capsys, command, path, *COMMANDS[command])


@pytest.mark.parametrize("name", [name for name, (_, _, words) in CHIPS.items()
                                  if "pixels" in words or "no packet" in words
                                  or "version 0" in words or "not 11" in words])
def test_receive_from_a_chip(name, tmp_path, capsys):
    """What is a packet is kept; what is none is not."""
    answers, babble, words = CHIPS[name]
    with forged(answers, babble) as path, bounded():
        assert run("receive", path, "-o", "out") == 2
    sentence = said(capsys)
    assert (words if "no packet" not in words else "is no packet") in sentence
    assert ("link.raw keeps all" in sentence) == (tmp_path / "out" / "link.raw").exists() == (
        not babble)


@pytest.mark.parametrize("state", [0xFF, 0x80 | 1 << 5, 3 << 5, 1 << 5])
def test_any_status_is_shown(state, capsys):
    """And is no success if the chip runs without what it needs."""
    answers = {**GOOD, Command.STATUS: status(state, 255, b"\xff" * 17),
               Command.IDENTIFY: identity(preset=200, lanes=255, clock=0),
               Command.READ: b"\xff" * 4}
    with forged(answers) as path, bounded():
        assert run("status", path, "--registers") == 3
    printed, error = capsys.readouterr()
    assert error == "" and "the laser guard has tripped: it saw a pulse longer" in printed


def test_tables_that_read_back_short(rig, capsys):
    answers = {**GOOD, **dict.fromkeys((Command.BEGIN, Command.TABLE, Command.WRITE), b""),
               Command.STATUS: status(3), Command.READ_TABLE: b"\1\2\3"}
    with forged(answers) as path:
        sentence = refused(capsys, "load", path, rig[1])
    assert "has 3 octets, not " in sentence and "The chip is stopped, the new tables" in sentence


def test_tables_that_read_back_other(rig, capsys):
    def zeros(wire, command, tag, data):
        size = {0: 5, 1: 5, 2: 3, 3: 9}[data[0]] * data[3] if command == Command.READ_TABLE else 0
        return wire.reply(tag, command, Reason.OK, GOOD.get(command, bytes(size)))

    with forged(zeros) as path:
        assert "reads back other than it was written" in refused(capsys, "load", path, rig[1])


def test_registers_that_read_back_other(capsys):
    with forged({**GOOD, Command.WRITE: b""}) as path:
        assert "took area_min = 9 and reads back 0" in refused(
            capsys, "load", path, "--register", "area_min=9")


def test_a_chip_that_does_not_stop(capsys, monkeypatch):
    monkeypatch.setattr("scripts.host.loading.stop.__defaults__", (0.2,))
    with forged({**GOOD, Command.WRITE: b"", Command.STATUS: status(1 << 5 | 3)}) as path:
        assert "The chip does not stop: reset it." in refused(capsys, "load", path, "--stop")


def test_calibrations_of_other_chips_meet_forged_ones(tmp_path, capsys):
    """The size on the paper is not what is allocated."""
    from calibration import file
    file.save(any_calibration(rows=2, columns=2), tmp_path / "calibration.json")
    with forged({**GOOD, Command.IDENTIFY: identity(width=512, height=512)}) as path:
        assert "the chip has one of 512 x 512" in refused(
            capsys, "load", path, tmp_path / "calibration.json")


@pytest.mark.parametrize("after", [0, 1, 7, 40])
def test_a_port_that_closes_in_the_middle(after, rig, capsys):
    """Of whatever is being done."""
    def answer(wire, command, tag, _):
        nonlocal count
        count += 1
        if count > after:
            return b""
        return wire.reply(tag, command, Reason.OK, GOOD.get(command, b""))

    count = 0
    server = socket.create_server(("127.0.0.1", 0))
    from tb.host.hostile import ForgedChip

    def serve():
        line, _ = server.accept()
        chip = ForgedChip(answer)
        with line:
            while count <= after and (octets := line.recv(999)):
                chip.send(octets)
                line.sendall(chip.receive())

    thread = threading.Thread(target=serve)
    thread.start()
    url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    sentence = refused(capsys, "load", url, rig[1], "--start")
    thread.join()
    server.close()
    assert sentence.startswith(f"{url} is gone.")
