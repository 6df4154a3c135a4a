"""Builds a block once, runs cocotb benches on it under pytest.

Amaranth blocks become Verilog for Verilator; hand-written VHDL twins go to GHDL. Builds are cached
under ``build/sim`` by the hash of all that goes into them. ``WAVES=1`` keeps waves there too.
"""

import contextlib
import hashlib
import json
import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path

import pytest
from cocotb_tools import config as cocotb_config
from cocotb_tools import runner as cocotb_runner

from scripts import paths
from scripts.paths import ROOT
from scripts.simulation import compiler
from scripts.simulation.compiler import compile_verilated
from scripts.simulation.library import ZEROS
from scripts.simulation.verilator import verilator_environment
from tb.verilog import cached_verilog

__all__ = ["run", "prepare_environment", "require_ghdl"]

BUILD = paths.COMPILED / "sim"
WAIVERS = ROOT / "tb" / "verilator.vlt"
WAVES = os.environ.get("WAVES") == "1"
#: Files that make a simulator of its sources.
_MAKERS = (Path(__file__), Path(compiler.__file__), WAIVERS)


def prepare_environment():
    """Put this process, and so every simulator it starts, into Verilator's environment."""
    os.environ.update(verilator_environment())


def _plain(folder):
    """A folder, or a link to it where makefiles could not name it."""
    if paths.plain(folder):
        return folder
    link = BUILD / Path(folder).name
    with contextlib.suppress(FileExistsError):
        link.symlink_to(folder)
    return link


class _Verilator(cocotb_runner.Verilator):
    """cocotb's runner with only the top's ports public: half the build time, twice the speed.

    It stops at what Verilator writes, which :func:`_compile` compiles.
    """

    def _build_command(self):
        command, _ = super()._build_command()
        at = command.index("--public-flat-rw")
        command[at:at + 1] = ["--public-depth", "1"]
        packages = str(cocotb_config.libs_dir.parents[1])
        return [[word.replace(packages, str(_plain(packages))) for word in command]]


