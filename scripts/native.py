"""Verilog and a C++ harness to a shared library, without VPI."""

import fcntl
import hashlib
import shutil
import subprocess
from pathlib import Path

from scripts.verilator import verilator_environment

__all__ = ["ROOT", "build"]

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build" / "native"
_PIC = "-fPIC -fno-semantic-interposition -std=c++17"


def build(name, key, verilog, harness, optimise=True):
    """Path of a shared library of a Verilated module and its harness; built if it is not there.

    Parameters
    ----------
    name : :class:`str`
        Name of the Verilog module, and of the C++ class with a ``V`` before it.
    key : :class:`str`
        All that the library depends on; a change of it makes another library.
    verilog : callable
        Gives the Verilog text when it is needed.
    harness : :class:`str`
        C++ text.
    optimise : :class:`bool`
        Take time to compile, for long runs.

    Raises
    ------
    RuntimeError
        If a step fails; what it printed is in ``build.log`` in the library's folder.
    """
    digest = hashlib.sha256((key + harness).encode()).hexdigest()[:16]
    folder = BUILD / f"{name}-{digest}"
    library = folder / f"lib{name}.so"
    if library.exists():
        return library
    folder.parent.mkdir(parents=True, exist_ok=True)
    with open(folder.parent / f".{folder.name}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not library.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            (folder / f"{name}.v").write_text(verilog())
            (folder / "harness.cpp").write_text(harness)
            _compile(folder, name, optimise).rename(library)
    return library


def _compile(folder, name, optimise):
    environment = verilator_environment()

    def step(*command):
        done = subprocess.run(command, cwd=folder, env=environment, text=True,
                              stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT)
        if done.returncode:
            (folder / "build.log").write_text(done.stdout)
            raise RuntimeError(f"{command[0]} failed, see {folder / 'build.log'}:\n"
                               + done.stdout[-3000:])
        return done.stdout

    slow = "-O1" if optimise else "-O0"
    step("verilator", "--cc", f"{name}.v", "--top-module", name, "--prefix", f"V{name}", "-Mdir",
         "objects", "-Wno-fatal", "-O3", "--x-assign", "fast", "--x-initial", "fast", "--noassert",
         "-CFLAGS", _PIC)
    step("make", "-s", "-C", "objects", "-f", f"V{name}.mk", "OPT_FAST=-O2", f"OPT_SLOW={slow}",
         f"OPT_GLOBAL={'-O2' if optimise else '-O1'}")
    include = Path(step("verilator", "--getenv", "VERILATOR_ROOT").strip()) / "include"
    step(*environment.get("OBJCACHE", "").split(), "c++", *_PIC.split(), "-O2", "-Iobjects",
         f"-I{include}", f"-I{include / 'vltstd'}", "-c", "harness.cpp", "-o", "harness.o")
    step("c++", "-shared", "harness.o", f"objects/libV{name}.a", "objects/libverilated.a",
         "-lpthread", "-o", "partial.so")
    return folder / "partial.so"
