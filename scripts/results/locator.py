"""From what the chip reports to millimetres: one row per spot."""

import numpy as np

from hdl.protocol import MOST_BEAMS
from model.preprocessing.centre import lsb_px
from model.stereo.epipolar import unpack_line
from model.stereo.undistort import undistort
from scripts.results.doubt import contradicts, is_near
from scripts.results.points import DOUBTFUL, DUPLICATE, OK, POINT

__all__ = ["Locator", "find_duplicates"]


def find_duplicates(reported, calibration=None):
    """Which ok spots are not the best of their beam in the frame.

    The best spot of a beam is the one nearest to the beam's epipolar line, the larger one of two
    that are equally near, the first one of two that are equally large. Without a calibration
    the distance is not known, and the larger one is the better.

    Parameters
    ----------
    reported : structured array
        Spots of one frame, as for :class:`Locator`.
    calibration : calibration or None
        Gives the lines.

    Returns
    -------
    array of :class:`bool`
        One for each spot.
    """
    duplicate = np.zeros(len(reported), bool)
    ok = np.flatnonzero(reported["status"] == OK)
    beam = np.asarray(reported["beam"], np.int64)[ok]
    if len(np.unique(beam)) == len(beam):
        return duplicate
    distance = _line_distance(reported[ok], calibration)
    area = np.asarray(reported["area"], np.int64)[ok]
    order = np.lexsort((np.arange(len(ok)), -area, distance, beam))
    repeated = np.flatnonzero(np.diff(beam[order]) == 0) + 1
    duplicate[ok[order[repeated]]] = True
    return duplicate


def _line_distance(reported, calibration):
    """Distance of ok spots from their beams' epipolar lines in LSBs; 0 where it is unknown."""
    beam = np.asarray(reported["beam"], np.int64)
    if calibration is None or not len(beam) or beam.max() >= len(calibration.settings.line):
        return np.zeros(len(beam), np.int64)
    settings = calibration.settings
    x, y, _ = undistort(reported["u"], reported["v"], settings, calibration.width,
                        calibration.height)
    slope, offset = unpack_line(np.asarray(settings.line, np.int64)[beam])
    return np.abs(y - (((slope * x + (1 << 16)) >> 17) + offset))


class Locator:
    """Frames in their order to rows of points, one for each spot.

    x, y and z are those of the undistorted ray through the spot's centre, at the depth that the
    chip measured. A beam has one ok point at most, see :func:`find_duplicates`. Where the chip
    corrects whole images, it reports coordinates in the corrected image; u and v are where the
    lens puts them.

    A point is doubtful if it contradicts its neighbours in the mesh, see
    :func:`scripts.results.doubt.contradicts`, and the depth of the last ok point of its beam, if
    there was one. If the beam has another spot in the frame that contradicts nothing, that is its
    ok point, and no duplicate.

    Parameters
    ----------
    calibration : calibration
        Gives the lens, the lines and the unit of ``inverse_z``.
    related : :class:`bool`
        Frames follow one another in time; otherwise each is judged by itself.
    """

    def __init__(self, calibration, related=True):
        self.calibration, self.related = calibration, related
        self._lsb_px = lsb_px(calibration.width, calibration.height)
        self._last = np.full(MOST_BEAMS, np.nan)  # 1/z of each beam's last ok point

    def __call__(self, reported, index, grey):
        """Rows of a frame's spots, in the order in which the chip reports them.

        Parameters
        ----------
        reported : structured array
            ``status beam area u v inverse_z``, in the integer units of the link.
        index : :class:`int`
            The frame's number.
        grey : 2-D ``uint8`` array
            Where the intensity is read.

        Returns
        -------
        array of :data:`scripts.results.points.POINT`
        """
        points = _rows(reported, index, self.calibration, grey)
        located = np.flatnonzero(np.isfinite(points["z"]))
        order = np.argsort(_line_distance(reported[located], self.calibration), kind="stable")
        located = located[order]
        best = located[points["status"][located] == OK]
        doubtful = best[self._doubt(points, reported, best, best)]
        points["status"][doubtful] = DOUBTFUL
        # Of other spots of their beams, the nearest to the line of each that contradicts nothing.
        spare = located[(points["status"][located] == DUPLICATE)
                        & np.isin(points["beam"][located], points["beam"][doubtful])]
        spare = spare[~self._doubt(points, reported, spare, best)]
        _, first = np.unique(points["beam"][spare], return_index=True)
        points["status"][spare[first]] = OK
        if self.related:
            kept = points[located[points["status"][located] == OK]]
            self._last[kept["beam"]] = 1 / kept["z"]
        for name in "xyz":
            points[name][points["status"] == DUPLICATE] = np.nan
        return points

    def _doubt(self, points, reported, chosen, best):
        """Which of the chosen spots contradict the best ones, and the past."""
        beam, inverse = points["beam"][chosen], 1 / points["z"][chosen]
        distance = _line_distance(reported[chosen], self.calibration) * self._lsb_px
        return contradicts(
            beam, inverse, distance, points["beam"][best], 1 / points["z"][best],
            self.calibration.columns) & ~is_near(inverse, self._last[beam])


def _rows(reported, index, calibration, grey):
    """Rows of a frame's spots, of which none is doubtful yet; duplicates have coordinates."""
    points = np.zeros(len(reported), POINT)
    points["frame"] = index
    for name in ("status", "area", "saturated", "border"):
        points[name] = reported[name]
    ok = points["status"] == OK
    points["status"][find_duplicates(reported, calibration)] = DUPLICATE
    points["beam"] = np.where(ok, np.asarray(reported["beam"], np.int16), -1)
    lens = calibration.lens
    scale = lsb_px(calibration.width, calibration.height)
    u, v = (np.asarray(reported[name], float) * scale for name in "uv")
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
    measured = ok & (inverse > 0)
    depth = 1 / inverse[measured]
    slopes = lens.ray(*undistorted)
    points["x"][measured] = slopes[0][measured] * depth
    points["y"][measured] = slopes[1][measured] * depth
    points["z"][measured] = depth
    return points
