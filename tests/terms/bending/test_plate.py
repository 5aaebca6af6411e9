"""`PlateBending` against exact solutions of thin plates, on regular and irregular meshes."""

import numpy as np
import pytest
from support.plates import (
    BENDING,
    PATTERNS,
    deflection,
    navier,
    on_sides,
    plate,
    square,
    transverse,
    uniform_load,
)
from support.tiers import stories_except

import fecloth as fc


def on_cylinder(X, radius, turn):
    """(n, 3) the nodes rolled without stretch on a cylinder, its axis at `turn` to the X axis."""
    c, s = np.cos(turn), np.sin(turn)
    along, across = X @ [c, s], X @ [-s, c] - 0.3
    y, z = radius * np.sin(across / radius), radius * (1 - np.cos(across / radius))
    return np.column_stack([c * along - s * y, s * along + c * y, z])


def inner_energy(system, x):
    """Energy per area of the triangles that are 0.15 or more away from the sides."""
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
    inside = ((centre > 0.15) & (centre < 0.85)).all(axis=1)
    return (density * edges.area)[inside].sum() / edges.area[inside].sum()


ISOTROPIC = fc.Fabric(**BENDING, bending_poisson_ratio=0.3)
ORTHOTROPIC = fc.Fabric(  # D11, D22, D12, D66 = 4, 1, 0.4, 0.6
    1.0, 1e3, bending_rigidity=(4.0, 1.0), bending_poisson_ratio=0.2, bias_rigidity=2.05
)


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
    assert abs(values[:3]).max() < 1e-8 * values[3]


def uniformly_loaded(pattern, n, fabric, edges):
    """The cloth, and the deflection of the square under the load 1."""
    cloth = square(pattern, n)
    system = plate(cloth, fabric, [fc.Pin(on_sides, clamp=edges == "clamped")])
    return cloth, deflection(system, uniform_load(cloth))


def sizes(pattern):
    """Graded meshes have three times as many nodes along a side."""
    return (8, 16) if pattern == "graded" else (32, 64)


def at_32(errors):
    """The error on edges of 1/32; that at 16 over 4 if there is none."""
    return errors.get(32, errors[16] / 4 if 16 in errors else np.nan)


@pytest.mark.parametrize("pattern", stories_except(PATTERNS, "unstructured"))
def test_orthotropic_supported_square_converges_to_navier(pattern):
    errors = {}
    for n in sizes(pattern):
        cloth, w = uniformly_loaded(pattern, n, ORTHOTROPIC, "supported")
        exact = navier(cloth.X, ORTHOTROPIC.plate())
        errors[n] = abs(w - exact).max() / exact.max()
    assert at_32(errors) < 1.0e-3
    first, second = errors.values()
    assert 1.8 < np.log2(first / second) < 2.3


@pytest.mark.parametrize(
    ("nu", "element", "h"), [(0.0, "P1", 0.05), (0.3, "P1", 0.05), (0.3, "P2", 0.1)]
)
def test_supported_disk_sags_as_its_poisson_ratio_says(nu, element, h):
    """(5 + ν)/(1 + ν) q a⁴/(64 D), where hinges carry ν = −1/3 whatever the fabric's.

    All nodes of the border are held, on P2 with the midpoints of its curved edges.
    """
    fabric = fc.Fabric(**BENDING, bending_poisson_ratio=nu)
    cloth = fc.Cloth.disk(1.0, h, element=element)
    w = deflection(plate(cloth, fabric, ["boundary"]), uniform_load(cloth)).max()
    assert w == pytest.approx((5 + nu) / (1 + nu) / 64, rel=1e-2)


def test_rigidity_of_the_orthotropic_fabric():
    assert ORTHOTROPIC.plate() == pytest.approx(np.array([[4, 0.4, 0], [0.4, 1, 0], [0, 0, 0.6]]))


@pytest.mark.parametrize("pattern", stories_except(PATTERNS, "right"))
def test_energy_of_a_cylinder_across_the_mesh(pattern):
    """Nodes on a cylinder of 57°, its axis 20° off the X axis: ½ B κ² over the area, order 2."""
    errors = []
    for n in (20, 40):
        cloth = square(pattern, n)
        system = plate(cloth, ISOTROPIC)
        x = on_cylinder(cloth.X, 1.0, np.radians(20))
        inner = 0.5 * ISOTROPIC.plate()[0, 0]
        # free edges carry no moment, so the energy is taken from the triangles inside
        errors.append(abs(inner_energy(system, x) / inner - 1))
    assert errors[0] < 7e-5
    assert 1.9 < np.log2(errors[0] / errors[1]) < 2.2
