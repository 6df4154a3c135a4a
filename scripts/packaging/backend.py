"""Build backend (PEP 517) around setuptools': a wheel holds all under one package, ``cyclope``.

The checkout has several packages, ``hdl``, ``model`` and so on, with short imports. Installed, they
would be names that anyone's project may have too. A map of folders in ``package-dir`` is not
enough: the files would go to ``cyclope/hdl``, but import ``hdl``. So a wheel is built from a copy
with other imports, see :mod:`.stage`. Editable installations and source distributions are
setuptools' own; a source distribution holds this backend, and gives the same wheel.
"""

import contextlib
import tempfile
from pathlib import Path

from setuptools import build_meta
from setuptools.build_meta import (
    build_editable,
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
)

from .stage import stage

__all__ = [
    "build_editable", "build_sdist", "build_wheel", "get_requires_for_build_editable",
    "get_requires_for_build_sdist", "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable", "prepare_metadata_for_build_wheel",
]


def _staged(hook, directory, *arguments):
    """Call a hook of setuptools in a copy of the project; what it makes goes to ``directory``."""
    directory = Path(directory).resolve()
    with tempfile.TemporaryDirectory(prefix="cyclope-wheel-") as folder:
        stage(Path.cwd(), Path(folder))
        with contextlib.chdir(folder):
            return hook(str(directory), *arguments)


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    """Write the wheel's metadata; gives the folder's name."""
    return _staged(build_meta.prepare_metadata_for_build_wheel, metadata_directory,
                   config_settings)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """Build the wheel; gives its name."""
    return _staged(build_meta.build_wheel, wheel_directory, config_settings, metadata_directory)
