"""Points that contradict their neighbours in the mesh and the past of their beam."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from hdl.protocol import Flag
from scripts.host.messages import POINT as REPORTED
from scripts.host.messages import Frame
from scripts.results.doubt import contradicts
from scripts.results.frames import Entry
from scripts.results.locator import Locator, find_duplicates
from scripts.results.measure import measure
from scripts.results.measurement import Measurement, write_frames, write_rest
from scripts.results.points import STATUS
from scripts.results.summary import frames_table, totals
from tb.system.fake_instrument import any_calibration

GREY = np.zeros((64, 64), np.uint8)
CALIBRATION = any_calibration(rows=4, columns=4)
#: 1/z of a tilted plane over a mesh of 7 x 7, and of another one behind an edge.
ROW, COLUMN = np.divmod(np.arange(49), 7)
PLANE = 1 / 60 * (1 + 0.06 * (COLUMN - 3) + 0.03 * (ROW - 3))
EDGE = np.where(COLUMN < 4, PLANE, PLANE * 0.6)


def judged(inverse, beam=None, distance=0.0, columns=7):
    """Which of a frame's points, each the only one of its beam, are in doubt."""
    beam = np.arange(len(inverse)) if beam is None else beam
    return contradicts(beam, inverse, np.full(len(inverse), distance), beam, inverse, columns)


@pytest.mark.parametrize("surface", [PLANE, EDGE], ids=["plane", "edge"])
@pytest.mark.parametrize("distance", [0.0, 1.0])
def test_surfaces_are_not_doubted(surface, distance):
    noise = 1 + 0.002 * np.random.default_rng(1).normal(size=49)
    doubted = judged(surface * noise, distance=distance)
    assert not doubted.any()


@pytest.mark.parametrize("surface", [PLANE, EDGE], ids=["plane", "edge"])
def test_a_spot_of_a_highlight_is_doubted_alone(surface):
    """At any beam, corners included; it does not carry its neighbours along."""
    for beam in range(49):
        if surface is EDGE and COLUMN[beam] in (2, 3, 4, 5):
            continue
        for factor in (0.5, 0.7, 1.4, 2.0):
            inverse = surface.copy()
            inverse[beam] *= factor
            assert np.flatnonzero(judged(inverse)).tolist() == [beam], (beam, factor)


def test_little_is_allowed_far_from_the_line():
    inverse = PLANE.copy()
    inverse[24] *= 1.04
    assert not judged(inverse).any()
    far = np.zeros(49)
    far[24] = 0.5
    doubted = contradicts(np.arange(49), inverse, far, np.arange(49), inverse, 7)
    assert np.flatnonzero(doubted).tolist() == [24]


def test_a_few_points_say_nothing():
    corner = np.array([0, 1, 2, 7, 8, 9, 14, 15])
    for count in range(9):
        beam = corner[:count]
        inverse = PLANE[beam] * np.where(beam == 8, 3, 1)
        assert judged(inverse, beam).tolist() == [each == 8 and count == 8 for each in beam]
    assert judged(np.full(7, 0.01) * [1, 1, 1, 3, 1, 1, 1], columns=7).tolist() == [False] * 7
    assert judged(np.zeros(0)).tolist() == []


@pytest.fixture(scope="module")
def wall():
    """Spots of a flat wall, as the chip reports them, and one of a highlight on beam 5's line."""
    from scripts.host.rebuild import Rebuilder
    rng = np.random.default_rng(1)
    u, v = rng.integers(0, 64 * 512, (2, 100_000))
    status, beam, inverse = Rebuilder(CALIBRATION.settings, 64, 64)(u, v)
    ok = status == 0
    u, v, beam, inverse = u[ok], v[ok], beam[ok], inverse[ok]
    middle = np.median(inverse)

    def spot(which, wanted):
        at = np.flatnonzero(beam == which)
        at = at[np.argmin(np.abs(inverse[at] / wanted - 1))]
        found = np.zeros(1, REPORTED)
        for name, values in (("u", u), ("v", v), ("beam", beam), ("inverse_z", inverse)):
            found[name] = values[at]
        found["area"] = 9
        return found

    spots = np.concatenate([spot(which, middle) for which in range(16)])
    assert np.abs(spots["inverse_z"] / middle - 1).max() < 0.03
    return spots, spot(5, 1.3 * middle), spot(5, middle)


