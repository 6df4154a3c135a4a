"""Points against the truth of a simulator.

Definitions: the error of an ok point is |z - z_true| / z_true, z_true being the true depth of the
point's beam or, where that beam has no truth in the frame, of the true spot nearest in the image.
The *mean error* is over all ok points, those with a wrong beam included. *Found* is the share of
the beams with an ok point, of those whose truth is inside the image; *wrong* is the share of the ok
points with an error of more than 5 %.
"""

from dataclasses import dataclass, field

import numpy as np

from calibration.csv_table import read_table
from hdl.protocol import MOST_BEAMS
from model.preprocessing.area import LARGEST_AREA
from scripts.results.points import POINT, STATUS

__all__ = ["TRUTH", "WRONG", "Accuracy", "compare", "load_points", "load_truth"]

#: An ok point with a larger relative error is wrong.
WRONG = 0.05

TRUTH = np.dtype([
    ("frame", np.int32), ("beam", np.int16), ("u", np.float64), ("v", np.float64),
    ("x", np.float64), ("y", np.float64), ("z", np.float64), ("inside", np.bool_)])

#: Octets of a table: 8000 frames of 512 beams.
_MOST = 1 << 28
_MOST_FRAME, _MOST_BEAM, _MOST_LENGTH = 2**31 - 1, MOST_BEAMS - 1, 1e6
_INSIDE = {"1": True, "true": True, "0": False, "false": False}
_COLUMNS = ("frame", "beam", "u_px", "v_px", "x_mm", "y_mm", "z_mm", "inside")


@dataclass(frozen=True)
class Accuracy:
    """Figures over some frames; NaN where there is nothing to count.

    ``error`` is the signed relative error of every point in ``points``, the ok ones.
    """

    expected: int
    found: float
    wrong: float
    mean: float
    median: float
    worst: float
    points: np.ndarray = field(repr=False)
    error: np.ndarray = field(repr=False)


def load_truth(path):
    """``truth.csv`` as an array of :data:`TRUTH`.

    Raises :class:`model.errors.UserError` if it is no such table; in a row with its line.
    """
    rows, lines = [], {}
    for row in read_table(path, _COLUMNS, "delete it, or simulate again", _MOST):
        frame = row.number("frame", 0, _MOST_FRAME, "the number of a frame", whole=True)
        beam = row.number("beam", 0, _MOST_BEAM, "the number of a beam", whole=True)
        first = lines.setdefault((frame, beam), row.line)
        if first != row.line:
            row.refuse(f"frame {frame} has beam {beam} in line {first} already")
        inside = row.text("inside").lower()
        if inside not in _INSIDE:
            row.refuse(f"inside must be 1 or 0, not {inside[:40]!r}")
        rows.append((frame, beam, *_coordinates(row), _INSIDE[inside]))
    return np.array(rows, TRUTH)


def _coordinates(row):
    """u, v, x, y and z of a row; NaN where there are none."""
    return (*(row.number(name, -_MOST_LENGTH, _MOST_LENGTH, "a number or nothing", empty=np.nan)
              for name in ("u_px", "v_px", "x_mm", "y_mm")),
            row.number("z_mm", 1e-6, _MOST_LENGTH, "a distance above 0 or nothing", empty=np.nan))


def load_points(path):
    """The spots of ``points.csv`` that have a status, as an array of
    :data:`scripts.results.points.POINT`."""
    rows = []
    for row in read_table(path, (*_COLUMNS[:-1], "area_px", "status"), "measure again", _MOST):
        if row.text("status") not in STATUS:
            continue
        frame = row.number("frame", 0, _MOST_FRAME, "the number of a frame", whole=True)
        beam = row.number("beam", 0, _MOST_BEAM, "the number of a beam or nothing", whole=True,
                          empty=-1)
        area = row.number("area_px", 0, LARGEST_AREA, "a number of pixels", whole=True)
        u, v, *place = _coordinates(row)
        rows.append((frame, beam, u, v, area, *place, STATUS.index(row.text("status")), 0,
                     False, False))
    return np.array(rows, POINT)


def _errors(points, truth):
    """Signed relative error of each point of one frame."""
    by_beam = {int(row["beam"]): row["z"] for row in truth if np.isfinite(row["z"])}
    located = truth[np.isfinite(truth["z"]) & np.isfinite(truth["u"])]
    error = np.full(len(points), np.nan)
    for index, point in enumerate(points):
        true = by_beam.get(int(point["beam"]))
        if true is None and len(located):
            distance = np.hypot(located["u"] - point["u"], located["v"] - point["v"])
            true = located["z"][np.argmin(distance)]
        if true is not None:
            error[index] = (point["z"] - true) / true
    return error


def compare(points, truth, frames):
    """Accuracy of points against truth.

    Parameters
    ----------
    points : array of :data:`scripts.results.points.POINT`
        All spots, of whatever status.
    truth : array of :data:`TRUTH`
        The simulator's table.
    frames : iterable of :class:`int`
        Frames that were measured; only their truth counts.

    Returns
    -------
    :class:`Accuracy` or None
        None if no frame has truth.
    """
    frames = np.intersect1d(np.asarray(list(frames), int), truth["frame"])
    if not len(frames):
        return None
    ok = points[(points["status"] == STATUS.index("ok")) & np.isin(points["frame"], frames)]
    truth = truth[np.isin(truth["frame"], frames)]
    error = np.full(len(ok), np.nan)
    expected = hits = 0
    for frame in frames:
        mine, true = ok["frame"] == frame, truth[truth["frame"] == frame]
        error[mine] = _errors(ok[mine], true)
        inside = true["beam"][true["inside"]]
        expected += len(inside)
        hits += np.count_nonzero(np.isin(inside, ok["beam"][mine]))
    size = np.abs(error)
    known = size[np.isfinite(size)]
    nothing = not len(known)
    return Accuracy(
        expected=expected, found=hits / expected if expected else float("nan"),
        wrong=float(np.mean(~(size <= WRONG))) if len(size) else float("nan"),
        mean=float("nan") if nothing else float(np.mean(known)),
        median=float("nan") if nothing else float(np.median(known)),
        worst=float("nan") if nothing else float(np.max(known)), points=ok, error=error)
