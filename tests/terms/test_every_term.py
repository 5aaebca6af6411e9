"""For every term: derivatives, power, internal forces, definite tangents, fastest rates."""

import numpy as np
import pytest
import scipy.linalg
from conftest import affine, flat, rough
from support.fast_states import fast_states
from support.over_step import Over, random_steps

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.stability.critical_step import rate_bounds
from fecloth.verify import check_term, trial_states

ISOTROPIC = fc.Fabric(0.2, 1000.0, 0.3)
RUBBER = fc.Fabric(0.2, 900.0, 0.3)
WOVEN = fc.Fabric(0.15, (2000.0, 900.0), 0.2, 60.0, bending_rigidity=(4e-5, 1e-5))
PATTERNS = ["unstructured", "right", "cross", "equilateral"]
SPRINGS = ("structural", "van_gelder", "biquadratic")
WIND = {
    law: fc.Wind((1.0, 2.0, 3.0), 0.7, 0.1, law, tangent="exact") for law in ("linear", "quadratic")
}


def named(rows):
    """Parameters with a term's text for the id, without addresses."""
    return [pytest.param(*row, id=str(row[0]).partition(" at 0x")[0][:70]) for row in rows]


# --- derivatives ----------------------------------------------------------------------------------

MESH = fc.Cloth.rectangle(0.3, 0.2, h=0.1, pattern="cross")
GRID = fc.Cloth.rectangle(0.4, 0.3, h=0.1, pattern="right")
QUADRATIC = fc.Cloth.rectangle(0.3, 0.2, h=0.1, pattern="cross", element="P2")
DISK = fc.Cloth.disk(0.5, h=0.2)


def one_state(cloth, F, noise=0.0):
    """A deformation F (2 or 3, 2) of the cloth with noise [m], at rest."""
    F = np.vstack([F, np.zeros((3 - len(F), 2))])
    x = affine(cloth, F) + noise * np.random.default_rng(4).standard_normal((len(cloth.X), 3))
    return [(str(F), x, np.zeros_like(x))]


def domes(cloth):
    """Rough, compressed and steep domes, all with a positive volume."""
    noise, v = np.random.default_rng(3).standard_normal((2, len(cloth.X), 3))
    x = flat(cloth) + np.outer(0.2 - 0.8 * np.sum(cloth.X**2, axis=1), [0, 0, 1])
    return [
        ("rough", x + 0.01 * noise, v),
        ("compressed", 0.3 * x + 0.003 * noise, v),
        ("steep", x * [1, 1, 5] + 0.01 * noise, v),
    ]


def swirl(x, v, t):
    """A force that is no gradient, with nonlinear damping."""
    return np.cross([0, 0, 1.5], x) - 3.0 * x * (1 + np.sum(x**2, axis=1))[:, None] - v * abs(v)


def moving(cloth):
    """Velocities away from zero, where v |v| is not smooth."""
    return [(name, x, v + 20.0) for name, x, v in trial_states(cloth)]


TAUT_STATE = [[2.0, 0.1], [0.2, 1.9], [0.1, 0.3]]
CURVES = [(1.05, 2.0), (1.1, 5.0), (1.2, 20.0), (1.3, 120.0)], [(1.05, 8.0), (1.3, 33.0)]
TABLE = fc.MembraneTable(*CURVES, [(0.1, 0.5), (0.5, 6.0), (0.7, 40.0)], 0.1)
POINTWISE = fc.MembraneTable(*CURVES, poisson=0.1, strain="pointwise")
BETWEEN_POINTS = [[1.07, 0.2], [0.0, 1.07]]
# an energy with a pole at J = 0 has no differences across it, and is not sheared to J = 0.05
BEFORE_THE_POLE = [*trial_states(MESH)[:2], *one_state(MESH, [[1.0, 1.5], [0.0, 0.12]])]
GAS = {"pressure": 300.0, "volume": 0.1, "ambient": 100.0}
PLATE = fc.PlateBending()

