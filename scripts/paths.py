"""Where the checkout is, and where what is built goes."""

from pathlib import Path

__all__ = ["BUILD", "ROOT"]

#: The checkout.
ROOT = Path(__file__).resolve().parents[1]
#: Everything that is built; ``make clean`` removes it.
BUILD = ROOT / "build"
