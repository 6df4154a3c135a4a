"""What a parallel camera port's pins amount to: pixels, and markers where synchronism was lost."""

import numpy as np

__all__ = ["BAD_SYNC", "BROKEN", "FRAME_END", "LINE_END", "OVERRUN", "camera"]

#: Bits of a marker.
LINE_END, FRAME_END, BROKEN = 1, 2, 4
#: Grey values of a broken beat: why the frame was broken off.
BAD_SYNC, OVERRUN = 1, 2


def _frame(line_valid, data, width, height):
    """Grey values of the pixels taken, whether they make a whole frame, whether it is broken."""
    line_falls = np.flatnonzero(line_valid[:-1] & ~line_valid[1:]) + 1
    pixels_before = np.concatenate([[0], np.cumsum(line_valid)])
    torn = line_falls[pixels_before[line_falls] % width != 0]
    end = int(torn[0]) if torn.size else len(data)
    grey = data[:end][line_valid[:end]][:width * height]
    good = len(grey) == width * height
    too_many = good and pixels_before[len(data)] > width * height
    return grey, good, not good or too_many


def camera(frame_valid, line_valid, data, width, height):
    """Beats that the pins make, a sample per pixel clock, if the reader keeps up.

    A frame begins where ``frame_valid`` rises; what comes before the first rise is left out. Its
    pixels are those with ``line_valid``, up to the last of ``width * height``, to where
    ``line_valid`` falls within a line, or to the end of ``frame_valid``. A broken beat follows
    where that were too few pixels, and where more follow.

    Parameters
    ----------
    frame_valid, line_valid : boolean array
        Pins.
    data : array of uint8
        Pins.
    width, height : :class:`int`
        Frame size.

    Returns
    -------
    tuple of two arrays
        Grey values and markers.
    """
    frame_valid = np.asarray(frame_valid, bool)
    line_valid = np.asarray(line_valid, bool)
    data = np.asarray(data, np.uint8)
    rises = np.flatnonzero(~frame_valid[:-1] & frame_valid[1:]) + 1
    greys, markers = [np.zeros(0, np.uint8)], [np.zeros(0, np.uint8)]
    for begin in rises:
        falls = np.flatnonzero(~frame_valid[begin:])
        if not falls.size:
            break
        inside = slice(begin, begin + int(falls[0]))
        grey, good, broken = _frame(line_valid[inside], data[inside], width, height)
        marker = np.where(np.arange(1, len(grey) + 1) % width == 0, LINE_END, 0)
        if good:
            marker[-1] |= FRAME_END
        greys.append(grey)
        markers.append(marker.astype(np.uint8))
        if broken:
            greys.append(np.array([BAD_SYNC], np.uint8))
            markers.append(np.array([LINE_END | FRAME_END | BROKEN], np.uint8))
    return np.concatenate(greys), np.concatenate(markers)
