"""The command itself: usage, unknown words, exit statuses, and how faults reach the terminal."""

import errno
import os
import re
import shlex
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from model.errors import UserError
from scripts.cyclope import cli, program
from scripts.paths import ROOT


def cyclope(*words, **options):
    """A finished process of the command."""
    return subprocess.run([sys.executable, "-m", "scripts.cyclope.cli", *map(str, words)],
                          cwd=ROOT, text=True, capture_output=True, **options)


def said(capsys):
    """The one line on the error output."""
    text = capsys.readouterr().err
    assert text.startswith("cyclope: ") and text.count("\n") == 1 and "Traceback" not in text, text
    return text


def test_help_is_quick_and_complete():
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "scripts.cyclope.cli", "--help"], cwd=ROOT,
        text=True, capture_output=True)
    assert done.returncode == 0
    assert all(name in done.stdout for name in cli.COMMANDS)
    assert re.search(r"exit status:\n +0 .*\n +2 .*\n +3 .*\n +130 ", done.stdout)
    for name in ("numpy", "matplotlib", "rich", "serial", "shtab"):
        assert not re.search(rf"\| +{name}\b", done.stderr), name


def test_alone_it_prints_its_help(capsys):
    assert cli.main([]) == 0
    assert capsys.readouterr().out.startswith("usage: cyclope")


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_has_a_help(name, capsys):
    assert cli.main([name, "--help"]) == 0
    assert f"usage: cyclope {name}" in capsys.readouterr().out


def test_version(capsys):
    assert cli.main(["--version"]) == 0
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert capsys.readouterr().out == f"cyclope {version}\n"


@pytest.mark.parametrize("words, sentence", [
    (["run", "--foo"], "--foo is no option of `cyclope run`; see `cyclope run --help`."),
    (["run", "x", "--calibrate=y"], "--calibrate is no option of `cyclope run`; did you mean "
                                    "--calibration?"),
    (["run", "-q"], "-q is no option of `cyclope run`"),
    (["simulate", "polyp", "x", "--frame", "1", "--sede", "2"],
     "--sede is no option of `cyclope simulate`; did you mean --seed?"),
    (["--engine", "rtl", "run"], "--engine is no option of `cyclope`; options of a command come "
                                 "after its name"),
    (["--foo"], "--foo is no option of `cyclope`; see `cyclope --help`."),
    (["rum"], "'rum' is no command of `cyclope`; did you mean `cyclope run`?"),
    (["xyzzy"], "'xyzzy' is no command of `cyclope`; there are simulate, calibrate, run,"),
    (["run"], "the following arguments are required: CAPTURE|FOLDER|FILE, --calibration"),
    (["run", "x\ny", "--calibration", "z", "-o", "w"], r"x\ny does not exist."),
    (["run", "x\udcff", "--calibration", "z", "-o", "w"], r"x\udcff does not exist."),
])
def test_wrong_words_are_named(words, sentence, capsys, monkeypatch):
    monkeypatch.setattr(cli, "pasteable", str)
    assert cli.main(words) == 2
    assert sentence in said(capsys)


def test_values_that_look_like_options_are_taken(capsys):
    """A negative number is a value, and so is a word behind ``--``."""
    assert cli.main(["simulate", "polyp", "x", "--seed", "-5"]) == 2
    assert "--seed must be 0 or more, not -5." in said(capsys)
    assert cli.main(["run", "--calibration", "x", "-oy", "--", "--foo"]) == 2
    assert "--foo does not exist." in said(capsys)


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion_knows_commands_and_options(shell, capsys):
    assert cli.main(["--print-completion", shell]) == 0
    text = capsys.readouterr().out
    assert all(word in text for word in (*cli.COMMANDS, "independent", "registers", "split-spots"))


