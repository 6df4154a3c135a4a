"""Ports that cannot be opened."""

import pytest

from scripts.host import port
from tb.host.bench import run, said


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
