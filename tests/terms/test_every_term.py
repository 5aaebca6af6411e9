"""What holds for every term: internal forces, definite tangents, bounds of the fastest rates."""

import numpy as np
import pytest
import scipy.linalg
from conftest import affine, flat, rough

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.stability.critical_step import rate_bounds

ISOTROPIC = fc.Fabric(0.2, 1000.0, 0.3)
RUBBER = fc.Fabric(0.2, 900.0, 0.3)
WOVEN = fc.Fabric(0.15, (2000.0, 900.0), 0.2, 60.0, bending_rigidity=(4e-5, 1e-5))
PATTERNS = ["unstructured", "right", "cross", "equilateral"]
SPRINGS = ("structural", "van_gelder", "biquadratic")
WIND = {
    law: fc.Wind((1.0, 2.0, 3.0), 0.7, 0.1, law, tangent="exact") for law in ("linear", "quadratic")
}


def named(rows):
    """Parameters with a term's text for the id."""
    return [pytest.param(*row, id=str(row[0])) for row in rows]


INTERNAL = [
    (fc.StVK(), WOVEN),
    (fc.TensorCondition(250.0), WOVEN),
    (fc.BaraffWitkin(damping=0.02), WOVEN),
    (fc.NeoHookean(), RUBBER),
    (fc.NeoHookean("compressible"), RUBBER),
    (fc.TensionField(), ISOTROPIC),
    (fc.MembraneTable([(1.1, 50.0), (1.3, 400.0)], poisson=0.2), WOVEN),
    *((fc.Springs(kind, damping=0.01), ISOTROPIC) for kind in SPRINGS),
    (fc.HingeBending(0.2), WOVEN),
    (fc.QuadraticBending(), WOVEN),
    (fc.StrainRateDamping(0.02), WOVEN),
    (fc.BendingDamping(0.01), WOVEN),
]


@pytest.mark.parametrize(("term", "fabric"), named(INTERNAL))
def test_internal_forces_have_no_resultant_and_turn_with_the_cloth(term, fabric, sheet, rng):
    system = fc.System(sheet, fabric, [term])
    state = system.state(rough(sheet, rng), rng.standard_normal((len(sheet.X), 3)))
    force = system.force(state)
    size = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-14 * size
    assert np.abs(np.cross(state.x, force).sum(axis=0)).max() < 1e-14 * size
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turn *= np.linalg.det(turn)
    moved = system.state(state.x @ turn + [1.0, -2.0, 3.0], state.v @ turn)
    np.testing.assert_allclose(system.force(moved), force @ turn, atol=1e-11 * abs(force).max())
    for name, energy in system.energies(state).items():
        assert system.energies(moved)[name] == pytest.approx(energy, rel=1e-11)


@pytest.mark.parametrize(("term", "fabric"), named(INTERNAL))
def test_a_rigid_motion_meets_no_force(term, fabric, sheet, rng):
    if isinstance(term, fc.HingeBending):
        term = fc.HingeBending()  # at rest where it is flat
    system = fc.System(sheet, fabric, [term])
    force = system.force(system.state(rough(sheet, rng), rng.standard_normal((len(sheet.X), 3))))
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    x, spin = flat(sheet) @ turn + [1.0, 2.0, 3.0], rng.standard_normal(3)
    rigid = system.state(x, np.cross(spin, x) + [0.3, 0.1, 2.0])
    assert abs(system.force(rigid)).max() < 1e-12 * abs(force).max()
    assert sum(system.energies(system.state(x)).values()) < 1e-24


@pytest.mark.parametrize("term", [fc.StrainRateDamping(0.02), fc.BendingDamping(0.02)], ids=repr)
def test_a_rigid_motion_of_a_deformed_cloth_is_not_damped(term, sheet, rng):
    system = fc.System(sheet, WOVEN, [term])
    x, spin = rough(sheet, rng), rng.standard_normal(3)
    rigid = system.force(system.state(x, np.cross(spin, x) + [1.0, -2.0, 0.5]))
    other = system.force(system.state(x, rng.standard_normal(x.shape)))
    assert abs(rigid).max() < 1e-12 * abs(other).max()


# --- definite tangents: conjugate gradients serve where they are used -----------------------------

