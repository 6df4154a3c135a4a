"""The lens from photographs of a chessboard."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.lens import Lens
from calibration.lens_fit import BROWN, EQUIDISTANT, fit_boards
from calibration.lens_region import bounded
from calibration.two_cameras import other_camera
from model.errors import UserError

__all__ = ["LensReport", "calibrate_lens", "find_corners", "fit_lens"]

#: Fewer boards than this do not determine five lens parameters and the principal point.
MIN_VIEWS = 5
#: A worse fit than this is not the board that was described, or not a rigid camera.
MAX_RMS_PX = 1.5
#: The equidistant model is used where it leaves this much less than Brown's.
_BETTER = 0.92
#: Relative standard deviation of the focal length from which on the lens is flagged, and refused.
FLAGGED_FOCAL, REFUSED_FOCAL = 0.02, 0.15
#: Standard deviation of the principal point from which on the lens is flagged, px.
FLAGGED_PRINCIPAL_PX = 3.0
#: Then a nominal focal length that is known so well is used too.
_NOMINAL_SIGMA = 0.05
#: So many photographs that do not fit the others are more than a blurred one.
_MANY_OUTLIERS = 2
_TILT = ("photograph the board tilted by 20 to 40 degrees, to the left, to the right, up and down, "
         "as large as the picture")


@dataclass(frozen=True)
class LensReport:
    """How well the lens fits: RMS over all corners, names of the views used and left out.

    Parameters
    ----------
    rms_px : :class:`float`
        RMS distance of the corners from where the lens puts them.
    used, view_rms_px : tuples
        Names of the photographs used, and the RMS distance of each.
    without_board, outliers : tuples of :class:`str`
        Photographs that show no complete board, and that fit much worse than the others.
    focal_sigma : :class:`float`
        Standard deviation of the focal length by the photographs, a share of it.
    scale_sigma : :class:`float`
        The same with the nominal focal length, where that was used.
    principal_sigma_px : :class:`float`
        That of the principal point, px.
    flags : tuple of :class:`str`
        What is doubtful, in sentences.
    """

    rms_px: float
    used: tuple = ()
    view_rms_px: tuple = ()
    without_board: tuple = ()
    outliers: tuple = ()
    focal_sigma: float = 0.0
    scale_sigma: float = 0.0
    principal_sigma_px: float = 0.0
    flags: tuple = ()


def find_corners(image, columns, rows):
    """Inner corners of a chessboard, or None.

    The sector-based detector finds more boards; the classical one is tried where it finds none.
    Subpixel positions come from the gradient: on sharp images their error is 0.05 px, against 0.1
    to 0.25 px of the sector-based detector. On blurred images it may be the other way round.

    Returns
    -------
    two float32 arrays (columns * rows, 2), or None
        Image coordinates, refined by the gradient and as detected.
    """
    size = (columns, rows)
    found, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        found, corners = cv2.findChessboardCorners(
            image, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return None
    corners = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    points = corners.reshape(rows, columns, 2)
    steps = [np.linalg.norm(np.diff(points, axis=axis), axis=2).min() for axis in (0, 1)]
    half = int(np.clip(min(steps) * 0.35, 2, 9))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    refined = cv2.cornerSubPix(image, corners.copy(), (half, half), (-1, -1), criteria)
    return refined.reshape(-1, 2), corners.reshape(-1, 2)


def _solve(board, corners, size, focal):
    matrix = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_K3
    # Several threads add up in the order in which they finish: the last bits would be random.
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        rms, matrix, coefficients, rotations, shifts = cv2.calibrateCamera(
            [board] * len(corners), corners, size, matrix, np.zeros(5), flags=flags)
    except cv2.error as error:
        raise UserError(
            "The lens cannot be solved from these chessboard photographs: check board_columns, "
            "board_rows and focal_px in capture.toml.") from error
    finally:
        cv2.setNumThreads(threads)
    coefficients = np.ravel(coefficients)
    lens = Lens(*size, float(matrix[0, 0]), float(matrix[0, 2]), float(matrix[1, 2]),
                *(float(value) for value in coefficients[:4]))
    poses = np.concatenate([np.reshape(rotations, (-1, 3)), np.reshape(shifts, (-1, 3))], axis=1)
    each = []
    for points, rotation, shift in zip(corners, rotations, shifts, strict=True):
        projected, _ = cv2.projectPoints(board, rotation, shift, matrix, coefficients)
        error = projected.reshape(-1, 2) - points
        each.append(float(np.sqrt(np.mean(np.sum(error ** 2, axis=1)))))
    return float(rms), lens, poses, each


def _without_outliers(board, names, corners, size, focal):
    """Solve, leaving out views much worse than the others; solution, names kept and left out."""
    names, outliers = list(names), []
    while True:
        solution = _solve(board, corners, size, focal)
        each = solution[3]
        worst = int(np.argmax(each))
        if len(corners) <= MIN_VIEWS or each[worst] < max(4 * np.median(each), 0.3):
            return solution, names, outliers
        outliers.append(names.pop(worst))
        corners.pop(worst)


def calibrate_lens(views, columns, rows, square_mm, focal_px, progress=None):
    """Lens and report from chessboard photographs.

    Views without a complete board are left out and named, and so are views that fit several times
    worse than the others. Fewer than five good ones, or a poor fit, are refused.
    The same views give the same lens to the last bit.

    Parameters
    ----------
    views : iterable of (:class:`str`, 2-D ``uint8`` array)
        Names and images, all of one size.
    columns, rows : :class:`int`
        Inner corners of the board.
    square_mm : :class:`float`
        Side of a square.
    focal_px : :class:`float`
        Nominal focal length, where the search starts.
    progress : callable or None
        Called with each view's name.

    Returns
    -------
    (:class:`calibration.lens.Lens`, :class:`LensReport`)
    """
    names, corners, missing, size = [], [], [], None
    for name, image in views:
        if progress:
            progress(name)
        size = image.shape[::-1] if size is None else size
        found = find_corners(image, columns, rows)
        if found is None:
            missing.append(name)
        else:
            names.append(name)
            corners.append(found)
    if len(corners) < MIN_VIEWS:
        lost = f" (not in {', '.join(missing)})" if missing else ""
        raise UserError(
            f"The {columns} x {rows} inner corners of the chessboard were found in "
            f"{len(corners)} photograph{'s' * (len(corners) != 1)}{lost}, at least {MIN_VIEWS} are "
            "needed: take more, with the whole board in the picture, or correct board_columns and "
            "board_rows.")
    return fit_lens(names, corners, size, (columns, rows, square_mm), focal_px, tuple(missing))


def _best_fit(board, corners, lens, poses):
    """Brown's model, or the equidistant one if that is much better."""
    brown = fit_boards(board, corners, BROWN, lens, poses)
    # Near the axis, atan r = r - r^3 / 3.
    start = replace(lens, k1=lens.k1 + 1 / 3, k2=0.0, p1=0.0, p2=0.0, model="equidistant")
    other = fit_boards(board, corners, EQUIDISTANT, start, poses)
    better = np.isfinite(other.rms_px) and other.rms_px < _BETTER * brown.rms_px
    return other if better and other.lens.focal > 0 else brown


