"""From beams in float to the table words of the chip, with their rounding errors."""

from dataclasses import dataclass, field

import numpy as np

from calibration.files import list_names
from hdl.protocol import COORDINATE_BITS
from model.errors import UserError
from model.stereo.depth import INVERSE_Z_LIMIT, inverse_depth, pack_depth
from model.stereo.epipolar import OK, pack_line, pack_window, unpack_line

__all__ = ["Tables", "Windows", "build_tables", "choose_windows", "coordinate_reach",
           "separations", "spot_columns", "widest_tolerance", "window_columns"]

_WINDOW_BITS = 5  # a window's limit is so many bits shorter than a coordinate
_TOLERANCE_BITS = 4  # a tolerance likewise
_TOLERANCE_LIMIT = 511
INVERSE_Z_ERROR = 1e-4              #: largest relative error of 1/z that rounding may make

#: Margin of the u-windows beyond the depth range: a factor of the distance, then pixels.
DEPTH_MARGIN = 1.10
WINDOW_MARGIN_PX = 1.0
#: A spot outside the depth range must not become a neighbour's point: spots are expected from the
#: nearest distance over this factor up to infinity.
NEAR_GUARD = 1.5
#: Lines must be this far apart where a neighbour's spot can be within a beam's window, in pixels
#: and in standard deviations of a spot's distance from its line.
SEPARATION_PX = 1.0
SEPARATION_SIGMAS = 8.0
#: A spot farther than this from a line is not its own, however far the next line is.
TOLERANCE_PX = 1.5
TOLERANCE_SIGMAS = 8.0


def coordinate_reach(fraction):
    """How far from the image centre an undistorted coordinate of the chip can lie, px."""
    return (1 << COORDINATE_BITS - 1 - fraction) - 0.1


def widest_tolerance(fraction):
    """The largest tolerance that a table can hold, px."""
    return _TOLERANCE_LIMIT / (1 << fraction - _TOLERANCE_BITS)


def separations(a, b, low, high, others_low=None, others_high=None):
    """Vertical distance between every two lines over the columns that both windows share, px.

    Parameters
    ----------
    a, b : arrays of :class:`float`
        Lines v = a u + b.
    low, high : arrays of :class:`float`
        Windows.
    others_low, others_high : arrays of :class:`float` or None
        Windows of the second line of each pair, if others.

    Returns
    -------
    array (beams, beams)
        inf where the windows share nothing, and on the diagonal.
    """
    first = np.maximum.outer(low, low if others_low is None else others_low)
    last = np.minimum.outer(high, high if others_high is None else others_high)
    slope, offset = np.subtract.outer(a, a), np.subtract.outer(b, b)
    one, other = slope * first + offset, slope * last + offset
    distance = np.where(one * other <= 0, 0.0, np.minimum(np.abs(one), np.abs(other)))
    distance[first > last] = np.inf
    np.fill_diagonal(distance, np.inf)
    return distance


def window_columns(alpha, beta, z_min, z_max):
    """First and last column of each beam over a depth range in mm, with margin, px.

    ``alpha`` and ``beta`` are arrays of the depth laws 1/z = alpha u + beta.
    """
    near, far = ((1 / z - beta) / alpha for z in (z_min / DEPTH_MARGIN, z_max * DEPTH_MARGIN))
    return np.minimum(near, far) - WINDOW_MARGIN_PX, np.maximum(near, far) + WINDOW_MARGIN_PX


def spot_columns(alpha, beta, z_min):
    """First and last column where a spot of each beam can be, also outside the depth range, px."""
    near, far = (NEAR_GUARD / z_min - beta) / alpha, -beta / alpha
    return np.minimum(near, far), np.maximum(near, far)


@dataclass(frozen=True)
class Windows:
    """Per beam u-window and tolerance in px, and what they were derived from.

    Parameters
    ----------
    low, high : arrays of :class:`float`
        Undistorted columns of the beam over the depth range, with margin.
    tolerance : array of :class:`float`
        Largest vertical distance of a spot from its line.
    separation : array of :class:`float`
        Vertical distance to the nearest line whose spots can be within this beam's window, also
        from outside the depth range; inf if there is none.
    neighbour : array of :class:`int`
        The number of that line's beam, -1 if there is none.
    smallest_px, smallest_whole_px : :class:`float`
        Smallest separation of all, and as if there were no u-windows.
    z_min, z_max : :class:`float`
        The depth range without margin.
    fraction : :class:`int`
        Fraction bits of a coordinate of the chip.
    """

    low: np.ndarray
    high: np.ndarray
    tolerance: np.ndarray
    separation: np.ndarray
    neighbour: np.ndarray
    smallest_px: float
    smallest_whole_px: float
    z_min: float
    z_max: float
    fraction: int