CRUMPLED, TAUT = 0.5, 1.0  # of the size at rest
SKEW = [
    (fc.BaraffWitkin(damping=0.01, tangent="exact"), WOVEN, CRUMPLED),
    (fc.StrainRateDamping(0.02, tangent="exact"), WOVEN, TAUT),
    *((fc.Springs(k, damping=0.01, tangent="exact"), ISOTROPIC, CRUMPLED) for k in SPRINGS),
    *((wind, ISOTROPIC, TAUT) for wind in WIND.values()),
    (fc.Wind((0.0, "2 * x", 5.0), normal=1.2, tangent="exact"), ISOTROPIC, TAUT),
    (
        fc.UserForce(("90 * y - 200 * z", "100 * x - 50 * vy", "-100 * z"), tangent="exact"),
        ISOTROPIC,
        TAUT,
    ),
]
SYMMETRIC = [
    (fc.StVK(), WOVEN, CRUMPLED),
    (fc.NeoHookean("compressible", mu=200.0, lam=2000.0), RUBBER, 3.0),
    (fc.HingeBending(), WOVEN, TAUT),
]


def tangents(term, fabric, cloth, size, rng):
    """K + 0.3 D of a crumpled cloth, as it is and made definite."""
    system = fc.System(cloth, fabric, [term])
    x = size * rough(cloth, rng, 0.02 / size)
    state = system.state(x, rng.standard_normal(x.shape))
    J = BlockMatrix.zeros(system.pattern)
    for definite in (False, True):
        A = system.assemble(J, state, wx=1.0, wv=0.3, definite=definite)
        yield A.to_scipy().toarray()


def asymmetry(A):
    return abs(A - A.T).max() / abs(A).max()


@pytest.mark.parametrize(("term", "fabric", "size"), named(SKEW + SYMMETRIC))
def test_a_definite_tangent_is_symmetric_and_definite(term, fabric, size, sheet, rng):
    exact, definite = tangents(term, fabric, sheet, size, rng)
    symmetric = fc.System(sheet, fabric, [term]).symmetric
    assert (asymmetry(exact) < 1e-12) == symmetric
    assert symmetric or asymmetry(exact) > 1e-4
    assert np.linalg.eigvalsh(0.5 * (exact + exact.T))[0] < -1e-3 * abs(exact).max()
    assert asymmetry(definite) < 1e-13
    assert np.linalg.eigvalsh(definite)[0] > -1e-12 * abs(definite).max()


@pytest.mark.parametrize(
    ("term", "fabric", "stretch"),
    [
        (fc.StVK(), WOVEN, (1.2, 1.2)),
        (fc.Springs(damping=0.01), ISOTROPIC, (1.2, 1.2)),
        (fc.NeoHookean("compressible", mu=200.0, lam=2000.0), RUBBER, (1.02, 1.03)),
    ],
    ids=str,
)
def test_the_definite_tangent_of_a_taut_cloth_is_the_exact_one(term, fabric, stretch, sheet):
    system = fc.System(sheet, fabric, [term])
    state = system.state(affine(sheet, [[stretch[0], 0.0], [0.0, stretch[1]], [0.0, 0.0]]))
    J = BlockMatrix.zeros(system.pattern)
    exact = system.assemble(J, state, wx=1.0).values.copy()
    definite = system.assemble(J, state, wx=1.0, definite=True).values
    np.testing.assert_allclose(definite, exact, atol=1e-12 * abs(exact).max())


# --- bounds of the fastest rates ------------------------------------------------------------------

BOUNDS = [  # the terms, their fabric, and how far the bounds are above at most
    ([fc.StVK()], WOVEN, 2.5),
    ([fc.NeoHookean()], RUBBER, 2.5),
    ([fc.NeoHookean("compressible")], RUBBER, 2.5),
    ([fc.BaraffWitkin(damping=0.03)], WOVEN, 4.0),
    ([fc.BaraffWitkin(rest=(0.9, 1.1))], WOVEN, 4.0),
    *(([fc.Springs(kind, damping=0.03)], ISOTROPIC, 4.0) for kind in SPRINGS),
    ([fc.HingeBending(), fc.BendingDamping(0.02)], WOVEN, 4.0),
    ([fc.QuadraticBending()], WOVEN, 4.0),
    *(([wind], ISOTROPIC, 2.0) for wind in WIND.values()),
]


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize(("terms", "fabric", "most"), named(BOUNDS))
def test_rates_are_bounded_from_above(terms, fabric, most, pattern):
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.2, pattern=pattern)
    system = fc.System(cloth, fabric, terms)
    M, rest = system.mass.toarray(), system.rest()
    matrices = system.stiffness(rest), system.damping(rest)
    for A, bound in zip(matrices, rate_bounds(system), strict=True):
        values = scipy.linalg.eigh((A + A.T).toarray() / 2, M, eigvals_only=True)
        assert values[-1] <= bound * (1 + 1e-12)
        assert bound <= most * values[-1] + 1e-12 * abs(A).max()