def _check(fit, focal_px):
    """Refuse a fit that is no lens, or that the photographs do not determine."""
    lens = fit.lens
    if not fit.rms_px <= MAX_RMS_PX:
        raise UserError(
            f"The chessboard corners fit a lens only to {fit.rms_px:.2f} px RMS (at most "
            f"{MAX_RMS_PX} px): check board_columns, board_rows and focal_px, and that the board "
            "is flat.")
    if not fit.focal_sigma < REFUSED_FOCAL:
        raise UserError(
            f"The chessboard photographs do not determine the lens (focal length {lens.focal:.0f} "
            f"px +-{fit.focal_sigma:.0%}, at most {REFUSED_FOCAL:.0%}): the boards are too nearly "
            f"square to the axis, or too small; {_TILT}.")
    inside = 0 < lens.principal_u < lens.width - 1 and 0 < lens.principal_v < lens.height - 1
    if not inside or not 0.5 < lens.focal / focal_px < 2:
        raise UserError(
            f"The chessboard photographs give an impossible lens (focal length {lens.focal:.0f} px "
            f"where {focal_px:.0f} px is nominal, principal point {lens.principal_u:.0f}, "
            f"{lens.principal_v:.0f}): correct focal_px, or tilt the board more from one "
            "photograph to the next.")


