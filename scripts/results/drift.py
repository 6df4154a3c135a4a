"""Whether a rig is still as it was calibrated, from the distances of spots across their lines.

A spot's place along its beam's epipolar line gives the depth. Its distance across the line is
redundant: in a rig that is as it was calibrated it is noise about zero. What moves in the rig
shifts these distances in a pattern over the mesh that follows from the calibration.
"""

from dataclasses import dataclass, replace

import numpy as np

from scripts.results.points import OK

__all__ = ["CAUSES", "Drift", "DriftMonitor", "beam_lines", "line_distance"]

#: What can move, and its columns in the patterns.
CAUSES = {"focus": (0,), "turned": (1, 2, 3), "base": (4, 5)}
#: Frames over which distances are averaged, by exponential forgetting.
_FRAMES = 64
#: Frames before anything is judged.
_LEAST_FRAMES = 16
#: Beams, below which nothing is judged.
_LEAST_BEAMS = 12
#: By how much the patterns must lessen chi-square for the rig to have moved: unmoved rigs reach 2
#: on smooth scenes and 7 on tissue. An alarm that stands ends at half of it.
_ALARM = 16.0
#: Shift of the spots in px, RMS, below which it does not matter what has moved. A turn about y by
#: 0.05 degrees, the least of what is to be found, shifts them by 0.013 to 0.015.
_LEAST_SHIFT_PX = 0.01
#: By how much less chi-square another cause may explain and still be possible.
_APART = 12.0
#: Distance in px, RMS, that light of an unmoved rig does not have, and the same in errors of the
#: calibrated lines. What is left of it by the best cause is due to something else: where a rig has
#: moved by much, spots are taken for those of other beams.
_FAR_PX, _FAR_LINES = 0.3, 4.0
#: Error of a beam's line in px that is assumed at least.
_LEAST_PX = 0.02


def beam_lines(calibration):
    """The beams' lines, array (beams, 4) of ``a``, ``b``, ``alpha`` and ``beta``.

    As those of :class:`calibration.file.Beam`; NaN for beams that were left out.
    """
    nothing = (np.nan,) * 4
    return np.array([
        nothing if beam is None else (beam.a, beam.b, beam.alpha, beam.beta)
        for beam in calibration.beams]).reshape(-1, 4)


def line_distance(points, lens, lines):
    """Distance of points across the lines of their beams in px, signed; NaN where it is unknown.

    Parameters
    ----------
    points : array (n,) of :data:`scripts.results.points.POINT`
        Points with a beam.
    lens : :class:`calibration.lens.Lens`
        The camera's.
    lines : array (beams, 4)
        See :func:`beam_lines`.
    """
    x, y = lens.undistort(points["u"], points["v"])
    a, b = lines[points["beam"], :2].T
    return y - a * x - b


@dataclass(frozen=True)
class Drift:
    """What the distances say, over the last frames.

    Parameters
    ----------
    distance_px : :class:`float`
        Distance of a spot across its line, RMS over the frame's ok points.
    normal_px : :class:`float`
        What that is at most while nothing has moved.
    causes : tuple of :class:`str`
        Names of :data:`CAUSES`: empty while nothing has moved, else the likeliest first, then those
        that fit nearly as well. ``unknown`` alone: none of them explains it.
    focus : :class:`float`
        Relative change of the focal length, if that is the cause.
    turned_deg : :class:`float`
        Angle by which the projector has turned, likewise.
    base_mm : :class:`float`
        Shift of the projector across its base, likewise.
    """

    distance_px: float
    normal_px: float
    causes: tuple = ()
    focus: float = 0.0
    turned_deg: float = 0.0
    base_mm: float = 0.0

    @property
    def sentence(self):
        """What has moved, and what to do; empty while nothing has."""
        if not self.causes:
            return ""
        words = {"focus": f"the focus has changed by {100 * self.focus:+.2f} %",
                 "turned": f"the projector has turned by {self.turned_deg:.3f} degrees",
                 "base": f"the projector has moved by {self.base_mm:.3f} mm",
                 "unknown": f"spots lie {self.distance_px:.2f} px beside their lines, more than a "
                            "small change explains"}
        causes = ", or ".join(words[cause] for cause in self.causes)
        return f"The rig is not as it was calibrated: {causes}; calibrate it again."


