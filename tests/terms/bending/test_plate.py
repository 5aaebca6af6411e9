"""`PlateBending` against exact solutions of thin plates, on regular and irregular meshes."""

import numpy as np
import pytest
import scipy.linalg
from support.plates import (
    BENDING,
    PATTERNS,
    deflection,
    navier,
    plate,
    sides,
    square,
    transverse,
    uniform_load,
)
from support.tiers import slow_except

import fecloth as fc

ISOTROPIC = fc.Fabric(**BENDING, bending_poisson_ratio=0.3)
ORTHOTROPIC = fc.Fabric(  # D11, D22, D12, D66 = 4, 1, 0.4, 0.6
    1.0, 1e3, bending_rigidity=(4.0, 1.0), bending_poisson_ratio=0.2, bias_rigidity=2.05
)


def test_rigidity_of_the_orthotropic_fabric():
    assert ORTHOTROPIC.plate() == pytest.approx(np.array([[4, 0.4, 0], [0.4, 1, 0], [0, 0, 0.6]]))


@pytest.mark.parametrize("fabric", [ISOTROPIC, ORTHOTROPIC], ids=["isotropic", "orthotropic"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_constant_curvature_is_a_solution_on_any_mesh(pattern, fabric):
    """The patch test: held as a quadratic in a band, the free nodes inside lie on it too."""
    n = 14
    cloth = square(pattern, n)
    system = plate(cloth, fabric)
    X = cloth.X
    held = ((4.2 / n > X) | (1 - 4.2 / n < X)).any(axis=1)
    assert (~held).sum() > 8
    for a, b, c in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0.3, -0.5, 0.8)):
        exact = 0.5 * a * X[:, 0] ** 2 + 0.5 * b * X[:, 1] ** 2 + c * X[:, 0] * X[:, 1]
        w = deflection(system, np.zeros(len(X)), held, exact)
        assert abs(w - exact).max() < 1e-10 / n**2


