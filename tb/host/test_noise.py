"""Commands over a line with noise in both directions."""

import pytest

from hdl.protocol import Mode
from scripts.host.commands import Commands
from scripts.simulation.terminal import Terminal
from tb.host.bad_line import BadLine
from tb.host.bench import TEXTURE, run
from tb.system.fake_instrument import FakeInstrument, images
from tb.system.played_instrument import PlayedInstrument


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    """The fake answers at once."""
    monkeypatch.setattr(Commands.__init__, "__defaults__", (0.1, 8, 3.0))


def chip(rig, running=False):
    """A fake instrument; the calibration's tables are in it if it runs."""
    fake = FakeInstrument(images(), len(rig[0].settings.line), TEXTURE)
    if running:
        fake.machine.tables_valid = True
        fake.machine.written["mode"] = fake.machine.acting["mode"] = int(Mode.CONTINUOUS)
    return fake


@pytest.mark.parametrize("command, running, seed", [
    *((command, running, seed) for seed in range(20) for command, running in (
        (["status", "--registers"], False), (["status"], True), (["load", "--stop"], True))),
    *((["load", "--start"], None, seed) for seed in range(4))])
def test_commands_come_through(command, running, seed, rig, capsys):
    """Whatever is between them, and however many replies to damage are on their way."""
    strays = 4e-3 if running is None else 1e-2
    line = BadLine(chip(rig, running), seed, flips=2e-4, strays=strays)
    words = [rig[1]] if running is None else []
    with Terminal(line, speed=8.0) as terminal:
        assert run(command[0], terminal.path, *words, *command[1:]) == 0
    assert capsys.readouterr().err == "" and min(line.added) > 0
    if command[0] == "load":
        assert (line.valid, line.registers["mode"]) == (True, Mode.STOP if running else 1)


@pytest.mark.parametrize("seed", range(20))
def test_replies_to_damage_that_wait(seed, rig, capsys):
    """Stray octets came before the program did, in more packets than a command is tried."""
    fake = chip(rig)
    fake.send(b"\0" + b"\x55\x66\x77\x88\x99\xaa\xbb\0" * (10 + 5 * seed))
    assert fake.counters["damaged"] >= 10
    with Terminal(fake, speed=8.0) as terminal:
        assert run("status", terminal.path) == 0
    assert capsys.readouterr().err == "" and fake.counters["accepted"] == 3


@pytest.mark.parametrize("seed", range(3))
def test_noise_at_the_rtl(seed, capsys):
    """Strays and flips at the receiver of the chip itself."""
    line = BadLine(PlayedInstrument(images(), TEXTURE), seed, flips=2e-4, strays=1e-2)
    line.instrument.send(b"\0" + b"\x55\x66\x77\x88\x99\xaa\xbb\0" * 20)
    with Terminal(line, step_us=250, speed=None) as terminal:
        assert run("load", terminal.path, "--start", "--capture-ms", "60000") == 0
        assert run("status", terminal.path) == 0
    assert capsys.readouterr().err == "" and min(line.added) > 0
