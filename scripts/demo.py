"""``make demo``: a rig that does not exist, from its capture folder to 3-D points.

Simulates a capsule that looks at a polyp on a gut wall, calibrates it from its own capture, and
measures the frames with the RTL. Capture and calibration are kept until the programs that made
them change.
"""

import hashlib
import shutil
import sys
import time
from pathlib import Path

from scripts import cli
from scripts.errors import UserError

__all__ = ["main", "prepare"]

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "out" / "demo"
#: Fewer beams found than this, and something is broken.
LEAST_FOUND = 0.9
_MAKERS = ("calibration", "model", "scripts/simulate.py", "scripts/calibrate.py",
           "scripts/demo.py")

_LEFT = (
    ("result/point_cloud.png", "the point cloud, from several sides"),
    ("result/depth_error.png", "errors against the truth, over depth and over the image"),
    ("result/frames/", "every frame with spots, beams and epipolar lines"),
    ("result/points.csv", "one row per spot"),
    ("result/points.ply", "the point cloud for MeshLab, CloudCompare or Blender"),
    ("result/summary.txt", "the tables above, all frames"),
    ("calibration.json", "what the chip was loaded with"),
    ("calibration.png", "how well lens and beams were learnt"),
    ("capture/", "the simulated capture; a capture of yours looks the same"))


def _stamp():
    """Changes when anything that makes the capture or the calibration does."""
    digest = hashlib.sha256()
    for name in _MAKERS:
        path = ROOT / name
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _show(*words):
    """Print a ``cyclope`` command as it would be typed."""
    here = Path.cwd()
    print("$ cyclope " + " ".join(
        str(word.relative_to(here) if isinstance(word, Path) and word.is_relative_to(here)
            else word) for word in words), flush=True)


def _command(*words):
    _show(*words)
    status = cli.main(words)
    if status:
        sys.exit(status)


def prepare(folder):
    """Capture and calibration in ``folder``, made anew only if need be; gives their paths."""
    stamp, capture, calibration = folder / "stamp", folder / "capture", folder / "calibration.json"
    wanted = _stamp()
    if stamp.exists() and stamp.read_text() == wanted and capture.exists() and calibration.exists():
        print("capture and calibration are there already")
        return capture, calibration
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    _command("simulate", "polyp", capture, "--rig", "capsule", "--frames", "12", "--seed", "1")
    _command("calibrate", capture, "-o", calibration)
    stamp.write_text(wanted)
    return capture, calibration


def _measure(folder, capture, calibration, engine):
    from scripts.run import run
    result = folder / "result"
    shutil.rmtree(result, ignore_errors=True)
    _show("run", capture, "--calibration", calibration, "--engine", engine, "-o", result)
    return run([capture], calibration, result, engine)


def main(folder=FOLDER, engine="rtl"):
    """Run the demonstration in a folder of its own; gives the exit status."""
    start = time.monotonic()
    try:
        capture, calibration = prepare(folder)
        _, accuracy = _measure(folder, capture, calibration, engine)
    except UserError as error:
        print(f"cyclope: {error}", file=sys.stderr)
        return 2
    print(f"\nLook at, in {folder}:")
    for name, purpose in _LEFT:
        print(f"  {name:24} {purpose}")
    print(f"\ndone in {time.monotonic() - start:.0f} s")
    if not accuracy.found >= LEAST_FOUND:
        print(f"cyclope: only {100 * accuracy.found:.0f} % of the beams were found, which a "
              "simulated rig should not do.", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
