"""``cyclope load`` and ``status``: what they do to a chip, and what they refuse."""

import os
import re
import signal

import numpy as np
import pytest

from calibration import file
from hdl.protocol import TABLE_VERSION, Mode
from model.link.points import PatternFrame
from scripts.host import load_plan, loading, port
from scripts.host.chip import REGISTERS
from scripts.host.commands import Commands
from scripts.host.guard import find_trips
from scripts.host.status import HEARTBEAT
from scripts.simulation.terminal import Terminal
from tb.benchmark import line_load
from tb.host.bench import QUICK, commands, load_chip, open_fake, open_rtl, rows, run, said
from tb.link.frames import near_points
from tb.system.fake_instrument import FakeInstrument, any_calibration, images


def test_load_stops_and_goes_on(each_terminal, rig, capsys):
    """Without a mode the chip stays in its own; without a calibration only the rest is done."""
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


def test_a_trip_is_shown_until_it_is_cleared(rig, tmp_path, capsys):
    """Light for longer than the ceiling is cut, and flagged in the frames. `load` would not ask for
    it."""
    with open_rtl(rig[0], images()) as terminal:
        load_chip(terminal, rig)
        with commands(terminal, timeout=0.5) as asking:
            asking.write("pattern_us", 2500)
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", tmp_path / "out",
                   "--frames", "6") == 3
        printed = capsys.readouterr().out
        assert "! the laser guard had tripped in " in printed
        assert ": it saw a pulse longer than the ceiling" in printed
        last = rows(tmp_path / "out" / "frames.csv")[-1]
        assert "tripped" in last["flags"].split()
        assert run("receive", tmp_path / "out" / "link.raw", "--calibration", rig[1], "-o",
                   tmp_path / "again") == 3
        assert ": it saw a pulse longer than the ceiling" in capsys.readouterr().out
        assert run("status", terminal.path) == 3
        assert ("! the laser guard has tripped: it saw a pulse longer than the ceiling; when the "
                "reason is gone, `cyclope load PORT --clear` forgets it.") in (
                    capsys.readouterr().out)
        assert run("load", terminal.path, "--pattern-us", "500", "--stop") == 3
        assert "the guard saw" in capsys.readouterr().out
        # The guard misses its heartbeat a while after the stop; that is the last that it notes.
        for _ in range(100):
            assert run("status", terminal.path) == 3
            if "frames that stopped coming" in " ".join(capsys.readouterr().out.split()):
                break
        assert run("load", terminal.path, "--clear", "--start") == 0
        assert "laser: armed\n" in capsys.readouterr().out


def test_a_stop_is_no_trip(rig, tmp_path, capsys):
    """The guard notes that frames stop coming; the next start clears that note, and no other."""
    with open_rtl(rig[0], images()) as terminal:
        assert run("load", terminal.path, "--start", "--capture-ms", "60000", *QUICK) == 0
        assert run("load", terminal.path, "--stop") == 0
        with commands(terminal, timeout=0.5) as asking:
            while asking.status()["guard_causes"] != HEARTBEAT:
                pass
        assert run("status", terminal.path) == 0
        assert run("load", terminal.path, "--start") == 0
        assert "laser: armed by the calibration capture\n" in capsys.readouterr().out
        load_chip(terminal, rig)  # stops and starts it
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", tmp_path / "out",
                   "--frames", "4") == 0
    with open_fake(rig[0], images()) as terminal:
        load_chip(terminal, rig, "--stop")
        terminal.instrument.guard_causes = HEARTBEAT | 1
        assert run("load", terminal.path, "--start") == 3
        assert terminal.instrument.guard_causes == HEARTBEAT | 1


