"""Registers and radial table of the undistortion unit, from a lens model in float."""

import numpy as np

from model.errors import UserError
from model.settings import Settings
from model.stereo.undistort import ROUNDS, SEGMENTS, TANGENTIAL_BITS, radius_bits, undistort

__all__ = ["GAIN_LIMIT", "build", "undistortion_settings"]

#: Undistorted pixels per distorted pixel, at most: near its fold the model amplifies the rounding
#: of the centres.
GAIN_LIMIT = 4.0
#: Slope of the distorted radius by the undistorted one beyond which the table is a straight line.
_LEAST_SLOPE = 1 / (2 * GAIN_LIMIT)
_SCALE = 1 << 16
_WORD = 1 << 18


def _radial_scale(radius, k1, k2):
    """Undistorted over distorted radius, without the tangential part, normalised radii.

    By bisection on the branch from the centre; beyond the radius where the slope gets too small
    the curve continues along its tangent, so that the iteration cannot diverge there.
    """
    ends = np.linspace(0, max(6.0, 4 * radius.max()), 20001)
    slopes = 1 + ends**2 * (3 * k1 + 5 * k2 * ends**2)
    steep = np.flatnonzero(slopes < _LEAST_SLOPE)
    end = ends[steep[0]] if len(steep) else ends[-1]

    def distorted(r):
        return r * (1 + r * r * (k1 + r * r * k2))

    low, high = np.zeros_like(radius), np.full_like(radius, end)
    for _ in range(60):
        middle = (low + high) / 2
        below = distorted(middle) < radius
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    slope = max(1 + end**2 * (3 * k1 + 5 * k2 * end**2), _LEAST_SLOPE)
    found = np.where(radius > distorted(end), end + (radius - distorted(end)) / slope, low)
    return np.where(radius > 1e-9, found / np.maximum(radius, 1e-9), 1.0)


