"""Forces over a step from the energy of the whole cloth: their work, their momenta, their size."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import rough
from support.over_step import energy_momentum as over_step
from support.tiers import stories_except

import fecloth as fc
from fecloth.terms.bending.hinge import hinge_angles
from fecloth.terms.discrete_gradient import DiscreteGradient
from fecloth.terms.loops.bound_condition import mean_ratio, spring_modulus

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

FABRIC = fc.Fabric(0.2, 500.0, 0.2, bending_rigidity=(1e-3, 5e-4), bending_poisson_ratio=0.2)
CLOTH = fc.Cloth.rectangle(0.4, 0.3, h=0.1)
QUADRATIC = fc.Cloth.rectangle(0.4, 0.3, h=0.15, element="P2")
EXACT = fc.Newton(tolerance=1e-12)


def length(y):
    """That of a cable through the nodes of a stencil, relative to 0.3 m."""
    return np.linalg.norm(np.diff(y, axis=1), axis=2).sum(axis=1) / 0.3 - 1.0


CABLE = fc.Condition(length, [[0, 5, 9, 12]], 40.0, damping=0.02)
BOWL = fc.Condition(lambda y: y[:, 0, 0] * y[:, 0, 2] + 1.0, [[3], [4], [7]], 5.0)
GAS = fc.Gas(300.0, 0.1, ambient=100.0, exponent=1.4)
OBJECTIVE = [
    (CLOTH, fc.PlateBending()),
    (CLOTH, fc.PlateBending(rest=0.4)),
    (QUADRATIC, fc.PlateBending()),
    (CLOTH, CABLE),
    (QUADRATIC, fc.NeoHookean("compressible")),
    (CLOTH, fc.NeoHookean()),
    (QUADRATIC, fc.MembraneTable([(1.05, 9.0), (1.3, 200.0)], poisson=0.2)),
    (CLOTH, fc.HingeBending(rest=0.2)),
]
MEAN_STRAIN = [
    (cloth, term) for cloth in (CLOTH, QUADRATIC) for term in (fc.StVK(), fc.TensorCondition(200.0))
]
MEAN_STRAIN += [OBJECTIVE[4], OBJECTIVE[5]]
IN_SPACE = [(CLOTH, BOWL), (CLOTH, GAS)]
IDS = [f"{type(term).__name__} on {cloth.element}" for cloth, term in OBJECTIVE + IN_SPACE]


def step_of(cloth, term, size=0.5):
    """A system of one term, and the ends of a step that turns it by `size` and strains it."""
    c, s, rng = np.cos(size), np.sin(size), np.random.default_rng(4)
    noise = 0.003 if isinstance(term, fc.NeoHookean) else 0.02  # its energy is +∞ where det C ≤ 0
    start = rough(cloth, rng, noise) + [0, 0, 0.3 if term is GAS else 0]
    turned = start @ [[1, 0, 0], [0, c, s], [0, -s, c]]
    end = turned + 2 * noise * size * rng.standard_normal(start.shape)
    return fc.System(cloth, FABRIC, [term]), start, end


def near(system, start, mean):
    """The force that is corrected: that of the mean positions, or of the mean strain."""
    step = fc.EnergyMomentum("exact").difference(system.state(start), 1.0)
    f = np.zeros_like(mean)
    system.bound[0].over_step(step).add_force(mean, np.zeros_like(mean), 0.0, f)
    return f


def change(system, start, end):
    return system.bound[0].energy(end, 0.0) - system.bound[0].energy(start, 0.0)


@pytest.mark.parametrize(("cloth", "term"), OBJECTIVE + IN_SPACE, ids=IDS)
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


@pytest.mark.parametrize(("cloth", "term"), OBJECTIVE + IN_SPACE, ids=IDS)
def test_it_differs_from_the_force_at_the_mean_by_the_square_of_the_step(cloth, term):
    differences = []
    for size in (1e-3, 5e-4):
        system, start, end = step_of(cloth, term, size)
        at = system.state((start + end) / 2)
        f = near(system, start, at.x)
        differences.append(np.linalg.norm(over_step(system, start).force(at) - f))
    assert np.log2(differences[0] / differences[1]) == pytest.approx(2, abs=0.15)


@pytest.mark.parametrize(("cloth", "term"), OBJECTIVE + IN_SPACE, ids=IDS)
def test_a_step_that_goes_nowhere_has_the_force_and_tangent_of_its_state(cloth, term):
    system, start, _ = step_of(cloth, term)
    over, at = over_step(system, start), system.state(start)
    f, K = system.force(at), system.stiffness(at)
    np.testing.assert_allclose(over.force(at), f, rtol=0, atol=1e-12 * np.abs(f).max())
    assert abs(over.stiffness(at) - K).max() < 1e-12 * abs(K).max()
    for (c, u), (k, w) in zip(over.dense(at), system.dense(at), strict=True):
        assert c == k
        np.testing.assert_array_equal(u, w)


@pytest.mark.parametrize(("cloth", "term"), MEAN_STRAIN, ids=repr)
@pytest.mark.parametrize("symmetric", [False, True])
def test_the_force_of_the_mean_strain_has_its_tangent(cloth, term, symmetric):
    """Exact, or symmetric and exact of a step that goes nowhere; and the work of a quadratic W."""
    system, start, end = step_of(cloth, term, 0.3)
    end = start + (end - start) * (0.0 if symmetric else 1.0)
    mean, direction = (start + end) / 2, np.random.default_rng(2).standard_normal(start.shape)
    method = fc.EnergyMomentum("symmetric" if symmetric else "exact")
    over = system.over_step(method.difference(system.state(start), 1.0))
    K = over.stiffness(system.state(mean))
    exact = -(K @ direction.ravel()).reshape(mean.shape)
    errors = []
    for h in (2e-6, 5e-7) if not symmetric else ():
        ends = [over.force(system.state(mean + s * h * direction)) for s in (1, -1)]
        errors.append(np.linalg.norm((ends[0] - ends[1]) / (2 * h) - exact))
    if symmetric:
        assert abs(K - K.T).max() < 1e-12 * abs(K).max()
        assert abs(K - system.stiffness(system.state(start))).max() < 1e-12 * abs(K).max()
    else:
        assert errors[-1] < 1e-6 * np.linalg.norm(exact)
        assert abs(K - K.T).max() > 1e-3 * abs(K).max()
    f = over.force(system.state(mean))
    work = np.vdot(f, end - start) + change(system, start, end)
    assert over.bound[0].conserves == (type(term) is not fc.NeoHookean)
    if over.bound[0].conserves:
        assert abs(work) < 1e-12 * np.abs(f).sum()


def test_hinges_have_the_mean_of_the_angles_of_both_ends():
    """As the force at the mean with another angle at rest, for which θ there is that mean."""
    system, start, end = step_of(CLOTH, fc.HingeBending(rest=0.2))
    before, at, after = (hinge_angles(CLOTH, x) for x in (start, (start + end) / 2, end))
    other = fc.HingeBending(rest=tuple(0.2 + at - (before + after) / 2))
    assert np.abs(at - (before + after) / 2).max() > 1e-3
    state = system.state((start + end) / 2)
    expected = fc.System(CLOTH, FABRIC, [other]).force(state)
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
    clamped = fc.System(CLOTH, FABRIC, [fc.PlateBending()], pins=[pin]).bound[0]
    computed = [step_of(*case)[0].bound[0].objective for case in OBJECTIVE + IN_SPACE]
    assert computed == [True] * len(OBJECTIVE) + [False] * 2
    assert not clamped.objective
    radius = fc.Condition(lambda y: np.linalg.norm(y, axis=2), [[3], [4]], 1.0)  # no moment
    shift = fc.Condition(lambda y: y[:, 0, 0] - 2 * y[:, 1, 0], [[3, 4]], 1.0)
    angle = fc.Condition(lambda y: y[:, 0, 0] - y[:, 1, 0], [[3, 4]], 1.0)  # no resultant
    assert not any(step_of(CLOTH, term)[0].bound[0].objective for term in (radius, shift, angle))


def fly(terms, cloth=CLOTH, dt=2e-3, t_end=0.02):
    """A run of a free cloth that turns and is deformed, and its momenta at both ends."""
    system = fc.System(cloth, FABRIC, terms)
    X = cloth.X
    z = 0.3 + 0.5 * X[:, 0] * (X[:, 1] + X[:, 0])
    x = np.column_stack([1.05 * X[:, 0], 1.03 * X[:, 1], z])
    start = system.state(x, np.cross([1.0, 5.0, 8.0], x) + [0.5, -0.2, 0.1])
    result = fc.run(system, fc.EnergyMomentum(), start, dt, t_end, newton=EXACT, solver="direct")
    return result, momenta(system, start), momenta(system, result.state)


def momenta(system, state):
    p = system.scalar_mass @ state.v
    return p.sum(axis=0), np.cross(state.x, p).sum(axis=0)


UNDAMPED = fc.Condition(length, [[0, 5, 9, 12]], 40.0)
FLIGHTS = {
    "plate": [fc.StVK(), fc.PlateBending(rest=0.4)],
    "cable": [fc.StVK(), UNDAMPED],
    "bowl": [fc.StVK(), BOWL],
    "gas": [fc.StVK(), fc.Gas(120.0, 0.036, ambient=100.0)],
}


@pytest.mark.parametrize("name", stories_except(FLIGHTS, "plate", "gas"))
def test_a_free_flight_keeps_the_energy_and_what_else_it_must(name):
    terms = FLIGHTS[name]
    t_end = {"cable": 0.006, "plate": 0.05}.get(name, 0.02)  # the cable takes many iterations
    result, (p0, L0), (p1, L1) = fly(terms, t_end=t_end)
    turnover = result.energies["kinetic"].max()
    assert np.ptp(result.energies[type(terms[1]).__name__]) > 1e-3 * turnover
    assert np.ptp(result.energies["total"]) < 1e-9 * turnover
    if name in ("plate", "cable"):
        assert np.linalg.norm(p1 - p0) < 1e-10 * np.linalg.norm(p0)
        assert np.linalg.norm(L1 - L0) < 1e-9 * np.linalg.norm(L0)
    else:  # the load changes them
        assert np.linalg.norm(p1 - p0) > 1e-2 * np.linalg.norm(p0)
