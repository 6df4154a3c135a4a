"""Two ok spots of one beam in a frame: one point is kept."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from hdl.protocol import Flag
from model.stereo.epipolar import unpack_line
from model.stereo.undistort import undistort
from scripts.host.messages import POINT as REPORTED
from scripts.host.messages import Frame
from scripts.host.rebuild import Rebuilder
from scripts.results.frames import Entry
from scripts.results.locator import Locator, find_duplicates
from scripts.results.measure import measure
from scripts.results.points import STATUS
from scripts.results.summary import totals
from tb.system.fake_instrument import any_calibration

CALIBRATION = any_calibration(rows=4, columns=4)


@pytest.fixture(scope="module")
def spots():
    """Many ok spots anywhere, and how far each is from its beam's line in 1/512 pixel."""
    rng = np.random.default_rng(1)
    settings = CALIBRATION.settings
    u, v = rng.integers(0, 64 * 512, (2, 20_000))
    status, beam, inverse_z = Rebuilder(settings, 64, 64)(u, v)
    ok = status == 0
    found = np.zeros(np.count_nonzero(ok), REPORTED)
    for name, values in (("u", u), ("v", v), ("beam", beam), ("inverse_z", inverse_z)):
        found[name] = values[ok]
    found["area"] = 9
    x, y, _ = undistort(found["u"], found["v"], settings, 64, 64)
    lines = [unpack_line(line) for line in settings.line]
    distance = np.array([abs(int(b) - int(lines[k][1]) - (int(lines[k][0]) * int(a) + 2**16 >> 17))
                         for a, b, k in zip(x, y, found["beam"], strict=True)])
    return found, distance


@pytest.fixture(scope="module")
def pair(spots):
    """Two spots of one beam, the one nearer to the line first, and one of another beam."""
    found, distance = spots
    beam = np.bincount(found["beam"]).argmax()
    mine = np.flatnonzero(found["beam"] == beam)
    order = mine[np.argsort(distance[mine])]
    assert distance[order[0]] < distance[order[-1]]
    other = np.flatnonzero(found["beam"] != beam)[0]
    return found[[order[0], order[-1], other]]


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0), (1, 2, 0)])
def test_the_nearest_to_the_line_is_kept(order, pair):
    """Whatever their order and areas; the others keep their beam, and have no coordinates."""
    reported = pair[list(order)]
    reported["area"] = [3, 200, 7]
    points = Locator(CALIBRATION)(reported, 5, np.zeros((64, 64), np.uint8))
    names = [STATUS[status] for status in points["status"]]
    assert names == ["duplicate" if which == 1 else "ok" for which in order]
    assert points["beam"].tolist() == reported["beam"].tolist()
    assert np.isnan(points["z"]).tolist() == [which == 1 for which in order]


def test_a_frame_of_many_spots(spots):
    """One ok spot is left of each beam: the nearest one."""
    found, distance = spots
    duplicate = find_duplicates(found, CALIBRATION)
    for beam in np.unique(found["beam"]):
        mine = found["beam"] == beam
        kept = mine & ~duplicate
        assert kept.sum() == 1 and distance[kept][0] == distance[mine].min()


def test_equally_near_spots(pair):
    """The larger one is kept, the first one of equals; so it is where no line is known."""
    reported = np.repeat(pair[:1], 3)
    reported["area"] = [5, 9, 9]
    for calibration in (CALIBRATION, None):
        assert find_duplicates(reported, calibration).tolist() == [True, False, True]
    reported["beam"] = 100  # more than the calibration has
    assert find_duplicates(reported, CALIBRATION).tolist() == [True, False, True]


def test_only_ok_spots_count(pair):
    reported = np.repeat(pair[:1], 4)
    reported["status"] = [1, 0, 2, 3]
    assert not find_duplicates(reported, CALIBRATION).any()
    assert not find_duplicates(reported[:0], CALIBRATION).any()


def test_run_counts_and_notes_them(pair, tmp_path):
    """`cyclope run` has the same rule, whatever the engine."""
    cv2.imwrite(str(tmp_path / "0.png"), np.full((64, 64), 9, np.uint8))
    frame = Frame(0, spots=3, ok=3, points=pair, flags=1 << Flag.LASER)
    engine = SimpleNamespace(frames=lambda images, independent: (frame for _ in images))
    (_, result), = measure([Entry(0, tmp_path / "0.png")], CALIBRATION, engine)
    assert result.count("ok") == 2 and result.count("duplicate") == 1
    assert f"more than one spot for beam {pair['beam'][0]}" in result.notes
    assert totals([result]) == {"spots": 3, "ok": 2, "noise": 0, "ambiguous": 0, "rejected": 0,
                                "duplicate": 1, "doubtful": 0, "dropped": 0}
