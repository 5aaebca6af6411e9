"""The recovered stress at a point and at the nodes, against a closed form."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.mesh.recovered_strain import edges_of
from fecloth.system.recovered_stress import (
    along_axes,
    nodal_places,
    stress_at_nodes,
    stress_at_point,
)

Y, NU = 1000.0, 0.3
K = 2.0  # of the displacement: 1/m
SMALL = 1e-7
STRETCH = 1.01  # keeps the sheet taut, so that it stays flat
TABLE = np.array([[1.0, 0.0], [1.05, 20.0], [1.2, 200.0]])  # stretch, force [N/m]
SHEAR = np.array([[0.0, 0.0], [0.1, 3.0], [0.3, 20.0]])  # angle, force [N/m]
INSIDE = 0.25 + 0.5 * np.random.default_rng(0).random((20, 2))


def displaced(X):
    """s X + ∇φ with φ = c e^(K X) cos(K Y): no divergence, no curl, so that no force is needed."""
    growth = SMALL * K * np.exp(K * X[:, 0])
    x = STRETCH * np.pad(X, ((0, 0), (0, 1)))
    x[:, 0] += growth * np.cos(K * X[:, 1])
    x[:, 1] -= growth * np.sin(K * X[:, 1])
    return x


def exact(X):
    """S = ℂ : E of s I + ∇∇φ, to the first order in φ: (p, 3) xx, yy, xy [N/m]."""
    even = Y / (1 - NU) * (STRETCH**2 - 1) / 2
    curved = SMALL * K**2 * np.exp(K * X[:, 0])
    shear_modulus = Y / (2 * (1 + NU))
    xx = 2 * shear_modulus * STRETCH * curved * np.cos(K * X[:, 1])
    xy = -2 * shear_modulus * STRETCH * curved * np.sin(K * X[:, 1])
    return np.column_stack([even + xx, even - xx, xy])


def solved(element, h, pattern="unstructured", grain=0.0, term=None):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h, pattern=pattern, element=element)
    fabric = fc.Fabric(0.2, Y, NU)
    terms = [term or fc.StVK()]
    system = fc.System(cloth, fabric, terms, [fc.Pin("boundary")], grain=grain)
    return system, fc.equilibrium(system, system.state(displaced(cloth.X)), tolerance=1e-11)


def errors(element, h, pattern):
    """The errors inside: at points, and at the nodes of the middle."""
    system, rest = solved(element, h, pattern)
    X = system.cloth.X
    scale = np.abs(exact(INSIDE)[:, 2]).max()  # of what varies
    at = np.array([stress_at_point(system, point)(rest.x)[0] for point in INSIDE])
    nodes = (np.abs(X - 0.5) < 0.25).all(axis=1)
    nodal = stress_at_nodes(system)(rest.x)[nodes] - exact(X[nodes])
    return [np.sqrt(np.mean(gap**2)) / scale for gap in (at - exact(INSIDE), nodal)]


@pytest.mark.parametrize("pattern", ["right", "cross", "equilateral", "unstructured"])
@pytest.mark.parametrize(("element", "least", "largest"), [("P1", 1.5, 0.01), ("P2", 2.5, 2e-4)])
def test_the_order_inside(element, least, largest, pattern):
    coarse, fine = np.array([errors(element, h, pattern) for h in (1 / 7, 1 / 20)])
    assert (np.log(coarse / fine) / np.log(20 / 7) >= least).all()
    assert (fine < largest).all()


@pytest.mark.parametrize("strain", ["interpolated", "pointwise"])
def test_the_axes_are_x_and_y_whatever_the_grain(strain):
    at = []
    for grain in (0.0, 0.7):
        system, rest = solved("P2", 0.1, grain=grain, term=fc.StVK(strain=strain))
        at.append(stress_at_point(system, (0.4, 0.3))(rest.x)[0])
    assert at[1] == pytest.approx(at[0], rel=1e-6)
    assert at[0] == pytest.approx(exact(np.array([[0.4, 0.3]]))[0], rel=1e-3)


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("pattern", ["right", "unstructured"])
def test_polynomials_are_recovered_exactly_also_at_the_border(element, pattern):
    """On P1 linear strains, of what the edges have of them; on P2 gradients of cubic positions."""
    cloth = fc.Cloth.rectangle(1.0, 0.7, h=0.25, pattern=pattern, element=element)
    system = fc.System(cloth, fc.Fabric(0.2, Y, NU), [fc.StVK()])
    places = nodal_places(system.panel)
    X, Y_ = cloth.X[places.mean.tocoo().row].T  # one row or more of each node
    if element == "P1":
        edges, _ = edges_of(cloth.triangles)
        x, y = cloth.X[edges].mean(axis=1).T
        along = cloth.X[edges[:, 1]] - cloth.X[edges[:, 0]]
        c, s = (along / np.linalg.norm(along, axis=1)[:, None]).T
        strains = c * c * (2 * x - 3 * y) + s * s * (1 - y) + 2 * c * s * (x + 4 * y)
        exact_values = 2 * X - 3 * Y_, 1 - Y_, X + 4 * Y_
        for matrix, values in zip(places.matrices, exact_values, strict=True):
            assert matrix @ strains == pytest.approx(values, abs=1e-9)
        return
    x, y = cloth.X.T
    along_x, along_y = (matrix @ (x**3 - x * y**2) for matrix in places.matrices)
    assert along_x == pytest.approx(3 * X**2 - Y_**2, abs=1e-9)
    assert along_y == pytest.approx(-2 * X * Y_, abs=1e-9)


MEMBRANES = [
    fc.StVK(),
    fc.NeoHookean(),
    fc.TensorCondition(50.0),
    fc.TensionField(),
    fc.BaraffWitkin(),
    fc.MembraneTable(warp=TABLE, weft=TABLE, shear=SHEAR),
]


@pytest.mark.parametrize("term", MEMBRANES, ids=lambda term: type(term).__name__)
def test_of_an_even_strain_it_is_the_stress_of_the_triangles(term):
    """On two regions with other grains; where they meet it is the mean of both sides."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    left = cloth.X[cloth.triangles].mean(axis=1)[:, 0] < 0.5
    regions = {"left": np.flatnonzero(left), "right": np.flatnonzero(~left)}
    cloth = fc.Cloth.from_arrays(cloth.X, cloth.triangles, regions=regions, renumber=False)
    left = np.isin(np.arange(len(left)), cloth.region("left"))
    grain = {"left": 0.3, "right": -0.2}
    fabric = fc.Fabric(0.2, (Y, 700.0), 0.2, shear_stiffness=60.0)
    if isinstance(term, fc.NeoHookean | fc.TensionField):
        fabric = fc.Fabric(0.2, Y, NU)
    system = fc.System(cloth, fabric, [term], grain=grain)
    x = cloth.X @ np.array([[1.05, 0.02, 0.1], [0.0, 1.01, 0.05]])
    out = np.zeros((len(cloth.triangles), 4))
    system.bound[0].add_stress(x, out)
    S = along_axes(out[:, :3], system.panel.grain)
    nodes = stress_at_nodes(system)(x)
    sides = S[left][0], S[~left][0]
    for X, expected in ((0.0, sides[0]), (0.5, np.mean(sides, axis=0)), (1.0, sides[1])):
        on = cloth.X[:, 0] == X
        assert nodes[on] == pytest.approx(np.tile(expected, (on.sum(), 1)))


