"""The table of the whole-image distortion correction, from a lens."""

import numpy as np

from calibration.undistortion import build
from model.errors import UserError
from model.preprocessing.remap import OUTSIDE, pack_remap

__all__ = ["remap_settings", "remap_table"]


def remap_table(lens):
    """Words of :func:`model.preprocessing.remap.remap`.

    A pixel of the corrected image stands for the undistorted position with the same offset from
    the image centre; it takes the pixel of the sensor's image nearest to where the lens projects
    that position. Pixels beyond the lens model's fold, or its usable region, take none.

    Parameters
    ----------
    lens : :class:`calibration.lens.Lens`
        Camera and sensor size.

    Returns
    -------
    tuple of width x height :class:`int`
    """
    row, column = np.mgrid[:lens.height, :lens.width]
    x, y = column - lens.centre[0], row - lens.centre[1]
    u, v = (np.floor(axis + 0.5).astype(np.int64) for axis in lens.distort(x, y))
    radius = np.hypot(x - lens.principal_x, y - lens.principal_y) / lens.focal
    valid = ((u >= 0) & (u < lens.width) & (v >= 0) & (v < lens.height)
             & (radius < lens.reach))
    return tuple(int(word) for word in np.where(valid, v * lens.width + u, OUTSIDE).ravel())


def remap_settings(lens):
    """What :class:`model.settings.Settings` holds where whole images are corrected.

    Centres in the corrected image are undistorted already: registers and radial table are those
    of a lens without distortion, which leave every position unchanged, to the last bit.

    Raises
    ------
    UserError
        If the chip's table cannot hold this lens.
    """
    table = remap_table(lens)
    try:
        pack_remap(table)
    except ValueError as error:
        raise UserError(f"{error}. Use a lens that distorts less.") from error
    tables = build(lens.focal, *lens.centre, 0, 0, 0, 0, lens.width, lens.height)
    return {"remap": table, **{name: tables[name] for name in (
        "principal_u", "principal_v", "tangential_1", "tangential_2", "radial")}}
