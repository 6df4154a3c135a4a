"""Points against the truth of a simulator.

Definitions: the error of an ok point is |z - z_true| / z_true, z_true being the depth of the beam
that the point says it is, or, where that beam has no truth in the frame, of the true spot nearest
in the image. The *mean error* is taken over all ok points, wrong beams included. *Found* is the
share of the beams whose truth is inside the picture that have an ok point; *wrong* the share of
the ok points that are off by more than 5 %.
"""

import csv
from dataclasses import dataclass, field

import numpy as np

from model.errors import UserError
from scripts.results.points import POINT, STATUS

__all__ = ["TRUTH", "WRONG", "Accuracy", "compare", "load_points", "load_truth"]

#: An ok point further off than this share of its depth is wrong.
WRONG = 0.05

TRUTH = np.dtype([
    ("frame", np.int32), ("beam", np.int16), ("u", np.float64), ("v", np.float64),
    ("x", np.float64), ("y", np.float64), ("z", np.float64), ("inside", np.bool_)])

_COLUMNS = ("frame", "beam", "u_px", "v_px", "x_mm", "y_mm", "z_mm", "inside")


@dataclass(frozen=True)
class Accuracy:
    """Figures over some frames; NaN where nothing could be counted.

    ``error`` has the signed relative error of every ok point of ``points``, in their order.
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
    """``truth.csv`` as an array of :data:`TRUTH`."""
    try:
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        truth = np.zeros(len(rows), TRUTH)
        for name, column in zip(TRUTH.names, _COLUMNS, strict=True):
            texts = [row[column] for row in rows]
            if name == "inside":
                truth[name] = [text.strip().lower() in ("1", "true") for text in texts]
            else:
                truth[name] = [float(text) if text else np.nan for text in texts]
    except (OSError, KeyError, ValueError, AttributeError, UnicodeDecodeError) as error:
        raise UserError(
            f"{path} cannot be read as a table with the columns {','.join(_COLUMNS)}: "
            "delete it or simulate again.") from error
    return truth


def load_points(path):
    """The spots of ``points.csv`` that have a status, as an array of
    :data:`scripts.results.points.POINT`."""
    with open(path, newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["status"] in STATUS]
    points = np.zeros(len(rows), POINT)
    for name, column in (("frame", "frame"), ("beam", "beam"), ("u", "u_px"), ("v", "v_px"),
                         ("area", "area_px"), ("x", "x_mm"), ("y", "y_mm"), ("z", "z_mm")):
        empty = -1 if name == "beam" else np.nan
        points[name] = [float(row[column]) if row[column] else empty for row in rows]
    points["status"] = [STATUS.index(row["status"]) for row in rows]
    return points


def _errors(points, truth):
    """Signed relative error of each point of one frame."""
    by_beam = {int(row["beam"]): row["z"] for row in truth if np.isfinite(row["z"])}
    placed = truth[np.isfinite(truth["z"]) & np.isfinite(truth["u"])]
    error = np.full(len(points), np.nan)
    for index, point in enumerate(points):
        true = by_beam.get(int(point["beam"]))
        if true is None and len(placed):
            distance = np.hypot(placed["u"] - point["u"], placed["v"] - point["v"])
            true = placed["z"][np.argmin(distance)]
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
        Frames that were measured; only theirs counts.

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
    expected = seen = 0
    for frame in frames:
        mine, true = ok["frame"] == frame, truth[truth["frame"] == frame]
        error[mine] = _errors(ok[mine], true)
        inside = true["beam"][true["inside"]]
        expected += len(inside)
        seen += np.count_nonzero(np.isin(inside, ok["beam"][mine]))
    size = np.abs(error)
    known = size[np.isfinite(size)]
    nothing = not len(known)
    return Accuracy(
        expected=expected, found=seen / expected if expected else float("nan"),
        wrong=float(np.mean(~(size <= WRONG))) if len(size) else float("nan"),
        mean=float("nan") if nothing else float(np.mean(known)),
        median=float("nan") if nothing else float(np.median(known)),
        worst=float("nan") if nothing else float(np.max(known)), points=ok, error=error)
