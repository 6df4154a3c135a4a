"""What the display shows of a frame and its spots."""

import numpy as np

__all__ = ["COLUMNS", "ROWS", "DIAMONDS", "display", "draw_diamond", "reach_of", "scale_and_origin"]

#: Size of the display.
COLUMNS, ROWS = 640, 480
#: Spots of a frame that are drawn.
DIAMONDS = 128
_GREEN, _RED = (0, 255, 0), (255, 0, 0)


def scale_and_origin(width, height):
    """Scale of the picture, and the display's column and row of its first pixel."""
    scale = min(COLUMNS // width, ROWS // height)
    return scale, (COLUMNS - width * scale) // 2, (ROWS - height * scale) // 2


def reach_of(width):
    """From the middle of a diamond to its corners, in pixels of the frame."""
    return 3 if width <= 128 else 5


def draw_diamond(picture, u, v, ok, reach):
    """Draw a diamond: the pixels of ``picture`` whose rows and columns are ``reach`` away, added.

    Parameters
    ----------
    picture : array (height, width, 3) of uint8
        Changed in place.
    u, v : :class:`int`
        The spot's centre, unsigned Q9.9.
    """
    height, width, _ = picture.shape
    column, row = (u + 256) // 512, (v + 256) // 512
    columns, rows = np.arange(width), np.arange(height)[:, None]
    picture[abs(columns - column) + abs(rows - row) == reach] = _GREEN if ok else _RED


def display(frame, spots=(), reach=None, colour_bits=8):
    """All pixels of the display.

    Parameters
    ----------
    frame : array (height, width) of uint8, or None
        What is shown; None for nothing yet.
    spots : sequence of (u, v, ok)
        Centres of its spots, unsigned Q9.9, in the order in which they came.
    reach : :class:`int`, optional
        By default that of :func:`reach_of`.
    colour_bits : :class:`int`
        Bits of each colour.

    Returns
    -------
    array (480, 640, 3) of uint8
    """
    whole = np.zeros((ROWS, COLUMNS, 3), np.uint8)
    if frame is not None:
        height, width = frame.shape
        picture = np.repeat(frame[:, :, None], 3, axis=2)
        for u, v, ok in spots[:DIAMONDS]:
            draw_diamond(picture, int(u), int(v), ok, reach_of(width) if reach is None else reach)
        scale, left, top = scale_and_origin(width, height)
        picture = picture.repeat(scale, axis=0).repeat(scale, axis=1)
        whole[top:top + height * scale, left:left + width * scale] = picture
    return whole >> (8 - colour_bits)