def test_capture_and_causes(terminal, capsys):
    terminal.instrument.guard_causes = 0b10010
    assert run("load", terminal.path, "--capture-ms", "60000", "--start") == 3
    printed = capsys.readouterr().out
    assert ("laser: armed by the calibration capture; the guard saw a pulse too soon after "
            "another, frames that stopped coming") in printed
    assert "tables: none that are valid" in printed
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
    (16, (64, 48), (7, 1), "The calibration is for a sensor of 64 x 64 pixels, the chip has one of "
     "48 x 64: calibrate this rig."),
    (9, (64, 64), (7, 1), "The calibration has 16 beams, the chip is made for 9: calibrate this "
     "rig."),
    (16, (64, 64), (2, 1), "The chip speaks version 2 of the protocol, this program version 7: use "
     "the program of the chip's version."),
    (16, (64, 64), (7, 9), "The chip takes tables of version 9, this program has those of version "
     "1: use the program of the chip's version.")])
def test_other_chips_are_refused(beams, size, versions, sentence, rig, tmp_path, capsys):
    """Before anything is changed; what the receiver recorded until then is kept."""
    fake = FakeInstrument([np.zeros(size, np.uint8)], beams, None, *versions)
    with Terminal(fake, speed=8.0) as terminal:
        assert run("load", terminal.path, rig[1], "--start") == 2
        assert said(capsys) == sentence
        assert fake.registers["mode"] == Mode.STOP and not fake.machine.begun
        assert run("receive", terminal.path, "--calibration", rig[1], "-o", tmp_path / "out") == 2
        assert said(capsys).startswith(f"{sentence} {tmp_path / 'out' / 'link.raw'} keeps all ")


@pytest.mark.parametrize("choices, sentence", [
    ({"width": 48}, "The calibration is for a sensor of 48 x 64 pixels, the chip has one of "
     "64 x 64: calibrate this rig."),
    ({"rows": 3}, "The calibration has 12 beams, the chip is made for 16: calibrate this rig."),
    ({"remap": tuple(range(64 * 64))},
     "The calibration is for a chip that corrects whole images")])
def test_calibrations_for_other_chips_are_refused(choices, sentence, each_terminal, tmp_path,
                                                  capsys):
    """Before anything is changed; what the receiver recorded until then is kept."""
    path = tmp_path / "calibration.json"
    file.save(any_calibration(**{"rows": 4, "columns": 4, **choices}), path)
    assert run("load", each_terminal.path, path, "--start") == 2
    assert said(capsys).startswith(sentence)
    assert run("receive", each_terminal.path, "--calibration", path, "-o", tmp_path / "out") == 2
    assert said(capsys).startswith(sentence)
    assert run("status", each_terminal.path) == 0
    printed = capsys.readouterr().out.split()
    assert "stopped" in printed and "none" in printed
    assert (tmp_path / "out" / "link.raw").stat().st_size


def test_versions_agree():
    """A calibration file of this version is made for tables of this version."""
    assert file.VERSION == TABLE_VERSION
    assert set(any_calibration().settings.registers()) < set(REGISTERS)


def test_a_memory_at_fault_is_found(terminal, rig, capsys):
    terminal.instrument.forgetful = True
    words = rig[0].settings.radial
    terminal.instrument.shown = images()
    assert run("load", terminal.path, rig[1], "--start") == (0 if words[100] & 1 else 2)
    if not words[100] & 1:
        assert said(capsys).startswith(
            "The table radial reads back other than it was written, from word 100 on:")
    assert words[100] & 1 or not terminal.instrument.valid


TIMES = {"period_us": 40_000, "pattern_reset_us": 100, "pattern_us": 500, "texture_reset_us": 100,
         "texture_us": 10_000}
CIF, SMALL = ({"width": width, "height": height, "clock_khz": 16_000}
              for width, height in ((352, 288), (64, 64)))