def names(points):
    return [STATUS[status] for status in points["status"]]


def test_a_doubtful_point_keeps_beam_and_coordinates(wall):
    spots, wrong, _ = wall
    reported = spots.copy()
    reported[5] = wrong[0]
    points = Locator(CALIBRATION)(reported, 3, GREY)
    assert names(points) == ["doubtful" if beam == 5 else "ok" for beam in range(16)]
    plain = Locator(CALIBRATION)(spots, 3, GREY)
    plain[5] = Locator(CALIBRATION)(wrong, 3, GREY)[0]  # alone it contradicts nothing
    assert names(plain) == ["ok"] * 16
    for name in ("frame", "beam", "u", "v", "x", "y", "z"):
        np.testing.assert_array_equal(points[name], plain[name])


def test_what_the_beam_showed_before_is_believed(wall):
    """Only of ok points, and only where frames are related."""
    spots, wrong, _ = wall
    reported = spots.copy()
    reported[5] = wrong[0]
    locator = Locator(CALIBRATION)
    assert names(locator(wrong, 0, GREY)) == ["ok"]  # nothing to contradict
    assert "doubtful" not in names(locator(reported, 1, GREY))
    locator = Locator(CALIBRATION)
    for number in range(3):  # a doubtful point is not believed the next time
        assert names(locator(reported, number, GREY))[5] == "doubtful"
    locator = Locator(CALIBRATION, related=False)
    locator(wrong, 0, GREY)
    assert names(locator(reported, 1, GREY))[5] == "doubtful"


@pytest.mark.parametrize("first", [True, False])
def test_the_other_spot_of_a_doubtful_beam_is_taken(first, wall):
    """Whichever of the two is nearer to the line."""
    spots, wrong, right = wall
    others = np.delete(spots, 5)
    reported = np.concatenate([wrong, right, others] if first else [right, wrong, others])
    locator = Locator(CALIBRATION)
    points = locator(reported, 0, GREY)
    found = dict(zip(reported["inverse_z"][:2].tolist(), names(points)[:2], strict=True))
    duplicate = find_duplicates(reported, CALIBRATION)[:2].argmax()
    if reported["inverse_z"][duplicate] == right["inverse_z"][0]:
        assert found == {int(wrong["inverse_z"][0]): "doubtful", int(right["inverse_z"][0]): "ok"}
        assert np.isfinite(points["z"]).all()
    else:
        assert found == {int(wrong["inverse_z"][0]): "duplicate", int(right["inverse_z"][0]): "ok"}
    assert names(points)[2:] == ["ok"] * 15


@pytest.mark.parametrize("doubtful", [True, False])
def test_run_counts_them_and_leaves_them_out_if_asked(doubtful, wall, tmp_path):
    spots, wrong, _ = wall
    reported = spots.copy()
    reported[5] = wrong[0]
    cv2.imwrite(str(tmp_path / "0.png"), np.full((64, 64), 9, np.uint8))
    frame = Frame(0, spots=16, ok=16, points=reported, flags=1 << Flag.LASER)
    engine = SimpleNamespace(frames=lambda images, independent: (frame for _ in images))
    measured = measure([Entry(0, tmp_path / "0.png")], CALIBRATION, engine)
    result, out = Measurement(), tmp_path / "out"
    out.mkdir()
    write_frames(out, measured, result, CALIBRATION, True, doubtful)
    write_rest(out, result, CALIBRATION, "test", None, True, doubtful)
    assert totals(result.frames)["doubtful"] == 1 and totals(result.frames)["ok"] == 15
    table = (out / "points.csv").read_text()
    assert table.count(",doubtful,") == 1 and table.count(",ok,") == 15
    assert f"element vertex {16 if doubtful else 15}\n" in (out / "points.ply").read_text()
    assert "doubt" in (out / "summary.txt").read_text()
    assert "doubt" in [column.header for column in frames_table(result.frames).columns]
    picture = cv2.imread(str(out / "frames" / "0000.png"))
    pink = (np.abs(picture.astype(int) - (0xd9, 0x7a, 0xff)).sum(axis=2) < 30).sum()
    assert (pink > 50) == doubtful
