"""Tests are left out only if nothing that they depend on has changed."""

import os
import re
import shutil
import subprocess
import sys
import time

import pytest

from scripts.paths import ROOT
from tb.dependencies import Dependencies

#: A repository in small, in which every kind of dependency occurs once.
FILES = {
    "pyproject.toml": "[tool.pytest.ini_options]\ntestpaths = ['tb']\n",
    "README.md": "A table.\n",
    "NOTES.md": "Nobody reads this.\n",
    "requirements.txt": "nothing==1\n",
    "hdl/__init__.py": "",
    "hdl/direct.py": "from hdl import inner\n\nVALUE = 1 + inner.VALUE\n",
    "hdl/inner.py": "VALUE = 1\n",
    "hdl/found.py": "VALUE = 1\n",
    "hdl/twin.vhd": "entity twin\n",
    "model/__init__.py": "",
    "model/late.py": "VALUE = 1\n",
    "model/relative.py": "from . import late\nfrom .late import VALUE\n",
    "model/other.py": "VALUE = 1\n",
    "scripts/__init__.py": "",
    "scripts/finder.py": "from importlib import import_module\n\n"
                         "def find(name):\n    return import_module('hdl.' + name)\n",
    "scripts/tool.py": "VALUE = 1\n",
    "scripts/harness.cpp": "int main();\n",
    "tb/__init__.py": "",
    "tb/conftest.py": "pytest_plugins = ['tb.unchanged']\n",
    "tb/unit/__init__.py": "",
    "tb/unit/conftest.py": "import pytest\n\n@pytest.fixture\ndef wanted():\n    return 2\n",
    "tb/unit/bench_of_unit.py": "VALUE = 1\n",
    "tb/unit/test_unit.py": '''
"""Says README.md and hdl.found, which in a docstring mean nothing."""
import pytest
from hdl.direct import VALUE
BENCH = "tb.unit.bench_of_unit"

@pytest.mark.parametrize("seed", [1, 2])
def test_value(wanted, seed):
    def late():
        import model.relative
        return model.relative
    assert VALUE == wanted and late().VALUE == 1
''',
    "tb/unit/test_finds.py": '''
from scripts.finder import find

def test_found():
    assert find("found").VALUE == 1
''',
    "tb/unit/test_names.py": '''
TOOL, TABLE = "tool.py", "README.md"

def test_nothing():
    pass
''',
    "tb/unit/test_starts.py": '''
import subprocess

def test_nothing():
    subprocess.run(["true"], check=True)
''',
}
OURS = ("tb/unchanged.py", "tb/dependencies.py")


@pytest.fixture
def repository(tmp_path):
    """The small repository, all of it written a while ago."""
    for name, text in FILES.items():
        write(tmp_path, name, text)
    for name in OURS:
        write(tmp_path, name, (ROOT / name).read_text())
    return tmp_path


def write(root, name, text, ago=100):
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    os.utime(path, (time.time() - ago,) * 2)


def run(root, *arguments, skip=True, environment=()):
    """(numbers by outcome, output) of a pytest run in ``root``."""
    for cache in root.rglob("__pycache__"):  # times are too close for it to tell texts apart
        shutil.rmtree(cache)
    done = subprocess.run(
        [sys.executable, "-B", "-m", "pytest", "-p", "no:cacheprovider", "--no-header", "-q",
         *(["--skip-unchanged"] if skip else []), *arguments], cwd=root, text=True,
        capture_output=True, env={**os.environ, "PYTHONPATH": str(root), **dict(environment)})
    summary = done.stdout.strip().rpartition("\n")[2]
    counts = {word: int(number) for number, word in re.findall(r"(\d+) ([a-z]+)", summary)}
    return counts, done.stdout + done.stderr


@pytest.mark.parametrize("workers", [(), ("-n", "2", "--dist", "load", "--maxschedchunk", "1")])
def test_what_passed_is_not_run_again(repository, workers):
    counts, said = run(repository, *workers)
    assert counts == {"passed": 5}, said
    counts, said = run(repository, *workers)
    assert counts == {"unchanged": 5}, said
    assert "make test FRESH=1" in said
    assert run(repository, *workers, skip=False)[0] == {"passed": 5}
    assert run(repository, *workers, "tb/unit/test_finds.py")[0] == {"unchanged": 1}


def test_a_fresh_clone_runs_all(repository):
    run(repository)
    shutil.rmtree(repository / "build")
    assert run(repository)[0] == {"passed": 5}


UNIT, FINDS, NAMES, STARTS = (
    f"tb/unit/test_{name}.py" for name in ("unit", "finds", "names", "starts"))


