"""What several system benches need, made once for all workers."""

from pathlib import Path

import pytest

from scripts import demo
from scripts.paths import locked

CACHE = Path(__file__).resolve().parents[2] / "build" / "test" / "demo"


@pytest.fixture(scope="session")
def prepared():
    """Capture and calibration of the demonstration."""
    with locked(CACHE):
        return demo.prepare(CACHE)
