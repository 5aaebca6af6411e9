"""The error in time that a run reports, against solutions in closed form."""

import math
import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import eigh
from support.tiers import stories_except

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.linalg.reductions import rms
from fecloth.quantities.formula import Formula
from fecloth.simulation import account
from fecloth.simulation.account import Run
from fecloth.simulation.rigid_motion import derivative
from fecloth.simulation.time_error import Sample, TimeError
from fecloth.simulation.time_error_words import describe_time_error

TIGHT = fc.Newton(tolerance=1e-10)
SIZE = 1e-5  # m; the motion is then linear
PERIODS = 3  # of the slowest mode

CASES = {name: method() for name, method in {**METHODS, **EXPLICIT}.items()}
del CASES["forward_euler"]  # unstable without damping
FIRST = ("backward_euler", "linearly_implicit_euler")  # by their drift
QUICK = ("implicit_midpoint", "bdf2", "backward_euler", "central_difference", "symplectic_euler")


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


def errors(method, system, at, dt, t_end):
    """The reported error, and the true one."""
    weights, seen = system.nodal_mass, []

    def report(info):
        exact = at(info.t)[0]
        seen.append((rms(weights, info.result.state.x - exact), exact))

    x, v = at(0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fc.FeclothWarning)
        start = system.state(x, v)
        result = fc.run(system, method, start, dt, t_end, newton=TIGHT, report=report)
    largest = max(rms(weights, one - x) for _, one in seen)
    return result.time_error, max(far for far, _ in seen) / largest


@pytest.mark.parametrize("name", stories_except(CASES, *QUICK))
@pytest.mark.parametrize("size", stories_except([0.4, 1.0], 0.4), ids=["small", "larger"])
@pytest.mark.parametrize("phase", [0.0, -math.pi / 2], ids=["drawn", "struck"])
def test_a_vibration_is_judged_rightly_by_every_method(name, size, phase):
    system, at, omega = vibration(phase=phase)
    omega_dt, periods = (0.05 * size, 0.75) if name in FIRST else (0.2 * size, PERIODS)
    said, true = errors(CASES[name], system, at, omega_dt / omega, 2 * math.pi * periods / omega)
    assert 1e-4 < true < 0.3
    assert 0.5 < said / true < 2.0 or (name == "symplectic_euler" and said > true)


@pytest.mark.parametrize("name", ["bdf2", "implicit_midpoint"])
def test_of_many_modes_the_fast_ones_that_are_lost_count_by_their_size(name):
    """The third mode is not resolved at all; it is a twentieth of the motion."""
    system, at, omega = vibration((1.0, 0.3, 0.05))
    said, true = errors(CASES[name], system, at, 0.15 / omega, 2 * math.pi * PERIODS / omega)
    assert 0.02 < true < 0.3
    assert 1 / 3 < said / true < 3


@pytest.mark.stories
@pytest.mark.parametrize("name", stories_except(("bdf2", "implicit_midpoint"), "bdf2"))
@pytest.mark.parametrize("ratio", [0.1, 0.4])
def test_a_damped_motion_is_judged_rightly(name, ratio):
    """Until it has come to rest."""
    omega = vibration()[2]
    system, at, _ = vibration(rate=ratio * omega)
    said, true = errors(CASES[name], system, at, 0.15 / omega, 8 / (ratio * omega))
    assert 0.5 < said / true < 3


def test_the_first_derivative_stands_for_all_the_time_before():
    """A motion with t³, whose third derivative is constant: the error is that of all its time."""
    system, ((shape, _), *_) = bar()
    rest, method, dt = system.rest().x, fc.ImplicitMidpoint(), 0.01
    energies = {"deforming": 1.0, "kinetic": 1.0, "inside": 0.0, "outside": 0.0}
    q, constant = method.traits.drift or (2, method.traits.error_constant)
    start = Sample(0.0, 0, rest, 0 * rest, **energies)
    error = TimeError(rest, start, (start,))
    for step in range(1, 7):
        state = fc.State(step * dt, rest + SIZE * (step * dt) ** 3 * shape, 0 * rest)
        sample = Sample(state.t, step, state.x, state.v, **energies)
        error = error.sampled(system, method.traits, state, sample)
        exact = math.pi / 2 * constant * dt**q * 6 * SIZE * step * dt if step > q else 0.0
        assert math.hypot(error.inner, error.rigid) == pytest.approx(exact, rel=1e-6)