@pytest.mark.parametrize("fabric", [ISOTROPIC, ORTHOTROPIC], ids=["isotropic", "orthotropic"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_only_affine_deflections_have_no_energy(pattern, fabric):
    system = plate(square(pattern, 6), fabric)
    values = np.linalg.eigvalsh(transverse(system).toarray())
    assert abs(values[:3]).max() < 1e-10 * values[-1]
    assert values[3] > 1e-6 * values[-1]


@pytest.mark.parametrize("fabric", [ISOTROPIC, ORTHOTROPIC], ids=["isotropic", "orthotropic"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_force_at_a_corner_twists_a_square_by_P_over_4_D66(pattern, fabric):
    cloth = square(pattern, 8)
    X = cloth.X
    a, b, c, d = (int(np.argmin(np.abs(X - corner).sum(axis=1))) for corner in
                  ((0, 0), (1, 0), (0, 1), (1, 1)))  # fmt: skip
    load, held = np.zeros(len(X)), np.zeros(len(X), bool)
    load[d], held[[a, b, c]] = 1.0, True
    w = deflection(plate(cloth, fabric), load, held)
    assert w[d] == pytest.approx(1 / (4 * fabric.plate()[2, 2]), rel=1e-8)


def supported(pattern, n, fabric, clamp):
    cloth = square(pattern, n)
    system = plate(cloth, fabric, [fc.Pin(sides, clamp=clamp)])
    return cloth, deflection(system, uniform_load(cloth))


def largest_error(pattern, n, fabric):
    cloth, w = supported(pattern, n, fabric, clamp=False)
    exact = navier(cloth.X, fabric.plate())
    return abs(w - exact).max() / exact.max()


@pytest.mark.parametrize("pattern", slow_except(PATTERNS, "unstructured"))
def test_simply_supported_square_converges_with_order_2(pattern):
    room = 1.5 if pattern == "graded" else 1.0
    errors = [largest_error(pattern, n, ISOTROPIC) for n in (16, 32)]
    assert errors[1] < 1.5e-3 * room
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.3


@pytest.mark.parametrize("pattern", slow_except(PATTERNS, "unstructured"))
def test_orthotropic_simply_supported_square_converges(pattern):
    room = 1.5 if pattern == "graded" else 1.0
    errors = [largest_error(pattern, n, ORTHOTROPIC) for n in (16, 32)]
    assert errors[1] < 1.5e-3 * room
    assert np.log2(errors[0] / errors[1]) > 1.8


@pytest.mark.parametrize("pattern", slow_except(PATTERNS, "unstructured"))
def test_clamped_square_converges_with_order_2(pattern):
    """Timoshenko and Woinowsky-Krieger (1959), table 35: 0.00126532 q a⁴/D at the centre."""
    room = 1.5 if pattern == "graded" else 1.0
    errors = []
    for n in (16, 32):
        _, w = supported(pattern, n, ISOTROPIC, clamp=True)
        errors.append(abs(w.max() / 0.00126532 - 1))
    assert errors[1] < 1.3e-2 * room
    lowest = 1.6 if pattern == "graded" else 1.8  # no node of these lies at the centre
    assert lowest < np.log2(errors[0] / errors[1]) < 2.3


def test_clamped_disk_converges_to_q_a4_over_64_D():
    errors = []
    for h in (0.1, 0.05):
        cloth = fc.Cloth.disk(1.0, h)
        system = plate(cloth, ISOTROPIC, [fc.Pin("boundary", clamp=True)])
        errors.append(deflection(system, uniform_load(cloth)).max() * 64 - 1)
    assert abs(errors[1]) < 5e-3
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.3


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_supported_disk_sags_as_its_poisson_ratio_says(nu):
    """(5 + ν)/(1 + ν) q a⁴/(64 D), where hinges carry ν = −1/3 whatever the fabric's."""
    fabric = fc.Fabric(**BENDING, bending_poisson_ratio=nu)
    cloth = fc.Cloth.disk(1.0, 0.05)
    w = deflection(plate(cloth, fabric, ["boundary"]), uniform_load(cloth)).max()
    assert w == pytest.approx((5 + nu) / (1 + nu) / 64, rel=1e-2)


@pytest.mark.parametrize("pattern", slow_except(PATTERNS, "unstructured"))
def test_free_square_vibrates_at_the_frequencies_of_leissa(pattern):
    """Leissa (1973), The free vibration of rectangular plates: ν = 0.3, 13.468, 19.596, 24.271."""
    room = 1.5 if pattern == "graded" else 1.0
    errors = []
    for n in (8, 16):
        system = plate(square(pattern, n), ISOTROPIC)
        K, M = transverse(system).toarray(), np.diag(system.nodal_mass)
        rates = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True, subset_by_index=(3, 5)))
        errors.append(abs(rates / [13.4682, 19.5961, 24.2702] - 1))
    assert errors[1][0] < 4 * 1.8e-3 * room
    assert errors[1][2] < 4 * 4.2e-3 * room
    assert 1.7 < np.log2(errors[0][0] / errors[1][0]) < 2.3


@pytest.mark.parametrize("pattern", PATTERNS[:5])
def test_energy_of_a_cylinder_across_the_mesh(pattern):
    """Nodes on a cylinder of 57°, its axis 20° off the X axis: ½ B κ² over the area, order 2."""
    errors = []
    for n in (10, 20):
        cloth = square(pattern, n)
        system = plate(cloth, ISOTROPIC)
        x = on_cylinder(cloth.X, 1.0, np.radians(20))
        inner = 0.5 * ISOTROPIC.plate()[0, 0]
        # free edges carry no moment, so the energy is taken from the triangles inside
        errors.append(abs(inner_energy(system, x, n) / inner - 1))
    assert errors[1] < 7e-5
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.3


def on_cylinder(X, radius, turn):
    """(n, 3) the nodes rolled without stretch on a cylinder, its axis at `turn` to the X axis."""
    c, s = np.cos(turn), np.sin(turn)
    along, across = X @ [c, s], X @ [-s, c] - 0.3
    y, z = radius * np.sin(across / radius), radius * (1 - np.cos(across / radius))
    return np.column_stack([c * along - s * y, s * along + c * y, z])


def inner_energy(system, x, n):
    """Energy per area of the triangles that are two edges or more away from the sides."""
    from fecloth.mesh.edge_slopes import EdgeSlopes
    from fecloth.terms.bending.plate_stiffness import plate_rigidity

    cloth = system.cloth
    slopes: EdgeSlopes = cloth.edge_slopes
    edges = slopes.edges
    alpha = (slopes.plain @ system.bound[0].plate.measures(x, 0.0)).reshape(-1, 3)
    kappa = np.einsum("eij,ej->ei", edges.curvature_of_slopes, alpha)
    D = plate_rigidity(system.panel, "test")
    density = 0.5 * np.einsum("ei,eij,ej->e", kappa, D, kappa)
    centre = cloth.X[cloth.triangles].mean(axis=1)
    inside = ((centre > 3 / n) & (centre < 1 - 3 / n)).all(axis=1)
    return (density * edges.area)[inside].sum() / edges.area[inside].sum()


@pytest.mark.parametrize(
    ("pattern", "n", "cut"), [("equilateral", 6, None), ("unstructured", 28, 0.5)]
)
def test_any_triangles_may_be_of_another_fabric(pattern, n, cut):
    """The matrix has a block for each weight that a seam or a clamp makes."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, 1 / n, pattern)
    centre = cloth.X[cloth.triangles].mean(axis=1)
    choose = np.random.default_rng(0)
    for _ in range(1 if cut else 20):
        soft = centre[:, 0] < cut if cut else choose.random(len(centre)) < 0.5
        parts = {"soft": np.flatnonzero(soft), "stiff": np.flatnonzero(~soft)}
        two = fc.Cloth.from_arrays(cloth.X, cloth.triangles, regions=parts)
        fabric = {"soft": ISOTROPIC, "stiff": fc.Fabric(1.0, 1e3, bending_rigidity=10.0)}
        pins = [fc.Pin(lambda X: X[:, 0] < 1e-9, clamp=True)]
        K = transverse(plate(two, fabric, pins))
        w = cloth.X[:, 0] ** 2
        assert w @ K @ w > 0.1
