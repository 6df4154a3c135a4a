"""Pictures of images with their spots, and a sheet of many."""

import cv2
import numpy as np

from scripts.results.overlay import SCALE, SHIFT, SPOT_COLOURS, enlarged, ring_radius
from scripts.results.points import STATUS

__all__ = ["MOST_ON_SHEET", "draw_sheet", "draw_spots"]

#: Pictures on a sheet at the most, and the width of each in pixels.
MOST_ON_SHEET, _CELL = 100, 360
_OK, _REJECTED, _SATURATED = (
    SPOT_COLOURS[STATUS.index(name)] for name in ("ok", "rejected", "ambiguous"))
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_spots(image, spots):
    """The image, three times as large, with a ring around each spot.

    Rings are green, orange where pixels are saturated, and red for rejected spots.

    Parameters
    ----------
    image : 2-D ``uint8`` array
        Grey values.
    spots : array of :data:`scripts.results.spot_rows.SPOT`
        Its spots.

    Returns
    -------
    3-D ``uint8`` array
        Blue, green, red.
    """
    large = cv2.resize(image, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_NEAREST)
    picture = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
    for spot in spots:
        radius = round(ring_radius(spot) * (1 << SHIFT))
        colour = _REJECTED if spot["status"] else _SATURATED if spot["saturated"] else _OK
        cv2.circle(picture, enlarged((spot["u"], spot["v"])), radius, colour, 1, cv2.LINE_AA, SHIFT)
    return picture


def _cell(name, picture):
    """A picture of the width of a cell, with its name below it."""
    height, width = picture.shape[:2]
    scale = min(_CELL / width, _CELL / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    cell = np.zeros((_CELL + 24, _CELL + 8, 3), np.uint8)
    cell[:size[1], :size[0]] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    printable = name.encode("ascii", "replace").decode()
    cv2.putText(cell, printable[-44:], (2, _CELL + 16), _FONT, 0.42, (235, 235, 235), 1,
                cv2.LINE_AA)
    return cell


def draw_sheet(pictures):
    """Many pictures on one, row by row.

    Parameters
    ----------
    pictures : list of (:class:`str`, 3-D ``uint8`` array)
        Names and pictures, one at least.
    """
    columns = int(np.ceil(np.sqrt(len(pictures))))
    cells = [_cell(name, picture) for name, picture in pictures]
    cells += [np.zeros_like(cells[0])] * (-len(cells) % columns)
    return np.concatenate([
        np.concatenate(cells[start:start + columns], axis=1)
        for start in range(0, len(cells), columns)])