SLOPES = [  # the term, its mesh, and what else `check_term` is told
    (fc.StVK(), MESH, {}),
    (fc.TensorCondition(250.0), MESH, {}),
    (fc.BaraffWitkin((3e5, 2e5), 4e4, area_exponent=1.0), MESH, {}),
    (fc.BaraffWitkin(rest=(0.9, 1.2)), MESH, {}),
    (fc.BaraffWitkin(damping=0.01, tangent="exact"), MESH, {}),
    (fc.BaraffWitkin(damping=0.01), MESH, {"tangents": "v"}),
    (fc.NeoHookean(), MESH, {"fabric": RUBBER, "states": BEFORE_THE_POLE}),
    (fc.NeoHookean("compressible"), MESH, {"fabric": RUBBER, "states": BEFORE_THE_POLE}),
    (
        fc.NeoHookean("compressible", mu=200.0, lam=2000.0),  # not convex where it is stretched so
        MESH,
        {"states": one_state(MESH, [[2.5, 0], [0, 2.4]], 0.01)},
    ),
    (fc.TensionField(), MESH, {"fabric": ISOTROPIC, "states": trial_states(MESH)[::2]}),
    *(
        (
            fc.TensionField(),
            MESH,
            {"fabric": ISOTROPIC, "states": one_state(MESH, np.diag(stretches), 0.003)},
        )
        for stretches in ([1.6, 1.5], [1.6, 0.3])  # taut; wrinkled
    ),
    *(
        (term, mesh, {"states": one_state(mesh, F, 5e-4), "scales": [1.0]})
        for term in (TABLE, POINTWISE)
        for mesh in (MESH, QUADRATIC)
        for F in (BETWEEN_POINTS, [[0.9, -0.15], [0.1, 0.95]])[: 2 if mesh is MESH else 1]
    ),
    (fc.StVK(), QUADRATIC, {"scales": [1.0]}),
    (fc.TensorCondition(250.0), QUADRATIC, {"scales": [1.0]}),
    *(
        (term, QUADRATIC, {"fabric": ISOTROPIC, "states": one_state(QUADRATIC, TAUT_STATE, 0.002)})
        for term in (fc.NeoHookean(), fc.NeoHookean("compressible"), fc.TensionField())
    ),
    *((fc.Springs(k, damping=0.01, tangent="exact"), MESH, {"fabric": RUBBER}) for k in SPRINGS),
    (fc.Springs(shear=70.0, bend=30.0, damping=0.02, tangent="exact"), GRID, {}),
    (fc.Tether("left", (0.1, 0.2, 0.3), 50.0, 2.0), MESH, {"scales": [1.0]}),
    (fc.HingeBending(), MESH, {}),
    (fc.HingeBending(0.3), MESH, {"scales": [1.0]}),
    (fc.QuadraticBending(), MESH, {}),
    *(
        (fc.PlateBending(rest), mesh, {"states": trial_states(mesh)[: 3 if mesh is GRID else 2]})
        for rest in (0.0, 0.4)
        for mesh in (GRID, QUADRATIC)
    ),
    *(
        (fc.BendingDamping(0.1, "exact", law), mesh, {})
        for law, mesh in ((None, MESH), (PLATE, GRID), (PLATE, QUADRATIC))
    ),
    (fc.BendingDamping(0.01), MESH, {"tangents": "v", "scales": [1.0]}),
    (fc.StrainRateDamping(0.01, tangent="exact"), MESH, {}),
    (fc.StrainRateDamping(0.01, tangent="exact"), QUADRATIC, {"scales": [1.0]}),
    (fc.StrainRateDamping(0.01), MESH, {"tangents": "v"}),
    *(
        (Over(fc.StrainRateDamping(0.003), step), mesh, {"tangents": "x"})
        for mesh in (MESH, QUADRATIC)
        for step in random_steps(mesh).values()
    ),
    *(
        (
            Over(fc.StrainRateDamping(0.003, law), random_steps(MESH)["BDF2"]),
            MESH,
            {"fabric": fc.Fabric(0.2, 1e3, 0.5), "tangents": "x"},
        )
        for law in (fc.TensorCondition(250.0), fc.NeoHookean(), fc.NeoHookean("compressible"))
    ),
    (fc.MassDamping(3.0), MESH, {}),
    (fc.MassDamping(3.0), QUADRATIC, {"tangents": "v"}),
    *(
        (fc.Drag(*shares, "linear", tangent="exact"), MESH, {})
        for shares in ((1.0, 0.0), (0.0, 1.0), (0.7, 0.3))
    ),
    *(
        (fc.Drag(*shares, tangent="exact"), MESH, {"states": fast_states(MESH)})
        for shares in ((1.0, 0.0), (0.0, 1.0), (0.7, 0.3))
    ),
    (fc.Drag(0.7, 0.3), MESH, {"states": fast_states(MESH), "tangents": "v"}),
    *(
        (fc.Wind(air, 0.7, 0.3, tangent="exact", **gusts), MESH, {"states": fast_states(MESH)})
        for air, gusts in (
            ((3.0, 1.0, -2.0), {}),
            (("3 + t", "x * y", "2 * z - x**2"), {}),
            (lambda x, t: np.sin(9 * x[:, ::-1]), {}),
            (lambda x, t: np.array([t, 1.0, 2.0]), {}),
            ((3.0, 1.0, -2.0), {"gusts": 0.5, "gust_length": 0.1}),
        )
    ),
    (fc.Wind(("3", "x * y", "z"), 0.7, 0.3, "linear", tangent="exact"), MESH, {}),
    (fc.Gravity((1.5, -2.0, -9.81)), MESH, {}),
    (fc.PointForce("left", (1.0, -2.0, 0.5)), MESH, {}),
    (fc.UserForce(swirl, tangent="exact"), MESH, {"states": moving(MESH)}),
    (fc.UserForce(("-50 * x", "sin(9 * y) - x", "-3 * vz"), tangent="exact"), QUADRATIC, {}),
    (fc.Pressure(30.0, tangent="exact"), MESH, {}),
    (fc.Pressure(300.0, tangent="exact"), QUADRATIC, {"scales": [1.0]}),
    *(
        (fc.EdgeForce("boundary", **load, follow=follow), mesh, {"scales": [1.0]})
        for mesh in (MESH, QUADRATIC)
        for load in ({"force": (3.0, -2.0, 1.0)}, {"normal": 5.0}, {"tangent": 4.0})
        for follow in (True, False)
    ),
    (fc.Gas(**GAS), DISK, {"states": domes(DISK)}),
    (fc.Gas(**GAS, exponent=1.4, origin=(0.1, -0.2, -0.05)), DISK, {"states": domes(DISK)}),
]


