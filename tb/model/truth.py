"""Rigs and surfaces to test the simulator with, and its truth as coordinates."""


import cv2
import numpy as np
import pytest

from model.optics.rigs import RIGS

__all__ = ["ALL", "ENDOSCOPE", "Sphere", "Union", "undistorted", "uv", "xyz"]

ENDOSCOPE = RIGS["endoscope"]
#: Repeats a test for every rig.
ALL = pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)


def xyz(truth):
    """Positions of the spots in space, mm."""
    return np.stack([truth[name] for name in ("x_mm", "y_mm", "z_mm")], axis=-1)


def uv(truth):
    """Positions of the spots in the image, px."""
    return np.stack([truth["u_px"], truth["v_px"]], axis=-1)


def undistorted(camera, image):
    """Undistorted pixels about the image centre, by OpenCV."""
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-13)
    found = cv2.undistortPoints(image[:, None], camera.matrix, camera.coefficients,
                                P=camera.matrix, criteria=criteria)
    return found[:, 0] - camera.centre_px


class Sphere:
    """A ball, for the closed form."""

    def __init__(self, centre, radius):
        self.centre, self.radius = np.array(centre, dtype=float), radius

    def clearance(self, points):
        return np.linalg.norm(points - self.centre, axis=-1) - self.radius


class Union:
    """Several surfaces at once."""

    def __init__(self, *parts):
        self.parts = parts

    def clearance(self, points):
        return np.minimum.reduce([part.clearance(points) for part in self.parts])