def _flags(fit, outliers):
    """What is doubtful about a fit, in sentences."""
    flags = []
    if len(outliers) >= _MANY_OUTLIERS:
        flags.append(f"The photographs {', '.join(outliers)} do not fit the lens of the others and "
                     "were left out: were they taken by another camera, or at another focus?")
    if fit.focal_sigma > FLAGGED_FOCAL:
        flags.append("The photographs hardly determine the focal length "
                     f"(+-{fit.focal_sigma:.1%}; good is below {FLAGGED_FOCAL:.0%}), so focal_px "
                     f"was used too: {_TILT}.")
    if fit.principal_sigma_px > FLAGGED_PRINCIPAL_PX:
        flags.append("The photographs hardly determine the principal point "
                     f"(+-{fit.principal_sigma_px:.1f} px; good is below "
                     f"{FLAGGED_PRINCIPAL_PX:g} px): {_TILT}.")
    return tuple(flags)


def fit_lens(names, corners, size, board, focal_px, missing=()):
    """Lens and report from the corners of chessboards.

    Parameters
    ----------
    names : sequence of :class:`str`
        Names of the photographs.
    corners : sequence of pairs of float32 arrays (columns * rows, 2)
        What :func:`find_corners` gives for each.
    size : (:class:`int`, :class:`int`)
        Columns and rows of the sensor.
    board : (:class:`int`, :class:`int`, :class:`float`)
        Inner corners of the board, columns and rows, and the side of a square in mm.
    focal_px : :class:`float`
        Nominal focal length, where the search starts.
    missing : tuple of :class:`str`
        Names of photographs without a board, for the report.

    Returns
    -------
    (:class:`calibration.lens.Lens`, :class:`LensReport`)
    """
    columns, rows, square_mm = board
    board = np.zeros((rows * columns, 3), np.float32)
    board[:, :2] = np.mgrid[:columns, :rows].T.reshape(-1, 2) * square_mm
    best = None
    for kind in zip(*corners, strict=True):
        views = list(kind)
        (_, lens, poses, _), kept, outliers = _without_outliers(
            board, names, views, size, focal_px)
        fit = _best_fit(board, views, lens, poses)
        if best is None or fit.rms_px < best[0].rms_px:
            best = fit, views, kept, outliers
    fit, views, kept, outliers = best
    other_camera(board, views, kept, fit)
    _check(fit, focal_px)
    focal_sigma, flags = fit.focal_sigma, _flags(fit, outliers)
    if focal_sigma > FLAGGED_FOCAL:
        spread = fit.rms_px / np.sqrt(2)
        fit = fit_boards(board, views, fit.names, fit.lens, fit.poses,
                         (focal_px, _NOMINAL_SIGMA * focal_px, spread))
        _check(fit, focal_px)
    lens = bounded(fit, np.concatenate(views))
    return lens, LensReport(
        rms_px=fit.rms_px, used=tuple(kept), view_rms_px=tuple(fit.view_rms_px.tolist()),
        without_board=tuple(missing), outliers=tuple(outliers),
        focal_sigma=focal_sigma, scale_sigma=fit.focal_sigma,
        principal_sigma_px=fit.principal_sigma_px, flags=flags)
