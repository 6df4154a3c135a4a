"""The Brown model (OpenCV's k1, k2, p1, p2) in float64, and its inverse by Newton's method."""

import numpy as np

__all__ = ["distort", "fold_radius", "gain", "jacobian", "undistort"]


def distort(x, y, k1, k2, p1, p2):
    """Normalised undistorted coordinates to normalised distorted ones."""
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * k2)
    return (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)


def jacobian(x, y, k1, k2, p1, p2):
    """Derivatives of :func:`distort`: du/dx, du/dy (which is dv/dx), dv/dy."""
    r2 = x * x + y * y
    radial, slope = 1 + r2 * (k1 + r2 * k2), 2 * k1 + 4 * k2 * r2
    return (radial + slope * x * x + 2 * p1 * y + 6 * p2 * x,
            slope * x * y + 2 * p1 * x + 2 * p2 * y,
            radial + slope * y * y + 6 * p1 * y + 2 * p2 * x)


def gain(x, y, k1, k2, p1, p2):
    """Largest derivative of the undistorted position by the distorted one; inf past the fold."""
    a, b, c = jacobian(x, y, k1, k2, p1, p2)
    least = (a + c) / 2 - np.hypot((a - c) / 2, b)  # the Jacobian is symmetric
    return np.where(least > 0, 1 / np.where(least > 0, least, 1), np.inf)


def fold_radius(k1, k2):
    """Normalised undistorted radius where the radial part turns back; inf if it never does."""
    roots = np.roots([5 * k2, 3 * k1, 1.0])
    roots = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
    return float(np.sqrt(roots.min())) if len(roots) else np.inf


def undistort(u, v, k1, k2, p1, p2):
    """Normalised distorted coordinates to undistorted ones; NaN where the model has folded.

    The distortion is switched on in steps, the inverse following, so that it stays on the branch
    that is joined to the centre.
    """
    u, v = np.asarray(u, dtype=float), np.asarray(v, dtype=float)
    x, y = u.copy(), v.copy()
    lost = np.zeros(u.shape, dtype=bool)
    steps = 10
    for step in range(1, steps + 1):
        part = tuple(value * step / steps for value in (k1, k2, p1, p2))
        for _ in range(12 if step == steps else 4):
            a, b, c = jacobian(x, y, *part)
            determinant = a * c - b * b
            lost |= ~(determinant > 1e-4) | ~(a + c > 0)
            determinant = np.where(lost, 1, determinant)
            fu, fv = distort(x, y, *part)
            fu, fv = np.where(lost, 0, fu - u), np.where(lost, 0, fv - v)
            x, y = x - (c * fu - b * fv) / determinant, y - (a * fv - b * fu) / determinant
    fu, fv = distort(x, y, k1, k2, p1, p2)
    lost |= ~(np.hypot(fu - u, fv - v) < 1e-10) | (np.hypot(x, y) > fold_radius(k1, k2))
    return np.where(lost, np.nan, x), np.where(lost, np.nan, y)