@pytest.mark.stories
@pytest.mark.parametrize("where", ["inside", "outside"])
def test_an_error_is_forgotten_as_fast_as_the_damped_mode_that_made_it(where):
    """e = κ dt^q ω^p A t exp(−γ t) of the mode A exp(−γ t) cos ωt, largest at t = 1/γ.

    It is the phase that grows, on an amplitude that falls. The damping may be felt by a rigid
    motion (outside) or not.
    """
    system, ((shape, omega), *_) = bar()
    rest, mass, method = system.rest().x, system.nodal_mass.sum(), fc.ImplicitMidpoint()
    gamma, dt = 0.02 * omega, 0.05 / omega
    counts, other = ("deforming", "kinetic")[:: 1 if where == "inside" else -1]
    q, constant = method.traits.drift or (2, method.traits.error_constant)

    def at(step, t, lost=0.0):
        fall = SIZE * math.exp(-gamma * t)
        speed = -fall * (omega * math.sin(omega * t) + gamma * math.cos(omega * t))
        kinetic = 0.5 * mass * speed**2
        energies = {"deforming": kinetic, "kinetic": kinetic, "inside": 0.0, "outside": 0.0}
        energies[where] = lost
        energies[other] *= 7  # it does not count
        x = rest + fall * math.cos(omega * t) * shape
        return fc.State(t, x, speed * shape), Sample(t, step, x, speed * shape, **energies)

    state, start = at(0, 0.0)
    error, lengths, lost = TimeError(state.x, start, (start,)), [], 0.0
    times = dt * np.arange(1, int(3 / (gamma * dt)))
    for step, t in enumerate(times, start=1):
        lost += (
            dt * 4 * gamma * getattr(at(step, t - 0.5 * dt)[1], counts)
        )  # the power of damping at the rate 2γ
        error = error.sampled(system, method.traits, *at(step, t, lost))
        lengths.append(error.inner)
    exact = constant * dt**q * omega ** (q + 1) * SIZE * times * np.exp(-gamma * times)
    later = times > 2 * math.pi / omega  # the estimate takes the mean of |cos ωt|
    assert np.array(lengths)[later] == pytest.approx(exact[later], rel=0.06)
    assert error.largest == pytest.approx(exact.max(), rel=0.02)


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
    whole = fc.System(system.cloth, system.fabric, [*system.terms, load])
    said, true = errors(CASES[name], whole, at, 0.1 / omega, 30 * 2 / rate)
    assert 1 / 5 < said / true < 5


@pytest.mark.parametrize("name", METHODS)  # stable steps of explicit ones resolve this motion
def test_steps_that_do_not_resolve_the_motion_are_told(name):
    system, at, omega = vibration()
    omega_dt, t_end = 0.2 if name in FIRST else 1.0, 2 * math.pi * PERIODS / omega
    said, true = errors(CASES[name], system, at, omega_dt / omega, t_end)
    assert true > 0.3
    assert said > 0.3


@pytest.mark.parametrize(("name", "omega_dt"), [("bdf2", 0.25), ("implicit_midpoint", 0.45)])
def test_the_step_that_is_proposed_gives_one_per_cent(name, omega_dt):
    system, at, omega = vibration()
    t_end = 2 * math.pi * PERIODS / omega
    start = system.state(*at(0.0))
    with pytest.warns(fc.FeclothWarning, match="would give 1 %") as found:
        fc.run(system, CASES[name], start, omega_dt / omega, t_end, newton=TIGHT)
    (words,) = (str(one.message) for one in found if "would give" in str(one.message))
    dt = float(words.split("dt = ")[1].split()[0])
    _, true = errors(CASES[name], system, at, dt, t_end)
    assert 0.005 < true < 0.02


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
    own = [result.figures["deformation_error"] for result in (rest, seen)]
    assert own[1] == pytest.approx(own[0], rel=0.02)
    assert seen.time_error == pytest.approx(own[0] / (math.hypot(0.02, 0.06) * t_end), rel=0.1)
    assert rest.time_error > 3 * seen.time_error


