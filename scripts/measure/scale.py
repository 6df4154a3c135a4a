"""What an error of the calibration as a whole does to lengths."""

__all__ = ["scale_variance"]


def scale_variance(calibration, place, direction):
    """Variance of a short length over its square, by the lens and the distances of the planes.

    Parameters
    ----------
    calibration : :class:`calibration.file.Calibration`
        Its budget has how well the focal length, and the planes' constant error, are known.
    place : array (3,)
        Where the length is, mm.
    direction : array (3,)
        Its unit vector.
    """
    budget = calibration.budget
    across = 1 - float(direction[2])**2
    lens = budget.get("focal_sigma_relative", 0.0) * across
    planes = budget.get("plane_offset_sigma_mm", 0.0) / float(place[2])
    return lens**2 + planes**2
