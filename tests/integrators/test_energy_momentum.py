"""Energy–momentum: forces between two states do the work of the energy, and keep the momenta."""

import numpy as np
import pytest
from conftest import rough
from support.over_step import energy_momentum as over_step
from support.tiers import stories_except

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

EXACT = fc.Newton(tolerance=1e-13)
ORTHOTROPIC = fc.Fabric(0.2, (1000.0, 600.0), 0.3, 150.0, (2e-3, 1e-3))
ISOTROPIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-3)
SPRINGS = [fc.Springs(), fc.Springs("van_gelder"), fc.Springs("biquadratic")]
GENERAL = [fc.NeoHookean(), fc.NeoHookean("compressible"), fc.TensionField()]
TERMS = [
    fc.StVK(),
    fc.TensorCondition(200.0),
    fc.HingeBending(),
    fc.BaraffWitkin(),
    *SPRINGS,
    *GENERAL,
]
EXACT_TANGENT = [fc.StVK(), fc.TensorCondition(200.0), fc.BaraffWitkin(), *SPRINGS]
LINEAR = [fc.Gravity(), fc.QuadraticBending(), fc.Tether([3, 4], (0, 0, 1), 30.0)]


@pytest.fixture(scope="module")
def cloth():
    return fc.Cloth.rectangle(0.4, 0.3, h=0.1)


def fabric_for(term):
    return ISOTROPIC if term in [*SPRINGS, *GENERAL] else ORTHOTROPIC


def step_of(cloth, term, rng):
    """A system of one term, and the ends of a long step: half a radian, and much strain."""
    c, s = np.cos(0.5), np.sin(0.5)
    start = rough(cloth, rng, 0.02)
    end = start @ [[1, 0, 0], [0, c, s], [0, -s, c]] + 0.02 * rng.standard_normal(start.shape)
    return fc.System(cloth, fabric_for(term), [term]), start, end


@pytest.mark.parametrize("term", [*TERMS, *LINEAR], ids=repr)
def test_work_between_two_states_is_the_change_of_the_energy(term, cloth, rng):
    system, start, end = step_of(cloth, term, rng)
    f = over_step(system, start).force(system.state((start + end) / 2))
    change = system.bound[0].energy(end, 0.0) - system.bound[0].energy(start, 0.0)
    assert abs(np.vdot(f, end - start) + change) < 1e-12 * np.abs(f * (end - start)).sum()
    at_mean = system.force(system.state((start + end) / 2))
    if term in TERMS:  # the force of the mean state does another work
        assert abs(np.vdot(at_mean, end - start) + change) > 1e-4 * abs(change)


@pytest.mark.parametrize("term", EXACT_TANGENT, ids=repr)
def test_tangent_is_the_derivative_of_the_force(term, cloth, rng):
    """Central differences: the error falls with the square of their step."""
    system, start, end = step_of(cloth, term, rng)
    over, mean = over_step(system, start), (start + end) / 2
    direction = rng.standard_normal(mean.shape)
    exact = -(over.stiffness(system.state(mean)) @ direction.ravel()).reshape(mean.shape)
    errors = []
    for h in 2.5e-5 / 4.0 ** np.arange(3):
        ends = [over.force(system.state(mean + s * h * direction)) for s in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * h)
        errors.append(np.linalg.norm(difference - exact) / np.linalg.norm(exact))
    assert errors[-1] < 1e-5
    np.testing.assert_allclose(-np.diff(np.log2(errors)) / 2, 2, atol=0.05)


@pytest.mark.parametrize("term", TERMS, ids=repr)
def test_symmetric_tangent_is_the_exact_one_of_a_step_that_goes_nowhere(term, cloth, rng):
    system, start, end = step_of(cloth, term, rng)
    over = over_step(system, start, symmetric=True)
    K, at_rest = (over.stiffness(system.state(x)).toarray() for x in ((start + end) / 2, start))
    exact = system.stiffness(system.state(start)).toarray()
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()
    assert abs(at_rest - exact).max() < 1e-12 * abs(exact).max()
    assert over.symmetric


@pytest.mark.parametrize("term", TERMS, ids=repr)
def test_definite_tangent_is_symmetric_and_has_no_negative_eigenvalue(term, cloth, rng):
    system, start, end = step_of(cloth, term, rng)
    over, J = over_step(system, start), BlockMatrix.zeros(system.pattern)
    K = over.assemble(J, system.state(0.6 * (start + end) / 2), wx=1.0, definite=True)
    K = K.to_scipy().toarray()
    values = np.linalg.eigvalsh(K)
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()
    assert values[0] > -1e-12 * values[-1]


def momenta(system, state):
    p = system.scalar_mass @ state.v
    return p.sum(axis=0), np.cross(state.x, p).sum(axis=0)


def flight(cloth, terms, method, dt, t_end):
    """A stretched and bent cloth that turns fast, free: its run, and its momenta at both ends."""
    system = fc.System(cloth, fabric_for(terms[0]), terms)
    X = cloth.X
    x = np.column_stack([1.2 * X[:, 0], 1.1 * X[:, 1], 0.5 * X[:, 0] * (X[:, 1] + X[:, 0])])
    start = system.state(x, np.cross([1.0, 20.0, 30.0], x) + [0.5, -0.2, 0.1])
    result = fc.run(system, method, start, dt, t_end, solver="direct", newton=EXACT)
    return result, momenta(system, start), momenta(system, result.state)


FLIGHTS = [[fc.StVK()], [fc.BaraffWitkin()], [fc.StVK(), fc.HingeBending()]]
FLIGHTS += [[term] for term in [*SPRINGS, *GENERAL]]


