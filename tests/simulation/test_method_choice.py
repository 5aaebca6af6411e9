"""Auto: the method that is predicted to be faster, what it costs to find out, and what is said."""

import itertools
import math
import time

import numpy as np
import pytest
from support.matrices import hide

import fecloth as fc
from fecloth.linalg.prices import StepPrices
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.simulation import method_choice
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
    method, _ = fc.Auto().candidates(system, 1.0)
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
    _, method = fc.Auto(rtol=1.0).candidates(system, 0.5)
    trial = method_choice.try_explicit(method, system, state, np.array([0.5]))
    steps = sum(1 for _ in fc.march(system, method, state, t_end=0.5))
    prices = StepPrices.of(system.pattern)
    assert steps > 2 * ROWS
    assert trial.dt == pytest.approx(0.5 / steps, rel=0.05)
    work = ROWS * prices.row + (steps - ROWS) * prices.fused
    assert trial.work == pytest.approx(work, rel=0.05)
    # where Python takes each step, each has a row
    monkeypatch.setattr(method_choice.FusedSteps, "bind", lambda system: None)
    trial = method_choice.try_explicit(method, system, state, np.array([0.5]))
    assert trial.work == pytest.approx(steps * prices.row, rel=0.05)


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
def test_a_run_with_contact_takes_no_thousands_of_steps():
    """A square falls flat on a plane: its impact has no duration that steps could resolve."""
    cloth = fc.Cloth.rectangle(0.4, 0.4, h=0.2, pattern="right")
    floor = fc.Obstacle(fc.shapes.Plane((0, 0, -0.02), (0, 0, 1)), gap=1e-3)
    system = fc.System(cloth, fc.Fabric(0.2, 100.0, 0.3), [fc.StVK(), fc.Gravity(), floor])
    result = fc.run(system, fc.Auto(rtol=1e-4), system.rest(), t_end=0.1)
    assert isinstance(result.method.method, fc.BDF2)
    assert result.method.shortest == pytest.approx(1e-4)
    assert len(result.times) < 1100
    assert -0.02 < result.state.x[:, 2].min() < -0.018
