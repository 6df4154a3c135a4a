"""Planes whose distance was mistyped: found by what their spots say."""

import numpy as np
from scipy.spatial import cKDTree

from calibration.plane_offset import corrected, estimate_offset, fit_each
from calibration.projector import predict
from model.errors import UserError

__all__ = ["check_plane_distances", "check_plane_positions"]

#: A plane that shows a smaller share of the mesh than this is looked at; a distance that
#: explains the larger share is believed.
_FEW, _MOST = 0.5, 0.75
_GATE_PX = 3.0
#: A distance is mistyped if it is off by so many standard deviations and such a share, and if
#: the other planes agree so much better without it.
_SIGMAS, _SHARE, _GAIN = 6.0, 0.003, 0.6


def _refuse(plane, distance):
    raise UserError(
        f"planes.csv gives {plane.z_mm:g} mm for {plane.name}, but its spots are those of a plane "
        f"at about {distance:.1f} mm, by all the other planes: correct its z_mm, or take its line "
        "out.")


def check_plane_positions(planes, identity, lens):
    """Refuse a plane that hardly shows the mesh at its distance, but does at another one.

    Parameters
    ----------
    planes : sequence of :class:`calibration.identity.PlaneSpots`
        Spots of all plane frames.
    identity : :class:`calibration.identity.Identity`
        The fitted mesh.
    lens : :class:`calibration.lens.Lens`
        Lens already calibrated.
    """
    mesh = identity.projector
    row, column = mesh.positions()
    alive = np.isin(np.arange(mesh.beams), np.concatenate(identity.beams))

    def distances(tree, z_mm):
        return tree.query(predict(lens, row, column, mesh.parameters(), 1 / z_mm)[alive])[0]

    shares = [np.mean(np.isin(np.flatnonzero(alive), beams)) for beams in identity.beams]
    for plane, share in zip(planes, shares, strict=True):
        if share >= _FEW * np.median(shares) or len(plane.x) < 4:
            continue
        tree = cKDTree(np.stack([plane.x, plane.y], axis=-1))
        tries = (plane.z_mm + identity.offset_mm) * np.geomspace(0.1, 10, 1201)
        found = np.minimum([distances(tree, z_mm) for z_mm in tries], _GATE_PX)
        best = int(found.mean(axis=1).argmin())
        if np.mean(found[best] < _GATE_PX) >= _MOST * np.median(shares):
            _refuse(plane, tries[best] - identity.offset_mm)


def _line_fit(data, kept):
    """Straight lines over 1/z through some of the rows: their four arrays, and how far
    the rows usually are from them, px."""
    error_x, *x = fit_each(data.beam, data.beams, kept, data.inverse_z, data.x)
    error_y, *y = fit_each(data.beam, data.beams, kept, data.inverse_z, data.y)
    squares = error_x**2 + error_y**2
    # Two unknowns of each beam and the offset follow the planes' own errors.
    planes = len(np.unique(data.plane[kept]))
    return (*x, *y), float(np.sqrt(np.median(squares[kept]) * planes / max(planes - 3, 1)))


def check_plane_distances(observations, planes):
    """Refuse a plane whose spots lie at another distance than all the others have them.

    Parameters
    ----------
    observations : :class:`calibration.lines.Observations`
        Of usable beams, at the distances of planes.csv.
    planes : sequence of :class:`calibration.identity.PlaneSpots`
        Spots of all plane frames.
    """
    distances = sorted({plane.z_mm for plane in planes})
    if len(distances) < 5:
        return      # without one of them nothing is left to compare
    offset = estimate_offset(observations).mm
    together = _line_fit(corrected(observations, offset), np.ones(len(observations.x), bool))[1]
    worst = (_GAIN * together, None, None)
    for number, z_mm in enumerate(distances):
        # The lines, and the offset, of all the other planes, then this plane's distance by them.
        out = observations.plane == number
        beams = np.bincount(observations.beam[~out], minlength=observations.beams) >= 3
        own = out & beams[observations.beam]
        if own.sum() < 3:
            continue
        offset = estimate_offset(observations.rows(~out)).mm
        data = corrected(observations, offset)
        (p, q, r, s), apart = _line_fit(data, ~out)
        beam = data.beam[own]
        w = (q[beam] * (data.x[own] - p[beam]) + s[beam] * (data.y[own] - r[beam])) / (
            q[beam] ** 2 + s[beam] ** 2)
        estimate = np.median(w)
        sigma = 1.4826 * np.median(np.abs(w - estimate)) / np.sqrt(len(w))
        off = abs(estimate * (z_mm + offset) - 1)
        if apart < worst[0] and off > max(_SHARE, _SIGMAS * sigma * (z_mm + offset)):
            worst = (apart, number, 1 / estimate - offset)
    if worst[1] is not None:
        _refuse(next(plane for plane in planes if plane.z_mm == distances[worst[1]]), worst[2])