def _compile(folder, name, log):
    """The simulator of the design that Verilator wrote to a folder."""
    def run(*command):
        done = subprocess.run(command, cwd=folder, text=True, errors="replace",
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if done.returncode:
            with open(log, "a") as file:
                file.write(f"{' '.join(command)}\n{done.stdout}")
            raise RuntimeError(f"{command[0]} failed")
        return done.stdout

    libraries = _plain(cocotb_config.libs_dir)
    main = cocotb_config.share_dir / "lib" / "verilator" / "verilator.cpp"
    compile_verilated(run, folder, "Vtop", folder / name, [main], [
        f"-Wl,-rpath,{libraries}", f"-L{libraries}", "-lcocotbvpi_verilator"])


def _runner(simulator):
    return _Verilator() if simulator == "verilator" else cocotb_runner.get_runner(simulator)


@cache
def _version(program):
    found = shutil.which(program)
    if not found:
        return None
    answer = subprocess.run([found, "--version"], capture_output=True, text=True)
    return found + (answer.stdout + answer.stderr).split("\n")[0]


def require_ghdl():
    """Leave the test out where GHDL is missing; with CI=true that is a failure."""
    prepare_environment()
    if _version("ghdl") is None:
        message = "GHDL is not installed: `apt-get install ghdl` to run the VHDL twins"
        if os.environ.get("CI") == "true":
            pytest.fail(message, pytrace=False)
        pytest.skip(message)


def _build(simulator, name, sources, arguments):
    digest = hashlib.sha256(json.dumps(
        [simulator, _version(simulator), name, arguments, WAVES, sys.version,
         *(file.read_text() for file in _MAKERS)]).encode())
    for label, text in sources:
        digest.update(label.encode() + text.encode())
    folder = BUILD / f"{name}-{simulator}-{digest.hexdigest()[:16]}"
    with paths.locked(folder):
        if (folder / ".ok").exists():
            return folder
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        files = []
        for label, text in sources:
            files.append(folder / label)
            files[-1].write_text(text)
        log = folder / "build.log"
        try:
            _runner(simulator).build(
                sources=([WAIVERS] if simulator == "verilator" else []) + files,
                hdl_toplevel=name, build_dir=folder, always=True, build_args=list(arguments),
                waves=WAVES, timescale=("1ns", "1ps"), log_file=log)
            if simulator == "verilator":
                _compile(folder, name, log)
        except (Exception, SystemExit):
            text = log.read_text(errors="replace") if log.exists() else ""
            pytest.fail(f"{simulator} could not build {name}:\n{text[-4000:]}", pytrace=False)
        (folder / ".ok").touch()
    return folder


def run(request, name, test_module, *, component=None, vhdl=None, standard="08", generics=None,
        parameters=None, testcase=None, seed=1, verilog=None, build_args=(), plusargs=()):
    """Run the cocotb tests of ``test_module`` on one block.

    Parameters
    ----------
    request : pytest fixture
        Names the run's folder.
    name : :class:`str`
        Module or entity.
    test_module : :class:`str`
        Python module with the cocotb tests, dotted from the project's root.
    component : :class:`amaranth.lib.wiring.Component`, optional
        Exported to Verilog for Verilator. Give this, ``verilog`` or ``vhdl``.
    verilog : :class:`dict`, optional
        Verilog texts by file name, where the bench needs more than the block itself.
    vhdl : list of path, optional
        VHDL files for GHDL, in order of analysis, from the project's root.
    standard : ``"93"`` or ``"08"``
        VHDL standard.
    generics : :class:`dict`, optional
        Integer generics of the VHDL entity.
    parameters : :class:`dict`, optional
        What the bench must know; it reads it with :func:`tb.harness.parameters`.
    testcase : :class:`str`, optional
        Only this test.
    build_args, plusargs : sequence of :class:`str`
        More for Verilator, and for the simulation.

    Fails the pytest test if any cocotb test fails, or none runs.
    """
    prepare_environment()
    if vhdl is None:
        simulator, standards = "verilator", []
        texts = {f"{name}.v": cached_verilog(component, name)} if verilog is None else verilog
        sources = [(label, ZEROS.sub("", text)) for label, text in texts.items()]
    else:
        require_ghdl()
        simulator, standards = "ghdl", [f"--std={standard}"]
        sources = [(Path(file).name, (ROOT / file).read_text()) for file in vhdl]
    folder = _build(simulator, name, sources, [*standards, *build_args])

    safe = "".join(c if c.isalnum() or c in "._-" else "_" for c in request.node.nodeid)
    results = BUILD / "runs" / safe
    shutil.rmtree(results, ignore_errors=True)
    results.mkdir(parents=True)
    xml, log = results / "results.xml", results / "sim.log"
    error = None
    try:
        _runner(simulator).test(
            hdl_toplevel=name, hdl_toplevel_lang="vhdl" if vhdl else "verilog",
            test_module=test_module, testcase=testcase, build_dir=folder, test_dir=results,
            results_xml=str(xml), parameters=dict(generics or {}) if vhdl else None,
            test_args=[*standards, f"--workdir={folder}"] if vhdl else [],
            plusargs=["--ieee-asserts=disable-at-0", "--assert-level=error"] if vhdl
            else list(plusargs),
            extra_env={
                "CYCLOPE_BENCH": json.dumps(parameters or {}), "PYTHONPATH": str(ROOT),
                "PYTHONWARNINGS": "ignore::DeprecationWarning"},
            seed=seed, waves=WAVES, timescale=("1ns", "1ps"), log_file=log)
    except (RuntimeError, SystemExit) as caught:
        error = caught
    text = log.read_text(errors="replace") if log.exists() else ""
    if not xml.exists():
        pytest.fail(f"the simulator wrote no results ({error!r})\n{text[-4000:]}", pytrace=False)
    ran, bad = 0, []
    for case in ElementTree.parse(xml).iter("testcase"):
        if case.find("skipped") is not None:
            continue
        ran += 1
        for kind in ("failure", "error"):
            fault = case.find(kind)
            if fault is not None:
                what = fault.get("message") or fault.get("error_msg") or ""
                bad.append(f"{case.get('name')}: {what}")
                break
    if bad:
        pytest.fail(f"{len(bad)} of {ran} cocotb tests failed:\n" + "\n".join(bad) + "\n"
                    + text[-6000:], pytrace=False)
    if not ran:
        pytest.fail(f"no cocotb test ran in {test_module}\n{text[-2000:]}", pytrace=False)
    if error:
        pytest.fail(f"the simulator failed: {error!r}\n{text[-4000:]}", pytrace=False)
