"""Spots of single images, without a calibration: rows of ``spots.csv``."""

import csv

import cv2
import numpy as np

from calibration.reciprocal import reciprocal_table
from calibration.spots import image_spots
from model.preprocessing.area import LARGEST_AREA, area_code, coded_area
from model.preprocessing.front_chain import learn_noise, lit_pixels
from model.settings import Settings

__all__ = [
    "HEADER", "SPOT", "STATUS", "count_too_large", "is_too_small", "spot_settings", "spots_of",
    "write_spots"]

HEADER = ("file", "u_px", "v_px", "area_px", "weight", "peak", "saturated", "status", "border")
STATUS = ("ok", "rejected")
#: A spot: centre in pixels, pixels, sum of their weights, brightest grey value, whether a pixel is
#: saturated, the status's number in :data:`STATUS`, and whether it touches the border.
SPOT = np.dtype([("u", np.float64), ("v", np.float64), ("area", np.int64), ("weight", np.int64),
                 ("peak", np.uint8), ("saturated", np.bool_), ("status", np.uint8),
                 ("border", np.bool_)])


def spot_settings():
    """Settings of a chip that reports every spot, rejected ones too."""
    return Settings(reciprocal=tuple(reciprocal_table()), report_rejected=True)


def is_too_small(image):
    """Whether an image is smaller than the window of the local mean: no spot can be found."""
    return min(image.shape) < spot_settings().mean_window


def _sums(labels, count, weights):
    """Area as it is reported, weight, and weight times column and row, of each component."""
    height, width = labels.shape
    flat = labels.ravel()
    row, column = np.divmod(np.arange(height * width), width)
    weights = weights.ravel()
    return np.stack([coded_area(area_code(np.bincount(flat, minlength=count)))] + [
        np.rint(np.bincount(flat, weights * factor, count)).astype(np.int64)
        for factor in (1, column, row)], axis=-1)


def spots_of(image):
    """Spots of an image as the chip of the preset ``capsule`` finds them.

    The noise is learnt on the image itself, as if it came twice.

    Parameters
    ----------
    image : 2-D ``uint8`` array
        Grey values, of any size.

    Returns
    -------
    array of :data:`SPOT`
        In the order in which the chip reports them; none if the image :func:`is_too_small`.
    """
    if is_too_small(image):
        return np.zeros(0, SPOT)
    settings = spot_settings()
    found, u, v, _ = image_spots(image, settings)
    spots = np.zeros(len(found), SPOT)
    spots["u"], spots["v"] = u, v
    for name in ("area", "weight", "saturated", "border"):
        spots[name] = found[name]
    spots["status"] = found["rejected"]
    # Which pixels they are: the components that have the same sums.
    lit, _, excess, _ = lit_pixels(image, learn_noise(image, settings), settings)
    weights = np.where(lit, excess.astype(np.int64) + 1, 0)
    count, labels = cv2.connectedComponents(lit.astype(np.uint8), connectivity=8)
    brightest = np.zeros(count, np.uint8)
    np.maximum.at(brightest, labels.ravel(), image.ravel())
    by_sums = {tuple(sums): peak for sums, peak in zip(
        _sums(labels, count, weights)[1:].tolist(), brightest[1:].tolist(), strict=True)}
    spots["peak"] = [by_sums[key] for key in zip(
        *(found[name].tolist() for name in ("area", "weight", "sum_u", "sum_v")), strict=True)]
    return spots


def count_too_large(image):
    """How many components of an image have a core, and more pixels than any spot may have.

    They have no centre, and so no row; the chip counts them as rejected.
    """
    if is_too_small(image):
        return 0
    settings = spot_settings()
    lit, core, _, _ = lit_pixels(image, learn_noise(image, settings), settings)
    count, labels = cv2.connectedComponents(lit.astype(np.uint8), connectivity=8)
    large = np.bincount(labels.ravel(), minlength=count) > LARGEST_AREA
    return int(np.count_nonzero(large[np.unique(labels[core])]))


def write_spots(path, rows):
    """Write ``spots.csv``.

    Parameters
    ----------
    path : path
        File to write.
    rows : iterable of (:class:`str`, array of :data:`SPOT`)
        Name of each image, and its spots.
    """
    with open(path, "w", newline="", encoding="utf-8", errors="surrogateescape") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(HEADER)
        for name, spots in rows:
            for spot in spots:
                table.writerow([
                    name, f"{spot['u']:.4f}", f"{spot['v']:.4f}", spot["area"], spot["weight"],
                    spot["peak"], int(spot["saturated"]), STATUS[spot["status"]],
                    int(spot["border"])])