class DriftMonitor:
    """Follows the distances, frame by frame.

    The distances of each beam are averaged over the last 64 frames, and the patterns of all that
    can move are fitted to the averages by least squares. The error of the calibrated lines counts
    as noise of the averages: it stays from frame to frame, so more frames do not make it smaller.
    What has moved is the cause whose pattern alone explains most.

    A change of the base along itself moves spots along their lines only, and is not seen.

    Parameters
    ----------
    calibration : :class:`calibration.file.Calibration`
        What the chip was loaded with.
    """

    def __init__(self, calibration):
        self.calibration = calibration
        self._lines = beam_lines(calibration)
        self._a, b, alpha, beta = self._lines.T
        residual = [beam.residual_v for beam in calibration.beams if beam is not None]
        self._line_px = max(_LEAST_PX, float(np.sqrt(np.mean(np.square(residual)))))
        # Slopes of the beams: where their spots tend to as the surface recedes.
        vanishing = -beta / np.where(alpha == 0, np.nan, alpha)
        self._slope_x, self._slope_y = calibration.lens.ray(
            vanishing, self._a * vanishing + b)
        beams = len(calibration.beams)
        self._frames, self._alarm = 0, False
        self._count = np.zeros(beams)
        self._sum, self._square = np.zeros(beams), np.zeros(beams)
        self._pattern = np.zeros((beams, 6))

    def add(self, points):
        """Take a frame's rows of spots, and say how the rig is.

        Parameters
        ----------
        points : array of :data:`scripts.results.points.POINT`
            Ok ones count.

        Returns
        -------
        :class:`Drift` or None
            None without points.
        """
        points = points[points["status"] == OK]
        distance = line_distance(points, self.calibration.lens, self._lines)
        known = np.isfinite(distance + points["z"]) & (points["z"] > 0)
        if not known.any():
            return None
        distance, points = distance[known], points[known]
        beam = points["beam"]
        self._frames += 1
        for each in (self._count, self._sum, self._square, self._pattern):
            each *= 1 - 1 / _FRAMES
        np.add.at(self._count, beam, 1)
        np.add.at(self._sum, beam, distance)
        np.add.at(self._square, beam, distance**2)
        np.add.at(self._pattern, beam, self._patterns(beam, 1 / points["z"]))
        return self._judged(float(np.sqrt(np.mean(distance**2))))

    def _patterns(self, beam, inverse):
        """Change of each point's distance, px, by each of what can move, (points, 6)."""
        lens, a = self.calibration.lens, self._a[beam]
        x, y = self._slope_x[beam], self._slope_y[beam]
        offset = y - a * x
        return lens.focal * np.column_stack([
            offset,
            -(1 + y**2) + a * x * y, x * y - a * (1 + x**2), x + a * y,
            inverse, -inverse * offset])

    def _judged(self, distance_px):
        """The state, from the averages."""
        seen = (self._count > 0.5) & np.isfinite(self._pattern).all(axis=1)
        count = self._count[seen]
        if not len(count):
            return Drift(distance_px, 3 * self._line_px)
        mean, pattern = self._sum[seen] / count, self._pattern[seen] / count[:, None]
        noise = max(0.0, float((self._square[seen] - count * mean**2).sum() / count.sum()))
        normal = 3 * float(np.hypot(self._line_px, np.sqrt(noise)))
        state = Drift(distance_px, normal)
        far = max(_FAR_PX, _FAR_LINES * self._line_px)
        square = self._square[seen].sum() / count.sum()
        if self._frames < _LEAST_FRAMES:
            return state
        if len(count) < _LEAST_BEAMS:
            return replace(state, causes=("unknown",)) if square > far**2 else state
        weight = 1 / (self._line_px**2 + noise / count)
        fits = {name: _fit(pattern[:, columns], mean, weight) for name, columns in CAUSES.items()}
        gain, values = _fit(pattern, mean, weight)
        self._alarm = gain >= (_ALARM / 2 if self._alarm else _ALARM) and (
            np.sqrt(np.mean((pattern @ values) ** 2)) >= _LEAST_SHIFT_PX)
        if not self._alarm:
            return state
        best = max(gain - len(CAUSES[name]) for name, (gain, _) in fits.items())
        causes = sorted((name for name, (gain, _) in fits.items()
                         if gain - len(CAUSES[name]) > best - _APART),
                        key=lambda name: len(CAUSES[name]) - fits[name][0])
        explained = pattern[:, CAUSES[causes[0]]] @ fits[causes[0]][1]
        if square - (count @ explained**2) / count.sum() > far**2:
            return replace(state, causes=("unknown",))
        return Drift(distance_px, normal, tuple(causes), float(fits["focus"][1][0]),
                     float(np.degrees(np.linalg.norm(fits["turned"][1]))),
                     float(np.linalg.norm(fits["base"][1])))


def _fit(pattern, distance, weight):
    """By how much a fit lessens chi-square, and its values."""
    root = np.sqrt(weight)
    values, *_ = np.linalg.lstsq(pattern * root[:, None], distance * root, rcond=1e-9)
    return float(((pattern @ values) * distance * weight).sum()), values
