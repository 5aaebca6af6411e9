"""For every method: drift, order, momenta, ledger, history, restart, and the halves of its step."""

from functools import cache

import numpy as np
import pytest
from conftest import affine, taut_start
from support.linear_term import LinearDamping, LinearMembrane
from support.rundirs import restart_at
from support.sliders import Sliders, SlidersOverStep
from support.tiers import MASSES, in_turn, stories_except

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS, MethodTraits, studied_by
from fecloth.integrators.protocol import StepChoice
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.runs import restart
from fecloth.simulation.fixed_step import FixedStep
from fecloth.simulation.stability_limited import StabilityLimited
from fecloth.stability.amplification_matrix import step_matrix
from fecloth.verify import VerificationFailed, check_integrator

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

TIGHT = fc.Newton(tolerance=1e-12, reuse=False)
ALL = {name: kind() for name, kind in METHODS.items()}
ALL |= {name: kind(beyond_limit=True) for name, kind in EXPLICIT.items()}
CLOTH = fc.Cloth.rectangle(0.4, 0.3, h=0.1)
FABRIC = fc.Fabric(0.2, 1000.0, 0.3)

# (method, mass): each method with one of the masses that it takes
WITH_MASS = [*in_turn([*METHODS], MASSES), *((name, "lumped") for name in EXPLICIT)]


def options(method):
    return {} if method.traits.explicit else {"solver": "direct", "newton": TIGHT}


# --- traits ---------------------------------------------------------------------------------------

OTHER_PARAMETERS = {f"rho = {rho}": fc.GeneralizedAlpha(rho) for rho in (0.0, 0.3, 0.8, 1.0)}
OTHER_PARAMETERS |= {f"beta = {beta}": fc.Newmark(beta) for beta in (0.26, 0.15, 0.4)}
OTHER_PARAMETERS |= {f"gamma = {gamma}": fc.Newmark(0.5, gamma) for gamma in (0.6, 0.9)}


@pytest.mark.parametrize("name", [*ALL, *OTHER_PARAMETERS])
def test_the_drift_of_an_oscillator_is_that_of_the_traits(name):
    """|log λ / (i ω dt) − 1| of the eigenvalue λ of a step that stands for the oscillator."""
    method, omega_dt = (ALL | OTHER_PARAMETERS)[name], 0.02
    values = np.linalg.eigvals(step_matrix(method, omega_dt, 0.0))
    value = values[np.argmin(abs(values - np.exp(1j * omega_dt)))]
    drift = abs(np.log(value) / (1j * omega_dt) - 1)
    order, constant = method.traits.drift
    assert drift / omega_dt**order == pytest.approx(constant, rel=0.01)


def test_methods_that_studies_run_by_default():
    usual = ("backward_euler", "bdf2", "implicit_midpoint", "generalized_alpha")
    more = ("energy_momentum", "linearly_implicit_euler", "symplectic_euler", "central_difference")
    assert studied_by("chart") == (*usual, "central_difference")
    assert studied_by("stability") == (*usual, *more)


def members(kind):
    """The names that a protocol asks for."""
    bases = [base for base in kind.__mro__ if getattr(base, "_is_protocol", False)]
    names = {name for base in bases for name in [*vars(base), *base.__annotations__]}
    return {name for name in names if not name.startswith("_")}


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.SymplecticEuler()])
def test_what_chooses_the_steps_of_a_method_hands_on_its_traits(method):
    for wrapper in StabilityLimited(method), fc.Adaptive(method), FixedStep(method, 0.1):
        assert all(hasattr(wrapper, name) for name in members(StepChoice))
        assert wrapper.traits.chooses_dt
        for name in ("order", "theta", "explicit", "symmetric", "error_constant", "stability"):
            assert getattr(wrapper.traits, name) == getattr(method.traits, name)


# --- order ----------------------------------------------------------------------------------------

TANGENTS = ["symmetric", "exact", "exact", "symmetric"]
ORDERS = {name: case for name, *case in in_turn([*METHODS], MASSES, TANGENTS)}
ORDERS |= dict.fromkeys(EXPLICIT, ("lumped", "symmetric"))


