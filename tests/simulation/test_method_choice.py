"""Auto: the method that is predicted to be faster, what it costs to find out, and what is said."""

import itertools
import math
import time

import numpy as np
import pytest
from support.matrices import hide

import fecloth as fc
from fecloth.integrators.step import Step
from fecloth.linalg.prices import StepPrices
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.nonlinear.statistics import Counts
from fecloth.simulation import method_choice
from fecloth.simulation.error_control import Control
from fecloth.simulation.fused_march import ROWS
from fecloth.simulation.resolve import resolve


def sheet(h=0.1, stiffness=20.0, damping=None, **options):
    """A square, stretched by a tenth, held around: taut, and in motion across."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h)
    terms = [fc.StVK(), fc.Gravity(), *([fc.StrainRateDamping(damping)] if damping else [])]
    system = fc.System(cloth, fc.Fabric(0.2, stiffness, 0.3), terms, ["boundary"], **options)
    return system, system.state(system.rest().x * [1.1, 1.1, 1.0])


def chosen(system, state, rtol=1e-3, t_end=1.0, **options):
    """Name of the method that is taken, and what is said."""
    method, _, why = resolve(system, fc.Auto(rtol), state, t_end, **options)
    return type(method.method).__name__, why


def test_a_soft_taut_membrane_goes_to_the_explicit_method():
    name, why = chosen(*sheet())
    assert name == "CentralDifference"
    assert "as the method is explicit" in why
    assert why.index("predicted: CentralDifference") < why.index("GeneralizedAlpha")


@pytest.mark.parametrize(
    "case",
    [{"damping": 0.02}, {"stiffness": 1e6}, {"stiffness": 2e4, "h": 0.03}],
    ids=["damped", "stiff", "stiff and fine"],
)
def test_auto_chooses_implicit_where_explicit_steps_are_tiny(case):
    name, why = chosen(*sheet(**case), rtol=0.1)
    assert name == "GeneralizedAlpha"
    assert why.index("predicted: GeneralizedAlpha") < why.index("CentralDifference")


def test_a_consistent_mass_leaves_no_choice():
    name, why = chosen(*sheet(mass="consistent"))
    assert name == "GeneralizedAlpha"
    assert "a consistent mass leaves no explicit method" in why


def test_auto_chooses_explicit_where_newton_fails(monkeypatch):
    def fails(*_):
        raise NewtonFailed("never", 1.0, "")

    monkeypatch.setattr(fc.GeneralizedAlpha, "step", fails)
    name, why = chosen(*sheet(stiffness=1e6))
    assert name == "CentralDifference"
    assert "GeneralizedAlpha failed" in why


@pytest.mark.parametrize("case", [{}, {"damping": 0.02}], ids=["explicit", "implicit"])
def test_the_run_is_bit_for_bit_that_of_the_method_alone(case):
    """The trial leaves no trace: neither in the state, nor in the solver."""
    system, state = sheet(**case)
    result = fc.run(system, fc.Auto(1e-2), state, t_end=0.05)
    alone = fc.run(system, result.method, state, t_end=0.05)
    assert isinstance(result.method, fc.Adaptive)
    assert result.method.rtol == 1e-2
    assert np.array_equal(result.times, alone.times)
    assert np.array_equal(result.state.x, alone.state.x)
    assert "predicted" in result.solver
    assert type(result.method.method).__name__ in result.solver


@pytest.mark.parametrize("case", [{}, {"damping": 0.02}], ids=["explicit", "implicit"])
def test_the_choice_depends_on_no_clock(monkeypatch, case):
    system, state = sheet(**case)
    expected = chosen(system, state)
    ticks = itertools.count()
    for clock in ("perf_counter", "process_time", "time", "monotonic"):
        monkeypatch.setattr(time, clock, lambda: float(next(ticks) % 7) ** 9)
    assert chosen(system, state) == expected


@pytest.mark.parametrize("linear", ["auto", "superlu", "pcg"])
def test_the_choice_is_the_same_without_other_packages(monkeypatch, linear):
    system, state = sheet(damping=0.02)
    expected = resolve(system, fc.Auto(), state, 1.0)
    hide(monkeypatch, "pypardiso", "rslab")
    method, _, why = resolve(system, fc.Auto(), state, 1.0, linear)
    assert method == expected[0]
    assert why.partition("(predicted")[2] == expected[2].partition("(predicted")[2] != ""


def test_a_trial_ends_where_it_takes_more_than_its_part_of_the_other_run(monkeypatch):
    system, state = sheet(damping=0.02)
    method, _ = fc.Auto().candidates(system)
    taken = []
    step = fc.GeneralizedAlpha.step
    monkeypatch.setattr(fc.GeneralizedAlpha, "step", lambda *given: taken.append(1) or step(*given))
    for rival, share, least in (
        (1.0, 0.05, 1),
        (math.inf, math.inf, method_choice.MOST_STEPS),
    ):
        taken.clear()
        monkeypatch.setattr(method_choice, "SHARE", share)
        trial = method_choice.try_implicit(method, system, state, np.array([1.0]), None, rival)
        assert least <= len(taken) <= least + 2  # with steps that were rejected
        assert rival < trial.work or math.isinf(rival)


def test_the_predicted_work_is_the_work_of_the_steps(monkeypatch):
    """All steps are at the stability limit: their number is the length of the run over it."""
    system, state = sheet(stiffness=1e4)
    _, method = fc.Auto(rtol=1.0).candidates(system)
    trial = method_choice.try_explicit(method, system, state, np.array([0.5]))
    steps = sum(1 for _ in fc.march(system, method, state, t_end=0.5))
    prices = StepPrices.of(system.pattern)
    assert steps > 2 * ROWS
    assert trial.dt == pytest.approx(0.5 / steps, rel=0.05)
    work = ROWS * prices.row + (steps - ROWS) * prices.fused
    assert trial.work == pytest.approx(work, rel=0.05)
    many = method_choice.try_explicit(method, system, state, np.array([500.0]))
    count = 500 / many.dt - ROWS
    assert many.work == pytest.approx(ROWS * prices.row + count * prices.fused, rel=1e-3)
    # where Python takes each step, each has a row
    monkeypatch.setattr(method_choice.FusedSteps, "bind", lambda system: None)
    trial = method_choice.try_explicit(method, system, state, np.array([0.5]))
    assert trial.work == pytest.approx(steps * prices.row, rel=0.05)


def falling_square(restitution):
    cloth = fc.Cloth.rectangle(0.4, 0.4, h=0.2, pattern="right")
    plane = fc.shapes.Plane((0, 0, -0.02), (0, 0, 1))
    floor = fc.Obstacle(plane, gap=1e-3, friction=0.3, restitution=restitution)
    return fc.System(cloth, fc.Fabric(0.2, 100.0, 0.3), [fc.StVK(), fc.Gravity(), floor])


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4])
def test_steps_find_the_time_of_an_impact_to_their_tolerance(rtol):
    """A square falls flat and bounces: its height, and few steps."""
    e, g, t_end, gap = 0.8, 9.81, 0.1, 1e-3
    system = falling_square(e)
    result = fc.run(system, fc.Auto(rtol=rtol), system.rest(), t_end=t_end)
    assert isinstance(result.method.method, fc.BDF2)
    assert len(result.times) < 40
    fall = 0.02 - gap
    t = t_end - np.sqrt(2 * fall / g)
    height = -fall + e * np.sqrt(2 * g * fall) * t - g * t**2 / 2
    allowed = rtol * 0.4 / np.sqrt(6)  # R of a square
    assert result.state.x[:, 2].mean() == pytest.approx(height, abs=4 * allowed + 0.2 * gap)


def test_the_first_step_with_contact_errs_as_much_as_any_other():
    """2/9 dt² g is what a second may err, times 0.9 of dt; no flight looks ahead of the barrier."""
    system = falling_square(0.0)
    method = fc.Adaptive(fc.BDF2(), rtol=1e-4)
    start = method.start(system, system.rest(), 1.0)
    allowed = 1e-4 * 0.2  # R of nine nodes with their lumped mass
    assert start.dt == pytest.approx(0.9 * np.sqrt(allowed / (2 / 9 * 9.81)))
    assert method.start(system, system.rest(), 1e-3).dt == pytest.approx(0.9e-3)


@pytest.mark.parametrize(
    ("touches", "iterations", "most"),
    [(True, 13, 0.5), (True, 12, 1.0), (True, 3, 2.0), (False, 13, 2.0)],
)
def test_the_work_of_a_step_in_contact_decides_on_the_next(touches, iterations, most):
    system = falling_square(0.0)
    old, dt = system.rest(), 1e-3
    new = system.state(old.x, old.v, t=dt)
    counts = Counts(newton=iterations)
    step = Step(new, new, None, counts, works=(0.0,) if touches else ())
    method = fc.Adaptive(fc.BDF2())
    before = Control(dt, 1e-2, np.full((9, 3), 2.0), -dt / 2)
    after = method.control_after(system, old, step, before)
    error = 2 / 9 * dt**2 * np.sqrt(12.0) / method.allowed(system, new)  # over one second
    assert method.error(system, old, step, before)[2] == pytest.approx(error)
    assert after.dt == pytest.approx(dt * min(most, 0.9 * error**-0.35 * 0.01**0.2))


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
def test_steps_in_contact_go_on_from_a_memory_with_the_same_bits():
    system = falling_square(0.5)
    method = fc.Adaptive(fc.BDF2())
    x = system.rest().x + np.array([[0, 0, 1e-3]]) * system.cloth.X[:, :1]
    options = {"t_end": 0.12, "solver": "pcg", "newton": fc.Newton(reuse=False)}
    whole = list(fc.march(system, method, system.state(x), **options))
    middle = next(n for n, (_, info) in enumerate(whole) if info.result.touches) + 2
    state, info = whole[middle]
    rest = list(fc.march(system, method, state, **options, memory=info.memory))
    assert len(rest) == len(whole) - middle - 1 > 3
    for (left, _), (right, _) in zip(rest, whole[middle + 1 :], strict=True):
        assert left.t == right.t
        np.testing.assert_array_equal(left.x, right.x)
