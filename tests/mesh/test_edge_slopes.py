"""Slopes of a plate's edges: exact for constant curvature, on patches as large as they must be."""

import numpy as np
import pytest
from support.plates import PATTERNS, square

import fecloth as fc


def angles(edges):
    """(h, 3) the angle of each hinge for each of the curvatures, of nodes on the deflection."""
    X, Y = edges.X.T
    w = np.column_stack([0.5 * X**2, 0.5 * Y**2, 0.5 * X * Y])
    return np.einsum("ha,hak->hk", edges.hinges.flat_gradient, w[edges.hinges.nodes])


def error(cloth):
    """The largest error of a slope of an interior edge, for a curvature of 1/m [rad]."""
    slopes = cloth.edge_slopes
    edges, inside = slopes.edges, slopes.edges.hinge >= 0
    return abs(slopes.plain @ angles(edges) - edges.slopes_of_curvature)[inside].max()


def least_singular(cloth, widened=False):
    """(h,) of the angles around each edge in edge lengths: of its two triangles, or its patch."""
    edges, patches = cloth.edge_slopes.edges, cloth.edge_slopes.patches
    values, hinge = [], edges.hinge.reshape(-1, 3)
    for h, sides in enumerate(edges.hinges.sides):
        around = np.unique(hinge[patches[h].indices if widened else sides])
        rows = angles(edges)[around[around >= 0]] / np.linalg.norm(edges.hinges.vector[h])
        values.append(np.linalg.svd(rows, compute_uv=False)[-1] if len(rows) > 2 else 0.0)
    return np.array(values)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_slopes_are_exact_for_constant_curvature_up_to_the_corners(pattern):
    assert error(square(pattern, 3)) < 1e-12


def with_a_tail(cloth):
    """Two triangles more at an edge of the boundary: the edge between them has two hinges."""
    X, n = cloth.X, len(cloth.X)
    a, b = (int(np.argmin(np.abs(X - at).sum(axis=1))) for at in ((1, 1 / 3), (1, 2 / 3)))
    points = np.vstack([X, [[1.3, 0.6], [1.25, 0.1]]])
    triangles = np.vstack([cloth.triangles, [[a, n, b], [a, n + 1, n]]])
    return fc.Cloth.from_arrays(points, triangles, renumber=False)


def test_an_edge_with_fewer_than_three_hinges_takes_those_around_its_nodes():
    cloth = with_a_tail(square("right", 3))
    slopes = cloth.edge_slopes
    last = len(cloth.triangles) - 1
    (tail,) = np.flatnonzero((slopes.edges.hinges.sides == last).any(axis=1))
    assert np.diff(slopes.patches.indptr)[tail] > 2
    assert error(cloth) < 1e-12


def leaning(part):
    """Squares of four triangles whose inner nodes lie `part` of an edge off the centres."""
    cloth = square("cross", 3)
    X, centre = cloth.X.copy(), np.abs(3 * cloth.X % 1 - 0.5).max(axis=1) < 1e-9
    X[centre] += part / 3 * np.array([0.6, 0.8])
    return fc.Cloth.from_arrays(X, cloth.triangles, renumber=False)


def test_where_angles_hardly_tell_a_curvature_the_slopes_are_exact_on_a_wider_patch():
    cloth = leaning(1e-4)
    assert least_singular(cloth).min() < 1e-3
    assert least_singular(cloth, widened=True).min() > 0.1
    assert error(cloth) < 1e-12