@pytest.mark.parametrize("name,dependent", [
    ("tb/unit/test_unit.py", {UNIT}),
    ("hdl/direct.py", {UNIT, FINDS, STARTS}),  # what searches or starts processes takes all
    ("hdl/inner.py", {UNIT, FINDS, STARTS}),
    ("hdl/found.py", {FINDS, STARTS}),
    ("hdl/__init__.py", {UNIT, FINDS, STARTS}),
    ("model/relative.py", {UNIT, FINDS, STARTS}),
    ("model/late.py", {UNIT, FINDS, STARTS}),
    ("model/other.py", {FINDS, STARTS}),
    ("scripts/finder.py", {FINDS, STARTS}),
    ("scripts/tool.py", {FINDS, NAMES, STARTS}),
    ("tb/unit/bench_of_unit.py", {UNIT, FINDS, STARTS}),
    ("tb/unit/conftest.py", {UNIT, FINDS, NAMES, STARTS}),
    ("tb/conftest.py", {UNIT, FINDS, NAMES, STARTS}),
    ("tb/unchanged.py", {UNIT, FINDS, NAMES, STARTS}),
    ("hdl/twin.vhd", {UNIT, FINDS, NAMES, STARTS}),
    ("scripts/harness.cpp", {UNIT, FINDS, NAMES, STARTS}),
    ("requirements.txt", {UNIT, FINDS, NAMES, STARTS}),
    ("pyproject.toml", {UNIT, FINDS, NAMES, STARTS}),
    ("README.md", {NAMES, STARTS}),
    ("NOTES.md", {STARTS}),
])
def test_a_byte_changes_the_keys_of_what_depends_on_it(repository, name, dependent):
    def keys():
        files = Dependencies(repository)
        return {test: files.key(test) for test in files.tests()}

    before = keys()
    assert before == keys() and len(set(before.values())) == 4
    write(repository, name, (repository / name).read_text() + "\n#")
    after = keys()
    assert {test for test in before if before[test] != after[test]} == dependent


def test_new_and_lost_files_and_other_tools_change_keys(repository):
    before = Dependencies(repository).key(UNIT)
    assert Dependencies(repository, "another simulator").key(UNIT) != before
    write(repository, "hdl/rig.v", "")
    assert Dependencies(repository).key(UNIT) != before
    (repository / "hdl/rig.v").unlink()
    assert Dependencies(repository).key(UNIT) == before
    (repository / "hdl/twin.vhd").rename(repository / "hdl/twins.vhd")
    assert Dependencies(repository).key(UNIT) != before


def test_a_change_runs_what_depends_on_it(repository):
    """Also one of the parameters; and what fails is run until it passes."""
    run(repository)
    text = FILES[UNIT].replace("[1, 2]", "[1, 2, 3]")
    write(repository, UNIT, text)
    assert run(repository)[0] == {"passed": 3, "unchanged": 3}
    write(repository, "hdl/inner.py", "VALUE = 2\n")
    assert run(repository)[0] == {"failed": 3, "passed": 2, "unchanged": 1}
    assert run(repository)[0] == {"failed": 3, "unchanged": 3}
    write(repository, "hdl/inner.py", "VALUE = 1\n")
    assert run(repository)[0] == {"passed": 5, "unchanged": 1}


def test_only_what_passes_is_written_down(repository):
    write(repository, "tb/test_outcomes.py", '''
import os
import pytest

def test_passes():
    pass

@pytest.mark.skip(reason="not here")
def test_skipped():
    pass

@pytest.mark.xfail
def test_expected():
    assert False

@pytest.fixture
def breaks():
    yield
    raise OSError

def test_teardown_fails(breaks):
    pass

@pytest.mark.always_run
def test_of_the_machine():
    pass

def test_of_the_environment():
    assert os.environ.get("CYCLOPE_CHOICE") != "bad"
''')
    first = run(repository, "tb/test_outcomes.py")[0]
    assert first == {"passed": 4, "skipped": 1, "xfailed": 1, "error": 1}
    second = {"passed": 2, "unchanged": 2, "skipped": 1, "xfailed": 1, "error": 1}
    assert run(repository, "tb/test_outcomes.py")[0] == second
    bad = run(repository, "tb/test_outcomes.py", environment={"CYCLOPE_CHOICE": "bad"})[0]
    assert bad["failed"] == 1 and "unchanged" not in bad


def test_a_failure_takes_back_what_passed(repository):
    """Of a test that does not do the same each time, under one and the same key."""
    write(repository, "tb/test_fickle.py", f'''
from pathlib import Path

def test_fickle():
    assert not Path({str(repository / "build" / "bad")!r}).exists()
''')
    assert run(repository, "tb/test_fickle.py")[0] == {"passed": 1}
    (repository / "build" / "bad").touch()
    assert run(repository, "tb/test_fickle.py", skip=False)[0] == {"failed": 1}
    assert run(repository, "tb/test_fickle.py")[0] == {"failed": 1}


def test_what_is_written_meanwhile_is_not_trusted(repository):
    write(repository, "tb/test_writes.py", f'''
from pathlib import Path

def test_writes():
    """As someone who edits while the tests run, and changes his mind."""
    file = Path({str(repository / "hdl" / "found.py")!r})
    text = file.read_text()
    file.write_text(text + "# ")
    file.write_text(text)
    from scripts.finder import find
''')
    for _ in range(2):
        assert run(repository, "tb/test_writes.py")[0] == {"passed": 1}


def test_a_file_that_cannot_be_collected_is_an_error(repository):
    write(repository, "hdl/inner.py", "VALUE\n")
    for _ in range(2):
        counts, said = run(repository, UNIT)
        assert counts == {"error": 1} and "NameError: name 'VALUE' is not defined" in said


def test_long_ones_come_first(repository):
    write(repository, "tb/durations.txt", f"60 {FINDS}::test_found\n9 {UNIT}::test_value[2]\n")
    said = run(repository, "-vv", skip=False)[1]
    order = re.findall(r"::(\S+) PASSED", said)
    assert order == ["test_found", "test_value[2]", "test_nothing", "test_nothing",
                     "test_value[1]"]