@pytest.mark.parametrize("method", [fc.BDF2(), fc.BackwardEuler(), fc.ImplicitMidpoint()], ids=str)
def test_a_rigid_rotation_is_judged_rightly(method):
    """A sheet that spins: the method turns it too slowly."""
    system, omega, mass = bar()[0], 20.0, bar()[0].nodal_mass
    r = system.rest().x - system.rest().x.mean(axis=0)
    start = fc.State(0.0, r, omega * np.column_stack([-r[:, 1], r[:, 0], 0 * r[:, 0]]))
    dt = 0.0004 if method.traits.order == 1 else 0.004
    seen = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fc.FeclothWarning)
        result = fc.run(
            system, method, start, dt, 0.1, report=lambda i: seen.append(i.result.state)
        )
        fine = fc.run(system, fc.ImplicitMidpoint(), start, 0.0004, 0.1)
    true = rms(mass, seen[-1].x - fine.state.x) / max(rms(mass, state.x - r) for state in seen)
    assert 1 / 3 < result.time_error / true < 3


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
    samples = [
        Sample(0.1 * i, i, system.rest().x + 1e-5 * i**2, system.rest().x, 0, 0, 0, 0)
        for i in range(3)
    ]
    estimate = TimeError(system.rest().x, samples[0], tuple(samples), largest=1e-6)
    estimate = estimate.changed(moved=part * 0.1 * gap)
    error = estimate.relative_error(system, fc.BackwardEuler.traits, 0.2)
    assert error == pytest.approx(1e-6 / estimate.moved) if known else math.isnan(error)


def test_the_derivative_is_exact_for_polynomials():
    times, cubic = (0.3, 0.5, 1.1, 1.2), np.arange(6.0).reshape(2, 3)
    samples = [
        Sample(t, i, 1e3 + cubic * t**3 - t**2, None, 0, 0, 0, 0) for i, t in enumerate(times)
    ]
    assert derivative([s.t for s in samples], [s.x for s in samples]) == pytest.approx(
        6 * cubic, abs=1e-6
    )


def test_samples_become_rare(monkeypatch):
    """The fast steps of explicit methods pay for few of them."""
    counted, whole = [], TimeError.sampled
    monkeypatch.setattr(TimeError, "sampled", lambda *given: counted.append(1) or whole(*given))
    system, at, omega = vibration()
    result = fc.run(
        system, fc.CentralDifference(), system.state(*at(0.0)), 0.01 / omega, 20 / omega
    )
    assert result.steps == 2000
    assert 20 < len(counted) < 500


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.ImplicitMidpoint()], ids=str)
def test_a_load_that_jumps_within_a_step_is_in_the_error(method):
    """A free sheet, pushed for 2.17 steps from 1.6 steps on, errs by some tenths of its motion."""
    cloth, dt = fc.Cloth.rectangle(0.8, 0.4, h=0.2, pattern="right"), 0.0023
    push = fc.UserForce((0, 0, f"where(t > {1.6 * dt} and t < {(1.6 + 2.17) * dt}, 1, 0)"))
    system = fc.System(cloth, fc.Fabric(0.2, 5.0), [fc.StVK(), push])
    with pytest.warns(fc.FeclothWarning, match=r"a load jumps at t = 0.00368 s.* would give 1 %"):
        result = fc.run(system, method, system.rest(), dt, 20 * dt)
    ratio = result.time_error / (math.sqrt(2) / 4 / 2.17)
    least, most = (0.8, 1.2) if method.traits.explicit else (1.0, 1.5)  # the field is larger
    assert least < ratio < most
    (words,) = (words for words in result.warnings if "jumps" in words)
    finer = float(words.split("dt = ")[1].split()[0])
    result = fc.run(system, method, system.rest(), finer, 20 * dt)
    assert result.time_error < 0.02
    exact = 1 / 0.2 * 2.17 * dt * (20 * dt - (1.6 + 2.17 / 2) * dt)
    assert result.state.x[:, 2].mean() == pytest.approx(exact, rel=0.02)