@pytest.mark.parametrize("name", stories_except(ORDERS, "central_difference"))
def test_order_with_damping_and_moved_pins(name):
    mass, tangent = ORDERS[name]
    shake = fc.Pin("left", motion=lambda t: [0.0, 0.0, 0.01 * (1 - np.cos(60 * t))])
    rail = fc.Slide("right", normal=(1.0, 0.0, 0.5))
    time, t_end, first = (2e-4, 0.01, 80) if name in EXPLICIT else (0.002, 0.005, 40)
    terms = [fc.StVK(), fc.StrainRateDamping(time, tangent=tangent), fc.Gravity()]
    system = fc.System(CLOTH, FABRIC, terms, pins=[shake, rail], mass=mass)
    steps = tuple(first * 2**k for k in range(4))
    check_integrator(system, ALL[name], taut_start(system), t_end=t_end, steps=steps)


def test_check_integrator_detects_a_wrong_order():
    class Claims(fc.BackwardEuler):
        traits = MethodTraits(order=2)

    system = fc.System(CLOTH, FABRIC, [fc.StVK()], pins=["boundary"])
    with pytest.raises(VerificationFailed, match="expected 2"):
        check_integrator(system, Claims(), taut_start(system), t_end=0.005)


# --- momenta --------------------------------------------------------------------------------------

TURNING = {  # c of L₁ − L₀ = c dt v₀ × M v₁ for a free cloth; other methods promise nothing
    "backward_euler": -1.0,
    "implicit_midpoint": 0.0,
    "energy_momentum": 0.0,
    "symplectic_euler": 0.0,
    "central_difference": 0.0,
    "forward_euler": 1.0,
}


def momenta(system, state):
    p = system.scalar_mass @ state.v
    return p.sum(axis=0), np.cross(state.x, p).sum(axis=0)


@pytest.mark.parametrize(
    ("name", "mass", "element"),
    [
        *((name, mass, "P1") for name, mass in WITH_MASS),
        ("backward_euler", "consistent", "P2"),
        ("energy_momentum", "consistent", "P2"),
        ("generalized_alpha", "consistent", "P2"),
    ],
)
def test_momenta_of_a_free_cloth(name, mass, element, quadratic, rng):
    cloth, method = CLOTH if element == "P1" else quadratic, ALL[name]
    dt, time = (1e-4, 2e-4) if name in EXPLICIT else (2e-3, 0.005)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.StrainRateDamping(time)], mass=mass)
    x = affine(cloth, [[1.1, 0.0], [0.1, 1.05], [0.0, 0.2]])
    v = np.cross([1.0, 2.0, 3.0], x) + [0.5, -0.2, 0.1] + 0.05 * rng.standard_normal(x.shape)
    old = system.state(x, v)
    (linear, angular), changes = momenta(system, old), []
    for new, _ in fc.march(system, method, old, dt, 20 * dt, **options(method)):
        p, L = momenta(system, new)
        assert np.linalg.norm(p - linear) < 1e-12 * np.linalg.norm(linear)
        if name in TURNING:
            formula = TURNING[name] * dt * np.cross(old.v, system.scalar_mass @ new.v).sum(axis=0)
            changes.append(np.linalg.norm(formula))
            difference = L - momenta(system, old)[1] - formula
            assert np.linalg.norm(difference) < 1e-11 * np.linalg.norm(angular)
        old = new
    if TURNING.get(name):
        assert max(changes) > 1e-6 * np.linalg.norm(angular)


# --- energy ---------------------------------------------------------------------------------------


@cache
def linear_run(method, mass="lumped", is_moved=True):
    """A linear, damped sheet under its weight on a slide, whose left edge is shaken or fixed."""
    shake = fc.Pin("left", lambda t: [0.02 * np.sin(30 * t), 0.0, 0.05 * np.sin(40 * t)])
    slide = fc.Slide("right", direction=(1, 2, 0))
    terms = [LinearMembrane(), LinearDamping(1e-4), fc.MassDamping(1.0), fc.Gravity()]
    pins = [shake if is_moved else "left", slide]
    system = fc.System(CLOTH, FABRIC, terms, pins, mass=mass)
    start = system.state(affine(CLOTH, [[1.2, 0.0], [0.0, 1.2], [0.0, 0.0]]))
    dt = 2e-4 if method.traits.explicit else 2e-3
    run = fc.run(system, method, start, dt, 40 * dt, most_growth=np.inf, **options(method))
    return system, start, run


KEEPING = [fc.Newmark(), fc.GeneralizedAlpha(1.0)]  # no energy of an undamped mode is lost
MORE = [fc.Newmark(0.36, 0.7), fc.GeneralizedAlpha(0.0), fc.GeneralizedAlpha(1.0)]


