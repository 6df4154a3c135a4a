"""``make demo``: the whole instrument in simulation, from its imager's pins to 3-D points.

Simulates the capture of an endoscope and calibrates it. Then the whole instrument runs as RTL: the
imager looks at a polyp on a gut wall, the sequencer exposes it with and without the laser, and the
points that come over the serial line are compared with the truth. Capture and calibration are kept
until the programs that made them change.
"""

import argparse
import hashlib
import json
import shlex
import shutil
import sys
import time
from pathlib import Path

from scripts.cyclope import cli
from scripts.cyclope.program import program
from scripts.paths import ROOT

__all__ = ["main", "prepare", "refresh"]

FOLDER = ROOT / "out" / "demo"
#: Fewer beams found than this, and something is broken.
LEAST_FOUND = 0.9
_MAKERS = ("calibration", "model", "scripts/cyclope/simulate.py", "scripts/cyclope/calibrate.py",
           "scripts/demo.py")

OUTPUTS = (
    ("result/point_cloud.png", "the point cloud, from several sides"),
    ("result/depth_error.png", "errors against the truth, over depth and over the image"),
    ("result/frames/", "pattern frames with spots, beams and epipolar lines"),
    ("result/texture.png", "the part of the texture that was received"),
    ("result/points.csv", "one row per spot"),
    ("result/points.ply", "the point cloud for MeshLab, CloudCompare or Blender"),
    ("result/frames.csv", "one row per frame: exposure, time, laser, counts"),
    ("result/link.raw", "all octets of the serial line"),
    ("result/truth.csv", "the true points of the imager's scenes"),
    ("result/summary.json", "the figures of the table above"),
    ("calibration.json", "the calibration that the chip was loaded with"),
    ("calibration.png", "how well lens and beams fit the capture"),
    ("capture/", "the simulated capture; yours has the same form"))
_COLUMNS = ("number", "kind", "laser", "flags", "level", "grey_noise", "saturated", "spots",
            "rejected", "dropped")
#: Pairs of frames to compare with the truth, and scenes that they show in turn.
_FRAMES, _SCENES = 24, 12
#: Pairs to receive: the chip may need one to learn its levels.
_RECEIVED = _FRAMES + 1


