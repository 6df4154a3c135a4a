"""A mesh of 19 x 19 beams from simulation to points, and in the RTL."""

import numpy as np
import pytest

from hdl.protocol import Command, Reason
from model.optics.rigs import RIGS
from scripts.cyclope import cli
from scripts.demo import refresh
from scripts.paths import locked
from scripts.results.accuracy import compare, load_points, load_truth
from scripts.simulation.emulator import Emulator
from scripts.simulation.terminal import Terminal
from tb.link.command_host import Host
from tb.system.conftest import CACHE

CAPTURES = CACHE.with_name("dense")
#: Largest mean error, and least share found, of each kind.
LIMITS = {"mixed": (0.0008, 0.99), "tissue": (0.0035, 0.97)}


@pytest.fixture(scope="session")
def captures():
    """A capture of each kind, and the calibration of the first, made once for all workers."""
    def make():
        for kind in LIMITS:
            folder = CAPTURES / kind
            assert cli.main(["simulate", kind, str(folder), "--rig", "dense", "--frames", "6",
                             "--seed", "3"]) == 0
        assert cli.main(["calibrate", str(CAPTURES / "mixed"), "--no-picture", "-o",
                         str(CAPTURES / "calibration.json")]) == 0

    with locked(CAPTURES):
        refresh(CAPTURES, (*LIMITS, "calibration.json"), make)
    return CAPTURES


def measure(captures, folder, engine, frames):
    """The bytes of points.csv."""
    assert cli.main(["run", *map(str, frames), "--calibration", str(captures / "calibration.json"),
                     "--engine", engine, "--no-pictures", "-o", str(folder)]) == 0
    return (folder / "points.csv").read_bytes()


@pytest.mark.parametrize("kind", LIMITS)
def test_accuracy(captures, kind, tmp_path):
    """Own calibration, all defaults: found, right, and as exact as a mesh of 7 x 7."""
    measure(captures, tmp_path / "out", "model", [captures / kind])
    result = compare(load_points(tmp_path / "out" / "points.csv"),
                     load_truth(captures / kind / "truth.csv"), range(6))
    error, found = LIMITS[kind]
    assert result.expected > 2000
    assert result.found >= found and result.wrong <= 0.001
    assert result.mean <= error


def test_rtl_is_the_model(captures, tmp_path):
    frames = sorted((captures / "mixed" / "frames").glob("*_ir.png"))[:2]
    points = [measure(captures, tmp_path / engine, engine, frames)
              for engine in ("model", "rtl")]
    assert points[0] == points[1]
    beams = {int(line.split(b",")[1]) for line in points[0].splitlines()[1:]}
    assert beams == set(range(361))


def test_load_and_receive_from_the_rtl(captures, tmp_path):
    """What `cyclope emulate`, `load` and `receive` do, at 1 Mbaud: no frame is left out."""
    emulator = Emulator("mixed", RIGS["dense"], 4, scenes=3, baud=1_000_000)
    calibration, out = str(captures / "calibration.json"), tmp_path / "out"
    with Terminal(emulator, speed=None) as terminal:
        assert cli.main(["load", terminal.path, calibration, "--start"]) == 0
        assert cli.main(["receive", terminal.path, "--calibration", calibration, "--frames", "4",
                         "-o", str(out)]) == 0
    (tmp_path / "truth.csv").write_text("\n".join(emulator.truth()) + "\n")
    rows = [row.split(",") for row in (out / "frames.csv").read_text().splitlines()[1:]]
    lit = [int(row[0]) for row in rows if row[1] == "pattern" and row[2] == "on"]
    assert len(lit) >= 3 and np.ptp(lit) == 2 * len(lit) - 2
    result = compare(load_points(out / "points.csv"), load_truth(tmp_path / "truth.csv"), lit)
    assert result.expected > 350 * len(lit)
    assert result.found >= 0.99 and result.wrong <= 0.001 and result.mean <= 0.0008


@pytest.mark.parametrize("beams", [361, 512])
def test_numbers_of_beams_above_eight_bits(beams):
    """IDENTIFY and BEGIN carry them whole, and tables of so many words are written and read."""
    host = Host(beams=beams)
    other = (64, 48, beams & 0xFF)
    sizes = b"".join(size.to_bytes(2, "little") for size in other)
    assert host.ask(Command.BEGIN, sizes + bytes([1]))[0] == Reason.OTHER_SENSOR
    assert host.begin() == Reason.OK
    assert host.ask(Command.IDENTIFY)[0] == Reason.OK
    rng = np.random.default_rng(beams)
    for number in (0, 3):
        count = host.model.counts[number]
        bits = host.model.kinds[number].bits
        words = [int.from_bytes(rng.bytes(bits // 8), "little") for _ in range(count)]
        host.load(number, words)
    assert host.commit() == Reason.OK
    host.read_everything()