def test_bash_completes():
    script = """eval "$(python -m scripts.cyclope.cli --print-completion bash)"
        COMP_WORDS=(cyclope run --ind); COMP_CWORD=2; $(complete -p cyclope |
        sed 's/.*-F \\([^ ]*\\).*/\\1/') cyclope --ind run; echo "${COMPREPLY[@]}" """
    answer = subprocess.run(
        ["bash", "-c", script], cwd=ROOT, text=True, capture_output=True,
        env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"})
    assert answer.stdout == "--independent\n", answer.stderr


@pytest.mark.parametrize("fault, status, sentence", [
    (UserError("No. Do `cyclope run`."), 2, "cyclope: No. Do `{} run`.\n"),
    (KeyboardInterrupt(), 130, "cyclope: interrupted.\n"),
    (OSError(errno.ENOSPC, "No space left on device", "x"), 2,
     "cyclope: x: No space left on device.\n"),
    (MemoryError(), 2, "cyclope: there is not enough memory for this.\n"),
    (RecursionError("too deep"), 1, "cyclope: a fault of the program (RecursionError: too deep);"),
])
def test_every_fault_is_one_sentence(fault, status, sentence, capsys):
    def action():
        raise fault

    assert cli.guarded(action) == status
    assert said(capsys).startswith(sentence.format(program.program()))


def test_a_note_follows_the_sentence(capsys):
    def action():
        error = KeyboardInterrupt()
        error.add_note("Two frames are in x.")
        raise error

    assert cli.guarded(action) == 130
    assert said(capsys) == "cyclope: interrupted. Two frames are in x.\n"


def test_faults_of_the_program_can_be_seen(monkeypatch):
    monkeypatch.setenv("CYCLOPE_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        cli.guarded(lambda: 1 // 0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_it_in_one_sentence(number, capsys):
    usual = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
    before = signal.signal(number, usual)  # in the background some are ignored

    def action():
        os.kill(os.getpid(), number)
        time.sleep(60)

    try:
        assert cli.guarded(action) == 130
        assert said(capsys) == "cyclope: interrupted.\n"
        assert signal.getsignal(number) == usual
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
@pytest.mark.parametrize("word", ["größe", "目", "x\udcff", "line\nfeed"])
def test_any_name_can_be_printed(word, encoding):
    done = cyclope("run", word, "--calibration", "x", "-o", "y",
                   env={**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"},
                   errors="surrogateescape")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and done.stderr.endswith(" does not exist.\n")


def test_outputs_that_cannot_be_written():
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-m", "scripts.cyclope.cli", "--version"],
                              cwd=ROOT, text=True, stdout=full, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (2, "cyclope: No space left on device.\n")
    command = '"$0" -m scripts.cyclope.cli --version'
    for rest, statuses in ((" >&-", (0,)), (" | true; exit ${PIPESTATUS[0]}", (0, 1))):
        done = subprocess.run(["bash", "-c", command + rest, sys.executable], cwd=ROOT, text=True,
                              stderr=subprocess.PIPE)
        assert done.returncode in statuses and done.stderr == "", rest


def test_commands_are_named_as_they_can_be_typed(tmp_path, monkeypatch):
    script = tmp_path / "some folder" / "cyclope"
    script.parent.mkdir()
    script.write_text("#!/bin/sh\n")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "argv", [str(script)])
    monkeypatch.setenv("PATH", "/nowhere")
    assert program.program() == f"'{script}'"
    monkeypatch.chdir(tmp_path)
    assert program.pasteable("Say `cyclope run`, or `cyclope`.") == (
        "Say `'some folder/cyclope' run`, or `'some folder/cyclope'`.")
    monkeypatch.chdir(script.parent)
    assert program.program() == "./cyclope"
    monkeypatch.setenv("PATH", str(script.parent))
    assert program.program() == "cyclope"
    monkeypatch.setattr(sys, "argv", ["-c"])
    assert program.program() in (
        "cyclope", shlex.quote(f"{Path(sys.executable).with_name('cyclope')}"))
