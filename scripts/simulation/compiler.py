"""Compiles what Verilator writes: a design in one piece; headers and runtime once for all designs.

Verilator's makefiles compile many files, each with all headers, and in each folder the runtime
again, which takes two to four times as long as this. Designs are compiled with ``-O1``: they run as
fast as with ``-O2``.
"""

import hashlib
import re
import shutil
from importlib import metadata
from pathlib import Path

from scripts import paths

__all__ = ["compile_verilated"]

BUILD = paths.COMPILED / "runtime"
#: C++20 for the coroutines of designs with delays; the same for all, so that all share a runtime.
_FLAGS = ("-fPIC", "-fno-semantic-interposition", "-std=c++20")
#: What is precompiled: Verilator's headers, and what harnesses include.
_HEADERS = ("verilated.h", "verilated_vpi.h", "algorithm", "array", "cstdint", "cstring", "deque",
            "map", "memory", "string", "vector")


def compile_verilated(run, objects, prefix, result, sources=(), options=()):
    """Compile and link the design that ``verilator --cc`` wrote to a folder.

    Parameters
    ----------
    run : callable
        Runs the words of a command, in the folder that holds ``objects``; gives what it printed.
    objects : :class:`pathlib.Path`
        The folder.
    prefix : :class:`str`
        Verilator's ``--prefix``.
    result : path
        The file to write.
    sources : sequence of path
        More C++, compiled with the design.
    options : sequence of :class:`str`
        For the linker, ``-shared`` for one.
    """
    makefile = (objects / f"{prefix}.mk").read_text()
    classes = (objects / f"{prefix}_classes.mk").read_text()
    defined = re.findall(r"^(VM_(?:COVERAGE|SC|TRACE\w*)) = (\d)$", classes, re.M)
    flags = [*_FLAGS, *_listed(makefile, "VM_USER_CFLAGS")]
    flags += ["-DVERILATOR=1", "-DVM_SC=0", *(f"-D{name}={value}" for name, value in defined)]
    include = Path(run("verilator", "--getenv", "VERILATOR_ROOT").strip(), "include")
    flags += [f"-I{include}", f"-I{include / 'vltstd'}"]
    units = _listed(classes, "VM_GLOBAL_FAST") + _listed(classes, "VM_GLOBAL_SLOW")
    runtime = _runtime(run, include, flags, units)
    whole = objects / "whole.cpp"
    whole.write_text("".join(
        f'#include "{file}"\n' for file in (*sorted(objects.glob(f"{prefix}*.cpp")), *sources)))
    made = whole.with_suffix(".o")
    run("c++", "-O1", *flags, "-include", str(runtime / "headers.h"), f"-I{objects}", "-c",
        str(whole), "-o", str(made))
    run("c++", str(made), *(str(runtime / f"{unit}.o") for unit in units), *options, "-lpthread",
        "-o", str(result))


def _listed(makefile, variable):
    """The words of a variable of Verilator's makefiles."""
    found = re.search(rf"^{variable} \+?= \\\n((?:  .*\\\n)*)", makefile, re.M)
    return found[1].replace("\\\n", " ").split() if found else []


def _runtime(run, include, flags, units):
    """Folder with Verilator's ``units`` compiled, and with precompiled headers."""
    key = "\0".join((run("c++", "--version"), str(include), _version(), *flags))
    folder = BUILD / hashlib.sha256(key.encode()).hexdigest()[:16]
    launcher = ["ccache"] if shutil.which("ccache") else []
    with paths.locked(folder):
        folder.mkdir(exist_ok=True)
        for unit in units:
            _made(folder / f"{unit}.o", lambda part, unit=unit: run(
                *launcher, "c++", "-O2", *flags, "-c", str(include / f"{unit}.cpp"), "-o", part))
        header = folder / "headers.h"
        if not header.exists():
            header.write_text("".join(f"#include <{name}>\n" for name in _HEADERS))
        _made(folder / f"{header.name}.gch", lambda part: run(
            "c++", "-O1", *flags, "-x", "c++-header", str(header), "-o", part))
    return folder


def _made(path, make):
    """Have ``make(name)`` write a file unless it is there; it gets its name when it is whole."""
    if not path.exists():
        part = path.with_name(f"{path.name}.part")
        make(str(part))
        part.rename(path)


def _version():
    try:
        return metadata.version("verilator")
    except metadata.PackageNotFoundError:  # the system's, whose version is in its path or not
        return ""