def _named(beams, columns, limit=8):
    """Numbers of beams with their rows and columns, in words."""
    return list_names([f"{beam} (row {beam // columns}, column {beam % columns})"
                       for beam in beams], limit)


def choose_windows(lines, columns, z_min, z_max, fraction=9, reach=None):
    """u-windows from the depth range, tolerances from the distances between lines and the noise.

    Parameters
    ----------
    lines : :class:`calibration.lines.BeamLines`
        Beams in float.
    columns : :class:`int`
        Columns of the mesh, to name beams.
    z_min, z_max : :class:`float`
        Depth range in mm.
    fraction : :class:`int`
        Fraction bits of a coordinate of the chip.
    reach : (:class:`float`, :class:`float`) or None
        First and last undistorted column where the lens model is valid; None for all of the chip.

    Returns
    -------
    :class:`Windows`
    """
    low, high = window_columns(lines.alpha, lines.beta, z_min, z_max)
    most = coordinate_reach(fraction)
    reach = (-most, most) if reach is None else reach
    low, high = np.maximum(low, reach[0]), np.minimum(high, reach[1])
    outside = np.flatnonzero(low >= high)
    if len(outside):
        raise UserError(
            f"Beams {_named(lines.numbers[outside], columns)} never come within {most:.0f} px of "
            "the image centre where the lens model is valid: turn the projector, or take it for "
            "another depth range.")
    distance = separations(lines.a, lines.b, low, high,
                           *spot_columns(lines.alpha, lines.beta, z_min))
    separation, neighbour = distance.min(axis=1), distance.argmin(axis=1)
    limit = max(SEPARATION_PX, SEPARATION_SIGMAS * lines.sigma_v)
    close = np.flatnonzero(separation < limit)
    if len(close):
        pairs = sorted({tuple(sorted((int(beam), int(neighbour[beam])))) for beam in close})
        number = lines.numbers
        words = ", ".join(f"{number[one]} and {number[other]} ({distance[one, other]:.2f} px)"
                          for one, other in pairs[:8])
        more = f" and {len(pairs) - 8} more pairs" if len(pairs) > 8 else ""
        raise UserError(
            f"The pattern is ambiguous: the epipolar lines of beams {words}{more} are closer than "
            f"{limit:.2f} px where spots of both can be: turn the mesh against the base, use fewer "
            "beams, or narrow the depth range (--depth-min, --depth-max).")
    whole = separations(lines.a, lines.b, np.full(len(low), low.min()),
                        np.full(len(low), high.max()))
    cap = max(TOLERANCE_PX, TOLERANCE_SIGMAS * lines.sigma_v)
    tolerance = np.minimum(np.minimum(separation / 2, cap), widest_tolerance(fraction))
    return Windows(low=low, high=high, tolerance=tolerance, separation=separation,
                   neighbour=np.where(np.isinf(separation), -1, lines.numbers[neighbour]),
                   smallest_px=float(separation.min()),
                   smallest_whole_px=float(whole.min()), z_min=float(z_min), z_max=float(z_max),
                   fraction=fraction)


@dataclass(frozen=True)
class Tables:
    """Memory contents of the stereo unit, the unit of 1/z, and the rounding errors.

    Parameters
    ----------
    line, window, depth : tuples of :class:`int`
        Words as in :class:`model.settings.Settings`.
    inverse_z_unit : :class:`float`
        1/mm of one LSB of the inverse depth.
    line_px : :class:`float`
        Largest difference between the chip's estimate and the line in float, over the windows.
    depth_relative : :class:`float`
        Largest relative difference of the chip's 1/z from float for the same quantised u.
    """

    line: tuple = field(repr=False)
    window: tuple = field(repr=False)
    depth: tuple = field(repr=False)
    inverse_z_unit: float
    line_px: float
    depth_relative: float


