"""`PlateBending` against exact solutions of thin plates, on regular and irregular meshes."""

import numpy as np
import pytest
import scipy.sparse
from scipy.sparse.linalg import eigsh
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
from support.tiers import in_turn, stories_except

import fecloth as fc
from studies.references import plates

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


@pytest.mark.stories
@pytest.mark.parametrize(
    ("pattern", "edges", "limit"),
    in_turn(PATTERNS, ["supported", "clamped"], [1.5e-3, 1.3e-2]),
)
def test_square_under_a_uniform_load_converges_with_order_2(pattern, edges, limit):
    """The largest error of w at n = 32 over the largest w, against Ritz's method."""
    errors = {}
    for n in sizes(pattern):
        cloth, w = uniformly_loaded(pattern, n, ISOTROPIC, edges)
        exact = plates.square_deflection(cloth.X, ISOTROPIC.plate(), edges)
        errors[n] = abs(w - exact).max() / exact.max()
    assert at_32(errors) < limit
    first, second = errors.values()
    assert 1.9 < np.log2(first / second) < 2.2


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
    ("h", "limit"), [(0.05, 5e-3), pytest.param(0.025, 1.3e-3, marks=pytest.mark.stories)]
)
def test_clamped_disk_converges_to_its_closed_form(h, limit):
    errors = []
    for size in (2 * h, h):
        cloth = fc.Cloth.disk(1.0, size)
        system = plate(cloth, ISOTROPIC, [fc.Pin("boundary", clamp=True)])
        w, exact = deflection(system, uniform_load(cloth)), plates.disk_deflection(cloth.X, 1.0)
        errors.append(abs(w - exact).max() / exact.max())
    assert errors[1] < limit
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.2


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


@pytest.mark.parametrize("pattern", stories_except(PATTERNS, "unstructured"))
def test_free_square_vibrates_at_the_frequencies_of_ritz(pattern):
    """The first and the third at n = 32, with lumped mass."""
    exact = plates.square_frequencies(ISOTROPIC.plate(), "free", 3)
    sizes = (8, 16) if pattern == "graded" else (16, 32)
    room = 4 if pattern == "graded" else 1
    errors = []
    for n in sizes:
        system = plate(square(pattern, n), ISOTROPIC)
        M = scipy.sparse.diags(system.nodal_mass).tocsc()
        squares = eigsh(transverse(system), 6, M, sigma=-1.0, return_eigenvectors=False)
        errors.append(abs(np.sqrt(np.sort(squares)[3:]) / exact - 1))
    assert errors[1][0] < 1.8e-3 * room
    assert errors[1][2] < 4.2e-3 * room
    assert 1.9 < np.log2(errors[0][0] / errors[1][0]) < 2.1
