"""The lens: four-parameter Brown model with square pixels, fitted to chessboard photographs."""

from dataclasses import dataclass

import cv2
import numpy as np

from model.errors import UserError

__all__ = ["Lens", "LensReport", "calibrate_lens", "find_corners"]

#: Fewer boards than this do not determine five lens parameters and the principal point.
MIN_VIEWS = 5
#: A worse fit than this is not the board that was described, or not a rigid camera.
MAX_RMS_PX = 1.5


@dataclass(frozen=True)
class Lens:
    """Pinhole camera with OpenCV's k1, k2, p1, p2 (k3 = 0) and one focal length.

    *Image* coordinates are pixels of the sensor's image, distorted, (0, 0) being the centre of the
    first pixel. *Undistorted* coordinates are pixels of the same focal length without distortion,
    relative to the image centre ((width - 1) / 2, (height - 1) / 2).

    Parameters
    ----------
    width, height : :class:`int`
        Size of the image.
    focal : :class:`float`
        Focal length in pixels.
    principal_u, principal_v : :class:`float`
        Principal point, image coordinates.
    k1, k2, p1, p2 : :class:`float`
        Distortion, in OpenCV's order and signs.
    """

    width: int
    height: int
    focal: float
    principal_u: float
    principal_v: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @property
    def centre(self):
        """Image centre (column, row), the origin of undistorted coordinates."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    @property
    def principal_x(self):
        """Principal point's column in undistorted coordinates."""
        return self.principal_u - self.centre[0]

    @property
    def principal_y(self):
        """Principal point's row in undistorted coordinates."""
        return self.principal_v - self.centre[1]

    @property
    def matrix(self):
        """OpenCV's camera matrix."""
        return np.array([[self.focal, 0, self.principal_u], [0, self.focal, self.principal_v],
                         [0, 0, 1.0]])

    @property
    def coefficients(self):
        """OpenCV's distortion coefficients."""
        return np.array([self.k1, self.k2, self.p1, self.p2, 0.0])

    def _brown(self, x, y):
        """Distort normalised coordinates; gives the result and the four partial derivatives."""
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * self.k2)
        slope = self.k1 + 2 * self.k2 * r2
        u = x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x)
        v = y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y
        uu = radial + 2 * x * x * slope + 2 * self.p1 * y + 6 * self.p2 * x
        uv = 2 * x * y * slope + 2 * self.p1 * x + 2 * self.p2 * y
        vv = radial + 2 * y * y * slope + 6 * self.p1 * y + 2 * self.p2 * x
        return u, v, uu, uv, uv, vv

    def distort(self, x, y):
        """Undistorted coordinates to image coordinates."""
        x = (np.asarray(x, float) - self.principal_x) / self.focal
        y = (np.asarray(y, float) - self.principal_y) / self.focal
        u, v = self._brown(x, y)[:2]
        return u * self.focal + self.principal_u, v * self.focal + self.principal_v

    def undistort(self, u, v):
        """Image coordinates to undistorted ones, by Newton's method to 1e-9 px.

        Where the model folds before it reaches (u, v) there is no answer, and both are NaN.
        """
        u = (np.asarray(u, float) - self.principal_u) / self.focal
        v = (np.asarray(v, float) - self.principal_v) / self.focal
        # The radial part alone is inverted first, climbing from the centre, which cannot step
        # over a fold; Newton's method then settles the small tangential part.
        target = np.hypot(u, v)
        radius = target.copy()
        for _ in range(60):
            r2 = radius * radius
            slope = 1 + r2 * (3 * self.k1 + 5 * self.k2 * r2)
            value = radius * (1 + r2 * (self.k1 + r2 * self.k2))
            radius = np.clip(radius - (value - target) / np.maximum(slope, 0.05), 0, 4 * target)
        with np.errstate(invalid="ignore", divide="ignore"):
            scale = np.where(target > 0, radius / np.where(target > 0, target, 1), 1.0)
        x, y = u * scale, v * scale
        for _ in range(8):
            fu, fv, uu, uv, vu, vv = self._brown(x, y)
            determinant = uu * vv - uv * vu
            determinant = np.where(np.abs(determinant) < 1e-6, 1e-6, determinant)
            eu, ev = u - fu, v - fv
            x = x + (vv * eu - uv * ev) / determinant
            y = y + (uu * ev - vu * eu) / determinant
        fu, fv, uu, uv, vu, vv = self._brown(x, y)
        good = (np.hypot(fu - u, fv - v) * self.focal < 1e-6) & (uu * vv - uv * vu > 0)
        good &= np.hypot(x, y) <= self.fold_radius
        x = np.where(good, x * self.focal + self.principal_x, np.nan)
        y = np.where(good, y * self.focal + self.principal_y, np.nan)
        return x, y

    @property
    def fold_radius(self):
        """Normalised undistorted radius where the radial part turns back; inf if it never does."""
        roots = np.roots([5 * self.k2, 3 * self.k1, 1.0]) if self.k2 else (
            np.array([-1 / (3 * self.k1)]) if self.k1 else np.array([]))
        roots = roots[np.isreal(roots) & (roots.real > 0)].real
        return float(np.sqrt(roots.min())) if len(roots) else float("inf")

    def folds(self):
        """Whether some pixel of the image is reached by no ray, or by several."""
        u = np.linspace(-0.5, self.width - 0.5, 89)
        v = np.linspace(-0.5, self.height - 0.5, 73)
        u, v = (grid.ravel() for grid in np.meshgrid(u, v))
        x, _ = self.undistort(u, v)
        return bool(np.isnan(x).any())

    def check_one_to_one(self):
        """Raise :class:`UserError` if the model folds inside the image."""
        if self.folds():
            raise UserError(
                f"The lens model folds back inside the {self.width} x {self.height} picture "
                f"(k1 = {self.k1:.4f}, k2 = {self.k2:.4f}), so that it cannot be undone there: "
                "photograph the chessboard up to the corners of the picture.")

    def ray(self, x, y):
        """Slopes dx/dz and dy/dz of the rays through undistorted (x, y)."""
        return ((np.asarray(x, float) - self.principal_x) / self.focal,
                (np.asarray(y, float) - self.principal_y) / self.focal)


