"""Auto: the method that is predicted to be faster, what it costs to find out, and what is said."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.simulation import method_choice
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


def counting_clock(monkeypatch):
    """Every step takes a second."""
    ticks = itertools.count()
    clock = SimpleNamespace(perf_counter=lambda: float(next(ticks)))
    monkeypatch.setattr(method_choice, "time", clock)


def test_the_forecast_is_the_number_of_steps_where_each_takes_a_second(monkeypatch):
    counting_clock(monkeypatch)
    system, state = sheet(damping=0.02)
    explicit = fc.Adaptive(fc.CentralDifference(), rtol=1.0)  # all steps at the stability limit
    run = method_choice.TrialRun(system, state, 0.1, record=lambda *step: None)
    trial = run.predict_cost(explicit, None, 10, rival=np.inf)
    steps = sum(1 for _ in fc.march(system, explicit, state, t_end=0.1))
    assert steps > 100
    assert trial.seconds == pytest.approx(steps, rel=0.05)
    assert trial.dt == pytest.approx(0.1 / steps, rel=0.05)


@pytest.mark.parametrize(
    ("rival", "steps"),
    [(1e9, 1), (np.inf, 12), (0.0, method_choice.FEWEST_TRIAL_STEPS)],
    ids=["far cheaper than the other", "nothing known of the other", "far dearer"],
)
def test_a_trial_takes_no_more_steps_than_it_needs(monkeypatch, rival, steps):
    counting_clock(monkeypatch)
    monkeypatch.setattr(method_choice, "COST_OF_TRIAL", 0.05 if rival < np.inf else 1.0)
    system, state = sheet(damping=0.02)
    taken = []

    class Counted(fc.Adaptive):
        def step(self, *arguments):
            taken.append(1)
            return super().step(*arguments)

    method = Counted(fc.GeneralizedAlpha(), 1e-3)
    solver, _ = fc.solver_for(system, method, 1e-3)
    run = method_choice.TrialRun(system, state, 1.0, record=lambda *step: None)
    run.predict_cost(method, solver, 12, rival)
    assert len(taken) == steps
