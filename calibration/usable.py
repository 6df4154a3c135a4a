"""Which beams can be calibrated: dead, blocked, overbright ones and those outside the picture."""

from dataclasses import dataclass, field

import numpy as np

from calibration.identity import USABLE_SHARE
from calibration.projector import predict
from model.errors import UserError

__all__ = ["MIN_PLANES", "UsableBeams", "check_distances", "drop_scattered",
           "relative_areas", "remarks", "seen_dead", "usable_beams"]

#: A line through fewer planes has nothing left to be checked with.
MIN_PLANES = 4
#: Spots of a beam this many times as large as those of the others, or as small, are pointed out.
OVERBRIGHT_AREA, DIM_AREA = 1.35, 0.5
#: Share of the expected spots of a missing row that may be there by chance.
_STRAY_SHARE = 0.25
#: A spot that is so near to where a dead beam's would be is one, px.
_SEEN_PX = 3.0


@dataclass(frozen=True)
class UsableBeams:
    """The observations of the beams that can be calibrated, and why others cannot be.

    Parameters
    ----------
    observations : :class:`calibration.lines.Observations`
        Of the usable beams.
    left_out : :class:`dict`
        From the number of a beam to the reason, in words.
    dead : frozenset of :class:`int`
        Beams among them that are known to be dead.
    """

    observations: object = field(repr=False)
    left_out: dict
    dead: frozenset = frozenset()


def _reason(found, expected):
    """Why a beam that was found at so few of the expected distances is left out."""
    if expected < MIN_PLANES:
        return f"inside the usable part of the picture at {expected} distances only"
    if not found:
        return (f"no spot at the {expected} distances that should show it: dead, blocked, or its "
                "spots are outside the limits of the area")
    return f"found at {found} of the {expected} distances that should show it"


def _check_number(observations, left_out, dead, mesh):
    """Refuse a mesh of which too little is left; beams known to be dead do not count."""
    total = mesh.beams - len(dead)
    if observations.beams >= max(1, USABLE_SHARE * total):
        return
    left_out = {beam: reason for beam, reason in left_out.items() if beam not in dead}
    words = [f"{beam} (row {beam // mesh.columns}, column {beam % mesh.columns}): {reason}"
             for beam, reason in sorted(left_out.items())]
    more = f"; and {len(words) - 6} more" if len(words) > 6 else ""
    raise UserError(
        f"Only {observations.beams} of the {total} beams{' that are alive' * bool(dead)} can be "
        "used, at least "
        f"{USABLE_SHARE:.0%} are needed; left out are {'; '.join(words[:6])}{more}: move the "
        "planes so that the beams stay in the picture, clean the projector, or set another "
        "threshold.")


def check_distances(distances):
    """Refuse planes at fewer than four distances; any numbers that stand for those will do."""
    count = len(np.unique(distances))
    if count == 1:
        raise UserError(
            f"All plane frames are at one distance by planes.csv, at least {MIN_PLANES} different "
            "ones are needed: correct z_mm, or add frames at other distances.")
    if count < MIN_PLANES:
        raise UserError(
            f"The plane frames show {count} distances, at least {MIN_PLANES} different ones are "
            "needed: add frames to planes/planes.csv.")


def _check_outer_rows(found, expected, mesh):
    """Refuse a mesh an outer row or column of which was never seen, though it should have been."""
    number = np.arange(mesh.beams).reshape(mesh.rows, mesh.columns)
    sides = {"row 0": ("rows", number[0]), f"row {mesh.rows - 1}": ("rows", number[-1]),
             "column 0": ("columns", number[:, 0]),
             f"column {mesh.columns - 1}": ("columns", number[:, -1])}
    for side, (key, beams) in sides.items():
        shown = beams[expected[beams] >= MIN_PLANES]
        # A stray spot may be where a beam is expected.
        missing = (found[beams] < MIN_PLANES).all() and (
            found[shown].sum() < _STRAY_SHARE * expected[shown].sum())
        if getattr(mesh, key) > 2 and missing and len(shown) >= 2:
            raise UserError(
                f"The spots of {side} are missing in the plane frames, though the others are "
                f"there: the mesh seems to have fewer than {getattr(mesh, key)} {key}; correct "
                f"{key} in [projector] of capture.toml.")


