"""The history of frames: exact at every position, in memory that does not grow with time."""

import errno
import os
import tracemalloc

import numpy as np
import pytest

from model.errors import UserError
from scripts.host import spool
from scripts.host.history import History
from scripts.host.messages import Frame, TextureFrame, TexturePiece
from scripts.results.points import POINT
from tb.system.fake_instrument import any_calibration

ROWS = 64


def piece(number):
    return TexturePiece(2 * number + 1, number % ROWS, 0, np.full(64, number % 251, np.uint8))


def add(history, numbers, points=9):
    """Frames, each with a row of the texture before it."""
    for number in numbers:
        index, now = 2 * number + 1, 40_000 * (number + 1)
        history.take(piece(number))
        history.take(TextureFrame(index, 0, 9, now, 0, 0, 0x80, index))
        rows = np.zeros(points, POINT)
        rows["frame"], rows["u"] = index + 1, number
        history.take(Frame(index + 1, index=index + 1, timestamp_us=now + 20_000), rows, number)


def check(history, position):
    """The frame at a position, and its texture, are what came."""
    moment = history.moment(position)
    assert moment.frame.index == 2 * position + 2 and moment.lost == position
    assert (moment.points["u"] == position).all()
    assert np.isclose(moment.seconds, 0.04 * position + 0.02)
    assert moment.seconds == history.seconds(position)
    assert history.position(2 * position + 2) == position
    grey, when = history.texture(position)
    for row in range(ROWS):
        last = position - (position - row) % ROWS
        if last < 0:
            assert (grey[row] == 0).all() and np.isinf(when[row]).all()
        else:
            assert (grey[row] == last % 251).all() and np.allclose(when[row], 0.04 * last)


def test_every_frame_is_remembered():
    history = History(any_calibration())
    with pytest.raises(UserError, match="no frame yet"):
        history.moment(0)
    with pytest.raises(UserError, match="There is no frame 3, nor any other"):
        history.position(3)
    add(history, range(600))
    assert (history.first, history.count) == (0, 600)
    assert history.numbers().tolist() == list(range(2, 1202, 2))
    for position in (0, 1, 63, 64, 249, 250, 251, 499, 500, 598, 599):
        check(history, position)
    assert history.moment(10**9).frame.index == 1200 and history.moment(-5).frame.index == 2
    with pytest.raises(UserError, match="There is no frame 3: they are numbered 2 to 1200"):
        history.position(3)


def test_memory_does_not_grow_with_time():
    """A frame of 361 points, 20 kB, costs some tens of octets."""
    history = History(any_calibration())
    add(history, range(260), 361)
    tracemalloc.start()
    try:
        add(history, range(260, 280), 361)
        before = tracemalloc.get_traced_memory()[0]
        add(history, range(280, 780), 361)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown / 500 < 100, f"{grown / 500:.0f} octets a frame"
    check(history, 3)


def test_a_texture_without_frames_is_no_load(monkeypatch):
    """Patterns that are sent as images in the dark: no pattern frame ever comes."""
    monkeypatch.setattr("scripts.host.history._PIECES", 10)
    history = History(any_calibration())
    add(history, range(3))
    history.take(TextureFrame(7, 0, 9, 200_000, 0, 0, 0x80, 7))
    for number in range(105):
        history.take(TexturePiece(7, number % ROWS, 0, np.full(64, 7, np.uint8)))
    assert len(history._since) <= 11
    add(history, range(4, 6))
    assert (history.texture(2)[0][:3] == [[0], [1], [2]]).all()
    grey, _ = history.texture(3)
    assert (grey[4] == 4).all() and (np.delete(grey, 4, axis=0) == 7).all()


@pytest.fixture
def disk(monkeypatch):
    """A disk that is full while ``full`` holds something."""
    full, real = [], os.pwrite

    def pwrite(number, octets, at):
        if full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(number, octets, at)

    monkeypatch.setattr(spool.os, "pwrite", pwrite)
    return full


def test_a_full_disk_forgets_and_says_so(disk, tmp_path):
    history = History(any_calibration(), tmp_path, forgets=True)
    add(history, range(300))
    disk.append(True)
    add(history, range(300, 303))
    assert (history.first, history.count) == (302, 303)
    assert history.trouble == (f"{tmp_path} takes no temporary file: No space left on device. "
                               "Older frames are only in the recording.")
    check(history, 302)
    disk.clear()
    add(history, range(303, 700))
    assert (history.first, history.count) == (303, 700)
    for position in (303, 304, 552, 553, 699):
        check(history, position)
    assert history.moment(0).frame.index == 2 * 303 + 2 and os.listdir(tmp_path) == []


def test_a_full_disk_is_no_short_recording(disk):
    """What is replayed is all there, or it is said."""
    history = History(any_calibration())
    disk.append(True)
    with pytest.raises(UserError, match="takes no temporary file"):
        add(history, range(1))


def test_a_folder_that_takes_nothing(tmp_path):
    with pytest.raises(UserError, match="takes no temporary file: No such file"):
        History(any_calibration(), tmp_path / "none")
