"""The repository keeps what its README promises."""

import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest

from scripts import setup
from scripts.paths import ROOT
from scripts.rtl.blocks import BLOCKS

# They look at every file that git knows.
pytestmark = pytest.mark.always_run

#: Folders of one machine, put together here so that this file passes its own test.
MACHINE_PATHS = re.compile("|".join(f"/{name}/" for name in ("work", "root", "home", "tmp")))
UNFINISHED = re.compile("|".join(("TO" + "DO", "FIX" + "ME", "XX" + "X", "not imple" + "mented")))
#: Made by others, or by their tools.
BUNDLED = ("scripts/view/page/three.js", "scripts/view/page/three-license.txt")
BINARY = (".png", ".jpg", ".npz", ".npy", ".gif", ".pdf")


@pytest.fixture(scope="module")
def files():
    """Texts of all files that git knows, by path."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("this is not a git checkout, so there is no list of files")
    names = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return {
        name: (ROOT / name).read_text() for name in names.split("\0")
        if name and not name.endswith(BINARY) and name not in BUNDLED
        and (ROOT / name).is_file()}


def offences(files, pattern):
    return [
        f"{name}:{number}: {line.strip()}" for name, text in files.items()
        for number, line in enumerate(text.splitlines(), 1) if pattern.search(line)]


def test_no_paths_of_one_machine(files):
    # A script's interpreter and the system's own places are the same everywhere.
    assert offences(files, MACHINE_PATHS) == []


def test_nothing_unfinished(files):
    assert offences(files, UNFINISHED) == []


def test_texts_are_tidy(files):
    assert offences(files, re.compile(r"[ \t]+$")) == []
    assert [name for name, text in files.items() if text and not text.endswith("\n")] == []
    assert [name for name, text in files.items() if "\r" in text or text.endswith("\n\n")] == []
    indented = {name: text for name, text in files.items() if name != "Makefile"}
    assert offences(indented, re.compile(r"^\t")) == []


def test_no_built_file_is_kept(files):
    kept = re.compile(r"(^|/)(build|out|\.venv|__pycache__)/|\.(vcd|fst|ghw|pyc|o|so)$")
    assert [name for name in files if kept.search(name)] == []


def test_help_lists_every_target():
    makefile = (ROOT / "Makefile").read_text()
    targets = set(re.search(r"^\.PHONY: (.*)$", makefile, re.M)[1].split())
    assert targets == set(re.findall(r"^([a-z-]+):(?!=)", makefile, re.M))
    listed = subprocess.run(
        ["make", "-s", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    shown = set(re.findall(r"^  make (\S+) +\S", listed, re.M))
    # `tools` is only a step of others.
    assert shown == targets - {"tools"}
    assert shown >= {"setup", "demo", "sim", "test", "lint", "bench", "synth-export", "clean"}


def test_requirements_are_pinned_once():
    lines = [
        line for line in (ROOT / "requirements.txt").read_text().splitlines()
        if line and not line.startswith("#")]
    names = [re.fullmatch(r"([\w.-]+)==[\w.]+", line)[1].lower() for line in lines]
    assert len(set(names)) == len(names)


def test_version_and_command():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["scripts"] == {"cyclope": "scripts.cyclope.cli:main"}
    assert re.fullmatch(r"\d+\.\d+\.\d+", project["version"])
    assert "## Unreleased" in (ROOT / "CHANGELOG.md").read_text()
    assert (ROOT / "LICENSE").read_text().startswith("BSD 2-Clause License")


def test_readme_gives_the_two_commands():
    readme = (ROOT / "README.md").read_text()
    assert "make demo" in readme and "make test" in readme


def test_ci_calls_what_the_readme_gives(files):
    assert os.access(ROOT / ".ci" / "run", os.X_OK)
    assert files[".ci/run"].rstrip().endswith("make test")
    assert "run: .ci/run" in files[".github/workflows/ci.yml"]


@pytest.mark.parametrize("block", BLOCKS, ids=[block.name for block in BLOCKS])
def test_every_block_has_a_bench(block):
    assert (ROOT / "tb" / block.unit / f"test_{block.name}.py").exists()


def test_model_and_design_share_no_code(files):
    for name, text in files.items():
        if name.endswith(".py") and name.startswith(("model/", "hdl/")):
            other = "hdl" if name.startswith("model/") else "model"
            # Numbers of registers, commands and packets have one source.
            text = re.sub(r"^from hdl.protocol import .*$", "", text, flags=re.M)
            assert not re.search(rf"^\s*(from|import) {other}\b", text, re.M), name


def test_second_setup_has_nothing_to_do():
    if not (ROOT / ".venv" / "cyclope-setup").exists():
        pytest.skip("this environment was not made by scripts/setup.py")
    answer = subprocess.run(
        [os.path.realpath(sys.executable), ROOT / "scripts" / "setup.py"], cwd=ROOT,
        capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout == ""


@pytest.mark.parametrize("program, sentence", [
    ("c++", "A C++ compiler is missing: `apt-get install g++`."),
    ("perl", "perl is missing: `apt-get install perl`."),
    ("git", "git is missing: `apt-get install git`."),
])
def test_setup_names_what_is_missing(program, sentence, tmp_path):
    for name in {"c++", "make", "perl", "git"} - {program}:
        (tmp_path / name).symlink_to("/bin/true")
    answer = subprocess.run(
        [os.path.realpath(sys.executable), ROOT / "scripts" / "setup.py"], cwd=ROOT,
        env={"PATH": str(tmp_path)}, capture_output=True, text=True)
    assert answer.returncode == 1
    assert answer.stderr == sentence + "\n"


@pytest.mark.parametrize("ci", ["false", "true"])
def test_setup_tells_what_is_left_out(ci, monkeypatch, capsys, tmp_path):
    """Without root GHDL's checks are left out in so many words, which CI does not let pass."""
    (tmp_path / "stamp").touch()
    monkeypatch.setattr(setup, "STAMP", tmp_path / "stamp")
    monkeypatch.setattr(setup, "VENV", tmp_path)
    (tmp_path / "cyclope-yosys-ready").touch()
    monkeypatch.setattr(setup.shutil, "which", {"apt-get": "apt-get"}.get)
    monkeypatch.setattr(setup.os, "geteuid", lambda: 1000)
    monkeypatch.setattr(setup, "make_environment", lambda: None)
    monkeypatch.setenv("CI", ci)
    if ci == "true":
        with pytest.raises(SystemExit, match="With CI=true nothing may be left out."):
            setup.make_test_environment()
    else:
        setup.make_test_environment()
    assert capsys.readouterr().out == (
        "Left out: the benches of the VHDL twins and their analysis, as ghdl is not installed and "
        "this is not root and sudo asks for a password; `apt-get install ghdl` brings them.\n"
        "Left out: the tests of the page in a browser, as chromium is not installed and this is "
        "not root and sudo asks for a password; `apt-get install chromium` brings them.\n")