@pytest.mark.parametrize(
    ("method", "mass"),
    [*((ALL[name], mass) for name, mass in WITH_MASS), *in_turn(MORE, MASSES)],
    ids=str,
)
def test_the_ledger_of_a_linear_problem_closes(method, mass):
    """Moved pins, a slide, damping, gravity: nothing is left unexplained."""
    _, start, run = linear_run(method, mass)
    energies, left = run.energies, CLOTH.nodes("left")
    t = run.state.t
    followed = start.x[left] + [0.02 * np.sin(30 * t), 0.0, 0.05 * np.sin(40 * t)]
    np.testing.assert_allclose(run.state.x[left], followed, rtol=0, atol=4e-15)
    assert min(abs(energies[c]).max() for c in ("pins", "dissipated:LinearDamping")) > 1e-4
    assert abs(energies["remainder"]).max() < 1e-10 * abs(energies["total"]).max()


@pytest.mark.parametrize("method", [*KEEPING, *MORE[:2], fc.BDF2()], ids=str)
def test_with_fixed_pins_only_methods_without_dissipation_take_nothing(method):
    energies = linear_run(method, is_moved=False)[2].energies
    takes = abs(energies["numerical"]).max() / abs(energies["total"]).max()
    assert takes < 1e-14 if method in KEEPING else takes > 1e-4


@pytest.mark.parametrize("mass", MASSES)
def test_a_linearised_step_is_backward_euler_on_a_linear_problem(mass):
    ends = [linear_run(m, mass)[2].state for m in (fc.BackwardEuler(), fc.LinearlyImplicitEuler())]
    np.testing.assert_allclose(ends[0].x, ends[1].x, atol=1e-12)
    np.testing.assert_allclose(ends[0].v, ends[1].v, atol=1e-9)


@pytest.mark.parametrize("name", ALL)
def test_reactions_of_a_slide_carry_what_it_holds(name):
    slide = fc.Slide(lambda X: X[:, 0] > -1, normal=(1.0, -2.0, 2.0), name="plane")
    system = fc.System(CLOTH, FABRIC, [fc.Gravity()], [slide])
    result = fc.run(system, ALL[name], system.rest(), 0.01, 0.1)
    weight = 0.2 * CLOTH.area * np.array([0.0, 0.0, -9.81])
    reaction = [result.observed[f"reaction:plane.{c}"][-1] for c in "xyz"]
    np.testing.assert_allclose(reaction, slide.projector @ weight - weight, atol=1e-12)
    speed = 0.1 * slide.projector @ [0.0, 0.0, -9.81]
    np.testing.assert_allclose(result.state.v, np.tile(speed, (len(CLOTH.X), 1)), atol=1e-12)


@pytest.mark.parametrize("name", EXPLICIT)
def test_explicit_steps_make_no_matrix(name, monkeypatch):
    def forbidden(*_):
        raise AssertionError("a matrix was made")

    system = fc.System(CLOTH, FABRIC, [fc.StVK(), fc.Gravity()], ["left"])
    monkeypatch.setattr(BlockMatrix, "zeros", forbidden)
    run = fc.run(system, ALL[name], system.rest(), 1e-4, 1e-3, solver="direct", time_error="none")
    assert run.solver == "none, as the method is explicit"


# --- history and restart --------------------------------------------------------------------------

DT, STEPS = 2e-4, 12


@pytest.fixture(scope="module")
def system():
    terms = [fc.StVK(), Sliders(k=20.0, most=0.003), fc.Gravity()]
    return fc.System(CLOTH, FABRIC, terms, pins=["left"])


def march(system, method, state, **known):
    return list(fc.march(system, method, state, DT, STEPS * DT, **options(method), **known))


@pytest.fixture(scope="module", params=ALL)
def course(request, system):
    """A method, and the steps that it makes from a taut start."""
    method = ALL[request.param]
    return method, march(system, method, taut_start(system))


def same(first, second):
    return np.array_equal(first.place, second.place) and np.array_equal(first.heat, second.heat)


def test_each_step_begins_with_what_the_one_before_left(course, system):
    """The record is the return mapping at the end of each step, begun where the last one ended."""
    start, bound = taut_start(system), system.bound[1]
    record = bound.start_history(start.x, 0.0)
    for state, info in course[1]:
        none, before, _ = info.result.earlier
        assert none is None
        assert same(before, record)
        record = SlidersOverStep(**vars(bound.with_history(record))).commit(state.x, state.t)
        assert same(record, info.result.history[1])
        assert same(record, info.memory.term_history[1])
    assert record.heat > 0
    assert np.linalg.norm(record.place - start.x, axis=1).max() > 1e-4