def test_a_region_says_which_of_two_pieces_or_fabrics_is_meant():
    layer = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    cloth = fc.Cloth.join([layer, layer], ["top", "apron"])
    system = fc.System(cloth, fc.Fabric(0.2, Y), [fc.StVK()])
    stretch = np.repeat([1.1, 1.2], len(layer.X))
    x = stretch[:, None] * system.rest().x
    for name, s in (("top", 1.1), ("apron", 1.2)):
        at = stress_at_point(system, (0.3, 0.3), name)(x)[0]
        assert at == pytest.approx([Y * (s**2 - 1) / 2] * 2 + [0.0], abs=1e-9)
    left = layer.X[layer.triangles].mean(axis=1)[:, 0] < 0.5
    regions = {"left": np.flatnonzero(left), "right": np.flatnonzero(~left)}
    cloth = fc.Cloth.from_arrays(layer.X, layer.triangles, regions=regions)
    fabrics = {"left": fc.Fabric(0.2, Y), "right": fc.Fabric(0.2, 2 * Y)}
    system = fc.System(cloth, fabrics, [fc.StVK()])
    x = 1.1 * system.rest().x
    sides = [stress_at_point(system, (0.5, 0.3), side)(x)[0, 0] for side in regions]
    assert sides == pytest.approx([Y * 0.105, 2 * Y * 0.105])


def test_two_membranes_add_up():
    single = solved("P1", 0.25)[0]
    x = displaced(single.cloth.X)
    two = fc.System(single.cloth, single.fabric, [fc.StVK(), fc.StVK()])
    assert stress_at_nodes(two)(x) == pytest.approx(2 * stress_at_nodes(single)(x))


def test_a_turned_tensor():
    angle = 0.4
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    S = np.array([[3.0, 0.7], [0.7, -1.0]])
    turned = R @ S @ R.T
    given = np.array([[[S[0, 0], S[1, 1], S[0, 1]]]])
    expected = [turned[0, 0], turned[1, 1], turned[0, 1]]
    assert along_axes(given, np.array([angle]))[0, 0] == pytest.approx(expected)
