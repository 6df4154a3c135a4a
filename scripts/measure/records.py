"""Measurements as they are listed: in JSON, in a CSV, and in a sentence."""

from dataclasses import dataclass, field

import numpy as np

from model.errors import UserError
from scripts.measure.polyp import polyp, size_class
from scripts.measure.ruler import ruler

__all__ = ["CSV_HEADER", "KINDS", "Record", "measure_frames"]

KINDS = ("ruler", "polyp")
CSV_HEADER = ("frame,frames,kind,length_mm,uncertainty_mm,height_mm,height_uncertainty_mm,"
              "size_class,points_px")
#: Frames whose lengths differ by more than this times what noise explains show a scene that moves.
_MOVED = 3.0


@dataclass(frozen=True)
class Record:
    """One measurement; lengths in mm, uncertainties of 68 %.

    Parameters
    ----------
    frame, frames : :class:`int`
        The first frame, and how many the mean is over.
    kind : :class:`str`
        One of :data:`KINDS`.
    image : tuple of tuples (u, v)
        What was marked, px.
    length, uncertainty : :class:`float`
        The ruler's distance, or the polyp's longest diameter.
    height, height_uncertainty : :class:`float`
        The polyp's, NaN otherwise.
    ends : array (2, 3)
        Between which the length is, in the first frame.
    rim : array (n, 3)
        The polyp's, in the first frame.
    notes : tuple of :class:`str`
        What is to be known of it.
    """

    frame: int
    frames: int
    kind: str
    image: tuple
    length: float
    uncertainty: float
    height: float = np.nan
    height_uncertainty: float = np.nan
    ends: np.ndarray = field(default=None, repr=False)
    rim: np.ndarray = field(default=None, repr=False)
    notes: tuple = ()

    @property
    def size_class(self):
        """Name of a polyp's size class; nothing for a ruler."""
        return size_class(self.length) if self.kind == "polyp" else ""

    @property
    def sure(self):
        """Whether the size class is the same at both ends of the uncertainty."""
        return self.kind != "polyp" or (
            size_class(self.length - self.uncertainty)
            == size_class(self.length + self.uncertainty))

    def plain(self):
        """What JSON holds."""
        def number(value):
            return None if value is None or np.isnan(value) else round(float(value), 4)

        def places(values):
            return [] if values is None else np.round(values, 4).tolist()

        return {
            "frame": self.frame, "frames": self.frames, "kind": self.kind,
            "points_px": [list(point) for point in self.image],
            "length_mm": number(self.length), "uncertainty_mm": number(self.uncertainty),
            "height_mm": number(self.height),
            "height_uncertainty_mm": number(self.height_uncertainty),
            "size_class": self.size_class or None,
            "size_class_sure": self.sure if self.kind == "polyp" else None,
            "ends_mm": places(self.ends), "rim_mm": places(self.rim), "notes": list(self.notes)}

    def row(self):
        """A line of the CSV, without its end."""
        def number(value):
            return "" if np.isnan(value) else f"{value:.4f}"

        marked = ";".join(f"{u:.2f} {v:.2f}" for u, v in self.image)
        return (f"{self.frame},{self.frames},{self.kind},{number(self.length)},"
                f"{number(self.uncertainty)},{number(self.height)},"
                f"{number(self.height_uncertainty)},{self.size_class},{marked}")

    def sentence(self):
        """What is shown of it."""
        mean = f", mean of {self.frames} frames" if self.frames > 1 else ""
        words = f"{self.length:.2f} mm +- {self.uncertainty:.2f} (68 %)"
        if self.kind == "ruler":
            return f"frame {self.frame}{mean}: distance {words}"
        height = "" if np.isnan(self.height) else (
            f", height {self.height:.1f} mm +- {self.height_uncertainty:.1f}")
        doubt = "" if self.sure else ", or the class beside it"
        return (f"frame {self.frame}{mean}: longest diameter {words}{height}, "
                f"size class {self.size_class}{doubt}")


def _once(surface, kind, image):
    """Length, its variance and the random part, height and its variance, and what was measured."""
    if kind == "ruler":
        found = ruler(surface, image)
        return found.value, found.uncertainty**2, found.random**2, np.nan, np.nan, found
    found = polyp(surface, image)
    return (found.diameter, found.diameter_uncertainty**2, found.random**2, found.height,
            found.height_uncertainty**2, found)


def measure_frames(surfaces, kind, image):
    """Measure the same marks in one frame, or in several and take the mean.

    Frames without surface at a mark are left out.

    Parameters
    ----------
    surfaces : list of :class:`scripts.measure.surface.Surface`
        Of frames that show the same scene, one at least.
    kind : :class:`str`
        One of :data:`KINDS`.
    image : array (n, 2)
        Marks in px; they are rounded to a hundredth.

    Returns
    -------
    :class:`Record`

    Raises
    ------
    UserError
        If no frame can be measured.
    """
    marks = tuple((round(float(u), 2), round(float(v), 2)) for u, v in image)
    found, failed = [], None
    for surface in surfaces:
        try:
            found.append((surface.frame, *_once(surface, kind, np.array(marks))))
        except UserError as error:
            failed = failed or error
    if not found:
        raise failed
    frame, *_, first = found[0]
    numbers = np.array([row[1:6] for row in found], float)
    length, variance, random = numbers[:, :3].mean(axis=0)
    notes = []
    if len(found) > 1:
        scatter = float(numbers[:, 0].var(ddof=1))
        if scatter > _MOVED**2 * max(random, 1e-6) and scatter > (0.01 * length)**2:
            notes.append("the scene, or the camera, moved between these frames")
        # What is the same in all frames stays; noise is less in the mean.
        variance = max(variance - random, 0) + max(random, scatter) / len(found)
    known = numbers[np.isfinite(numbers[:, 3])]
    height, height_variance = known[:, 3:].mean(axis=0) if len(known) else (np.nan, np.nan)
    if len(found) < len(surfaces):
        notes.append(f"{len(surfaces) - len(found)} of {len(surfaces)} frames could not be "
                     "measured and are left out")
    if kind == "polyp" and not first.beams:
        notes.append("no measured point on the polyp, so its height is not known")
    return Record(frame, len(found), kind, marks, float(length), float(np.sqrt(variance)),
                  float(height), float(np.sqrt(height_variance)), first.ends,
                  getattr(first, "rim", None), tuple(notes))
