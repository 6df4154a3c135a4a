"""What the tests of the reader share: instruments behind pseudo-terminals, and commands."""

import csv
from contextlib import contextmanager

import numpy as np

from calibration import file
from model.capsule import Capsule
from scripts.cyclope import cli
from scripts.host import port
from scripts.host.commands import Commands
from scripts.results.locator import Locator
from scripts.simulation.terminal import Terminal
from tb.system.fake_instrument import FakeInstrument, any_calibration, images
from tb.system.played_instrument import PlayedInstrument

__all__ = ["INSTRUMENTS", "QUICK", "TEXTURE", "babbling", "commands", "contents", "load_chip",
           "open_fake", "open_rtl", "record", "rows", "run", "said", "spots_sent", "truth"]

TEXTURE = np.random.default_rng(1).integers(0, 256, (64, 64), np.uint8)
#: The shortest period that the laser guard bears: less to simulate.
QUICK = ("--period-us", "20000")


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


#: What the reader is tested against: a context manager, given the calibration and the frames to
#: show, of something with the members of :class:`scripts.simulation.terminal.Terminal`.
INSTRUMENTS = {"fake": open_fake, "rtl": open_rtl}


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


@contextmanager
def commands(terminal, **choices):
    """Commands to an instrument, that do not wait long."""
    with port.open_port(terminal.path) as opened:
        yield Commands(opened, **{"timeout": 0.15, "patience": 0.3, **choices})


def run(*words):
    """Exit status of a ``cyclope`` command."""
    return cli.main(list(words))


def load_chip(terminal, rig, *words):
    """Load and start, or whatever is asked for."""
    assert run("load", terminal.path, rig[1], *(words or ["--start"])) == 0


def record(folder, frames):
    """A folder with a calibration, and in ``out`` what ``cyclope receive`` made of so many frames
    of a chip that it was loaded into; gives the calibration."""
    calibration = any_calibration(rows=4, columns=4)
    file.save(calibration, folder / "calibration.json")
    with open_fake(calibration, images()) as terminal:
        load_chip(terminal, (calibration, folder / "calibration.json"), "--start", *QUICK)
        assert run("receive", terminal.path, "--calibration", folder / "calibration.json",
                   "--frames", str(frames), "-o", folder / "out") == 0
    return calibration


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


def _rows(located):
    """Rows of points.csv of points with coordinates, without their status."""
    return [(str(point["frame"]), str(point["beam"]), f"{point['u']:.4f}", f"{point['v']:.4f}",
             str(point["area"]), *(f"{point[name]:.4f}" for name in "xyz"))
            for point in located if np.isfinite(point["z"])]


def _found(instrument, calibration):
    """The ok spots of all frames that were shown."""
    model = Capsule(calibration.settings, 64, 64)
    found = [model.frame(image).points for image in instrument.shown]
    return [points[points["status"] == 0] for points in found]


def truth(instrument, numbers, calibration):
    """What the model finds in frames, given in their order: rows of ok and doubtful points."""
    found, locate = _found(instrument, calibration), Locator(calibration)
    return [row for number in numbers for row in _rows(locate(
        found[instrument.pattern(number)], number, np.zeros((64, 64), np.uint8)))]


def spots_sent(instrument, numbers, calibration):
    """As :func:`truth`, but for each ok spot as if it were the only one of its frame."""
    found = _found(instrument, calibration)
    return {row for number in numbers for spot in found[instrument.pattern(number)]
            for row in _rows(Locator(calibration)(
                np.array([spot]), number, np.zeros((64, 64), np.uint8)))}
