"""What several system benches need, made once for all workers."""

import fcntl
from pathlib import Path

import pytest

from scripts import demo

CACHE = Path(__file__).resolve().parents[2] / "build" / "test" / "demo"


@pytest.fixture(scope="session")
def prepared():
    """Capture and calibration of the demonstration."""
    CACHE.parent.mkdir(parents=True, exist_ok=True)
    with open(CACHE.parent / ".demo.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        return demo.prepare(CACHE)
