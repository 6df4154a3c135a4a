"""The list of measurements of a page: it is kept on disk beside the recording."""

import csv
import threading
from pathlib import Path

import numpy as np

from calibration.files import beside
from model.errors import UserError
from scripts.measure.records import CSV_HEADER, measure_frames
from scripts.measure.surface import Surface

__all__ = ["Measurements"]

#: Octets of a table that is read back, and frames of a mean.
_MOST, MOST_FRAMES = 1 << 22, 200


class Measurements:
    """Measurements by their numbers, which do not change.

    Parameters
    ----------
    history : :class:`scripts.host.history.History`
        Frames to measure in.
    path : path or None
        ``measurements.csv``, read if it is there; None keeps nothing.
    """

    def __init__(self, history, path=None):
        self._history, self._path = history, path and Path(path)
        self._rows, self._next, self._lock = {}, 1, threading.Lock()
        self.trouble = None
        if self._path is not None and self._path.exists():
            self._read()

    def _read(self):
        """Measurements of an earlier time; they have no ends, so they are only listed."""
        with open(self._path, encoding="utf-8", errors="replace", newline="") as file:
            text = file.read(_MOST)
        if not text.startswith(CSV_HEADER):
            raise UserError(f"{self._path} is there already and is no list of measurements: move "
                            "it away.")
        for row in csv.DictReader(text.splitlines()):
            def number(name, row=row):
                try:
                    return float(row[name])
                except (TypeError, ValueError):
                    return None
            if number("frame") is None or number("length_mm") is None:
                continue
            marks = [[float(part) for part in mark.split()]
                     for mark in (row["points_px"] or "").split(";") if mark]
            self._add({
                "frame": int(number("frame")), "frames": int(number("frames") or 1),
                "kind": row["kind"], "points_px": marks, "length_mm": number("length_mm"),
                "uncertainty_mm": number("uncertainty_mm"), "height_mm": number("height_mm"),
                "height_uncertainty_mm": number("height_uncertainty_mm"),
                "size_class": row["size_class"] or None, "ends_mm": [], "rim_mm": [], "notes": [],
            }, ",".join(row[name] or "" for name in CSV_HEADER.split(",")))

    def _add(self, plain, line):
        number, self._next = self._next, self._next + 1
        self._rows[number] = {"number": number, **plain}, line
        return self._rows[number][0]

    def measure(self, position, kind, marks, frames=1):
        """Measure in the frame at a position, or in the mean over it and those before it.

        Returns
        -------
        dict
            As :meth:`scripts.measure.records.Record.plain`, with its number in the list.
        """
        if not 1 <= frames <= MOST_FRAMES:
            raise UserError(f"A mean is over 1 to {MOST_FRAMES} frames, not {frames}.")
        marks = np.asarray(marks, float).reshape(-1, 2)
        if not np.isfinite(marks).all() or len(marks) > 500:
            raise UserError("These marks are no points of the picture.")
        last = min(max(position, self._history.first), self._history.count - 1)
        first = max(self._history.first, last - frames + 1)
        surfaces = [Surface(self._history.moment(each).points, self._history.calibration)
                    for each in range(last, first - 1, -1)]
        record = measure_frames(surfaces, kind, marks)
        with self._lock:
            added = self._add(record.plain(), record.row())
        self._save()
        return added

    def remove(self, number):
        """Take a measurement off the list."""
        with self._lock:
            if self._rows.pop(number, None) is None:
                raise UserError(f"There is no measurement {number}.")
        self._save()

    def plain(self):
        """All of them, for JSON."""
        with self._lock:
            return [plain for plain, _ in self._rows.values()]

    def csv(self):
        """All of them as a table."""
        with self._lock:
            return "\n".join([CSV_HEADER, *(line for _, line in self._rows.values()), ""])

    def _save(self):
        if self._path is None:
            return
        try:
            with beside(self._path) as file:
                file.write(self.csv().encode())
        except UserError as error:
            self.trouble = f"The list of measurements is not saved: {error}"
        else:
            self.trouble = None
