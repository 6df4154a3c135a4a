"""What several tests of this folder share."""

import pytest

from scripts.cyclope import cli


@pytest.fixture(scope="session")
def small_capture(tmp_path_factory):
    """A capture folder of the small rig: planes, seed 3, 5 frames."""
    path = tmp_path_factory.mktemp("optics") / "capture"
    assert cli.main(["simulate", "plane", path, "--rig", "small", "--seed", "3", "--frames",
                     "5"]) == 0
    return path
