"""Which components go on to the stereo unit, and what is counted of the others."""

import numpy as np

from .area import LARGEST_AREA, area_code, coded_area

__all__ = ["COUNT_LIMIT", "QUEUED_DTYPE", "filter_spots"]

QUEUED_DTYPE = np.dtype([
    ("rejected", "?"), ("area", "i4"), ("saturated", "?"), ("border", "?"), ("weight", "i4"),
    ("sum_u", "i4"), ("sum_v", "i4")])

#: Counters stop here.
COUNT_LIMIT = 0xFFFF


def filter_spots(spots, settings):
    """Filter a frame's components by area and core, as a queue that is never full would.

    A component is rejected if its area lies outside ``area_min`` to ``area_max`` (both included)
    or if no pixel of it survived the erosion. Rejected ones are counted; they go on, marked, only
    with ``report_rejected`` and an area of at most :data:`.area.LARGEST_AREA`.

    Parameters
    ----------
    spots : structured array
        From :func:`model.preprocessing.labelling.label`.
    settings : :class:`model.settings.Settings`
        ``area_min, area_max, report_rejected``.

    Returns
    -------
    array of :data:`QUEUED_DTYPE`, dict
        What goes on, in the same order, areas rounded down to one that has a code
        (:mod:`.area`); ``spots`` and those ``rejected`` that do not go on,
        saturated at 65,535, and ``dropped``, which is 0: only a full queue drops spots.
    """
    area = spots["area"]
    rejected = (area < settings.area_min) | (area > settings.area_max) | ~spots["core"]
    kept = ~rejected | (settings.report_rejected & (area <= LARGEST_AREA))
    queued = np.zeros(np.count_nonzero(kept), dtype=QUEUED_DTYPE)
    queued["rejected"] = rejected[kept]
    queued["area"] = coded_area(area_code(area[kept]))
    for name in ("saturated", "border", "weight", "sum_u", "sum_v"):
        queued[name] = spots[name][kept]
    counts = {
        "spots": min(len(spots), COUNT_LIMIT),
        "rejected": min(np.count_nonzero(~kept), COUNT_LIMIT),
        "dropped": 0,
    }
    return queued, counts
