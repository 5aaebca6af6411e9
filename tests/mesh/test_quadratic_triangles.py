"""Quadratic triangles: nodes, sets, mass, load and fields."""

import numpy as np
import pytest
import skfem

import fecloth as fc

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

FABRIC = fc.Fabric(0.2, (1000.0, 600.0), 0.3, 150.0)


def system_on(cloth, *terms):
    return fc.System(cloth, FABRIC, terms)


def test_nodes_are_the_corners_and_the_middles_of_the_edges(quadratic):
    linear = fc.Cloth.rectangle(0.3, 0.2, h=0.1)
    corners = len(linear.X)
    assert np.array_equal(quadratic.X[:corners], linear.X)
    assert np.array_equal(quadratic.triangles, linear.triangles)
    edges = {
        frozenset(pair) for t in linear.triangles for pair in zip(t, np.roll(t, 1), strict=True)
    }
    assert len(quadratic.X) == corners + len(edges)
    middles = {tuple(np.round(linear.X[list(edge)].mean(axis=0), 12)) for edge in edges}
    assert {tuple(x) for x in np.round(quadratic.X[corners:], 12)} == middles
    assert (quadratic.source_nodes[corners:] == -1).all()
    assert np.array_equal(quadratic.source_nodes[:corners], linear.source_nodes)


def test_the_orders_of_a_triangles_nodes(quadratic):
    """Three corners, then the midpoints of 01, 12, 20; `cells` is counter-clockwise."""
    for nodes in (quadratic.stencil, quadratic.cells):
        assert nodes.shape == (len(quadratic.triangles), 6)
        x = quadratic.X[nodes]
        for a, b, middle in ((0, 1, 3), (1, 2, 4), (2, 0, 5)):
            np.testing.assert_allclose(x[:, middle], (x[:, a] + x[:, b]) / 2, atol=1e-15)
    assert np.array_equal(quadratic.cells[:, :3], quadratic.triangles)
    assert (np.sort(quadratic.cells, axis=1) == np.sort(quadratic.stencil, axis=1)).all()


@pytest.mark.parametrize("h", [0.1, 0.2])
@pytest.mark.parametrize("pattern", ["unstructured", "right"])
def test_sets_contain_their_midpoints(pattern, h):
    cloth = fc.Cloth.rectangle(0.3, 0.2, h, pattern, element="P2")
    x, y = cloth.X.T
    on = {"left": x < 1e-9, "right": x > 0.3 - 1e-9, "bottom": y < 1e-9, "top": y > 0.2 - 1e-9}
    for name, inside in on.items():
        assert cloth.nodes(name).tolist() == np.flatnonzero(inside).tolist()
    border = np.flatnonzero(np.any(list(on.values()), axis=0))
    assert cloth.nodes("boundary").tolist() == border.tolist()
    assert len(cloth.nodes("corners")) == 4
    assert cloth.nodes(lambda X: X[:, 0] < 1e-9).tolist() == cloth.nodes("left").tolist()


def test_sets_of_input_arrays_get_their_midpoints():
    """A curve gets its own midpoints; another set gets those between two of its nodes."""
    X = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    triangles = [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)]
    cloth = fc.Cloth.from_arrays(
        X, triangles, {"foot": [0, 1, 2], "two": [0, 5]}, regions={"west": [0, 1]}, element="P2"
    )
    at = {name: sorted(map(tuple, cloth.X[cloth.nodes(name)])) for name in ("foot", "two")}
    assert at["foot"] == [(0, 0), (0.5, 0), (1, 0), (1.5, 0), (2, 0)]
    assert at["two"] == [(0, 0), (2, 1)]
    assert len(cloth.nodes("boundary")) == 12
    assert len(cloth.region("west")) == 2


def test_mass_and_load(quadratic):
    """∫ N_a N_b of a triangle of area 1: 6, −1, −4, 32 and 16 over 180; ∫ N_a: 0 and 1/3."""
    triangle = fc.Cloth.from_arrays(
        [(0, 0), (2, 0), (0, 1)], [(0, 1, 2)], renumber=False, element="P2"
    )
    M = np.full((6, 6), 16.0)
    M[:3, :3], M[:3, 3:], M[3:, :3] = -1, 0, 0
    M[range(6), range(6)] = [6, 6, 6, 32, 32, 32]
    for corner, opposite in ((0, 4), (1, 5), (2, 3)):
        M[corner, opposite] = M[opposite, corner] = -4
    nodes = triangle.stencil[0]
    np.testing.assert_allclose(triangle.mass().toarray()[np.ix_(nodes, nodes)], M / 180, atol=1e-12)
    np.testing.assert_allclose(triangle.load()[nodes], [0, 0, 0, 1 / 3, 1 / 3, 1 / 3], atol=1e-12)
    basis = skfem.Basis(quadratic.mesh, skfem.ElementTriP2(), intorder=8)
    form = skfem.BilinearForm(lambda u, v, w: 0.2 * u * v).assemble(basis).toarray()
    mass = system_on(quadratic).scalar_mass.toarray()
    np.testing.assert_allclose(mass, form, rtol=0, atol=1e-12 * np.abs(form).max())
    system = system_on(quadratic)
    assert system.mass_kind == "consistent"
    assert system.diagonal_mass.min() > 0
    assert system.diagonal_mass.sum() == pytest.approx(0.2 * 0.06, rel=1e-12)
    f = quadratic.load(lambda X: np.column_stack([X[:, 0] ** 3, X[:, 1], 0 * X[:, 0]]))
    np.testing.assert_allclose(f.sum(axis=0), [0.3**4 / 4 * 0.2, 0.3 * 0.02, 0], atol=1e-15)
    moment = quadratic.X[:, 0] @ f  # X is in the space: Σ X_a f_a = ∫ X f dA
    np.testing.assert_allclose(moment, [0.3**5 / 5 * 0.2, 0.045 * 0.02, 0], atol=1e-15)


