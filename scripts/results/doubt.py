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
_STEPS = np.array([(row, column) for row in range(-_REACH, _REACH + 1)
                   for column in range(-_REACH, _REACH + 1) if row or column])
_AWAY = np.abs(_STEPS).max(axis=1)

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
    beam, inverse_depth = np.asarray(beam, int), np.asarray(inverse_depth, float)
    if not len(beam) or len(known_beam) <= _LEAST:
        return np.zeros(len(beam), bool)
    values = _neighbours(beam, np.asarray(known_beam, int), np.asarray(known, float), columns)
    near = np.isfinite(values)
    judged = near.sum(axis=1) >= _LEAST
    values, near, inverse, distance = (
        part[judged] for part in (values, near, inverse_depth, np.asarray(distance_px)))
    expected, off = _planes(near, np.where(near, values, 1.0))
    scatter = np.nanmedian(np.where(near, off, np.nan), axis=1) if len(off) else np.zeros(0)
    error = np.abs(inverse - expected)
    same = near & (np.abs(values / inverse[:, None] - 1) <= _BESIDE)
    alone = ~same[:, _AWAY == 1].any(axis=1)
    wrong = np.zeros(len(beam), bool)
    wrong[judged] = (
        alone & (error > _OFF * inverse) & (error > _SCATTER * scatter)
        | (distance > _FAR_PX) & (error > _OFF_FAR * inverse) & (error > _SCATTER_FAR * scatter))
    return wrong


def _neighbours(beam, known_beam, known, columns):
    """What is known of the beams at :data:`_STEPS` from each beam, (n, 24); NaN where nothing."""
    row, column = np.divmod(beam, columns)
    known_row, known_column = np.divmod(known_beam, columns)
    rows = max(row.max(), known_row.max()) + 1
    mesh = np.full((rows + 2 * _REACH, columns + 2 * _REACH), np.nan)
    mesh[known_row + _REACH, known_column + _REACH] = known
    return mesh[row[:, None] + _REACH + _STEPS[:, 0], column[:, None] + _REACH + _STEPS[:, 1]]


def _planes(near, values):
    """A plane over the neighbours of each beam, by least absolute deviations.

    Gives its value at the beam itself, (n,), and how far each neighbour is off, (n, 24).
    """
    terms = np.column_stack([np.ones(len(_STEPS)), _STEPS])
    products = (terms[:, :, None] * terms[:, None]).reshape(-1, 9)
    # Where all neighbours are in one row, or in one column, the plane is level across it.
    level = 1e-9 * np.eye(3)
    weights = near / (1.0 + _AWAY**2)
    least, now = 1e-3 * values, weights
    for _ in range(_ROUNDS):
        plane = np.linalg.solve(
            (now @ products).reshape(-1, 3, 3) + level, ((now * values) @ terms)[..., None])[..., 0]
        off = np.abs(plane @ terms.T - values)
        now = weights / np.maximum(off, least) * least
    return plane[:, 0], off
