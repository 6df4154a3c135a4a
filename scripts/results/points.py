"""From what the chip reports to millimetres: one row per spot."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from model.stereo.epipolar import unpack_line
from model.stereo.undistort import undistort

__all__ = ["DUPLICATE", "POINT", "STATUS", "FrameResult", "find_duplicates", "locate"]

#: Names of the status codes: those on the wire, and what is found out here.
STATUS = ("ok", "noise", "ambiguous", "rejected", "duplicate")
#: An ok spot whose beam has a better one in the same frame: it keeps the beam, and has no
#: coordinates.
DUPLICATE = STATUS.index("duplicate")

#: A spot: image coordinates in pixels, coordinates in millimetres (NaN where there are none), beam
#: (-1 where there is none), grey value at the spot.
POINT = np.dtype([
    ("frame", np.int64), ("beam", np.int16), ("u", np.float64), ("v", np.float64),
    ("area", np.int16), ("x", np.float64), ("y", np.float64), ("z", np.float64),
    ("status", np.uint8), ("intensity", np.uint8)])

#: Image coordinates on the wire have 9 bits behind the binary point.
_LSB_PX = 1 / 512


@dataclass(frozen=True)
class FrameResult:
    """The result of one frame.

    Parameters
    ----------
    index : :class:`int`
        The frame's number in the tables.
    path : :class:`~pathlib.Path`
        Its pattern image.
    texture : :class:`~pathlib.Path` or None
        Its image without the laser.
    level : :class:`int`
        Threshold used.
    spots, rejected, dropped : :class:`int`
        Connected components in the frame, those that were rejected in any block, and those that
        were dropped because a buffer was full.
    points : array of :data:`POINT`
        The spots that were reported.
    notes : :class:`tuple` of :class:`str`
        What makes the frame worse than it could be.
    """

    index: int
    path: Path
    texture: Path | None
    level: int
    spots: int
    rejected: int
    dropped: int
    points: np.ndarray = field(repr=False)
    notes: tuple = ()

    def count(self, status):
        """How many of the reported spots have the status of that name."""
        return int(np.count_nonzero(self.points["status"] == STATUS.index(status)))


def find_duplicates(reported, calibration=None):
    """Which ok spots are not the best of their beam in the frame.

    The best spot of a beam is the one nearest to the beam's epipolar line, the larger one of two
    that are equally near, the first one of two that are equally large. Without a calibration
    the distance is not known, and the larger one is the better.

    Parameters
    ----------
    reported : structured array
        Spots of one frame, as for :func:`locate`.
    calibration : calibration or None
        Gives the lines.

    Returns
    -------
    array of :class:`bool`
        One for each spot.
    """
    duplicate = np.zeros(len(reported), bool)
    ok = np.flatnonzero(reported["status"] == STATUS.index("ok"))
    beam = np.asarray(reported["beam"], np.int64)[ok]
    if len(np.unique(beam)) == len(beam):
        return duplicate
    distance = np.zeros(len(ok), np.int64)
    if calibration is not None and beam.max() < len(calibration.settings.line):
        settings = calibration.settings
        x, y, _ = undistort(reported["u"][ok], reported["v"][ok], settings, calibration.width,
                            calibration.height)
        slope, offset = unpack_line(np.asarray(settings.line, np.int64)[beam])
        distance = np.abs(y - (((slope * x + (1 << 16)) >> 17) + offset))
    area = np.asarray(reported["area"], np.int64)[ok]
    order = np.lexsort((np.arange(len(ok)), -area, distance, beam))
    repeated = np.flatnonzero(np.diff(beam[order]) == 0) + 1
    duplicate[ok[order[repeated]]] = True
    return duplicate


def locate(reported, index, calibration, grey):
    """Rows of a frame's spots, in the order in which the chip reports them.

    x, y and z are those of the undistorted ray through the spot's centre, at the depth that the
    chip measured. A beam has one ok point at most, see :func:`find_duplicates`. Where the chip
    corrects whole images, it reports coordinates in the corrected image; u and v are where the
    lens puts them.

    Parameters
    ----------
    reported : structured array
        ``status beam area u v inverse_z``, in the integer units of the link.
    index : :class:`int`
        The frame's number.
    calibration : calibration
        Gives the lens and the unit of ``inverse_z``.
    grey : 2-D ``uint8`` array
        Where the intensity is read.
    """
    points = np.zeros(len(reported), POINT)
    points["frame"] = index
    for name in ("status", "area"):
        points[name] = reported[name]
    ok = points["status"] == STATUS.index("ok")
    points["status"][find_duplicates(reported, calibration)] = DUPLICATE
    points["beam"] = np.where(ok, np.asarray(reported["beam"], np.int16), -1)
    lens = calibration.lens
    u, v = (np.asarray(reported[name], float) * _LSB_PX for name in "uv")
    if calibration.settings.remap:
        undistorted = u - lens.centre[0], v - lens.centre[1]
        u, v = lens.distort(*undistorted)
    else:
        undistorted = lens.undistort(u, v)
    points["u"], points["v"] = u, v

    column = np.clip(np.rint(points["u"]).astype(int), 0, grey.shape[1] - 1)
    row = np.clip(np.rint(points["v"]).astype(int), 0, grey.shape[0] - 1)
    points["intensity"] = grey[row, column]

    for name in "xyz":
        points[name] = np.nan
    inverse = np.asarray(reported["inverse_z"], float) * calibration.inverse_z_unit
    measured = (points["status"] == STATUS.index("ok")) & (inverse > 0)
    depth = 1 / inverse[measured]
    slopes = lens.ray(*undistorted)
    points["x"][measured] = slopes[0][measured] * depth
    points["y"][measured] = slopes[1][measured] * depth
    points["z"][measured] = depth
    return points
