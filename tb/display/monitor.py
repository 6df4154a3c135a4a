"""A screen: it knows the VESA timing of 640 x 480 and three pins of colours, and nothing else."""

import numpy as np

__all__ = ["Monitor"]

COLUMNS, ROWS = 640, 480
#: Clocks of a line and of its sync pulse; from the pulse's first edge to the line's first pixel.
LINE, PULSE, BEFORE = 800, 96, 96 + 48
#: Lines of a screen and of its sync pulse; from the pulse's first edge to the first line.
SCREEN, PULSE_LINES, BEFORE_LINES = 525, 2, 2 + 33


class Monitor:
    """Finds pictures in what the pins did.

    Parameters
    ----------
    red, green, blue, hsync, vsync, visible : array of uint8
        A value for each clock.

    Attributes
    ----------
    pictures : list of array (480, 640, 3)
        All screens that were whole, in order.
    starts : list of int
        Clock of the first pixel of each.

    Raises
    ------
    AssertionError
        If a pulse is not where VESA wants it, or a pin is not dark in a blanking.
    """

    def __init__(self, red, green, blue, hsync, vsync, visible):
        lines, line_ends = self._edges(hsync)
        assert (np.diff(lines) == LINE).all(), "a line has not 800 clocks"
        assert (line_ends[:len(lines)] - lines == PULSE).all(), "a line's pulse has not 96 clocks"
        screens, screen_ends = self._edges(vsync)
        assert (np.diff(screens) == LINE * SCREEN).all(), "a screen has not 525 lines"
        assert (screen_ends[:len(screens)] - screens == LINE * PULSE_LINES).all(), \
            "a screen's pulse has not 2 lines"
        assert np.isin(screens, lines).all(), "the pulses do not begin together"

        colour = np.stack([red, green, blue], axis=-1)
        lit = np.zeros(len(hsync), bool)
        self.pictures, self.starts = [], []
        first = screens[0] % (LINE * SCREEN) - LINE * SCREEN  # a screen whose pulse was missed
        for edge in range(first, len(hsync), LINE * SCREEN):
            start = edge + LINE * BEFORE_LINES + BEFORE
            clocks = start + LINE * np.arange(ROWS)[:, None] + np.arange(COLUMNS)
            inside = (clocks >= 0) & (clocks < len(hsync))
            lit[clocks[inside]] = True
            if inside.all():
                self.pictures.append(colour[clocks])
                self.starts.append(start)
        assert not colour[~lit].any(), "a pin is not dark in a blanking"
        assert np.array_equal(visible.astype(bool), lit), "`visible` is not"

    @staticmethod
    def _edges(pin):
        """Clocks in which a pin went down, and those after in which it went up."""
        steps = np.diff(pin.astype(np.int8))
        down, up = np.flatnonzero(steps < 0) + 1, np.flatnonzero(steps > 0) + 1
        up = up[up > down[0]]
        return down[:len(up)], up
