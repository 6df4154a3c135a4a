"""The object that has the port: it records whatever else is done with the chip."""

import os
import time
from contextlib import contextmanager

import pytest

from model.errors import UserError
from scripts.host.decoder import Decoder
from scripts.host.history import History, read_history
from scripts.host.live_chip import LiveChip
from scripts.host.messages import Frame, Reply
from scripts.host.port import open_port
from scripts.host.reception import Reception
from tb.host.bench import TEXTURE, open_fake
from tb.system.fake_instrument import any_calibration, images


@contextmanager
def owning(path, calibration, folder):
    """An owner of the port, with its recording, which is completed at the end."""
    history, reception = History(calibration), Reception(folder, calibration)
    with LiveChip(lambda: open_port(path() if callable(path) else path), reception, history,
                   calibration) as owner:
        yield owner
    reception.finish()


@pytest.fixture
def terminal(rig):
    """A fake instrument that is not too fast for all that is done with its frames here."""
    with open_fake(rig[0], images(), speed=1.0) as opened:
        yield opened


def wait(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)


def test_load_start_stop_and_status_beside_the_recording(rig, terminal, tmp_path):
    calibration, _ = rig
    with owning(terminal.path, calibration, tmp_path / "out") as owner:
        wait(lambda: owner.state is not None)
        assert owner.state["mode"] == "stop" and not owner.state["tables"]
        assert owner.history.identity["beams"] == 16
        assert owner.do("load").result(60).startswith("The calibration is loaded, and the chip is")
        wait(lambda: owner.history.count > 5)
        wait(lambda: owner.state["mode"] == "continuous" and owner.state["armed"])
        size = (tmp_path / "out" / "link.raw").stat().st_size
        assert "pattern_us = 300" in owner.do("set", {"pattern_us": 300}).result(60)
        wait(lambda: owner.history.moment(10**9).frame.exposure_us == 300)
        assert (tmp_path / "out" / "link.raw").stat().st_size > size
        assert "stopped, the laser is off" in owner.do("stop").result(60)
        assert owner.trouble is None
        assert owner.state["registers"]["pattern_us"] == 300
        for action, as_images in (("pattern-images", True), ("pattern-only", False)):
            assert owner.do(action).result(60) and owner.state["mode"] == "pattern"
            assert owner.state["as_images"] is as_images
        assert owner.do("stop").result(60)
        count = owner.history.count
        assert owner.do("single").result(60)
        wait(lambda: owner.history.count == count + 1)
    # Replies and all frames are in the recording, which is read again to the same history.
    events = Decoder().events((tmp_path / "out" / "link.raw").read_bytes())
    assert sum(isinstance(event, Reply) for event in events) > 50
    assert sum(isinstance(event, Frame) and not event.joined for event in events) == (
        owner.history.count)
    again = read_history(tmp_path / "out" / "link.raw", calibration)
    assert again.count == owner.history.count
    for position in range(0, again.count, max(1, again.count // 12)):
        one, two = again.moment(position), owner.history.moment(position)
        assert one.frame.index == two.frame.index and (one.points["u"] == two.points["u"]).all()
        assert (again.texture(position)[0] == owner.history.texture(position)[0]).all()
    assert (tmp_path / "out" / "points.ply").exists()
    assert (again.texture(10**9)[0] == TEXTURE).mean() > 0.5


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_fault_of_the_program_is_said(rig, terminal, tmp_path, monkeypatch):
    """... and whoever waits for an answer gets it; what came is kept."""
    calibration, _ = rig

    def fail(*_):
        raise ValueError("planted")

    with owning(terminal.path, calibration, tmp_path / "out") as owner:
        monkeypatch.setattr(owner.reception.recorder, "take", fail)
        with pytest.raises(UserError, match="This program has a fault.*planted"):
            owner.do("load").result(60)
        wait(lambda: owner.trouble is not None)
        assert "has a fault (ValueError: planted): start it again" in owner.trouble
    assert (tmp_path / "out" / "link.raw").stat().st_size > 0


def test_what_the_chip_refuses_is_said_and_receiving_goes_on(rig, terminal, tmp_path):
    calibration, _ = rig
    with owning(terminal.path, calibration, tmp_path / "out") as owner:
        owner.do("load").result(60)
        with pytest.raises(UserError, match="The laser guard would trip: pattern_us is 5000"):
            owner.do("set", {"pattern_us": 5000}).result(60)
        count = owner.history.count
        wait(lambda: owner.history.count > count + 2)


def test_a_calibration_of_another_chip(terminal, tmp_path):
    other = any_calibration(rows=3, columns=3)
    with owning(terminal.path, other, tmp_path / "out") as owner:
        wait(lambda: owner.trouble is not None)
        assert "The calibration has 9 beams, the chip is made for 16" in owner.trouble
        with pytest.raises(UserError, match="9 beams"):
            owner.do("load").result(60)
        time.sleep(2.5)  # it is not forgotten with the next look
        assert "9 beams" in owner.trouble


def test_a_port_that_vanishes_and_comes_back(rig, tmp_path):
    calibration, _ = rig
    now = tmp_path / "device"
    with open_fake(calibration, images(), speed=1.0) as first:
        os.symlink(first.path, now)
        owner_of = owning(lambda: os.path.realpath(now), calibration, tmp_path / "out")
        owner = owner_of.__enter__()
        owner.do("load").result(60)
        wait(lambda: owner.history.count > 2)
    try:
        wait(lambda: owner.trouble is not None)
        assert "nothing comes until it is back" in owner.trouble
        count = owner.history.count
        with open_fake(calibration, images(), speed=1.0) as second:
            now.unlink()
            os.symlink(second.path, now)
            wait(lambda: owner.state is not None)
            assert owner.trouble is None
            owner.do("load").result(60)
            wait(lambda: owner.history.count > count + 2)
    finally:
        owner_of.__exit__(None, None, None)
    assert read_history(tmp_path / "out" / "link.raw", calibration).count == owner.history.count


def test_a_full_disk_ends_the_recording_and_not_the_view(rig, terminal, tmp_path, monkeypatch):
    calibration, _ = rig
    with owning(terminal.path, calibration, tmp_path / "out") as owner:
        owner.do("load").result(60)
        wait(lambda: owner.history.count > 2)

        def full(octets, ended=None):
            raise UserError("link.raw cannot be written: No space left on device.")

        monkeypatch.setattr(owner.reception, "take", full)
        wait(lambda: not owner.recording)
        assert owner.trouble.endswith("No space left on device. Nothing more is recorded.")
        count = owner.history.count
        wait(lambda: owner.history.count > count + 2)