@pytest.mark.parametrize(("term", "mesh", "how"), named(SLOPES))
def test_force_and_tangents_are_derivatives(term, mesh, how):
    """And the matrix is symmetric if and only if the term says so."""
    how = how | {"states": list(how.get("states", trial_states(mesh)))}
    check_term(term, mesh, **how)
    system = fc.System(mesh, how.get("fabric", WOVEN), [term])
    _, x, v = how["states"][0]
    K = (system.stiffness(system.state(x, v)) + 0.3 * system.damping(system.state(x, v))).toarray()
    asymmetry = abs(K - K.T).max()
    assert asymmetry <= 1e-11 * abs(K).max() or not system.symmetric
    assert asymmetry > 1e-6 * abs(K).max() or system.symmetric


# --- power ----------------------------------------------------------------------------------------

POWERS = [
    (fc.BaraffWitkin(damping=0.02), GRID),
    (fc.Springs(damping=0.1, stiffness=9.0), GRID),
    (fc.StrainRateDamping(0.02), QUADRATIC),
    (fc.BendingDamping(0.02), GRID),
    (fc.BendingDamping(0.02, law=PLATE), QUADRATIC),
    (fc.MassDamping(3.0), QUADRATIC),
    *((fc.Drag(0.7, 0.1, law), GRID) for law in ("linear", "quadratic")),
    *((fc.Wind((3.0, "2 * z", 1.0), 0.7, 0.1, law), GRID) for law in ("linear", "quadratic")),
    (fc.Pressure("30 + t"), QUADRATIC),
    (fc.EdgeForce("right", normal="20 * t", tangent=2.0), QUADRATIC),
    (fc.EdgeForce("right", (1.0, 2.0, "t"), follow=True), GRID),
    (fc.PointForce("right", ("t", 2.0, 3.0)), GRID),
    (fc.UserForce(swirl, per="mass"), GRID),
]


@pytest.mark.parametrize(("term", "mesh"), named(POWERS))
def test_what_is_supplied_and_not_lost_is_the_power_of_the_force(term, mesh, rng):
    """f·v without the elastic force, whose power is in the energy."""
    system, t = fc.System(mesh, WOVEN, [term]), 0.7
    x, v = rough(mesh, rng), rng.standard_normal((len(mesh.X), 3))
    (bound,) = system.bound
    f = system.force(system.state(x, v, t=t))
    if bound.has_energy:
        f -= system.force(system.state(x, t=t))
    supplied = bound.supply(x, v, t) if bound.supplies else 0.0
    lost = bound.power(x, v, t) if bound.dissipative else 0.0
    assert supplied - lost == pytest.approx(np.vdot(f, v), rel=1e-11)
    assert lost >= 0
    assert (lost > 0) == bound.dissipative


# --- internal forces ------------------------------------------------------------------------------

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
    (fc.PlateBending(), WOVEN),
    (fc.StrainRateDamping(0.02), WOVEN),
    (fc.BendingDamping(0.01), WOVEN),
    (fc.BendingDamping(0.01, law=PLATE), WOVEN),
]
FOLLOWING = [(fc.Drag(0.7, 0.1), ISOTROPIC), (fc.Pressure(30.0), ISOTROPIC)]


@pytest.mark.parametrize(("term", "fabric"), named(INTERNAL + FOLLOWING))
def test_internal_forces_have_no_resultant_and_turn_with_the_cloth(term, fabric, sheet, rng):
    system = fc.System(sheet, fabric, [term])
    state = system.state(rough(sheet, rng), rng.standard_normal((len(sheet.X), 3)))
    force = system.force(state)
    if (term, fabric) in INTERNAL:
        size = np.abs(force).sum()
        assert np.abs(force.sum(axis=0)).max() < 1e-13 * size
        assert np.abs(np.cross(state.x, force).sum(axis=0)).max() < 1e-13 * size
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


@pytest.mark.parametrize(
    "term",
    [fc.StrainRateDamping(0.02), fc.BendingDamping(0.02), fc.BendingDamping(0.02, law=PLATE)],
    ids=repr,
)
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
    (fc.PlateBending(), WOVEN, TAUT),
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
        (fc.TensionField(), ISOTROPIC, (1.2, 0.4)),
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
    ([fc.PlateBending()], WOVEN, 3.0),
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
