"""Pattern frames for the link's benches: random ones, and those at the limits."""

import numpy as np

from model.link.points import POINT, PatternFrame
from model.preprocessing.area import area_code, coded_area

__all__ = ["EXTREMES", "near_points", "pattern_frame", "random_points"]

_BITS = {"beam": 9, "area": 10, "saturated": 1, "border": 1, "u": 18, "v": 18, "inverse_z": 18}


def random_points(rng, count, ok=0.8):
    """Points of any values; ``ok`` is the share of that status."""
    points = np.zeros(count, POINT)
    for name, bits in _BITS.items():
        points[name] = rng.integers(0, 1 << bits, count)
    points["area"] = coded_area(area_code(points["area"]))
    return _with_status(points, np.where(rng.random(count) < ok, 0, rng.integers(1, 4, count)))


def _with_status(points, status):
    """The points with that status; only ok ones have beam and inverse depth."""
    points["status"] = status
    ok = points["status"] == 0
    points["inverse_z"] = np.where(ok, np.maximum(points["inverse_z"], 1), 0)
    points["beam"] *= ok
    return points


def near_points(rng, count, ok=1.0):
    """Points down an image as a mesh would give them: v grows by less than seven rows, mostly."""
    points = random_points(rng, count, ok)
    points["area"] = rng.integers(0, 70, count)
    points["saturated"] &= rng.random(count) < 0.2
    points["border"] &= rng.random(count) < 0.2
    points["v"] = np.cumsum(rng.integers(-600, 3700, count)).clip(0, (1 << 18) - 1)
    return points


def pattern_frame(rng, points, **fields):
    """A frame with those points and any counts that add up."""
    def any_of(bits):
        return int(rng.integers(0, 1 << bits))

    chosen = {
        "number": any_of(16), "level": any_of(12), "every": any_of(4), "grey_noise": any_of(9),
        "saturated": any_of(19), "skipped": any_of(8), "exposure_us": any_of(16),
        "timestamp_us": any_of(24), "rejected": any_of(int(rng.integers(0, 11))),
        "dropped": any_of(int(rng.integers(0, 11))),
        **{name: bool(any_of(1)) for name in (
            "learning", "broken", "laser", "capture", "tripped", "tables_valid")}, **fields}
    return PatternFrame(
        points=points, spots=len(points) + chosen["rejected"] + chosen["dropped"], **chosen)


def _of_values(count, **values):
    points = np.zeros(count, POINT)
    for name, value in {"inverse_z": 1, **values}.items():
        points[name] = value
    return points


def _packet_limits(rng):
    """Points of which exactly as many bits as there is room for are taken, and one more."""
    for last_area in (63, 64):
        for count in (15, 16, 19, 20):  # about the room before a trailer, and without one
            points = _of_values(count, u=77, v=5, area=np.full(count, 9))
            points["area"][-1] = last_area
            yield points
    for long_ones in range(6):
        for count in (14, 15, 18, 19):
            points = _of_values(count, v=900)
            points["area"][:long_ones] = 200
            yield points


def _steps(rng):
    """Steps in v at the ends of the short form and far beyond."""
    v = [0, 3583, 7167, 6655, 10238, 13822, 13309, 0, 3584, 262143, 0, 511, 0, 512, 0, 513, 0,
         261632, 0, 1, 262143, 261631, 261118, 262143, 261630, 131072, 0]
    points = random_points(rng, len(v), ok=1.0)
    points["v"], points["area"] = v, rng.integers(0, 66, len(v))
    points["saturated"] = points["border"] = False
    return points


def _extremes():
    rng = np.random.default_rng(2010)
    ones = {name: (1 << bits) - 1 for name, bits in _BITS.items()} | {"area": 1020}
    none = {"rejected": 0, "dropped": 0}
    yield "no spot", pattern_frame(rng, _of_values(0), **none)
    yield "no spot, all zero", PatternFrame()
    yield "49 ok points", pattern_frame(rng, near_points(rng, 49), **none)
    yield "300 ok points", pattern_frame(rng, near_points(rng, 300), **none)
    yield "255 spots", pattern_frame(rng, near_points(rng, 255, 0.5), **none)
    yield "256 spots", pattern_frame(rng, near_points(rng, 255, 0.5), rejected=1, dropped=0)
    yield "rejected before", pattern_frame(rng, near_points(rng, 3), rejected=65000, dropped=0)
    yield "dropped", pattern_frame(rng, near_points(rng, 3), rejected=0, dropped=65000)
    for status in (1, 2, 3):
        for count in (1, 8, 9, 10, 40):
            points = _with_status(random_points(rng, count), status)
            yield f"{count} of status {status}", pattern_frame(rng, points, **none)
    yield "long forms only", pattern_frame(rng, _of_values(60, **ones), **none)
    yield "short forms only", pattern_frame(rng, _of_values(60), **none)
    yield "v goes backwards", pattern_frame(rng, _of_values(
        60, v=np.arange(59, -1, -1) * 511, area=5), **none)
    yield "steps", pattern_frame(rng, _steps(rng), **none)
    for index, points in enumerate(_packet_limits(rng)):
        yield f"packet limit {index}", pattern_frame(rng, points, **none)
        yield f"packet limit {index}, wide", pattern_frame(rng, points, rejected=500, dropped=0)
    for count in (6, 7, 8, 10, 11, 20):
        yield f"{count} records", pattern_frame(rng, random_points(rng, count), **none)
    yield "8 records, wide", pattern_frame(rng, random_points(rng, 7), rejected=300)
    yield "numbers at their ends", pattern_frame(
        rng, _of_values(1, **ones), number=0xFFFF, level=0xFFF, every=15, grey_noise=0x1FF,
        saturated=0x7FFFF, skipped=255, exposure_us=0xFFFF,
        timestamp_us=0xFFFFFF, rejected=0xFFFE, dropped=0, learning=True, broken=True, laser=True,
        capture=True, tripped=True, tables_valid=True)


#: Pairs of a name and a frame.
EXTREMES = list(_extremes())
