"""Frames of the link to rows of points: what is trusted, and where it is."""

import numpy as np

from hdl.protocol import SMALL_SENSOR
from model.preprocessing.centre import lsb_px
from scripts.results.drift import DriftMonitor
from scripts.results.locator import Locator, find_duplicates
from scripts.results.points import DUPLICATE, OK, POINT, STATUS

__all__ = ["NAMES", "UNVERIFIED", "FrameLocator"]

#: Points of frames whose check failed get this word instead of ok, and no coordinates.
NAMES = (*STATUS, "unverified")
UNVERIFIED = len(STATUS)
_DARK = np.zeros((1, 1), np.uint8)


class FrameLocator:
    """Rows of the points of frames, called with them in their order.

    Points are trusted while the last check that could be made was right.

    Parameters
    ----------
    calibration : :class:`calibration.file.Calibration` or None
        What the chip was loaded with; without, there are no coordinates.

    Attributes
    ----------
    drift : :class:`scripts.results.drift.Drift` or None
        Whether the rig is as it was calibrated, by the last frame; None if that had no points.
    """

    def __init__(self, calibration=None):
        #: Sensor size in pixels, for u and v without a calibration. None: with no side above 512.
        self.size = None
        self._locate = calibration and Locator(calibration)
        self._monitor = calibration and DriftMonitor(calibration)
        self.drift = None
        self._trusted = False

    def __call__(self, frame):
        """An array of :data:`scripts.results.points.POINT`; the status may be UNVERIFIED too."""
        if frame.verified is not None:
            self._trusted = frame.verified and (self._trusted or frame.ok > 0)
        reported = frame.points.copy()
        if not self._trusted:
            reported["status"][reported["status"] == OK] = UNVERIFIED
        if self._locate is not None:
            # The texture comes later and in parts: intensities are taken from it at the end.
            points = self._locate(reported, frame.index, _DARK)
            self.drift = self._monitor.add(points)
            return points
        points = np.zeros(len(reported), POINT)
        points["frame"] = frame.index
        for name in ("status", "area", "saturated", "border"):
            points[name] = reported[name]
        points["beam"] = np.where(
            points["status"] == OK, np.asarray(reported["beam"], np.int16), -1)
        points["status"][find_duplicates(reported)] = DUPLICATE
        scale = lsb_px(*(self.size or (SMALL_SENSOR, SMALL_SENSOR)))
        for name in "uv":
            points[name] = np.asarray(reported[name], float) * scale
        for name in "xyz":
            points[name] = np.nan
        return points
