"""A small rig, and the instruments that the reader is tested against."""

import pytest

from calibration import file
from tb.host.bench import INSTRUMENTS, open_fake
from tb.system.fake_instrument import any_calibration, images


@pytest.fixture(autouse=True)
def name_of_the_command(monkeypatch):
    """Messages call it `cyclope`, wherever the tests run."""
    monkeypatch.setattr("scripts.cyclope.program.program", lambda: "cyclope")


@pytest.fixture(scope="session")
def rig(tmp_path_factory):
    """Calibration of a small sensor, and the file that holds it."""
    calibration = any_calibration(rows=4, columns=4)
    path = tmp_path_factory.mktemp("rig") / "calibration.json"
    file.save(calibration, path)
    return calibration, path


@pytest.fixture
def terminal(rig):
    """A fake instrument that nothing was loaded into."""
    with open_fake(rig[0], images()) as opened:
        yield opened


@pytest.fixture(params=INSTRUMENTS)
def each_terminal(request, rig):
    """Each of the instruments in turn; nothing was loaded into it."""
    with INSTRUMENTS[request.param](rig[0], images()) as opened:
        yield opened
