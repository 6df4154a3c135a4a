"""Does the lens of the photographs fit the plane frames? All beams leave one point, it says."""

from dataclasses import replace

import numpy as np

from calibration.lines import Observations, common_origin_sigma
from calibration.plane_offset import corrected

__all__ = ["doubts", "turned_lenses"]

#: With the right lens, lines through one point leave at the most so much more than free ones.
_MOST_RATIO = 1.25
#: A turned lens that leaves so much less than the lens as it is, is the right one.
_TURNED_GAIN = 0.85


def turned_lenses(lens):
    """The lens of photographs that were turned or mirrored, by what was done to them."""
    right, below = lens.width - 1, lens.height - 1
    u, v = right - lens.principal_u, below - lens.principal_v
    result = {
        "turned by 180 degrees": replace(lens, principal_u=u, principal_v=v, p1=-lens.p1,
                                         p2=-lens.p2),
        "mirrored left to right": replace(lens, principal_u=u, p2=-lens.p2),
        "mirrored upside down": replace(lens, principal_v=v, p1=-lens.p1)}
    if lens.width == lens.height:
        result["turned by 90 degrees counterclockwise"] = replace(
            lens, principal_u=lens.principal_v, principal_v=u, p1=-lens.p2, p2=lens.p1)
        result["turned by 90 degrees clockwise"] = replace(
            lens, principal_u=v, principal_v=lens.principal_u, p1=lens.p2, p2=-lens.p1)
    return result


def _ratio(planes, identity, lens, offset_mm, kept):
    """Residuals of lines through one point, px, and by those of free lines."""
    seen = []
    for plane in planes:
        x, y = lens.undistort(plane.u, plane.v)
        seen.append(replace(plane, x=x, y=y))
    data = corrected(Observations.of(seen, identity, lens).only(kept), offset_mm)
    common, free = common_origin_sigma(data)
    return common, common / max(free, 1e-6)


def doubts(planes, identity, lens, offset_mm, used):
    """What is wrong with the lens by the plane frames, in sentences.

    Parameters
    ----------
    planes : sequence of :class:`calibration.identity.PlaneSpots`
        Spots of all plane frames.
    identity : :class:`calibration.identity.Identity`
        Their beams.
    lens : :class:`calibration.lens.Lens`
        From the photographs.
    offset_mm : :class:`float`
        What was added to all distances.
    used : array of :class:`int`
        Numbers of the usable beams.

    Returns
    -------
    list of :class:`str`
    """
    kept = np.isin(np.arange(identity.projector.beams), used)
    sigma, ratio = _ratio(planes, identity, lens, offset_mm, kept)
    if ratio <= 1 + (_MOST_RATIO - 1) / 2:
        return []
    turned = {name: _ratio(planes, identity, other, offset_mm, kept)[0]
              for name, other in turned_lenses(lens).items()}
    best = min(turned, key=turned.get)
    if turned[best] < _TURNED_GAIN * sigma:
        return [f"The chessboard photographs seem to be {best} against the plane frames (the beams "
                f"meet in one point to {turned[best]:.3f} px then, to {sigma:.3f} px as they are): "
                "take both with the camera the same way round."]
    if ratio <= _MOST_RATIO:
        return []
    return [f"The lens of the photographs does not fit the plane frames (the beams meet in one "
            f"point only to {sigma:.3f} px, {ratio:.1f} times what the spots allow): were they "
            "taken by another camera, or at another focus? Or the beams do not leave one point."]
