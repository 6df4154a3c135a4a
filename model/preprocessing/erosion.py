"""3x3 erosion of a mask."""

import numpy as np

__all__ = ["erode"]


def erode(lit, mode):
    """Lit pixels and core pixels after the erosion.

    A pixel survives when it and its eight neighbours are lit; outside the image all is dark.

    Parameters
    ----------
    lit : boolean array (height, width)
        Mask.
    mode : ``"off"``, ``"erode"`` or ``"gate"``
        *off*: nothing changes, every lit pixel is core. *erode*: only survivors stay lit (the
        paper's form). *gate*: all pixels stay, survivors are core.

    Returns
    -------
    tuple of boolean arrays (height, width)
        Lit, core.
    """
    if mode == "off":
        return lit, lit
    rows = np.zeros_like(lit)
    rows[1:-1] = lit[:-2] & lit[1:-1] & lit[2:]
    core = np.zeros_like(lit)
    core[:, 1:-1] = rows[:, :-2] & rows[:, 1:-1] & rows[:, 2:]
    return (core, core) if mode == "erode" else (lit, core)
