"""Where the checkout and the RTL's sources are, and where what is built goes."""

import contextlib
import hashlib
import os
import re
import sys
import tempfile
from pathlib import Path

import platformdirs

import hdl

__all__ = ["BUILD", "COMPILED", "HDL", "ROOT", "locked", "plain"]

#: Folder of the RTL's sources.
HDL = Path(hdl.__file__).resolve().parent
if __package__ == "scripts":
    #: The checkout; None in an installed package, where this module is ``cyclope.paths``.
    ROOT = HDL.parent
    #: Everything that is built; ``make clean`` removes it.
    BUILD = ROOT / "build"
else:
    ROOT, BUILD = None, platformdirs.user_cache_path("cyclope")


@contextlib.contextmanager
def locked(path):
    """Keep other processes out while a file or folder is made: they wait with the same path."""
    import fcntl  # not on Windows, where recordings can be read

    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path.with_name(f".{path.name}.lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def plain(path):
    """Whether makefiles can name a path: Verilator's cannot with blanks, quotes or umlauts."""
    return re.fullmatch(r"[\w./+@-]+", str(path), re.ASCII) is not None


def _mine(folder):
    """Whether nobody else can have put anything into a folder."""
    try:
        return folder.lstat().st_uid == os.getuid()
    except FileNotFoundError:
        return True


def _compiled(build):
    """``build``, or a folder of this user's that makefiles can name; ``build`` if there is none."""
    if plain(build):
        return build
    name = hashlib.sha256(os.fsencode(build)).hexdigest()[:12]
    temporary = Path(tempfile.gettempdir(), f"cyclope-{os.getuid()}")
    for folder in (platformdirs.user_cache_path("cyclope"), temporary):
        if plain(folder) and _mine(folder):
            return folder / name / "build"
    return build


#: What Verilator and make build: BUILD, or, where its path is not plain, a folder of the user's.
COMPILED = _compiled(BUILD)

if __name__ == "__main__":
    if not plain(COMPILED):
        sys.exit(f"The RTL cannot be built in {ROOT}, for makefiles take no blanks and no letters "
                 "outside ASCII in a path: move the checkout, or set XDG_CACHE_HOME to a folder "
                 "without.")
    print(COMPILED)