@dataclass(frozen=True)
class LensReport:
    """How well the lens fits: RMS over all corners, names of the views used and left out."""

    rms_px: float
    used: tuple = ()
    view_rms_px: tuple = ()
    without_board: tuple = ()
    outliers: tuple = ()


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
    each = []
    for points, rotation, shift in zip(corners, rotations, shifts, strict=True):
        projected, _ = cv2.projectPoints(board, rotation, shift, matrix, coefficients)
        error = projected.reshape(-1, 2) - points
        each.append(float(np.sqrt(np.mean(np.sum(error ** 2, axis=1)))))
    return float(rms), matrix, np.ravel(coefficients), each


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
    (:class:`Lens`, :class:`LensReport`)
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
    board = np.zeros((rows * columns, 3), np.float32)
    board[:, :2] = np.mgrid[:columns, :rows].T.reshape(-1, 2) * square_mm

    (rms, matrix, coefficients, each), names, outliers = min(
        (_without_outliers(board, names, list(kind), size, focal_px)
         for kind in zip(*corners, strict=True)), key=lambda solution: solution[0][0])
    lens = Lens(width=size[0], height=size[1], focal=float(matrix[0, 0]),
                principal_u=float(matrix[0, 2]), principal_v=float(matrix[1, 2]),
                k1=float(coefficients[0]), k2=float(coefficients[1]),
                p1=float(coefficients[2]), p2=float(coefficients[3]))
    if not rms <= MAX_RMS_PX:
        raise UserError(
            f"The chessboard corners fit a lens only to {rms:.2f} px RMS (at most {MAX_RMS_PX} "
            "px): check board_columns, board_rows and focal_px, and that the board is flat.")
    inside = 0 < lens.principal_u < lens.width - 1 and 0 < lens.principal_v < lens.height - 1
    if not inside or not 0.5 < lens.focal / focal_px < 2:
        raise UserError(
            f"The chessboard photographs give an impossible lens (focal length {lens.focal:.0f} px "
            f"where {focal_px:.0f} px is nominal, principal point {lens.principal_u:.0f}, "
            f"{lens.principal_v:.0f}): tilt the board more from one photograph to the next.")
    lens.check_one_to_one()
    return lens, LensReport(rms_px=rms, used=tuple(names), view_rms_px=tuple(each),
                            without_board=tuple(missing), outliers=tuple(outliers))