def jumps_of(load, t_end=0.1):
    cloth = fc.Cloth.rectangle(0.8, 0.4, h=0.2, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 5.0), [fc.StVK(), load])
    return Run(system, fc.BDF2(), system.rest(), 0, 4.0, t_end).load_jumps


@pytest.mark.parametrize(
    "load",
    [fc.Pressure("where(t < 0.0337, 0, 5)"), fc.Pressure(lambda t: 5.0 * (t >= 0.0337))]
    + [fc.UserForce(lambda x, v, t: np.full_like(x, t >= 0.0337))],
    ids=["formula", "function", "force"],
)
def test_a_jump_of_a_load_is_found_before_the_run(load):
    assert jumps_of(load) == pytest.approx([0.0337], rel=1e-9)


def test_many_jumps_of_a_load_are_found():
    found = jumps_of(fc.Pressure("sign(cos(1000*pi*t))"))
    assert found == pytest.approx((np.arange(100) + 0.5) * 1e-3, rel=1e-6)


def test_smooth_loads_are_not_searched_for_jumps(monkeypatch):
    monkeypatch.setattr(Formula, "__call__", None)
    assert not len(jumps_of(fc.Pressure("300*t + exp(-((t - 0.1)/1e-4)**2)")))
    assert not len(jumps_of(fc.Wind(("3*sin(t)", "0", "0"), normal=0.7)))


def test_loads_are_searched_once(monkeypatch):
    searched = []
    monkeypatch.setattr(account, "find_load_jumps", lambda loads: searched.append(1) or np.zeros(0))
    cloth = fc.Cloth.rectangle(0.8, 0.4, h=0.2, pattern="right")
    load = fc.Pressure("where(t < 0.05, 0, 5)")
    system = fc.System(cloth, fc.Fabric(0.2, 5.0), [fc.StVK(), load])
    fc.run(system, fc.CentralDifference(), system.rest(), 1e-3, 0.1)
    assert searched == [1]


def test_no_step_is_proposed_without_an_estimate():
    assert describe_time_error(math.nan, fc.BDF2(), math.nan) == "error in time: no estimate"


@pytest.mark.parametrize("jump", [math.inf, 0.3])
def test_no_step_is_proposed_where_the_error_is_below_1_percent(jump):
    assert "would give" not in describe_time_error(0.0099, fc.BDF2(), 0.01, jump=jump)
    assert "would give" in describe_time_error(0.0101, fc.BDF2(), 0.01, jump=jump)


def test_the_proposed_step_follows_the_order_and_a_jump_of_a_load_makes_it_1():
    bdf2 = fc.BDF2()
    assert describe_time_error(0.04, bdf2, 0.01).endswith("; dt = 0.005 s would give 1 %")
    words = describe_time_error(0.04, bdf2, 0.01, jump=0.3)
    assert words.endswith("; dt = 0.0025 s would give 1 %")
    assert "jumps" not in words
    assert "a load jumps at t = 0.3 s" in describe_time_error(0.04, bdf2, 0.01, 0.3, is_cause=True)


@pytest.mark.parametrize(("share", "said"), [(0.8, True), (1.25, False)])
def test_a_jump_is_named_where_it_is_most_of_the_error(share, said):
    """The error of the motion is `share` times what the jump has given."""
    system, _ = bar()
    start = Sample(0.0, 0, system.rest().x, None, 0.0, 0.0, 0.0, 0.0)
    error = replace(
        TimeError(start.x, start, (start,)), kick=1e-3, kicked=0.5, largest=share * 5e-4
    )
    error = replace(error, moved=1e9)  # nothing swings back
    assert (error.kick_length(system, 1.0) > error.largest) == said
