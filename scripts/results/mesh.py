"""Triangles between neighbours in the mesh, where the surface goes on from one to the other."""

import numpy as np

__all__ = ["STEEPEST", "triangles", "vertex_normals"]

#: Tangent of the steepest angle between the surface and the view across it: an edge of the mesh
#: over which 1/z changes by more than this times the angle between its two rays is a jump from one
#: surface to another one behind it.
STEEPEST = 3.0


def _corners(beam, columns):
    """Indices of the points at the corners of each cell of the mesh, (cells, 4); -1 is no point.

    The corners are top left, top right, bottom left, bottom right.
    """
    row, column = np.divmod(np.asarray(beam, int), columns)
    grid = np.full((row.max(initial=0) + 2, columns + 1), -1)
    grid[row, column] = np.arange(len(row))
    return np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]],
                    axis=-1).reshape(-1, 4)


def _continuous(one, two, ray, inverse):
    """Whether the surface goes on from points ``one`` to points ``two``."""
    step = np.hypot(*(ray[one] - ray[two]).T)
    return np.abs(np.log(inverse[one] / inverse[two])) <= STEEPEST * step


def triangles(beam, ray, inverse, columns):
    """Triangles of the surface: a cell of the mesh has two, or one where a corner is missing.

    They depend on which beams have a point and on their depth alone, so they stay the same from
    frame to frame.

    Parameters
    ----------
    beam : array (n,) of :class:`int`
        Beams of the points, each once; beam = row * columns + column.
    ray : array (n, 2)
        x/z and y/z of each.
    inverse : array (n,)
        1/z of each.
    columns : :class:`int`
        Of the mesh.

    Returns
    -------
    array (triangles, 3) of :class:`int`
        Indices of points, in the same sense for all.
    """
    corners = _corners(beam, columns)
    missing = (corners < 0).sum(axis=1)
    whole = corners[missing == 0]
    found = [whole[:, [0, 2, 1]], whole[:, [1, 2, 3]]]
    for absent, rest in enumerate(([1, 2, 3], [0, 2, 3], [0, 3, 1], [0, 2, 1])):
        found.append(corners[(missing == 1) & (corners[:, absent] < 0)][:, rest])
    found = np.concatenate(found)
    ray, inverse = np.asarray(ray, float), np.asarray(inverse, float)
    if not len(found):
        return found.reshape(0, 3)
    good = np.ones(len(found), bool)
    for one, two in ((0, 1), (1, 2), (2, 0)):
        good &= _continuous(found[:, one], found[:, two], ray, inverse)
    return found[good]


def vertex_normals(xyz, triangle):
    """Unit normals (n, 3) of the points, towards the camera; zero where a point has no triangle."""
    normals = np.zeros((len(xyz), 3))
    across = np.cross(xyz[triangle[:, 1]] - xyz[triangle[:, 0]],
                      xyz[triangle[:, 2]] - xyz[triangle[:, 0]])
    across *= -np.sign((across * xyz[triangle[:, 0]]).sum(axis=1))[:, None]
    for corner in range(3):
        np.add.at(normals, triangle[:, corner], across)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
