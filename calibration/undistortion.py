"""Registers and radial table of the undistortion unit, from a lens model in float."""

import numpy as np

from calibration.lens import Lens
from hdl.protocol import fraction_bits
from model.errors import UserError
from model.settings import Settings
from model.stereo.undistort import ROUNDS, SEGMENTS, radius_bits, tangential_bits, undistort

__all__ = ["BORDER_PX", "GAIN_LIMIT", "build", "lens_tables", "undistortion_settings"]

#: Undistorted pixels per distorted pixel, at most: near its fold the model amplifies the rounding
#: of the centres.
GAIN_LIMIT = 4.0
#: Slope of the distorted radius by the undistorted one beyond which the table is a straight line.
_LEAST_SLOPE = 1 / (2 * GAIN_LIMIT)
#: The border of the usable region is that of a table segment, and the tangential part moves it.
BORDER_PX = 1.5
_SCALE = 1 << 16
_WORD = 1 << 18


def _radial_scale(radius, radial):
    """Undistorted over distorted radius, without the tangential part, normalised radii.

    By bisection on the branch from the centre; beyond the radius where the slope gets too small
    the curve continues along its tangent, so that the iteration cannot diverge there.
    """
    ends = radial.nodes(max(6.0, 4 * radius.max()))
    steep = np.flatnonzero(radial.slope(ends) < _LEAST_SLOPE)
    end = ends[steep[0]] if len(steep) else ends[-1]
    low, high = np.zeros_like(radius), np.full_like(radius, end)
    for _ in range(60):
        middle = (low + high) / 2
        below = radial.distorted(middle) < radius
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    slope = max(float(radial.slope(end)), _LEAST_SLOPE)
    last = float(radial.distorted(end))
    found = np.where(radius > last, end + (radius - last) / slope, low)
    return np.where(radius > 1e-9, found / np.maximum(radius, 1e-9), 1.0)


def _radial_table(lens, bits):
    """Words of :func:`model.stereo.undistort.undistort`: straight lines through two Chebyshev
    nodes of each segment, which balances their errors. The chip truncates squared radii to 18 bits:
    half an LSB is added here. Segments beyond the usable region hold the largest value, which takes
    their positions out of every window."""
    node = np.sqrt(0.5) / 2
    middle = np.arange(SEGMENTS) + 0.5
    ends = np.stack([middle - node, middle + node]) * 2.0**bits / SEGMENTS
    scale = _radial_scale(np.sqrt(ends) / lens.focal, lens.radial)
    slope = (scale[1] - scale[0]) / (2 * node)
    start = scale.mean(axis=0) - slope * (0.5 - SEGMENTS / _WORD / 2)
    slope_word = np.round(-slope * _SCALE)
    # Products with the fraction are truncated: half an LSB compensates.
    start_word = np.round((slope_word != 0) / 2 - start * _SCALE)
    if lens.usable_px is not None:
        beyond = np.arange(SEGMENTS) * 2.0**bits / SEGMENTS >= lens.usable_px**2
        start_word, slope_word = np.where(beyond, -_WORD, start_word), slope_word * ~beyond
    words = np.stack([start_word, slope_word], axis=-1)
    words = np.clip(words, -_WORD // 2, _WORD // 2 - 1).astype(int)
    return tuple(int(word) % _WORD for word in words.ravel())


def build(fx, cx, cy, k1, k2, p1, p2, width, height, rounds=ROUNDS):
    """Registers and table for a lens of the model ``brown``, see :func:`lens_tables`.

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
    """
    return lens_tables(Lens(width, height, fx, cx, cy, k1, k2, p1, p2), rounds)


def lens_tables(lens, rounds=ROUNDS):
    """Registers and table for a lens, checked against float.

    Parameters
    ----------
    lens : :class:`calibration.lens.Lens`
        Camera and sensor size.
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
        If the model folds inside the usable part of the image, its gain exceeds
        :data:`GAIN_LIMIT` there, or a value does not fit its register.
    """
    fx, cx, cy = lens.focal, lens.principal_u, lens.principal_v
    width, height = lens.width, lens.height
    if not fx > 0:
        raise ValueError(f"The focal length must be positive, not {fx:g} px.")
    scale = 2**tangential_bits(width, height)
    pixel = 1 << fraction_bits(width, height)
    tangential = [round(p / fx * scale) for p in (lens.p1, lens.p2)]
    if max(map(abs, tangential)) >= _WORD // 2:
        raise ValueError(f"The tangential distortion p1 = {lens.p1:g}, p2 = {lens.p2:g} is too "
                         f"strong for a focal length of {fx:g} px: the limit is "
                         f"{fx * 2**17 / scale:.2g}.")
    bits = radius_bits(width, height)
    if not (0 <= cx < width and 0 <= cy < height) or (
            lens.corner_px**2 >= 2**bits and bits < 35 - 2 * fraction_bits(width, height)):
        raise ValueError(f"The principal point ({cx:.1f}, {cy:.1f}) is too far from the centre of "
                         f"a {width} x {height} image.")
    settings = {
        "principal_u": round(cx * pixel), "principal_v": round(cy * pixel),
        "tangential_1": tangential[0], "tangential_2": tangential[1],
        "radial": _radial_table(lens, bits),
    }

    u, v = np.meshgrid(np.linspace(0, width - 1, 83), np.linspace(0, height - 1, 71))
    u, v = (np.round(grid.ravel() * pixel).astype(int) for grid in (u, v))
    if lens.usable_px is not None:
        usable = lens.distance_px(u / pixel, v / pixel) < lens.usable_px - BORDER_PX
        u, v = u[usable], v[usable]
    x, y = lens.undistort(u / pixel, v / pixel)
    gains = lens.gain(x, y)
    if np.isinf(gains).any():
        raise ValueError(
            f"The lens model folds inside the {width} x {height} image (k1 = {lens.k1:.4g}, k2 = "
            f"{lens.k2:.4g}, p1 = {lens.p1:.4g}, p2 = {lens.p2:.4g}), so it cannot be undone "
            "there.")
    if gains.max() > GAIN_LIMIT:
        raise ValueError(
            f"The lens model is about to fold inside the {width} x {height} image (k1 = "
            f"{lens.k1:.4g}, k2 = {lens.k2:.4g}): an error of a centre would grow "
            f"{gains.max():.1f} times, and {GAIN_LIMIT:g} times is the limit.")
    chip_x, chip_y, ok = undistort(u, v, Settings(**settings), width, height, rounds)
    error = np.hypot(chip_x / pixel - x, chip_y / pixel - y)
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
        tables = lens_tables(lens)
    except ValueError as error:
        raise UserError(f"{error} Photograph the chessboard up to the corners of the picture and "
                        "calibrate again, or use a lens that distorts less.") from error
    return {name: tables[name] for name in (
        "principal_u", "principal_v", "tangential_1", "tangential_2", "radial")}