@pytest.mark.parametrize("terms", stories_except(FLIGHTS, FLIGHTS[0]), ids=repr)
def test_a_free_flight_keeps_everything_at_a_coarse_step(terms, cloth):
    method = fc.EnergyMomentum(tangent="exact")  # its last iteration goes down to round-off
    result, (p0, L0), (p1, L1) = flight(cloth, terms, method, 2e-3, 0.1)
    turnover = result.energies["kinetic"].max()
    for term in terms:  # something has happened
        exchanged = np.ptp(result.energies[type(term).__name__])
        assert exchanged > 1e-3 * turnover
    assert np.ptp(result.energies["total"]) < 1e-10 * turnover
    assert abs(result.energies["remainder"]).max() < 1e-10 * turnover
    assert np.linalg.norm(p1 - p0) < 1e-12 * np.linalg.norm(p0)
    assert np.linalg.norm(L1 - L0) < 1e-10 * np.linalg.norm(L0)


def test_reactions_balance_the_change_of_momentum(cloth):
    """The pins hold with dp/dt less the weight, whatever the membrane does."""
    system = fc.System(cloth, ORTHOTROPIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    dt = 5e-3
    run = fc.run(system, fc.EnergyMomentum(), system.rest(), dt, dt, newton=EXACT)
    reaction = np.array([run.observed[f"reaction:left.{c}"][-1] for c in "xyz"])
    change = momenta(system, run.state)[0] / dt
    weight = system.nodal_mass.sum() * np.array([0, 0, -9.81])
    np.testing.assert_allclose(reaction, change - weight, atol=1e-9 * np.linalg.norm(weight))


def test_the_force_of_springs_over_a_turn_has_no_jump_at_a_small_stretch(cloth):
    """Per stretch it is the same from 1e-10 on; it jumped by φ²/8 where the stretch was 1e-8."""
    system = fc.System(cloth, fc.Fabric(0.2, 500.0, 0.2), [fc.Springs()])
    x, (c, s) = system.rest().x, (np.cos(0.4), np.sin(0.4))
    mean = 0.5 * (x + x @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    over, forces = over_step(system, x), []
    for stretch in (1e-10, 1e-9, 1e-8, 1e-7, 1e-6):
        forces.append(over.force(system.state(mean * (1 + stretch))) / stretch)
    for f in forces:
        assert np.linalg.norm(f - forces[-1]) < 1e-3 * np.linalg.norm(forces[-1])


@pytest.mark.stories
def test_the_exact_tangent_helps_where_the_symmetric_one_does_not_converge():
    """A sheet that turns by 0.6 rad in each step."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.HingeBending()])
    x = system.rest().x - [0.5, 0.5, 0.0]
    start = system.state(1.02 * x, np.cross([0.0, 30.0, 9.0], x))

    def end(tangent):
        method = fc.EnergyMomentum(tangent=tangent)
        return [s.x for s, _ in fc.march(system, method, start, 0.02, 0.06, newton=EXACT)][-1]

    with pytest.raises(fc.StepFailed):
        end("symmetric")
    np.testing.assert_allclose(end("auto"), end("exact"), rtol=0, atol=1e-8)


def test_the_midpoint_rule_does_not_keep_the_energy_of_that_flight(cloth):
    result, *_ = flight(cloth, [fc.StVK()], fc.ImplicitMidpoint(), 2e-3, 0.02)
    assert np.ptp(result.energies["total"]) > 1e-3 * result.energies["kinetic"].max()


@pytest.mark.stories
@pytest.mark.parametrize(
    "terms",
    [
        [fc.StVK(), fc.StrainRateDamping(0.002), fc.MassDamping(1.0), fc.Gravity()],
        [fc.Springs(damping=0.002), fc.HingeBending(), fc.BendingDamping(0.01), fc.Gravity()],
    ],
    ids=["membrane", "springs"],
)
def test_the_ledger_closes_on_a_nonlinear_problem_with_damping_and_a_moved_pin(terms, cloth):
    pin = fc.Pin("left", motion=lambda t: [0.0, 0.0, 0.05 * np.sin(20 * t)])
    system = fc.System(cloth, ISOTROPIC, terms, pins=[pin])
    newton = fc.Newton(tolerance=1e-13)
    energies = fc.run(system, fc.EnergyMomentum(), system.rest(), 5e-3, 0.2, newton=newton).energies
    flows = [v for k, v in energies.items() if k.startswith("dissipated")] + [energies["pins"]]
    turnover = energies["kinetic"].max() + sum(abs(flow).max() for flow in flows)
    assert all(abs(flow).max() > 1e-5 * turnover for flow in flows)
    assert abs(energies["remainder"]).max() < 1e-10 * turnover


@pytest.mark.stories
@pytest.mark.parametrize("damping", [0.0, 0.003])
@pytest.mark.parametrize(("pattern", "rate"), [("right", 5.0), ("equilateral", 30.0)])
def test_a_net_that_turns_without_stretch_meets_no_jump_of_the_force(pattern, rate, damping):
    """A spring's force over a step has a limit as its stretch over the step goes to zero."""
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.1, pattern=pattern)
    system = fc.System(cloth, fc.Fabric(0.2, 500.0, 0.2), [fc.Springs(damping=damping)])
    x = system.rest().x - [0.5, 0.3, 0.0]
    start = system.state(x, np.cross([0.0, 0.0, rate], x))
    run = fc.run(system, fc.EnergyMomentum("exact"), start, dt=0.005, t_end=0.3)
    assert run.newton < 5 * 60