def test_fields_between_cloths_of_two_elements():
    """P2 represents a quadratic polynomial exactly; two integrals give the same error of P1."""
    coarse = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right", element="P2")
    linear = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right")
    square = lambda X: X[:, 0] ** 2 - X[:, 0] * X[:, 1]  # noqa: E731
    slope = lambda X: np.column_stack([2 * X[:, 0] - X[:, 1], -X[:, 0]])  # noqa: E731
    u, w = square(coarse.X), square(linear.X)
    assert coarse.l2_error(u, square) < 1e-14
    assert coarse.h1_error(u, slope) < 1e-13
    errors = linear.l2_error(w, square), linear.h1_error(w, slope)
    assert min(errors) > 0.01
    differences = coarse.l2_difference(linear, u, w), coarse.h1_difference(linear, u, w)
    assert differences == pytest.approx(errors, rel=1e-12)
    points = np.random.default_rng(5).uniform(size=(50, 2))
    np.testing.assert_allclose(coarse.interpolate(u, points), square(points), atol=1e-14)
    assert coarse.l2_norm(u) ** 2 == pytest.approx(1 / 5 - 2 / 8 + 1 / 9, rel=1e-12)


def test_the_area_of_a_disk_has_order_two_and_with_curved_edges_four():
    for element, order in (("P1", 2), ("P2", 4)):
        missing = [np.pi - fc.Cloth.disk(1.0, h, element=element).area for h in (0.2, 0.1)]
        assert order - 0.2 < np.log2(missing[0] / missing[1]) < order + 0.2


def test_only_the_edges_along_the_border_of_a_disk_are_curved():
    disk = fc.Cloth.disk(0.5, 0.1, element="P2")
    border = disk.nodes("boundary")
    np.testing.assert_allclose(np.hypot(*disk.X[border].T), 0.5, rtol=1e-14)
    cells = disk.cells
    for a, b, middle in ((0, 1, 3), (1, 2, 4), (2, 0, 5)):
        bulge = disk.X[cells[:, middle]] - (disk.X[cells[:, a]] + disk.X[cells[:, b]]) / 2
        is_curved = np.linalg.norm(bulge, axis=1) > 1e-9
        assert np.array_equal(is_curved, np.isin(cells[:, middle], border))


def test_integrals_and_values_on_curved_triangles():
    """∫ X² dA = π r⁴/4 of a disk; a linear field is exact, also beyond the chords."""
    disk = fc.Cloth.disk(0.5, 0.1, element="P2")
    exact = np.pi * 0.5**4 / 4
    assert disk.l2_norm(disk.X[:, 0]) ** 2 == pytest.approx(exact, rel=2e-5)
    assert disk.load(lambda X: X[:, 0] ** 2).sum() == pytest.approx(exact, rel=2e-5)
    for kind in ("lumped", "consistent"):
        assert disk.mass(kind).sum() == pytest.approx(disk.area, rel=1e-12)
    angles = np.linspace(0, 2 * np.pi, 40)
    points = 0.4999 * np.column_stack([np.cos(angles), np.sin(angles)])
    np.testing.assert_allclose(disk.interpolate(disk.X, points), points, atol=1e-12)
    linear = disk.X @ [2.0, -3.0]
    assert disk.h1_error(linear, lambda X: np.tile([2.0, -3.0], (len(X), 1))) < 1e-11


def test_a_uniform_strain_on_curved_triangles():
    """Of the pointwise strain a uniform stress is in balance; the interpolated one is near it."""
    unbalanced = {}
    for strain in ("pointwise", "interpolated"):
        for h in (0.1, 0.05):
            disk = fc.Cloth.disk(0.5, h, element="P2")
            system = system_on(disk, fc.StVK(strain=strain))
            x = disk.X @ np.array([[1.02, 0.01, 0], [0.03, 0.99, 0]])
            force = system.force(system.state(x))
            free = np.setdiff1d(np.arange(len(x)), disk.nodes("boundary"))
            unbalanced[strain, h] = np.abs(force[free]).max() / np.abs(force).max()
    assert max(unbalanced["pointwise", h] for h in (0.1, 0.05)) < 1e-11
    assert unbalanced["interpolated", 0.1] < 0.002
    assert unbalanced["interpolated", 0.05] < 0.4 * unbalanced["interpolated", 0.1]
