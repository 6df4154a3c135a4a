"""Triangles of the mesh: all of a surface, none over an edge."""

import numpy as np

from scripts.results.mesh import STEEPEST, triangles, vertex_normals


def mesh(rows=3, columns=3, pitch=0.04, depth=50.0):
    beam = np.arange(rows * columns)
    ray = np.stack([(beam % columns) * pitch, (beam // columns) * pitch], axis=-1)
    return beam, ray, np.full(len(beam), 1 / depth)


def area(ray, triangle):
    """Signed area of each triangle in the picture."""
    one, two = (ray[triangle[:, k]] - ray[triangle[:, 0]] for k in (1, 2))
    return (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]) / 2


def test_a_whole_mesh_is_covered_once():
    beam, ray, inverse = mesh()
    triangle = triangles(beam, ray, inverse, 3)
    assert len(triangle) == 8
    assert np.isclose(area(ray, triangle).sum(), -4 * 0.04**2)
    assert (area(ray, triangle) < 0).all()


def test_a_cell_without_a_corner_has_one_triangle():
    beam, ray, inverse = mesh(2, 2)
    for missing in range(4):
        kept = beam != missing
        triangle = triangles(beam[kept], ray[kept], inverse[kept], 2)
        assert len(triangle) == 1 and area(ray[kept], triangle)[0] < 0, missing
    assert len(triangles(beam[:2], ray[:2], inverse[:2], 2)) == 0
    assert len(triangles(beam[:0], ray[:0], inverse[:0], 2)) == 0


def test_no_triangle_over_an_edge():
    beam, ray, inverse = mesh(3, 4)
    behind = beam % 4 >= 2
    jump = np.exp(STEEPEST * 0.04)
    # Columns 1 and 2 are on both sides of it.
    for step, count in ((jump * 0.99, 12), (jump * 1.01, 8)):
        far = np.where(behind, inverse / step, inverse)
        triangle = triangles(beam, ray, far, 4)
        assert len(triangle) == count
        crossing = behind[triangle].any(axis=1) & ~behind[triangle].all(axis=1)
        assert crossing.any() == (count == 12)


def test_order_of_points_does_not_matter():
    beam, ray, inverse = mesh(4, 4)
    order = np.random.default_rng(1).permutation(16)
    one = {frozenset(beam[each]) for each in triangles(beam, ray, inverse, 4)}
    two = {frozenset(beam[order][each]) for each in triangles(
        beam[order], ray[order], inverse[order], 4)}
    assert one == two


def test_normals_look_at_the_camera():
    beam, ray, inverse = mesh()
    xyz = np.column_stack([ray, np.ones(9)]) / inverse[:, None]
    assert np.allclose(vertex_normals(xyz, triangles(beam, ray, inverse, 3)), [0, 0, -1])
    assert (vertex_normals(xyz, np.zeros((0, 3), int)) == 0).all()
