"""Forces on edges: patch tests and closed forms."""

import numpy as np
import pytest
from conftest import affine, flat, rough
from support.tiers import in_turn

import fecloth as fc
from fecloth.errors import InputError

PATTERNS = ["unstructured", "right", "cross", "equilateral"]
ELEMENTS = ["P1", "P2"]
SIDES = {"left": (-1, 0), "right": (1, 0), "bottom": (0, -1), "top": (0, 1)}
TURN = fc.Rotation((0, 0, 0), (1.0, 2.0, -0.5), "t").matrix(0.7)


def force_of(term, cloth, fabric, x=None, start=None, t=0.0):
    start = None if start is None else fc.State(0.0, start, 0 * start)
    system = fc.System(cloth, fabric, [term], start=start)
    return system.force(system.state(flat(cloth) if x is None else x, t=t))


# --- the patch test -------------------------------------------------------------------------------


@pytest.mark.parametrize(("pattern", "element"), in_turn(PATTERNS, ELEMENTS))
def test_a_uniform_stress_is_balanced_on_any_mesh(pattern, element, orthotropic):
    """P N on each side against the force of a membrane in a uniform deformation."""
    cloth = fc.Cloth.rectangle(0.7, 0.45, 0.12, pattern, element)
    F = np.array([[1.1, 0.2], [0.05, 0.95], [0.3, -0.1]])
    x = affine(cloth, F)
    E = (F.T @ F - np.eye(2)) / 2
    C11, C22, C66, C12, C16, C26 = orthotropic.moduli()
    S11, S22, S12 = np.array([[C11, C12, C16], [C12, C22, C26], [C16, C26, C66]]) @ [
        E[0, 0],
        E[1, 1],
        2 * E[0, 1],
    ]
    P = F @ np.array([[S11, S12], [S12, S22]])
    loads = [fc.EdgeForce(side, tuple(P @ N)) for side, N in SIDES.items()]
    system = fc.System(cloth, orthotropic, [fc.StVK(), *loads])
    residual = system.force(system.state(x))
    membrane = fc.System(cloth, orthotropic, [fc.StVK()]).force(system.state(x))
    assert abs(membrane).max() > 1.0
    assert abs(residual).max() < 1e-12 * abs(membrane).max()


# --- dead forces ----------------------------------------------------------------------------------


@pytest.mark.parametrize("element", ELEMENTS)
def test_shares_of_an_edge(element, isotropic):
    """½, ½ of an edge of P1; 1/6, 4/6, 1/6 of an edge of P2."""
    cloth = fc.Cloth.rectangle(1.0, 0.2, 0.2, "right", element)
    f = force_of(fc.EdgeForce("right", (3.0, 0, -1.0)), cloth, isotropic)
    nodes = cloth.nodes("right")[np.argsort(cloth.X[cloth.nodes("right"), 1])]
    shares = {"P1": [1 / 2, 1 / 2], "P2": [1 / 6, 4 / 6, 1 / 6]}[element]
    np.testing.assert_allclose(f[nodes], np.outer(shares, [0.6, 0, -0.2]), atol=1e-15)
    assert np.count_nonzero(f.any(axis=1)) == len(nodes)


@pytest.mark.parametrize(
    ("side", "element", "follow"), in_turn(list(SIDES), ELEMENTS, [False, False, True, True])
)
def test_normal_and_tangent_on_a_turned_flat_cloth(side, element, follow, isotropic):
    """Outward and counter-clockwise on each side, as the cloth lies."""
    cloth = fc.Cloth.rectangle(0.7, 0.45, 0.15, element=element)
    x = flat(cloth) @ TURN.T
    n = np.array([*SIDES[side], 0.0])
    along = np.cross([0, 0, 1.0], n)
    length = 0.45 if side in ("left", "right") else 0.7
    term = fc.EdgeForce(side, normal=4.0, tangent="3 * t", follow=follow)
    f = force_of(term, cloth, isotropic, x, start=x, t=2.0)
    expected = length * (4.0 * TURN @ n + 6.0 * TURN @ along)
    np.testing.assert_allclose(f.sum(axis=0), expected, atol=1e-12)