def usable_beams(observations, mesh, expected, dead=()):
    """Leave out the beams that were found at fewer than four distances.

    Raises :class:`UserError` if there are fewer than four distances at all, or if less than half
    of the mesh is left, dead beams not counted.

    Parameters
    ----------
    observations : :class:`calibration.lines.Observations`
        Assigned spots of all beams.
    mesh : :class:`calibration.projector.Projector`
        Gives rows and columns.
    expected : array (beams,) of :class:`int`
        Distances at which each beam is inside the picture.
    dead : iterable of :class:`int`
        Beams that are known to be dead.

    Returns
    -------
    :class:`UsableBeams`
    """
    check_distances(observations.plane)
    found = np.array([observations.planes_of(beam) for beam in range(observations.beams)])
    _check_outer_rows(found, expected, mesh)
    left_out = {int(observations.numbers[beam]): _reason(int(found[beam]), int(expected[beam]))
                for beam in np.flatnonzero(found < MIN_PLANES)}
    left_out |= {int(beam): "known to be dead" for beam in dead}
    kept = observations.only(found >= MIN_PLANES)
    _check_number(kept, left_out, dead, mesh)
    return UsableBeams(kept, left_out, frozenset(dead))


def drop_scattered(usable, lines, mesh):
    """Leave out the beams whose spots lie on no line; gives the same object if there are none.

    Parameters
    ----------
    usable : :class:`UsableBeams`
        From :func:`usable_beams`.
    lines : :class:`calibration.lines.BeamLines`
        Their lines; ``planes`` counts the distances without outliers.
    mesh : :class:`calibration.projector.Projector`
        Gives rows and columns.

    Returns
    -------
    :class:`UsableBeams`
    """
    scattered = np.flatnonzero(lines.planes < MIN_PLANES)
    if not len(scattered):
        return usable
    left_out = {**usable.left_out, **{
        int(lines.numbers[beam]): f"only {int(lines.planes[beam])} of its spots lie on a line"
        for beam in scattered}}
    kept = usable.observations.only(lines.planes >= MIN_PLANES)
    _check_number(kept, left_out, usable.dead, mesh)
    return UsableBeams(kept, left_out, usable.dead)


def seen_dead(usable, planes, identity, lens):
    """The usable beams, and with the reasons of dead ones whether spots are where theirs would be.

    Parameters
    ----------
    usable : :class:`UsableBeams`
        From :func:`usable_beams`.
    planes : sequence of :class:`calibration.identity.PlaneSpots`
        Spots of all plane frames.
    identity : :class:`calibration.identity.Identity`
        Of them.
    lens : :class:`calibration.lens.Lens`
        Lens.
    """
    left_out = dict(usable.left_out)
    row, column = identity.projector.positions()
    for beam in usable.dead:
        seen = set()
        for plane, beams in zip(planes, identity.beams, strict=True):
            x, y = predict(lens, row[beam], column[beam], identity.projector.parameters(),
                           1 / (plane.z_mm + identity.offset_mm))[0]
            if (np.hypot(plane.x - x, plane.y - y)[beams < 0] < _SEEN_PX).any():
                seen.add(plane.z_mm)
        if len(seen) >= MIN_PLANES:
            left_out[beam] += (f", but there are spots where its own would be at {len(seen)} "
                               "distances: is it the right row and column?")
    return UsableBeams(usable.observations, left_out, usable.dead)


def relative_areas(planes, beams, count):
    """Area of each beam's spots by the median of their plane, the median over the planes.

    Parameters
    ----------
    planes : sequence of :class:`calibration.identity.PlaneSpots`
        Spots of all plane frames.
    beams : sequence of arrays of :class:`int`
        For each plane the beam of each spot, -1 for none.
    count : :class:`int`
        Number of beams.

    Returns
    -------
    array (count,) of :class:`float`
        NaN for a beam that was never found.
    """
    shares = np.full((len(planes), count), np.nan)
    for row, plane, beam in zip(shares, planes, beams, strict=True):
        own = beam >= 0
        if own.any():
            row[beam[own]] = plane.area[own] / np.median(plane.area[own])
    seen = np.isfinite(shares).any(axis=0)
    result = np.full(count, np.nan)
    result[seen] = np.nanmedian(shares[:, seen], axis=0)
    return result


def remarks(usable, areas, identity, planes):
    """What is to be said of single beams: a text for each number.

    Parameters
    ----------
    usable : :class:`UsableBeams`
        Which beams were left out, and why.
    areas : array of :class:`float`
        From :func:`relative_areas`.
    identity : :class:`calibration.identity.Identity`
        Gives the distances that should show each beam.
    planes : :class:`int`
        Number of distances.

    Returns
    -------
    :class:`dict`
        From numbers of beams to texts, in their order.
    """
    result = {beam: f"left out: {reason}" for beam, reason in usable.left_out.items()}
    for beam in usable.observations.numbers.tolist():
        words = []
        if areas[beam] > OVERBRIGHT_AREA:
            words.append(f"overbright: its spots are {areas[beam]:.1f} times as large as usual")
        elif areas[beam] < DIM_AREA:
            words.append(f"dim: its spots are {areas[beam]:.1f} times as large as usual")
        if identity.expected[beam] < planes:
            words.append("outside the usable part of the picture at "
                         f"{planes - identity.expected[beam]} of {planes} distances")
        if words:
            result[beam] = "; ".join(words)
    return dict(sorted(result.items()))
