"""Kernel arrays, masses, interpolation and norms of a cloth, and the selection of nodes."""

from itertools import pairwise

import numpy as np
import pytest

import fecloth as fc

PATTERNS = ["unstructured", "right", "cross", "equilateral"]


@pytest.fixture(scope="module")
def disk():
    return fc.Cloth.disk(0.5, h=0.1)


@pytest.fixture(scope="module", params=[*PATTERNS, "disk"])
def cloth(request, disk):
    if request.param == "disk":
        return disk
    return fc.Cloth.rectangle(1.0, 0.6, h=0.13, pattern=request.param)


def areas(cloth):
    """Areas (m,) from the corners, positive for counter-clockwise triangles."""
    a, b, c = np.moveaxis(cloth.X[cloth.triangles], 1, 0)
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def linear(X):
    """A scalar and a vector field without curvature, (n, 3)."""
    return np.column_stack([X[:, 0], 2 - 3 * X[:, 1], 0.5 + X @ [1.5, -0.7]])


def test_gradients_and_weights_in_closed_form(cloth):
    """∂N_a/∂X is the inner normal of the opposite edge over twice the area; P1 has one point."""
    m = len(cloth.triangles)
    assert cloth.shape == ((0, 0, 0), (0,))
    assert cloth.gradients.shape == (m, 1, 3, 2)
    assert cloth.stencil.dtype == np.int32
    assert np.array_equal(np.sort(cloth.stencil, axis=1), np.sort(cloth.triangles, axis=1))
    np.testing.assert_allclose(cloth.weights[:, 0], areas(cloth), rtol=1e-12)
    assert (areas(cloth) > 0).all()
    corners = cloth.X[cloth.stencil]
    b, c = np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)
    normal = np.stack([b[..., 1] - c[..., 1], c[..., 0] - b[..., 0]], axis=-1)
    twice = np.einsum("eai,eai->ea", corners - b, normal)  # ± twice the area
    np.testing.assert_allclose(cloth.gradients[:, 0], normal / twice[..., None], atol=1e-11)
    assert abs(cloth.gradients.sum(axis=2)).max() < 1e-12 / np.sqrt(areas(cloth).min())


def test_masses_and_load_from_the_areas(cloth):
    """A P1 triangle has the mass A/12 (1 + δ_ab), its row sums are A/3."""
    n = len(cloth.X)
    expected, load = np.zeros((n, n)), np.zeros(n)
    for nodes, area in zip(cloth.triangles, areas(cloth), strict=True):
        expected[np.ix_(nodes, nodes)] += area / 12 * (1 + np.eye(3))
        load[nodes] += area / 3
    np.testing.assert_allclose(cloth.mass("consistent").toarray(), expected, atol=1e-15)
    np.testing.assert_allclose(cloth.load(), load, rtol=1e-12)
    np.testing.assert_allclose(cloth.mass().toarray(), np.diag(load), rtol=1e-12)
    assert cloth.area == pytest.approx(load.sum(), rel=1e-12)


@pytest.mark.parametrize("renumber", [True, False])
def test_source_numbers_give_the_input_mesh(renumber, rng):
    """And the sets of nodes and the regions are of the same nodes and triangles as they came in."""
    source = fc.Cloth.rectangle(1.0, 0.6, h=0.2, pattern="cross")
    order, rows = rng.permutation(len(source.X)), rng.permutation(len(source.triangles))
    X, triangles = source.X[order], np.argsort(order)[source.triangles[rows]]
    hem = np.flatnonzero(X[triangles].mean(axis=1)[:, 0] > 0.6)
    cloth = fc.Cloth.from_arrays(
        X, triangles, {"some": [3, 7, 1]}, renumber=renumber, regions={"hem": hem}
    )
    assert np.array_equal(cloth.X, X[cloth.source_nodes])
    came_in = cloth.source_nodes[cloth.triangles]
    assert np.array_equal(came_in, triangles[cloth.source_triangles])
    assert sorted(cloth.source_nodes[cloth.nodes("some")]) == [1, 3, 7]
    assert sorted(cloth.source_triangles[cloth.region("hem")]) == hem.tolist()
    assert np.array_equal(cloth.region("hem"), cloth.region(lambda X: X[:, 0] > 0.6))
    assert renumber != np.array_equal(cloth.source_nodes, np.arange(len(X)))