@pytest.mark.parametrize("mode, change, identity, certain, possible", [
    (Mode.CONTINUOUS, {}, CIF, "", ""),
    (Mode.PATTERN, {"period_us": 59_999}, CIF, "", ""),
    (Mode.PATTERN, {"period_us": 60_000}, CIF, "a frame comes only every 60000 us", ""),
    (Mode.PATTERN, {"pattern_reset_us": 60_000}, CIF, "a frame comes only every", ""),
    (Mode.CONTINUOUS, {"period_us": 65_535}, CIF, "", ""),
    (Mode.CONTINUOUS, {"period_us": 65_535, "texture_us": 1}, SMALL, "", "a frame comes only"),
    (Mode.CONTINUOUS, {"texture_us": 60_000}, CIF, "a frame comes only every 66436 us", ""),
    (Mode.SINGLE, {"texture_us": 65_000}, CIF, "", ""),
    (Mode.SINGLE, {"pattern_us": 1001}, CIF, "pattern_us is 1001, and a pulse lasts 1000 us", ""),
    (Mode.CONTINUOUS, {"pattern_us": 1000}, CIF, "", ""),
    (Mode.CONTINUOUS, {"pattern_us": 501, "period_us": 1}, CIF, "", "pattern_us is 501 every "),
    (Mode.PATTERN, {"pattern_us": 501, "period_us": 39_999}, CIF, "any 40000 us hold 1000 us", ""),
    (Mode.PATTERN, {"pattern_us": 500, "period_us": 20_000}, CIF, "", ""),
    (Mode.PATTERN, {"period_us": 19_999}, SMALL, "", "a pattern comes every 19999 us"),
    (Mode.STOP, {"pattern_us": 5000, "period_us": 65_000}, CIF, "", "")])
def test_times_that_trip_the_guard_are_known(mode, change, identity, certain, possible):
    """For sure, or depending on how fast the imager is read out."""
    for words, reasons in zip((certain, possible), find_trips(mode, {**TIMES, **change}, identity),
                              strict=True):
        assert len(reasons) == bool(words) and all(words in reason for reason in reasons), reasons


@pytest.mark.parametrize("words", [
    ["--pattern-only", "--period-us", "65000"], ["--start", "--pattern-us", "1500"],
    ["--pattern-images", "--register", "period_us=60000", "--capture-ms", "100"]])
def test_times_that_trip_the_guard_are_refused(words, terminal, rig, capsys):
    assert run("load", terminal.path, rig[1], *words) == 2
    assert said(capsys).startswith("The laser guard would trip: ")
    assert terminal.instrument.registers["period_us"] == 40_000 and not terminal.instrument.valid
    # While it stands still it may have them; it does not start with them.
    assert run("load", terminal.path, "--stop", *words[1:]) == 0
    assert run("load", terminal.path, words[0]) == 2
    assert said(capsys).startswith("The laser guard would trip: ")
    assert terminal.instrument.registers["mode"] == Mode.STOP


def test_the_guard_trips_as_predicted(rig):
    """At the limits of the heartbeat, on the RTL."""
    with open_rtl(rig[0], images()) as terminal:
        assert run("load", terminal.path, "--pattern-only", "--period-us", "59000",
                   "--capture-ms", "60000") == 0
        with commands(terminal, timeout=0.5) as asking:
            def patterns(count):
                begin = asking.status()["pairs"]
                while asking.status()["pairs"] < begin + count:
                    pass
                return asking.status()["guard_causes"]
            assert patterns(2) == 0
            asking.write("period_us", 60_500)
            assert patterns(4) == HEARTBEAT


