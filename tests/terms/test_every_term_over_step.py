"""For every term over a step of `EnergyMomentum`: work, tangents, correction, momenta, size."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import rough
from support.over_step import energy_momentum as over_step

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.bending.hinge import hinge_angles
from fecloth.terms.discrete_gradient import DiscreteGradient
from fecloth.terms.loops.bound_condition import mean_ratio, spring_modulus

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

ORTHOTROPIC = fc.Fabric(0.2, (1000.0, 600.0), 0.3, 150.0, (2e-3, 1e-3), 0.2)
ISOTROPIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-3)
CLOTH = fc.Cloth.rectangle(0.4, 0.3, h=0.1)
QUADRATIC = fc.Cloth.rectangle(0.4, 0.3, h=0.15, element="P2")
EXACT = fc.Newton(tolerance=1e-13)


def length(y):
    """That of a cable through the nodes of a stencil, relative to 0.3 m."""
    return np.linalg.norm(np.diff(y, axis=1), axis=2).sum(axis=1) / 0.3 - 1.0


CABLE = fc.Condition(length, [[0, 5, 9, 12]], 40.0, damping=0.02)
BOWL = fc.Condition(lambda y: y[:, 0, 0] * y[:, 0, 2] + 1.0, [[3], [4], [7]], 5.0)
GAS = fc.Gas(300.0, 0.1, ambient=100.0, exponent=1.4)
SPRINGS = [(CLOTH, fc.Springs(kind)) for kind in ("structural", "van_gelder", "biquadratic")]
MEAN_STRAIN = [
    (cloth, term) for cloth in (CLOTH, QUADRATIC) for term in (fc.StVK(), fc.TensorCondition(200.0))
]
OF_ITS_OWN = [*MEAN_STRAIN, (CLOTH, fc.BaraffWitkin()), *SPRINGS]  # its force does the work
NEO_HOOKEAN = [(QUADRATIC, fc.NeoHookean("compressible")), (CLOTH, fc.NeoHookean())]
OBJECTIVE = [  # corrected; no rigid motion changes their energy
    (CLOTH, fc.PlateBending()),
    (CLOTH, fc.PlateBending(rest=0.4)),
    (QUADRATIC, fc.PlateBending()),
    (CLOTH, CABLE),
    *NEO_HOOKEAN,
    (CLOTH, fc.NeoHookean("compressible")),
    (CLOTH, fc.TensionField()),
    (QUADRATIC, fc.MembraneTable([(1.05, 9.0), (1.3, 200.0)], poisson=0.2)),
    (CLOTH, fc.HingeBending(rest=0.2)),
    (CLOTH, fc.HingeBending()),
]
IN_SPACE = [(CLOTH, BOWL), (CLOTH, GAS)]
LINEAR = [fc.Gravity(), fc.QuadraticBending(), fc.Tether([3, 4], (0, 0, 1), 30.0)]
LINEAR = [(CLOTH, term) for term in LINEAR]  # the force of the mean state does the work


def rows(*kinds):
    """Parameters of the cloths and terms, with their names."""
    cases = [case for kind in kinds for case in kind]
    return [pytest.param(*case, id=f"{case[1]!s:.40} on {case[0].element}") for case in cases]


every_term = pytest.mark.parametrize(("cloth", "term"), rows(OF_ITS_OWN, OBJECTIVE, IN_SPACE))
corrected = pytest.mark.parametrize(("cloth", "term"), rows(OBJECTIVE, IN_SPACE))


def fabric_for(term):
    isotropic = fc.Springs | fc.NeoHookean | fc.TensionField
    return ISOTROPIC if isinstance(term, isotropic) else ORTHOTROPIC


def step_of(cloth, term, size=0.5):
    """A system of one term, and the ends of a step that turns it by `size` and strains it."""
    c, s, rng = np.cos(size), np.sin(size), np.random.default_rng(4)
    noise = 0.003 if isinstance(term, fc.NeoHookean) else 0.02  # its energy is +∞ where det C ≤ 0
    start = rough(cloth, rng, noise) + [0, 0, 0.3 if term is GAS else 0]
    turned = start @ [[1, 0, 0], [0, c, s], [0, -s, c]]
    end = turned + 2 * noise * size * rng.standard_normal(start.shape)
    return fc.System(cloth, fabric_for(term), [term]), start, end


def uncorrected(system, start, symmetric=False):
    """The system with the forces of the mean positions, or of the mean strain."""
    method = fc.EnergyMomentum("symmetric" if symmetric else "exact")
    return system.over_step(method.difference(system.state(start), 1.0))


def near(system, start, mean):
    """The force that is corrected."""
    f = np.zeros_like(mean)
    uncorrected(system, start).bound[0].add_force(mean, np.zeros_like(mean), 0.0, f)
    return f


def change(system, start, end):
    return system.bound[0].energy(end, 0.0) - system.bound[0].energy(start, 0.0)


@pytest.mark.parametrize(("cloth", "term"), rows(OF_ITS_OWN, OBJECTIVE, IN_SPACE, LINEAR))
def test_work_between_two_states_is_the_change_of_the_energy(cloth, term):
    system, start, end = step_of(cloth, term)
    mean = system.state((start + end) / 2)
    f, defect = over_step(system, start).force(mean), change(system, start, end)
    assert abs(np.vdot(f, end - start) + defect) < 1e-11 * np.abs(f * (end - start)).sum()
    if (cloth, term) not in LINEAR:
        assert abs(np.vdot(system.force(mean), end - start) + defect) > 1e-4 * abs(defect)


@pytest.mark.parametrize(("cloth", "term"), rows(OF_ITS_OWN, NEO_HOOKEAN))
def test_tangent_is_the_derivative_of_the_force(cloth, term):
    """Central differences: the error falls with the square of their step."""
    system, start, end = step_of(cloth, term, 0.3)
    over, mean = uncorrected(system, start), (start + end) / 2
    direction = np.random.default_rng(2).standard_normal(mean.shape)
    K = over.stiffness(system.state(mean))
    exact = -(K @ direction.ravel()).reshape(mean.shape)
    errors = []
    for h in 2.5e-5 / 4.0 ** np.arange(3):
        ends = [over.force(system.state(mean + s * h * direction)) for s in (1, -1)]
        errors.append(np.linalg.norm((ends[0] - ends[1]) / (2 * h) - exact))
    assert errors[-1] < 1e-5 * np.linalg.norm(exact)
    np.testing.assert_allclose(-np.diff(np.log2(errors)) / 2, 2, atol=0.05)
    assert abs(K - K.T).max() > 1e-3 * abs(K).max()
    assert over.bound[0].conserves == ((cloth, term) not in NEO_HOOKEAN)


@every_term
@pytest.mark.parametrize("symmetric", [False, True])
def test_a_step_that_goes_nowhere_has_the_force_and_tangent_of_its_state(cloth, term, symmetric):
    """The symmetric tangent is symmetric in other steps, too."""
    system, start, end = step_of(cloth, term)
    over, at = over_step(system, start, symmetric), system.state(start)
    f, K = system.force(at), system.stiffness(at)
    np.testing.assert_allclose(over.force(at), f, rtol=0, atol=1e-12 * np.abs(f).max())
    assert abs(over.stiffness(at) - K).max() < 1e-12 * abs(K).max()
    for (c, u), (k, w) in zip(over.dense(at), system.dense(at), strict=True):
        assert c == k
        np.testing.assert_array_equal(u, w)
    if symmetric:
        K = over.stiffness(system.state((start + end) / 2))
        assert abs(K - K.T).max() < 1e-12 * abs(K).max()
        assert over.symmetric


@pytest.mark.parametrize(("cloth", "term"), rows(OF_ITS_OWN, OBJECTIVE))
def test_definite_tangent_is_symmetric_and_has_no_negative_eigenvalue(cloth, term):
    system, start, end = step_of(cloth, term)
    over, J = over_step(system, start), BlockMatrix.zeros(system.pattern)
    K = over.assemble(J, system.state(0.6 * (start + end) / 2), wx=1.0, definite=True)
    K = K.to_scipy().toarray()
    values = np.linalg.eigvalsh(K)
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()
    assert values[0] > -1e-12 * values[-1]


@corrected
def test_the_correction_is_along_the_motion_weighted_by_mass(cloth, term):
    """u by a basis of the six rigid motions, from which d is cleared in the norm of the mass."""
    system, start, end = step_of(cloth, term)
    mean, d, m = (start + end) / 2, end - start, system.diagonal_mass[:, None]
    f = near(system, start, mean)
    r = d.copy()
    if (cloth, term) in OBJECTIVE:
        rigid = [np.broadcast_to(axis, d.shape) for axis in np.eye(3)]
        rigid += [np.cross(axis, mean) for axis in np.eye(3)]
        A = (np.sqrt(m) * np.array(rigid)).reshape(6, -1).T
        r -= np.tensordot(np.linalg.lstsq(A, (np.sqrt(m) * d).ravel(), rcond=None)[0], rigid, 1)
    defect = change(system, start, end) + np.vdot(f, d)
    expected = f - defect / np.vdot(m * r, d) * (m * r)
    computed = over_step(system, start).force(system.state(mean))
    np.testing.assert_allclose(computed, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@corrected
def test_it_differs_from_the_force_at_the_mean_by_the_square_of_the_step(cloth, term):
    differences = []
    for size in (1e-3, 5e-4):
        system, start, end = step_of(cloth, term, size)
        at = system.state((start + end) / 2)
        f = near(system, start, at.x)
        differences.append(np.linalg.norm(over_step(system, start).force(at) - f))
    assert np.log2(differences[0] / differences[1]) == pytest.approx(2, abs=0.15)


def test_hinges_have_the_mean_of_the_angles_of_both_ends():
    """As the force at the mean with another angle at rest, for which θ there is that mean."""
    system, start, end = step_of(CLOTH, fc.HingeBending(rest=0.2))
    before, at, after = (hinge_angles(CLOTH, x) for x in (start, (start + end) / 2, end))
    other = fc.HingeBending(rest=tuple(0.2 + at - (before + after) / 2))
    assert np.abs(at - (before + after) / 2).max() > 1e-3
    state = system.state((start + end) / 2)
    expected = fc.System(CLOTH, ORTHOTROPIC, [other]).force(state)
    np.testing.assert_allclose(near(system, start, state.x), expected, rtol=0, atol=1e-15)


def test_springs_of_no_length_have_no_force_over_a_step():
    zero = np.zeros((1, 3))
    assert mean_ratio(zero, zero) == 0.0
    np.testing.assert_array_equal(spring_modulus(np.ones(1), zero, zero)[0], np.eye(3))


def test_a_step_that_only_turns_the_cloth_is_not_corrected():
    """Both N and u are round-off there."""
    system, start, _ = step_of(CLOTH, fc.PlateBending(rest=0.4))
    c, s = np.cos(0.3), np.sin(0.3)
    end = start @ [[1, 0, 0], [0, c, s], [0, -s, c]]
    at = system.state((start + end) / 2)
    f, at_mean = over_step(system, start).force(at), system.force(at)
    np.testing.assert_allclose(f, at_mean, rtol=0, atol=1e-6 * np.abs(at_mean).max())


@pytest.mark.parametrize(("part", "corrects"), [(0.8, False), (1.25, True)])
def test_a_change_of_the_energy_by_round_off_is_not_corrected(part, corrects):
    """Up to 1e-15 of both energies: about 9 units of the last digit of one of them."""
    energies = iter([1.0, 1.0 + part * 2e-15])
    term = SimpleNamespace(energy=lambda x, t: next(energies), objective=False)
    over = DiscreteGradient(term, term, start=np.zeros((1, 3)), mass=np.ones(1), t=0.0)
    d = np.array([[1.0, 0.0, 0.0]])
    assert over.correction(0.5 * d, d, np.zeros((1, 3))).any() == corrects


def test_damping_acts_as_at_the_mean():
    system, start, end = step_of(CLOTH, CABLE)
    v = np.random.default_rng(1).standard_normal(start.shape)
    mean, over = (start + end) / 2, over_step(system, start)
    viscous = system.force(system.state(mean, v)) - system.force(system.state(mean))
    computed = over.force(system.state(mean, v)) - over.force(system.state(mean))
    assert np.abs(viscous).max() > 1e-3
    np.testing.assert_allclose(computed, viscous, rtol=0, atol=1e-12)
    power = system.bound[0].power(mean, v, 0.0)
    assert over.bound[0].power(mean, v, 0.0) == power > 0


def test_which_energies_no_rigid_motion_changes():
    pin = fc.Pin("left", clamp=True)
    clamped = fc.System(CLOTH, ORTHOTROPIC, [fc.PlateBending()], pins=[pin]).bound[0]
    computed = [step_of(*case)[0].bound[0].objective for case in OBJECTIVE + IN_SPACE]
    assert computed == [True] * len(OBJECTIVE) + [False] * 2
    assert not clamped.objective
    radius = fc.Condition(lambda y: np.linalg.norm(y, axis=2), [[3], [4]], 1.0)  # no moment
    shift = fc.Condition(lambda y: y[:, 0, 0] - 2 * y[:, 1, 0], [[3, 4]], 1.0)
    angle = fc.Condition(lambda y: y[:, 0, 0] - y[:, 1, 0], [[3, 4]], 1.0)  # no resultant
    assert not any(step_of(CLOTH, term)[0].bound[0].objective for term in (radius, shift, angle))


# --- flights --------------------------------------------------------------------------------------

FLIGHTS = [  # terms, their cloth, seconds, and whether no load changes the momenta
    ([fc.StVK()], CLOTH, 0.1, True),
    ([fc.StVK()], QUADRATIC, 0.02, True),
    ([fc.BaraffWitkin()], CLOTH, 0.1, True),
    ([fc.StVK(), fc.HingeBending()], CLOTH, 0.1, True),
    *(([term], cloth, 0.1, True) for cloth, term in SPRINGS),
    *(([term], CLOTH, 0.1, True) for term in (fc.NeoHookean(), fc.NeoHookean("compressible"))),
    ([fc.TensionField()], CLOTH, 0.1, True),
    ([fc.StVK(), fc.PlateBending(rest=0.4)], CLOTH, 0.05, True),
    ([fc.StVK(), fc.Condition(length, [[0, 5, 9, 12]], 40.0)], CLOTH, 0.006, True),
    ([fc.StVK(), BOWL], CLOTH, 0.02, False),
    ([fc.StVK(), fc.Gas(120.0, 0.036, ambient=100.0)], CLOTH, 0.02, False),
]
IN_LAYER_ONE = (0, 10, 13)


def momenta(system, state):
    p = system.scalar_mass @ state.v
    return p.sum(axis=0), np.cross(state.x, p).sum(axis=0)


def fly(terms, method, cloth, t_end):
    """A run of a free cloth, stretched and bent, that turns; and its momenta at both ends."""
    system = fc.System(cloth, fabric_for(terms[0]), terms)
    X, Y = cloth.X.T
    x = np.column_stack([1.1 * X, 1.05 * Y, 0.3 + 0.5 * X * (X + Y)])
    start = system.state(x, np.cross([1.0, 10.0, 15.0], x) + [0.5, -0.2, 0.1])
    result = fc.run(system, method, start, 2e-3, t_end, newton=EXACT, solver="direct")
    return result, momenta(system, start), momenta(system, result.state)


@pytest.mark.parametrize(
    ("terms", "cloth", "t_end", "is_free"),
    [
        pytest.param(*row, marks=[] if i in IN_LAYER_ONE else pytest.mark.stories)
        for i, row in enumerate(FLIGHTS)
    ],
)
@pytest.mark.parametrize("tangent", ["exact", "symmetric"])
def test_a_flight_keeps_the_energy_and_what_else_it_must(terms, cloth, t_end, is_free, tangent):
    run, (p0, L0), (p1, L1) = fly(terms, fc.EnergyMomentum(tangent), cloth, t_end)
    turnover = run.energies["kinetic"].max()
    for term in terms:  # something has happened
        assert np.ptp(run.energies[type(term).__name__]) > 1e-3 * turnover
    assert np.ptp(run.energies["total"]) < 1e-9 * turnover
    assert abs(run.energies["remainder"]).max() < 1e-9 * turnover
    if is_free:
        assert np.linalg.norm(p1 - p0) < 1e-10 * np.linalg.norm(p0)
        assert np.linalg.norm(L1 - L0) < 1e-9 * np.linalg.norm(L0)
    else:  # the load changes them
        assert np.linalg.norm(p1 - p0) > 1e-2 * np.linalg.norm(p0)


def test_the_midpoint_rule_does_not_keep_the_energy_of_that_flight():
    run, *_ = fly([fc.StVK()], fc.ImplicitMidpoint(), CLOTH, 0.02)
    assert np.ptp(run.energies["total"]) > 1e-4 * run.energies["kinetic"].max()