@pytest.mark.parametrize("stretch", [1, 50], ids=["", "slivers"])
def test_interpolation_inside(cloth, stretch, rng):
    """The triangle that contains a point is found even if other centroids are nearer."""
    cloth = fc.Cloth.from_arrays(cloth.X * [stretch, 1], cloth.triangles)
    corners, shares = cloth.X[cloth.triangles], rng.dirichlet(np.ones(3), len(cloth.triangles))
    points, u = np.einsum("pa,pai->pi", shares, corners), rng.standard_normal(len(cloth.X))
    expected = np.sum(shares * u[cloth.triangles], axis=1)
    np.testing.assert_allclose(cloth.interpolate(u, points), expected, atol=1e-11)
    got = cloth.interpolate(linear(cloth.X), points)
    np.testing.assert_allclose(got, linear(points), atol=1e-13 * stretch)
    np.testing.assert_allclose(cloth.interpolate(u, cloth.X), u, atol=1e-11)
    assert cloth.interpolate(cloth.X[:, 0], [0.2, 0.1]) == pytest.approx([0.2], abs=1e-13)


def test_l2_norm_in_closed_form(cloth, disk):
    """∫ |X|² over a rectangle (w³h + wh³)/3, and over the disk's polygon of k chords."""
    k = len(disk.nodes("boundary"))
    polygon = k / 64 * np.sin(2 * np.pi / k) * (2 + np.cos(2 * np.pi / k)) / 3
    expected = polygon if cloth is disk else (0.6 + 0.6**3) / 3
    assert cloth.l2_norm(cloth.X) == pytest.approx(np.sqrt(expected), rel=1e-12)
    constant = np.full(len(cloth.X), -2.0)
    assert cloth.l2_norm(constant) == pytest.approx(2 * np.sqrt(cloth.area), rel=1e-12)


def test_differences_of_nested_interpolants_in_closed_form():
    """X₁² at h and h/2 differs by a hat of h²/4 in each cell: L2 = h²/√48 √A, H1 = h/2 √A."""
    sheets = [fc.Cloth.rectangle(1.0, 0.5, 0.5 / 2**i, "right") for i in range(1, 4)]
    for i, (coarse, fine) in enumerate(pairwise(sheets)):
        h, fields = 0.25 / 2**i, (coarse.X[:, 0] ** 2, fine.X[:, 0] ** 2)
        l2, h1 = coarse.l2_difference(fine, *fields), coarse.h1_difference(fine, *fields)
        assert l2 == pytest.approx(h**2 * np.sqrt(0.5 / 48), rel=1e-11)
        assert h1 == pytest.approx(h / 2 * np.sqrt(0.5), rel=1e-11)
        assert fine.l2_difference(coarse, *fields[::-1]) == l2


def test_nodes_by_set_predicate_indices_and_mask(sheet):
    left = np.flatnonzero(sheet.X[:, 0] == 0)
    assert len(left) > 3
    for where in ("left", lambda X: X[:, 0] == 0, left, sheet.X[:, 0] == 0):
        assert np.array_equal(sheet.nodes(where), left)
    assert sheet.nodes([5, 2, 5]).tolist() == [5, 2]
    assert sheet.nodes(lambda X: [3, 1]).tolist() == [3, 1]
    assert sheet.nodes(len(sheet.X) - 1).tolist() == [len(sheet.X) - 1]


@pytest.mark.parametrize("point", [(1.5, 0.5), (1.34, 1.34), (1.36, 0.0)])
def test_interpolate_outside_limit_is_the_distance_to_the_triangle(point):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.25, "right")
    with pytest.raises(fc.MeshError, match="must lie on the cloth"):
        cloth.interpolate(cloth.X, [point])
    assert cloth.interpolate(cloth.X, [(1.3, 0.5)]) == pytest.approx(np.array([[1.3, 0.5]]))
