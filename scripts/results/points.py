"""Rows of spots: what they hold, and the names of their status."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

__all__ = ["DOUBTFUL", "DUPLICATE", "OK", "POINT", "STATUS", "FrameResult"]

#: Names of the status codes: those on the wire, and what is found out here.
STATUS = ("ok", "noise", "ambiguous", "rejected", "duplicate", "doubtful")
OK = STATUS.index("ok")
#: An ok spot whose beam has a better one in the same frame: it keeps the beam, and has no
#: coordinates.
DUPLICATE = STATUS.index("duplicate")
#: An ok spot that contradicts its neighbours in the mesh and the last depth of its beam; it keeps
#: its coordinates.
DOUBTFUL = STATUS.index("doubtful")

#: A spot: image coordinates in pixels, coordinates in millimetres (NaN where there are none), beam
#: (-1 where there is none), grey value at the spot, whether a pixel of it is saturated, and whether
#: it touches the border of the picture.
POINT = np.dtype([
    ("frame", np.int64), ("beam", np.int16), ("u", np.float64), ("v", np.float64),
    ("area", np.int16), ("x", np.float64), ("y", np.float64), ("z", np.float64),
    ("status", np.uint8), ("intensity", np.uint8), ("saturated", np.bool_), ("border", np.bool_)])


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
    level, grey_noise : :class:`float`
        Grey values from which on pixels were lit, above the local mean or in the preset ``paper``
        above 0; and the noise that this is a multiple of, 0 in the preset ``paper``.
    saturated : :class:`int`
        Pixels at the sensor's maximum; 0 in the preset ``paper``.
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
    level: float
    grey_noise: float
    saturated: int
    spots: int
    rejected: int
    dropped: int
    points: np.ndarray = field(repr=False)
    notes: tuple = ()

    def count(self, status):
        """How many of the reported spots have the status of that name."""
        return int(np.count_nonzero(self.points["status"] == STATUS.index(status)))