def _makers_digest():
    """A hash of all programs that make the capture and the calibration."""
    digest = hashlib.sha256()
    for name in _MAKERS:
        path = ROOT / name
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _near(path):
    """A path as short as it can be typed."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def _typed(*words):
    """A ``cyclope`` command as it can be pasted."""
    return " ".join([program(), *(
        shlex.quote(str(_near(word) if isinstance(word, Path) else word)) for word in words)])


def _command(*words):
    print("$", _typed(*words), flush=True)
    status = cli.main(words)
    if status:
        sys.exit(status)


def refresh(folder, names, make):
    """Have ``make()`` fill a new ``folder`` if it does not hold the files ``names``, made by these
    programs; gives whether it did."""
    stamp, wanted = folder / "stamp", _makers_digest()
    if stamp.exists() and stamp.read_text() == wanted and all(
            (folder / name).exists() for name in names):
        return False
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    make()
    stamp.write_text(wanted)
    return True


def prepare(folder):
    """Capture and calibration in ``folder``, remade only if necessary; gives their paths."""
    capture, calibration = folder / "capture", folder / "calibration.json"

    def make():
        _command("simulate", "polyp", capture, "--rig", "endoscope", "--frames", "12", "--seed",
                 "1")
        _command("calibrate", capture, "-o", calibration)

    if not refresh(folder, (capture.name, calibration.name), make):
        print("capture and calibration are there already")
    return capture, calibration


def _run_instrument(folder, calibration):
    """Load the instrument, start it, receive from it; gives the emulator."""
    from model.optics.rigs import RIGS
    from scripts.simulation.emulator import Emulator
    from scripts.simulation.terminal import Terminal

    result = folder / "result"
    shutil.rmtree(result, ignore_errors=True)
    print("building and starting the instrument", flush=True)
    emulator = Emulator("polyp", RIGS["endoscope"], seed=2, scenes=_SCENES)
    with Terminal(emulator, step_us=200, speed=None) as terminal:
        _command("load", terminal.path, calibration, "--start")
        _command("receive", terminal.path, "--calibration", calibration, "--frames", _RECEIVED,
                 "-o", result)
    return emulator


def _evaluate(folder, calibration_path, emulator):
    """Draw frames and plots, compare the points with the truth; gives the figures."""
    import numpy as np
    from rich.console import Console

    from calibration import file
    from calibration.csv_table import read_table
    from scripts.results.accuracy import compare, load_points, load_truth
    from scripts.results.demo_figures import figures
    from scripts.results.overlay import beam_segments, draw_frame, write_picture
    from scripts.results.points import FrameResult
    from scripts.results.report_plots import plot_cloud, plot_error
    from scripts.results.summary import accuracy_table

    result = folder / "result"
    calibration = file.load(calibration_path)
    (result / "truth.csv").write_text("\n".join(emulator.truth()) + "\n")
    points, truth = load_points(result / "points.csv"), load_truth(result / "truth.csv")
    frames = [row for row in read_table(result / "frames.csv", _COLUMNS, "run the demo again")
              if row.text("kind") == "pattern" and row.text("laser") == "on"
              and "learning" not in row.text("flags").split()][:_FRAMES]
    numbers = [int(row.text("number")) for row in frames]
    accuracy = compare(points, truth, numbers)
    (result / "frames").mkdir()
    segments = beam_segments(calibration)
    for row, number in zip(frames, numbers, strict=True):
        if number > numbers[0] + 2 * _SCENES - 2:
            break
        image = emulator.shown[number][0]
        grey = (float(row.text(name)) for name in _COLUMNS[4:6])
        counts = (int(row.text(name)) for name in _COLUMNS[6:])
        frame = FrameResult(number, result, None, *grey, *counts,
                            points[points["frame"] == number])
        write_picture(result / "frames" / f"{number:04}.png", draw_frame(image, frame, segments))
    first = np.isin(points["frame"], numbers[:_SCENES])
    plot_cloud(result / "point_cloud.png", points[first], calibration.columns)
    plot_error(result / "depth_error.png", accuracy, calibration.width, calibration.height)
    Console().print(accuracy_table({f"{len(numbers)} frames with the laser on": accuracy}))
    summary = figures(len(numbers), accuracy)
    (result / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    return summary


def _demonstrate(folder, readme):
    """Run all of it; gives the exit status."""
    from scripts.results.demo_figures import sentence, updated

    start = time.monotonic()
    capture, calibration = prepare(folder)
    emulator = _run_instrument(folder, calibration)
    summary = _evaluate(folder, calibration, emulator)
    print(f"\nLook at, in {_near(folder)}:")
    for name, purpose in OUTPUTS:
        print(f"  {name:24} {purpose}")
    print("\nThis measures the images of the capture:")
    print("$", _typed("run", capture, "--calibration", calibration, "-o", folder / "run"))
    print(f"\n{sentence(summary)}")
    print(f"done in {time.monotonic() - start:.0f} s")
    if readme is not None:
        readme.write_text(updated(readme.read_text(), summary))
    if not summary["found"] >= LEAST_FOUND:
        print(f"cyclope: only {100 * summary['found']:.0f} % of the beams were found, which a "
              "simulated rig should not do.", file=sys.stderr)
        return 3
    return 0


def main(folder=FOLDER, readme=None):
    """Run the demonstration in ``folder``; gives the exit status.

    With ``readme``, write its figures into that file.
    """
    return cli.guarded(lambda: _demonstrate(folder, readme))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m scripts.demo",
                                     description="Run the demonstration.")
    parser.add_argument("--readme", action="store_true",
                        help="write its figures into README.md")
    sys.exit(main(readme=ROOT / "README.md" if parser.parse_args().readme else None))
