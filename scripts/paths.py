"""Where the checkout and the RTL's sources are, and where what is built goes."""

from pathlib import Path

import platformdirs

import hdl

__all__ = ["BUILD", "HDL", "ROOT"]

#: Folder of the RTL's sources.
HDL = Path(hdl.__file__).resolve().parent
if __package__ == "scripts":
    #: The checkout; None in an installed package, where this module is ``cyclope.paths``.
    ROOT = HDL.parent
    #: Everything that is built; ``make clean`` removes it.
    BUILD = ROOT / "build"
else:
    ROOT, BUILD = None, platformdirs.user_cache_path("cyclope")
