"""Which points contradict their neighbours in the mesh, and what their beam showed before."""

import numpy as np

__all__ = ["contradicts", "is_near"]

#: Steps in the mesh up to which beams are neighbours, and the number of them that says something.
_REACH, _LEAST = 2, 7
#: A point contradicts its neighbours if its inverse depth is off by more than this part, and by
#: more than so many times what the neighbours' own are off.
_OFF, _SCATTER = 0.08, 4.0
#: A beam beside it whose inverse depth is so nearly the same takes its part.
_BESIDE = 0.03
#: The same for spots that are so far from their epipolar line as light of the laser seldom is.
_FAR_PX = 0.35
_OFF_FAR, _SCATTER_FAR = 0.02, 3.0
#: Inverse depths of a beam in frames that follow one another differ by less than this part.
_LATER = 0.05
_ROUNDS = 8

# The figures are measured on simulated tissue (tilted walls, polyps and folds, 12-look speckle)
# with 4 to 30 highlights a frame: they find 9 of 10 wrong points and mark 0.1 to 0.3 % of the right
# ones.


def is_near(inverse_depth, other):
    """Whether inverse depths are the same but for what happens from frame to frame."""
    return np.abs(inverse_depth - other) <= _LATER * np.abs(other)


def contradicts(beam, inverse_depth, distance_px, known_beam, known, columns):
    """Which spots cannot be part of the surface that their beams' neighbours show.

    In inverse depth a plane is linear over the mesh. So the neighbours of a beam, up to two steps
    away, say what its own should be: by a plane fitted to them, in which outliers count little.
    Where they are far from any plane, as at an edge, much is allowed, and a spot that agrees with
    one of the beams beside it contradicts nothing. Beams with fewer than seven neighbours are not
    judged.

    Parameters
    ----------
    beam : array (n,) of :class:`int`
        Beams of the spots to be judged.
    inverse_depth : array (n,) of :class:`float`
        1/z of each, in any unit.
    distance_px : array (n,) of :class:`float`
        Distance of each from its beam's epipolar line.
    known_beam, known : arrays (m,)
        Beams of the frame, each once, and 1/z of their best spots, in the same unit. A beam is not
        its own neighbour.
    columns : :class:`int`
        Of the mesh; beam = row * columns + column.

    Returns
    -------
    array (n,) of :class:`bool`
    """
    beam, known_beam = np.asarray(beam, int), np.asarray(known_beam, int)
    if not len(beam) or len(known_beam) <= _LEAST:
        return np.zeros(len(beam), bool)
    known = np.asarray(known, float)
    known_place = np.stack(np.divmod(known_beam, columns), axis=-1)
    steps = known_place - np.stack(np.divmod(beam, columns), axis=-1)[:, None]
    away = np.abs(steps).max(axis=-1)
    near = (away > 0) & (away <= _REACH)
    expected, off = _planes(steps, near / (1.0 + away**2), known)
    off = np.where(near, off, np.nan)
    with np.errstate(invalid="ignore"):
        scatter = np.nanmedian(np.where(near.any(axis=1, keepdims=True), off, 0), axis=1)
    error = np.abs(inverse_depth - expected)
    same = np.abs(known / inverse_depth[:, None] - 1) <= _BESIDE
    alone = ~(near & (away == 1) & same).any(axis=1)
    wrong = alone & (error > _OFF * np.abs(inverse_depth)) & (error > _SCATTER * scatter)
    wrong |= (distance_px > _FAR_PX) & (error > _OFF_FAR * np.abs(inverse_depth)) & (
        error > _SCATTER_FAR * scatter)
    return wrong & (near.sum(axis=1) >= _LEAST)


def _planes(steps, weights, known):
    """A plane over the mesh for each spot, by least absolute deviations.

    Gives its value at the spot's own beam, (n,), and how far each known one is off, (n, m).
    """
    terms = np.concatenate([np.ones((*steps.shape[:2], 1)), steps], axis=-1)
    # Where all neighbours are in one row, or in one column, the plane is level across it.
    level = 1e-9 * np.eye(3)
    now = weights
    least = 1e-3 * np.abs(known)
    for _ in range(_ROUNDS):
        weighted = now[..., None] * terms
        normal = np.swapaxes(weighted, 1, 2) @ terms + level
        plane = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ known[:, None])
        off = np.abs((terms @ plane)[..., 0] - known)
        now = weights / np.maximum(off, least) * least
    return plane[:, 0, 0], off
