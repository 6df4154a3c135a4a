"""What whole chips are built from.

Apart from the library, which blocks are built with too: those depend on their own sources alone.
"""

from pathlib import Path

from scripts.paths import HDL

__all__ = ["rtl_sources"]


def rtl_sources(*files):
    """Text of all that the RTL is written in, and of ``files``."""
    return "".join(file.read_text() for file in (*sorted(HDL.rglob("*.py")), *map(Path, files)))
