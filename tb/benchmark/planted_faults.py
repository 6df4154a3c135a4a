"""Plant faults in the RTL, one after the other, and run the test that has to find each.

``python -m tb.benchmark.planted_faults`` takes them all, which is about half an hour; names of
faults behind it choose some. Exit status: 0 if all are found, 1 if not, 2 for an unknown name.
A fault counts as found when its test fails, so run ``make test`` before: without faults it must
pass. Each fault has its own copy of the sources under ``build``, which is removed afterwards.
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from scripts.paths import BUILD, ROOT
from tb.benchmark.faults import FAULTS
from tb.dependencies import PACKAGES

__all__ = ["copy_sources", "found_by", "main", "plant"]

#: Seconds after which a test is stopped. Its fault then counts as not found.
_LIMIT = 900
_FAILED, _STOPPED = 1, None


def copy_sources(folder):
    """Copy to ``folder`` what tests of the RTL need; results of earlier runs stay behind."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package,
                        ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)


def plant(fault, folder):
    """Change the fault's file in ``folder``; ValueError unless its text is there exactly once."""
    file = folder / fault.file
    text = file.read_text()
    if text.count(fault.old) != 1:
        raise ValueError(f"{fault.name}: {fault.file} must contain {fault.old!r} exactly once, "
                         f"not {text.count(fault.old)} times: correct it in tb/benchmark/faults.py")
    file.write_text(text.replace(fault.old, fault.new))


def _run(test, folder):
    """Exit status of pytest, None if it was stopped, and what it printed."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider",
               "-p", "no:tb.unchanged", test]
    process = subprocess.Popen(
        command, cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env=os.environ | {"CI": "true"}, start_new_session=True)
    try:
        output, _ = process.communicate(timeout=_LIMIT)
        return process.returncode, output
    except subprocess.TimeoutExpired:
        return _STOPPED, ""
    finally:
        if process.poll() is None:  # simulators too
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def found_by(fault):
    """The test that fails with the fault, an empty string if none does.

    Raises
    ------
    ValueError
        If the fault cannot be planted.
    RuntimeError
        If its test cannot be run.
    """
    BUILD.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f"{fault.name}_", dir=BUILD) as folder:
        copy_sources(Path(folder))
        plant(fault, Path(folder))
        status, output = _run(fault.test, folder)
    if status not in (0, _FAILED, _STOPPED):
        raise RuntimeError(f"{fault.name}: {fault.test} cannot be run:\n{output[-2000:]}")
    failed = re.search(r"^FAILED (.+?)(?: - |$)", output, re.MULTILINE)
    return failed[1] if failed else ""


def main(arguments=None):
    """Print the table; gives the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m tb.benchmark.planted_faults", description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these faults")
    names = parser.parse_args(arguments).names
    known = {fault.name: fault for fault in FAULTS}
    unknown = [name for name in names if name not in known]
    if unknown:
        parser.error(f"There is no fault {unknown[0]!r}; there are: {', '.join(known)}.")
    chosen, missed = [known[name] for name in names or known], 0
    for fault in chosen:
        begin = time.monotonic()
        test = found_by(fault)
        missed += not test
        print(f"{fault.name:<38} {test or 'NOT FOUND':<80} {time.monotonic() - begin:4.0f} s",
              flush=True)
    print(f"{len(chosen) - missed} of {len(chosen)} found")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