@pytest.mark.parametrize("baud", [115_200, 1_000_000])
def test_points_that_the_line_carries(baud):
    """... are those of a packed frame: nearly as many fit, and a tenth more does not."""
    def share(count):
        points = near_points(np.random.default_rng(1), count)
        points["saturated"] = points["border"] = False
        points["v"] = 100 << 9
        frame = PatternFrame(points=points, spots=count)
        return line_load.points_octets(frame) / line_load.octets_per_pair(baud)

    carried = loading.points_carried(baud, 40_000)
    assert share(carried * 95 // 100) <= 1 < share(carried * 11 // 10)
    assert loading.points_carried(baud, 40_000, full_records=True) < carried / 2
    assert loading.points_carried(1200, 1000) == 0


def test_a_line_that_is_too_slow_for_the_mesh(terminal, rig, capsys):
    load_chip(terminal, rig, "--stop")
    assert "the line carries" not in capsys.readouterr().out
    with commands(terminal) as asking:
        asking.write("divisor", 1200)
    load_chip(terminal, rig, "--stop")
    assert re.search(r"! at [\d,]+ baud the line carries about \d of 16 points in 40 ms: the chip "
                     r"measures one pattern frame in 3, 8.33 a second", capsys.readouterr().out)
    with commands(terminal) as asking:
        assert asking.read("pattern_every") == 3
    load_chip(terminal, rig, "--stop", "--register", "pattern_every=1")
    assert re.search(r"\d of 16 points in 40 ms: the others, spread over the mesh, are dropped",
                     capsys.readouterr().out)
    with commands(terminal) as asking:
        asking.write("pattern_every", 3)
        asking.write("divisor", 16)
    load_chip(terminal, rig, "--stop")
    with commands(terminal) as asking:
        assert asking.read("pattern_every") == 1


def test_single_says_who_receives_it(terminal, rig, capsys):
    load_chip(terminal, rig, "--stop")
    assert run("load", terminal.path, "--single") == 0
    assert "`cyclope receive PORT --single` takes another one" in capsys.readouterr().out


@pytest.mark.parametrize("mode", ["--start", "--pattern-only", "--single", "--pattern-images"])
def test_no_tables_no_light_no_success(mode, terminal, capsys):
    assert run("load", terminal.path, mode) == 3
    assert "there are no valid tables" in capsys.readouterr().out


def test_status_says_what_is_wrong(terminal, rig, capsys):
    """And its exit status does; a chip that stands still is not at fault."""
    assert run("status", terminal.path) == 0
    load_chip(terminal, rig)
    assert run("status", terminal.path) == 0
    terminal.instrument.machine.tables_valid = False
    assert run("status", terminal.path) == 3
    assert "! the laser stays off: there are no valid tables" in capsys.readouterr().out


def interrupt_at(monkeypatch, module, name, at, number=signal.SIGINT):
    """Let a signal come in the call ``at`` of a function."""
    real, calls = getattr(module, name), 0

    def counting(*arguments, **options):
        nonlocal calls
        calls += 1
        if calls == at:
            os.kill(os.getpid(), number)
        return real(*arguments, **options)

    monkeypatch.setattr(module, name, counting)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("where, at, sentence", [
    ((Commands, "identify"), 1, "Nothing was changed in the chip."),
    ((Commands, "begin"), 1, "The chip is stopped, the new tables are not complete"),
    ((Commands, "write_table"), 50, "The chip is stopped, the new tables are not complete"),
    ((Commands, "read_table"), 9, "The chip is stopped, the new tables are not complete"),
    ((load_plan, "write_registers"), 1,
     "The chip is stopped, the new tables are loaded, though not all of their registers"),
    ((load_plan, "wait_until"), 1, "The chip is running, the new tables are loaded")])
def test_an_interrupt_tells_the_state(where, at, sentence, number, terminal, rig, monkeypatch,
                                      capsys):
    """What was done to the chip until then, and how to do it all."""
    load_chip(terminal, rig)
    with monkeypatch.context() as patch:
        interrupt_at(patch, *where, at, number)
        assert run("load", terminal.path, rig[1], "--pattern-only", "--pattern-us", "400") == 130
    text = said(capsys)
    assert text.startswith(f"interrupted. {sentence}")
    if again := re.search("`cyclope (.*)`", text):
        assert run(*again[1].split()) == 0
        assert terminal.instrument.registers["mode"] == Mode.PATTERN
        assert terminal.instrument.registers["pattern_us"] == 400 and terminal.instrument.valid


def test_a_port_that_vanishes_while_loading(rig, capsys, monkeypatch):
    """The message has the state as far as it is known."""
    with open_fake(rig[0], images()) as terminal:
        real = loading.load

        def load_and_vanish(asking, calibration, progress):
            real(asking, calibration, lambda done, _: terminal.close() if done > 100 else None)

        monkeypatch.setattr(load_plan, "load", load_and_vanish)
        assert run("load", terminal.path, rig[1], "--start") == 2
        assert said(capsys).startswith(
            f"{terminal.path} is gone. The chip was stopped, the new tables are not complete: "
            f"`cyclope load {terminal.path} {rig[1]} --start` does it all.")