def build_tables(lines, windows, columns, beams):
    """Quantise lines, windows and depth laws, and measure the rounding errors.

    Every second parameter of a pair is chosen after the first has been rounded, so that the error
    is smallest over the beam's own window. A beam without a line gets words of zero: a tolerance of
    zero, so that no spot ever matches it. Raises :class:`UserError` for beams that do not fit the
    formats.

    Parameters
    ----------
    lines : :class:`calibration.lines.BeamLines`
        Beams in float.
    windows : :class:`Windows`
        Their windows and tolerances.
    columns, beams : :class:`int`
        Columns of the mesh, to name beams, and the number of all its beams.

    Returns
    -------
    :class:`Tables`
    """
    low, high = windows.low, windows.high
    pixel = 1 << windows.fraction
    window_pixel, tolerance_pixel = pixel >> _WINDOW_BITS, pixel >> _TOLERANCE_BITS
    slope = np.rint(lines.a * (1 << 17)).astype(np.int64)
    middle = (low + high) / 2
    offset = np.rint((lines.a * middle + lines.b) * pixel
                     - slope * middle * pixel / (1 << 17)).astype(np.int64)
    steep = np.flatnonzero((np.abs(slope) >= 1 << 17) | (np.abs(offset) >= 1 << 17))
    if len(steep):
        raise UserError(
            f"The epipolar lines of beams {_named(lines.numbers[steep], columns)} are too steep, "
            "or meet the middle column "
            f"more than {(1 << 17) // pixel} px from the image centre: the "
            "projector must stand beside the camera along the rows of the sensor.")
    u_min = np.clip(np.floor(low * window_pixel), -4096, 4095).astype(np.int64)
    u_max = np.clip(np.ceil(high * window_pixel), -4096, 4095).astype(np.int64)
    tolerance = np.floor(windows.tolerance * tolerance_pixel)
    tolerance = np.clip(tolerance, 1, _TOLERANCE_LIMIT).astype(np.int64)

    # The last column of a window is a whole LSB of the window wide.
    first = u_min * (pixel // window_pixel)
    last = np.minimum((u_max + 1) * (pixel // window_pixel) - 1, (1 << 17) - 1)
    ends = np.stack([first, last]) / pixel
    inverse_z = lines.alpha * ends + lines.beta
    unreal = np.flatnonzero((inverse_z <= 0).any(axis=0))
    if len(unreal):
        raise UserError(
            f"The windows of beams {_named(lines.numbers[unreal], columns)} reach beyond infinite "
            "distance: narrow the depth range (--depth-max).")
    # Rounding alpha moves 1/z by up to 64 LSB at the end of the widest window.
    unit = max(inverse_z.max() / (INVERSE_Z_LIMIT - 66),
               np.abs(lines.alpha).max() / pixel / (((1 << 17) - 1) / 4096)) * (1 + 1e-9)
    alpha = np.rint(lines.alpha / pixel / unit * 4096).astype(np.int64)
    # The rounding of alpha turns the law about one column: where both ends of the window then
    # suffer the same relative error.
    pivot = (ends[0] * inverse_z[1] + ends[1] * inverse_z[0]) / inverse_z.sum(axis=0)
    beta = np.rint((lines.alpha * pivot + lines.beta) / unit * 4096
                   - alpha * pivot * pixel).astype(np.int64)

    depth = pack_depth(alpha, beta)
    line = pack_line(slope, offset)
    line_px = depth_relative = 0.0
    stored, constant = unpack_line(line)
    for beam in range(len(slope)):
        x = np.unique(np.linspace(first[beam], last[beam], 201).astype(np.int64))
        estimate = ((stored[beam] * x + (1 << 16)) >> 17) + constant[beam]
        exact = lines.a[beam] * x / pixel + lines.b[beam]
        line_px = max(line_px, float(np.abs(estimate / pixel - exact).max()))
        _, _, value = inverse_depth(x, np.full(len(x), beam), np.full(len(x), OK), depth)
        exact = lines.alpha[beam] * x / pixel + lines.beta[beam]
        depth_relative = max(depth_relative, float(np.abs(value * unit / exact - 1).max()))
    if depth_relative > INVERSE_Z_ERROR:
        raise UserError(
            f"The depth range is too wide for 18 bits of 1/z (relative error {depth_relative:.1e}, "
            f"at most {INVERSE_Z_ERROR:.0e}): narrow it (--depth-min, --depth-max).")

    def words(values):
        whole = np.zeros((beams, len(values) // len(lines.numbers)), np.int64)
        whole[lines.numbers] = np.reshape(values, (-1, whole.shape[1]))
        return tuple(int(value) for value in whole.ravel())

    return Tables(line=words(line), window=words(pack_window(tolerance, u_min, u_max)),
                  depth=words(depth), inverse_z_unit=float(unit), line_px=line_px,
                  depth_relative=depth_relative)