def test_a_dead_force_keeps_its_length_and_direction(sheet, isotropic, rng):
    for term in (fc.EdgeForce("top", (1.0, 2, 3)), fc.EdgeForce("top", normal=2.0, tangent=1.0)):
        f = force_of(term, sheet, isotropic)
        moved = force_of(term, sheet, isotropic, rough(sheet, rng))
        assert np.array_equal(f, moved)
        assert f.any()


def test_which_edges_are_loaded(isotropic):
    """Names, indices and predicates; of an inner curve both sides are one edge."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, 0.25, "right")
    line = cloth.nodes(lambda X: abs(X[:, 0] - 0.5) < 1e-9)
    pairs = np.sort(np.stack([line[:-1], line[1:]], axis=1), axis=1)
    cloth.edge_sets["middle"], cloth.node_sets["middle"] = pairs, line
    for where, length in (
        ("right", 0.5),
        (cloth.nodes("right").tolist(), 0.5),
        (lambda X: X[:, 0] > 0.7, 1.0),  # the right side, and an edge of 0.25 m above and below
        ("middle", 0.5),
    ):
        f = force_of(fc.EdgeForce(where, (0, 0, 2.0)), cloth, isotropic)
        assert f.sum(axis=0)[2] == pytest.approx(2 * length, rel=1e-13)
    with pytest.raises(InputError, match="inside the cloth has two sides"):
        force_of(fc.EdgeForce("middle", normal=1.0), cloth, isotropic)


# --- forces that follow ---------------------------------------------------------------------------


def test_a_curved_edge_of_quadratic_triangles(isotropic):
    """On a side bent to a parabola y = c s(1 − s) the resultant of a normal force p is p times the
    chord turned by 90°, and its moment is that of exact integrals."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, 1.0, "right", "P2")
    x = flat(cloth)
    c, p = 0.8, 3.0
    s = x[:, 1].copy()
    x[:, 0] += np.where(x[:, 0] > 0.9, c * s * (1 - s), 0.0)
    f = force_of(fc.EdgeForce("right", normal=p, follow=True), cloth, isotropic, x)
    np.testing.assert_allclose(f.sum(axis=0), [p, 0, 0], atol=1e-12)
    moment = np.cross(x, f).sum(axis=0)[2]
    # n ds = (ds, −dx): M = ∫ x n_y − y n_x ds = −∫ (1 + X) X′ ds − ∫ s ds with X = c s (1 − s)
    assert moment == pytest.approx(-p / 2, abs=1e-12)
    middle = force_of(fc.EdgeForce("right", (0, 0, 1.0), follow=True), cloth, isotropic, x)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    arc = weights / 2 @ np.sqrt(1 + (c * (1 - (1 + nodes))) ** 2)
    assert middle.sum(axis=0)[2] == pytest.approx(arc, rel=5e-3)


# --- in time --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "load",
    [
        {"force": lambda t: [t, 0.0, 2 * t]},
        {"force": ("t", 0, "2 * t")},
        {"normal": lambda t: 3 * t, "tangent": 1.0},
        {"normal": "3 * t", "tangent": lambda t: 1.0},
        {"normal": "3 * t", "tangent": 1.0, "follow": True},
        {"force": lambda t: [t, 0.0, 2 * t], "follow": True},
    ],
)
def test_numbers_formulas_and_functions_of_time(load, sheet, isotropic, rng):
    x = rough(sheet, rng)
    f = force_of(fc.EdgeForce("right", **load), sheet, isotropic, x, t=0.5)
    at = {
        "force": {"force": (0.5, 0.0, 1.0)},
        "normal": {"normal": 1.5, "tangent": 1.0},
    }[next(iter(load))]
    fixed = fc.EdgeForce("right", **at, follow=load.get("follow", False))
    np.testing.assert_allclose(f, force_of(fixed, sheet, isotropic, x), rtol=1e-14)
