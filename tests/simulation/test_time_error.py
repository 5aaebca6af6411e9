"""The error in time that a run reports, against solutions in closed form."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation
from support.tiers import in_turn, stories_except

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.linalg.reductions import rms
from fecloth.simulation.account import Run
from fecloth.simulation.rigid_motion import derivative, rms_of_deformation
from fecloth.simulation.sampled_error import FEWEST_SAMPLES, SampledError
from fecloth.simulation.time_error import TimeError
from fecloth.simulation.time_error_words import describe_time_error

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

TIGHT = fc.Newton(tolerance=1e-10)
SIZE = 1e-5  # m; the motion is then linear
PERIODS = 3  # of the slowest mode

CASES = {name: method() for name, method in {**METHODS, **EXPLICIT}.items()}
del CASES["forward_euler"]  # unstable without damping
FIRST = ("backward_euler", "linearly_implicit_euler")  # by their drift


@cache
def bar(rate=0.0):
    """A free sheet with damping, and its slowest modes: shape (n, 3) of rms 1, and ω."""
    cloth = fc.Cloth.rectangle(0.8, 0.4, h=0.2, pattern="right")
    terms = [fc.StVK()] + ([fc.MassDamping(rate=rate)] if rate else [])
    system = fc.System(cloth, fc.Fabric(0.2, 500.0, 0.2), terms)
    plane = np.arange(3 * len(cloth.X)).reshape(-1, 3)[:, :2].ravel()
    K = system.stiffness(system.rest()).toarray()[np.ix_(plane, plane)]
    squares, shapes = eigh(K, np.diag(np.repeat(system.nodal_mass, 2)))
    modes = []
    for number in (3, 5, 8):  # three are rigid
        shape = np.zeros((len(cloth.X), 3))
        shape.ravel()[plane] = shapes[:, number]
        shape /= np.sqrt(system.nodal_mass @ (shape**2).sum(axis=1) / system.nodal_mass.sum())
        modes.append((shape, math.sqrt(squares[number])))
    return system, modes


def vibration(amounts=(1.0,), phase=0.0, rate=0.0):
    """The system and its motion x(t), v(t): the modes with these amounts of SIZE."""
    system, modes = bar(rate)
    rest, chosen = system.rest().x, list(zip(amounts, modes, strict=False))

    def at(t):
        x, v = rest.copy(), np.zeros_like(rest)
        for amount, (shape, omega) in chosen:
            damped, fall = math.sqrt(omega**2 - rate**2 / 4), math.exp(-rate * t / 2)
            angle = damped * t + phase
            x += SIZE * amount * fall * math.cos(angle) * shape
            speed = -damped * math.sin(angle) - rate / 2 * math.cos(angle)
            v += SIZE * amount * fall * speed * shape
        return x, v

    return system, at, modes[0][1]


def estimate_of(result):
    """The estimated error in time, before its factor of safety."""
    return result.time_error / SampledError.safety


def errors(method, system, at, dt, t_end):
    """The estimated error, and the true one."""
    weights, seen = system.nodal_mass, []

    def report(info):
        exact = at(info.t)[0]
        seen.append((rms(weights, info.result.state.x - exact), exact))

    x, v = at(0.0)
    result = fc.run(system, method, system.state(x, v), dt, t_end, newton=TIGHT, report=report)
    largest = max(rms(weights, each - x) for _, each in seen)
    return estimate_of(result), max(far for far, _ in seen) / largest


@pytest.mark.parametrize(
    ("name", "size", "phase"),
    in_turn(list(CASES), [0.4, 1.0], [0.0, 0.0, -math.pi / 2, -math.pi / 2]),
)
def test_a_vibration_is_judged_rightly_by_every_method(name, size, phase):
    system, at, omega = vibration(phase=phase)
    omega_dt, periods = (0.05 * size, 0.75) if name in FIRST else (0.2 * size, PERIODS)
    said, true = errors(CASES[name], system, at, omega_dt / omega, 2 * math.pi * periods / omega)
    assert 1e-4 < true < 0.3
    assert 0.5 < said / true < 2.0 or (name == "symplectic_euler" and said > true)


@pytest.mark.stories
@pytest.mark.parametrize("name", ["bdf2", "implicit_midpoint", "generalized_alpha"])
def test_errors_of_a_driven_motion_with_damping_are_forgotten(name):
    """A force near resonance for thirty times as long as a free motion lasts."""
    system, modes = bar(rate := 100.0)
    shape, omega = modes[0]
    driven = 0.9 * omega
    answer = 1 / (omega**2 - driven**2 + 1j * rate * driven)

    def push(x, v, t):
        return SIZE / abs(answer) * math.cos(driven * t) * shape

    def at(t):
        swing = SIZE / abs(answer) * answer * np.exp(1j * driven * t)
        rest = system.rest().x
        return rest + swing.real * shape, (1j * driven * swing).real * shape

    load = fc.UserForce(push, per="mass")
    whole = system.replace(terms=[*system.terms, load])
    said, true = errors(CASES[name], whole, at, 0.1 / omega, 30 * 2 / rate)
    assert 1 / 5 < said / true < 5


@pytest.mark.parametrize("name", METHODS)  # stable steps of explicit ones resolve this motion
def test_steps_that_do_not_resolve_the_motion_are_told(name):
    system, at, omega = vibration()
    omega_dt, t_end = 0.2 if name in FIRST else 1.0, 2 * math.pi * PERIODS / omega
    said, true = errors(CASES[name], system, at, omega_dt / omega, t_end)
    assert true > 0.3
    assert said > 0.3 / SampledError.safety


@pytest.mark.parametrize(("name", "omega_dt"), [("bdf2", 0.25), ("implicit_midpoint", 0.45)])
def test_the_step_that_is_proposed_gives_at_most_one_per_cent(name, omega_dt):
    system, at, omega = vibration()
    t_end = 2 * math.pi * PERIODS / omega
    start = system.state(*at(0.0))
    with pytest.warns(fc.FeclothWarning, match="would give at most 1 %") as result:
        fc.run(system, CASES[name], start, omega_dt / omega, t_end, newton=TIGHT)
    (words,) = (str(each.message) for each in result if "would give" in str(each.message))
    dt = float(words.split("dt = ")[1].split()[0])
    _, true = errors(CASES[name], system, at, dt, t_end)
    assert 0.005 < SampledError.safety * true < 0.02


def deformed(added):
    """The result of a vibration seen by an observer who moves, and its time."""
    system, at, omega = vibration()
    x, v = at(0.0)
    start, t_end = system.state(x, v + added), 2 * math.pi * PERIODS / omega
    return fc.run(system, CASES["bdf2"], start, 0.1 / omega, t_end, newton=TIGHT), t_end


def test_the_error_is_relative_to_all_that_moves_and_the_deformation_has_its_own():
    """An observer who flies by sees the same error in metres, of a longer way."""
    rest, _ = deformed(0.0)
    seen, t_end = deformed(np.array([0.02, 0.0, -0.06]))
    assert seen.deformation_error == pytest.approx(rest.deformation_error, rel=0.02)
    assert rest.figures["deformation_error"] == rest.deformation_error
    length = rest.deformation_error * rest.accounts[TimeError].deformed
    assert rest.deformation_error == pytest.approx(rest.time_error, rel=0.02)
    assert seen.time_error == pytest.approx(length / (math.hypot(0.02, 0.06) * t_end), rel=0.1)
    assert rest.time_error > 3 * seen.time_error


@pytest.mark.parametrize(
    "method",
    stories_except([fc.BDF2(), fc.BackwardEuler(), fc.ImplicitMidpoint()], fc.BDF2()),
    ids=str,
)
def test_a_rigid_rotation_is_judged_rightly(method):
    """A sheet that spins: the method turns it too slowly."""
    system, omega, mass = bar()[0], 20.0, bar()[0].nodal_mass
    r = system.rest().x - system.rest().x.mean(axis=0)
    start = fc.State(0.0, r, omega * np.column_stack([-r[:, 1], r[:, 0], 0 * r[:, 0]]))
    dt = 0.0004 if method.traits.order == 1 else 0.004
    seen = []
    result = fc.run(system, method, start, dt, 0.1, report=lambda i: seen.append(i.result.state))
    fine = fc.run(system, fc.ImplicitMidpoint(), start, 0.0004, 0.1)
    true = rms(mass, seen[-1].x - fine.state.x) / max(rms(mass, state.x - r) for state in seen)
    assert 1 / 3 < estimate_of(result) / true < 3


def test_a_cloth_at_rest_and_two_steps_have_no_estimate():
    system, at, omega = vibration()
    rest = fc.run(system, fc.BDF2(), system.rest(), 0.1 / omega, 1.0 / omega)
    assert math.isnan(rest.time_error)
    assert "no estimate" in repr(rest)
    short = fc.run(system, fc.BDF2(), system.state(*at(0.0)), 0.1 / omega, 0.2 / omega)
    assert math.isnan(short.time_error)


@pytest.mark.parametrize(("part", "known"), [(0.8, False), (1.25, True)])
def test_a_motion_within_a_tenth_of_the_gap_has_no_estimate(part, known):
    """The barrier gives way as much under the weight of the cloth."""
    cloth, gap = fc.Cloth.rectangle(0.3, 0.3, 0.3), 1e-3
    obstacles = [fc.Obstacle(fc.shapes.Plane((0, 0, -9), (0, 0, 1)), n * gap) for n in (1, 2)]
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK(), *obstacles])
    error = TimeError(system.rest().x, (0.0, 0), sampled(whole=1e-6), moved=part * 0.1 * gap)
    whole, _ = error.relative_errors(system)
    expected = SampledError.safety * 1e-6 / error.moved
    assert whole == pytest.approx(expected) if known else math.isnan(whole)


def test_the_derivative_is_exact_for_polynomials():
    times, cubic = (0.3, 0.5, 1.1, 1.2), np.arange(6.0).reshape(2, 3)
    places = [1e3 + cubic * t**3 - t**2 for t in times]
    assert derivative(times, places) == pytest.approx(6 * cubic, abs=1e-6)


@pytest.mark.parametrize(
    ("t_end", "most"),
    [(20, 2 * FEWEST_SAMPLES), pytest.param(2000, 400, marks=pytest.mark.stories)],
)
def test_samples_of_a_long_run_are_rare(t_end, most, monkeypatch):
    """The fast steps of explicit methods pay for few of them: at most one in 500 of many."""
    counted, whole = [], SampledError.sampled
    monkeypatch.setattr(SampledError, "sampled", lambda *given: counted.append(1) or whole(*given))
    system, at, omega = vibration()
    start = system.state(*at(0.0))
    result = fc.run(system, fc.CentralDifference(), start, 0.01 / omega, t_end / omega)
    assert result.steps == 100 * t_end
    assert FEWEST_SAMPLES / 2 < len(counted) < most


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.ImplicitMidpoint()], ids=str)
def test_a_load_that_jumps_within_a_step_is_in_the_error(method):
    """A free sheet, pushed for 4.34 steps from 1.6 steps on, errs by some tenths of its motion."""
    cloth, dt = fc.Cloth.rectangle(0.8, 0.4, h=0.2, pattern="right"), 0.0023
    push = fc.UserForce((0, 0, f"where(t > {1.6 * dt} and t < {(1.6 + 4.34) * dt}, 1, 0)"))
    system = fc.System(cloth, fc.Fabric(0.2, 5.0), [fc.StVK(), push])
    with pytest.warns(fc.FeclothWarning, match="would give at most 1 %"):
        result = fc.run(system, method, system.rest(), dt, 20 * dt)
    ratio = estimate_of(result) / (math.sqrt(2) / 4 / 4.34)
    assert 0.5 < ratio < 2.0  # where in a step it jumps is chance
    (words,) = (words for words in result.warnings if "would give" in words)
    finer = float(words.split("dt = ")[1].split()[0])
    result = fc.run(system, method, system.rest(), finer, 20 * dt)
    assert result.time_error < 0.02
    exact = 1 / 0.2 * 4.34 * dt * (20 * dt - (1.6 + 4.34 / 2) * dt)
    assert result.state.x[:, 2].mean() == pytest.approx(exact, rel=0.02)


ONE = [0.0337]
MANY = (np.arange(100) + 0.5) * 1e-3
JUMPS = {
    "formula": (fc.Pressure("where(t < 0.0337, 0, 5)"), ONE),
    "function": (fc.Pressure(lambda t: 5.0 * (t >= 0.0337)), ONE),
    "force": (fc.UserForce(lambda x, v, t: np.full_like(x, t >= 0.0337)), ONE),
    "many": (fc.Pressure("sign(cos(1000*pi*t))"), MANY),
}


@pytest.mark.parametrize(("load", "expected"), JUMPS.values(), ids=JUMPS)
def test_jumps_of_a_load_are_known_before_the_run(load, expected):
    system = fc.System(bar()[0].cloth, fc.Fabric(0.2, 5.0), [fc.StVK(), load])
    jumps = Run(system, fc.BDF2(), system.rest(), 0, 4.0, 0.1).load_jumps
    assert jumps == pytest.approx(expected, rel=1e-9 if expected is ONE else 1e-6)


def sampled(**values):
    """The error of a run at its begin, with these values."""
    system, _ = bar()
    run = Run(system, fc.BDF2(), system.rest(), 0, 4.0, 1.0)
    return replace(SampledError.begin(run), **values)


def words_of(most, jump=math.inf):
    return describe_time_error(most, sampled(kicked=jump), fc.BDF2(), 0.01)


@pytest.mark.parametrize(
    ("most", "jump", "end"),
    [
        (math.nan, math.inf, "no estimate"),
        (0.0104, math.inf, "(at most 1 %)"),
        (0.0104, 0.3, "(at most 1 %)"),
        (0.04, math.inf, "; dt = 0.005 s would give at most 1 %"),  # by the order
        (0.04, 0.3, "; dt = 0.0025 s would give at most 1 %"),  # a jump of a load makes it 1
    ],
)
def test_a_step_is_proposed_where_the_error_rounds_to_more_than_1_percent(most, jump, end):
    assert words_of(most, jump=jump).endswith(end)
    assert "would give" in words_of(0.0106, jump=jump)


def test_what_is_stated_is_at_most_1():
    """Errors that have grown beyond the motion say only that nothing is known."""
    system, _ = bar()
    grown = sampled(whole=1e30, deforming=1e30)
    error = TimeError(system.rest().x, (0.0, 0), grown, moved=0.1, deformed=0.1)
    assert error.relative_errors(system) == (1.0, 1.0)
    assert "not resolved, or small errors have grown" in words_of(1.0)


def test_a_deformation_is_what_no_rigid_motion_explains(rng):
    """A stretch by 1 % along x, then turned far and shifted: the rms is 1 % of the rms of x."""
    a, w = rng.normal(size=(40, 3)), rng.uniform(0.5, 2.0, 40)
    a -= w @ a / w.sum()
    axes = np.linalg.eigh((w[:, None] * a).T @ a)[1]
    a = a @ axes  # the moments of x, y and z are 0, so that no rotation explains the stretch
    b = a * [1.01, 1.0, 1.0]
    turn = Rotation.from_rotvec([0.3, -2.0, 1.1]).as_matrix()
    expected = 0.01 * math.sqrt(w @ a[:, 0] ** 2 / w.sum())
    assert rms_of_deformation(w, a, b @ turn.T + [1.0, 2.0, 3.0]) == pytest.approx(expected)
    assert rms_of_deformation(w, a, a @ turn.T) == pytest.approx(0.0, abs=1e-12)
    assert rms_of_deformation(w, a, a * [1.0, 1.0, -1.0]) > 0.1  # a reflection is no rotation