def _radial_table(focal, k1, k2, bits):
    """Words of :func:`model.stereo.undistort.undistort`: straight lines through two Chebyshev
    nodes of each segment, which balances their errors. The chip truncates squared radii to 18 bits:
    half an LSB is added here."""
    node = np.sqrt(0.5) / 2
    middle = np.arange(SEGMENTS) + 0.5
    ends = np.stack([middle - node, middle + node]) * 2.0**bits / SEGMENTS
    scale = _radial_scale(np.sqrt(ends) / focal, k1, k2)
    slope = (scale[1] - scale[0]) / (2 * node)
    start = scale.mean(axis=0) - slope * (0.5 - SEGMENTS / _WORD / 2)
    slope_word = np.round(-slope * _SCALE)
    # Products with the fraction are truncated: half an LSB compensates.
    start_word = np.round((slope_word != 0) / 2 - start * _SCALE)
    words = np.stack([start_word, slope_word], axis=-1)
    words = np.clip(words, -_WORD // 2, _WORD // 2 - 1).astype(int)
    return tuple(int(word) % _WORD for word in words.ravel())


def _newton(u, v, k1, k2, p1, p2):
    """Undistorted normalised positions and their gains (inf where the model has folded)."""
    scale = _radial_scale(np.hypot(u, v), k1, k2)
    x, y = u * scale, v * scale
    for _ in range(15):
        r2 = x * x + y * y
        radial, slope = 1 + r2 * (k1 + r2 * k2), 2 * k1 + 4 * k2 * r2
        a = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        b = slope * x * y + 2 * p1 * x + 2 * p2 * y
        c = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        least = (a + c) / 2 - np.hypot((a - c) / 2, b)
        determinant = np.where(np.abs(a * c - b * b) > 1e-3, a * c - b * b, 1)
        error_u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - u
        error_v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - v
        x = x - (c * error_u - b * error_v) / determinant
        y = y - (a * error_v - b * error_u) / determinant
    folded = ~(np.hypot(error_u, error_v) < 1e-9) | ~(least > 0)
    # Beyond a fold the radial part rises again: there Newton's method finds the wrong branch.
    path = np.linspace(0, 1, 33)[:, None] * np.hypot(x, y)
    folded |= (1 + path**2 * (3 * k1 + 5 * k2 * path**2)).min(axis=0) <= 0
    return x, y, np.where(folded, np.inf, 1 / np.where(least > 0, least, 1))


def build(fx, cx, cy, k1, k2, p1, p2, width, height, rounds=ROUNDS):
    """Registers and table for a lens with square pixels, checked against float.

    Parameters
    ----------
    fx : :class:`float`
        Focal length in pixels.
    cx, cy : :class:`float`
        Principal point, image coordinates.
    k1, k2, p1, p2 : :class:`float`
        Distortion, OpenCV's names and signs.
    width, height : :class:`int`
        Sensor size in pixels.
    rounds : :class:`int`
        Rounds of the tangential iteration of the chip.

    Returns
    -------
    dict
        ``principal_u, principal_v, tangential_1, tangential_2, radial`` for
        :class:`model.settings.Settings`; ``worst_error`` of the bit-true model in px, over
        the positions that are not rejected, on a grid that includes the corners; ``worst_gain``.

    Raises
    ------
    ValueError
        If the model folds inside the image, its gain exceeds :data:`GAIN_LIMIT` there, or a value
        does not fit its register.
    """
    if not fx > 0:
        raise ValueError(f"The focal length must be positive, not {fx:g} px.")
    tangential = [round(p / fx * 2**TANGENTIAL_BITS) for p in (p1, p2)]
    if max(map(abs, tangential)) >= _WORD // 2:
        raise ValueError(f"The tangential distortion p1 = {p1:g}, p2 = {p2:g} is too strong for a "
                         f"focal length of {fx:g} px: the limit is {fx * 2**17 / 2**27:.2g}.")
    bits = radius_bits(width, height)
    reach = max(np.hypot(du, dv) for du in (cx, width - 1 - cx) for dv in (cy, height - 1 - cy))
    if not (0 <= cx < width and 0 <= cy < height) or reach**2 >= 2**bits and bits < 17:
        raise ValueError(f"The principal point ({cx:.1f}, {cy:.1f}) is too far from the centre of "
                         f"a {width} x {height} image.")
    settings = {
        "principal_u": round(cx * 512), "principal_v": round(cy * 512),
        "tangential_1": tangential[0], "tangential_2": tangential[1],
        "radial": _radial_table(fx, k1, k2, bits),
    }

    u, v = np.meshgrid(np.linspace(0, width - 1, 83), np.linspace(0, height - 1, 71))
    u, v = (np.round(grid.ravel() * 512).astype(int) for grid in (u, v))
    x, y, gains = _newton((u / 512 - cx) / fx, (v / 512 - cy) / fx, k1, k2, p1, p2)
    if np.isinf(gains).any():
        raise ValueError(
            f"The lens model folds inside the {width} x {height} image (k1 = {k1:.4g}, "
            f"k2 = {k2:.4g}, p1 = {p1:.4g}, p2 = {p2:.4g}), so it cannot be undone there.")
    if gains.max() > GAIN_LIMIT:
        raise ValueError(
            f"The lens model is about to fold inside the {width} x {height} image (k1 = {k1:.4g}, "
            f"k2 = {k2:.4g}): an error of a centre would grow {gains.max():.1f} times, and "
            f"{GAIN_LIMIT:g} times is the limit.")
    chip_x, chip_y, ok = undistort(u, v, Settings(**settings), width, height, rounds)
    error = np.hypot(chip_x / 512 - (x * fx + cx - (width - 1) / 2),
                     chip_y / 512 - (y * fx + cy - (height - 1) / 2))
    return {**settings, "worst_error": float(error[ok].max(initial=0)),
            "worst_gain": float(gains.max())}


def undistortion_settings(lens):
    """What :class:`model.settings.Settings` holds of a :class:`calibration.lens.Lens`.

    Raises
    ------
    UserError
        If the chip cannot undo this lens.
    """
    try:
        tables = build(lens.focal, lens.principal_u, lens.principal_v, lens.k1, lens.k2, lens.p1,
                       lens.p2, lens.width, lens.height)
    except ValueError as error:
        raise UserError(f"{error} Photograph the chessboard up to the corners of the picture and "
                        "calibrate again, or use a lens that distorts less.") from error
    return {name: tables[name] for name in (
        "principal_u", "principal_v", "tangential_1", "tangential_2", "radial")}
