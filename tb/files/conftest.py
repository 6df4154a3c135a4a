"""Hostile files go through the command itself, in this process, in bounded time and memory."""

import resource
import signal
from pathlib import Path

import pytest

from scripts.cyclope import cli
from tb.system.conftest import prepared  # noqa: F401

_SECONDS, _OCTETS = 60, 600_000_000


@pytest.fixture(autouse=True)
def bounded():
    """Whatever takes longer, or more memory, fails."""
    def late(*_):
        pytest.fail(f"this takes more than {_SECONDS} s")

    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    limits = resource.getrlimit(resource.RLIMIT_AS)
    handler = signal.signal(signal.SIGALRM, late)
    resource.setrlimit(resource.RLIMIT_AS, (used + _OCTETS, limits[1]))
    signal.alarm(_SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, handler)
        resource.setrlimit(resource.RLIMIT_AS, limits)


@pytest.fixture
def refused(capfd, tmp_path):
    """Runs a command that is to end with one sentence, and gives that sentence.

    Nothing else may reach the terminal, a library's own remarks included, and nothing may be left
    of the output ``out``.
    """
    def refuse(*words):
        capfd.readouterr()
        status = cli.main(words)
        out, err = capfd.readouterr()
        assert status == 2, (status, err)
        assert err.startswith("cyclope: ") and err.endswith((".\n", "?\n")), err
        assert err.count("\n") == 1 and len(err) < 700 and out == "", err
        assert "Traceback" not in err and "a fault of the program" not in err
        assert not (tmp_path / "out").exists()
        return err

    return refuse