def test_a_run_goes_on_from_a_restart_file_bit_for_bit(course, system, tmp_path):
    method, steps = course
    state, info = steps[STEPS // 2]
    saved = restart.read(restart.write(tmp_path, restart_at(state, info.memory))).progress
    assert same(saved.memory.term_history[1], info.result.history[1])
    on = march(system, method, saved.state, memory=saved.memory)
    assert len(on) == STEPS - STEPS // 2 - 1
    for (first, _), (second, _) in zip(on, steps[STEPS // 2 + 1 :], strict=True):
        assert np.array_equal(first.x, second.x)
        assert np.array_equal(first.v, second.v)
    assert same(on[-1][1].result.history[1], steps[-1][1].result.history[1])


def test_a_step_that_is_repeated_gives_the_same(course, system):
    method, ((state, info), (_, following), *_) = course
    solver, _ = fc.solver_for(system, method, DT, "direct", TIGHT)
    for _ in range(2):
        memory = info.memory.method_memory
        step = method.step(system, state, DT, solver, memory, info.result.history)
        np.testing.assert_array_equal(step.state.x, following.result.state.x)
        assert same(step.history[1], following.result.history[1])


# --- steps that open and close --------------------------------------------------------------------


def pulled(*more, damped=True):
    """Without damping of the strain rate the tangents of all methods are exact."""
    terms = [fc.StVK(), fc.MassDamping(2.0), fc.Gravity(), *more]
    terms += [fc.StrainRateDamping(1e-3)] if damped else []
    pull = fc.Pin("left", motion=lambda t: [0.1 * t, 0.0, 0.2 * np.sin(9 * t)])
    return fc.System(CLOTH, FABRIC, terms, pins=[pull, fc.Slide("right", direction=(0, 1, 0))])


def second_step(system, method, dt):
    """The arguments of `open` at a second step, and that step."""
    solver, _ = fc.solver_for(system, method, dt, "direct", TIGHT)
    start = taut_start(system)
    first = method.step(system, start, dt, solver, None, system.start_history(start))
    given = first.memory, first.history
    return (system, first.state, dt, *given), method.step(system, first.state, dt, solver, *given)


def solved(step):
    """The q of a step, which is an entry of its memory."""
    return getattr(step.memory, "a", getattr(step.memory, "dv", step.memory))


@pytest.mark.parametrize("slides", [False, True], ids=["", "with history"])
@pytest.mark.parametrize("name", ALL)
def test_open_and_close_at_the_solved_q_are_the_step(name, slides):
    """The q of explicit methods is the acceleration at the state that they ask for."""
    system, method = pulled(*([Sliders(20.0, 0.003)] if slides else [])), ALL[name]
    given, step = second_step(system, method, 1e-4 if name in EXPLICIT else 2e-3)
    opening = method.open(*given)
    if name in EXPLICIT:
        q = opening.acceleration()
        a = opening.over.force(opening.at) / system.nodal_mass[:, None]
        np.testing.assert_allclose(q, a, rtol=1e-14)
    else:
        q = system.constraints.project(solved(step).copy())  # without what the pins prescribe
        size = np.linalg.norm(opening.residual(0 * q))
        assert np.linalg.norm(opening.residual(q)) < 1e-10 * size
    closed = method.close(opening, q)
    np.testing.assert_allclose(closed.state.x, step.state.x, rtol=0, atol=1e-15)
    np.testing.assert_allclose(closed.state.v, step.state.v, rtol=0, atol=1e-13)
    assert closed.state.t == step.state.t
    if slides:
        by_parts, at_once = closed.history[3], step.history[3]
        np.testing.assert_allclose(by_parts.place, at_once.place, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", METHODS)
def test_the_tangent_is_the_derivative_of_the_residual(name, rng):
    """Central differences along a free direction, where the tangents are exact."""
    kind = METHODS[name]
    method = kind(tangent="exact") if name == "energy_momentum" else kind()
    system = pulled(damped=name in ("backward_euler", "bdf2"))
    given, _ = second_step(system, kind(), 2e-3)
    opening, project = method.open(*given[:-1]), system.constraints.project
    wx = opening.stage.wx if hasattr(opening, "stage") else 2e-3
    q, d = (project(a / wx * rng.standard_normal(CLOTH.X.shape[:1] + (3,))) for a in (1e-3, 1e-6))
    J = opening.tangent(q, BlockMatrix.zeros(system.pattern))
    change = 0.5 * (opening.residual(q + d) - opening.residual(q - d))
    np.testing.assert_allclose(project(J @ d), change, atol=1e-6 * abs(change).max())
