"""The tolerance "auto": Newton's iteration ends where its error is small against that in time."""

import math
from dataclasses import replace

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear.error_left import ErrorLeft
from fecloth.simulation.step_history import StepHistory

SHARP = fc.Newton(tolerance=1e-11)
METHODS = {
    "backward Euler": fc.BackwardEuler(),
    "BDF2": fc.BDF2(),
    "generalised-α": fc.GeneralizedAlpha(),
}


@pytest.fixture(scope="module")
def hanging():
    """A sheet of stiff cotton that is held at two corners and falls from a horizontal plane."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.125, pattern="cross")
    corners = fc.Pin(lambda X: (X[:, 1] > 1 - 1e-9) & (abs(X[:, 0] - 0.5) > 0.5 - 1e-9))
    terms = [fc.StVK(), fc.HingeBending(), fc.Gravity()]
    cotton = fc.Fabric(0.15, (3000.0, 1500.0), 0.2, 60.0, 1e-5)
    return fc.System(cloth, cotton, terms, [corners])


def end(system, method, dt, t_end, newton=None):
    """Return x at the end and the counts of all steps."""
    steps = list(fc.march(system, method, system.rest(), dt, t_end, solver="pcg", newton=newton))
    counts = steps[0][1].counts
    for _, info in steps[1:]:
        counts = counts.plus(info.counts)
    return steps[-1][0].x, counts


def test_the_error_left_is_the_rest_of_a_geometric_series(hanging):
    left, shape = ErrorLeft(unit=2.0, in_time=1.0), np.ones((len(hanging.cloth.X), 3))
    size = 2.0 * math.sqrt(3.0)
    left.correct(hanging, shape, whole=True)
    assert left.error == math.inf  # there is no contraction yet
    left.correct(hanging, 0.25 * shape, whole=True)
    assert left.error == pytest.approx(size * (1 / 16 + 1 / 64) / (1 - 1 / 16), rel=1e-12)
    assert not left.is_small
    left.correct(hanging, 0.001 * shape, whole=True)
    assert left.is_small
    left.correct(hanging, 0.0001 * shape, whole=False)
    assert left.error == math.inf
    left.correct(hanging, 0.001 * shape, whole=True)
    assert left.error == math.inf  # the corrections grow


@pytest.mark.parametrize("name", METHODS)
def test_newton_leaves_a_tenth_of_the_error_in_time(name, hanging):
    method, dt, t_end = METHODS[name], 1 / 60, 0.25
    x, counts = end(hanging, method, dt, t_end)
    exact, work = end(hanging, method, dt, t_end, SHARP)
    fine, _ = end(hanging, fc.GeneralizedAlpha(), dt / 24, t_end, fc.Newton(tolerance=1e-8))
    in_time = np.linalg.norm(exact - fine)
    assert np.linalg.norm(x - exact) < 0.1 * in_time
    assert counts.newton < 0.7 * work.newton
    assert counts.estimated > 0.6 * t_end / dt
    assert 0 < counts.newton_error < 0.1 * counts.step_error


@pytest.mark.parametrize("name", ["BDF2", "generalised-α"])
def test_the_error_follows_the_step_as_if_solved_closely(name):
    """Newton's share of it stays small while dt and the error shrink together."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="cross")
    drum = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK()], ["boundary"])
    X, Y = np.pi * drum.cloth.X.T
    start = drum.state(np.column_stack([1.05 * drum.cloth.X, 0.1 * np.sin(X) * np.sin(Y)]))

    def position(steps, newton=None):
        run = drum, METHODS[name], start, 0.1 / steps, 0.1
        marched = list(fc.march(*run, solver="pcg", newton=newton))
        return marched[-1][0].x, sum(info.counts.estimated for _, info in marched)

    fine, _ = position(512, SHARP)
    errors = []
    for steps in (16, 32, 64):
        (x, estimated), (exact, _) = position(steps), position(steps, SHARP)
        errors.append(np.linalg.norm(exact - fine))
        assert estimated > 0.1 * steps
        assert np.linalg.norm(x - exact) < 0.05 * errors[-1]
    assert errors[2] < 0.5 * errors[0]


@pytest.mark.parametrize(("method", "degree"), [(fc.BackwardEuler(), 1), (fc.BDF2(), 2)])
def test_the_error_of_a_step_is_that_of_a_polynomial(method, degree, hanging):
    """With a = shape t^degree the derivative of that order is degree! shape at any steps."""
    X = hanging.cloth.X
    shape = np.column_stack([0 * X[:, 0], 0 * X[:, 0], np.sin(3 * X[:, 0])])
    hanging.constraints.project(shape)
    weights = hanging.diagonal_mass / hanging.diagonal_mass.sum()
    history, still, t = StepHistory(), hanging.rest(), 0.0
    for dt in (0.01, 0.02, 0.015, 0.01):
        assert len(history.times) > degree or history.error(hanging, method.traits, still) is None
        middle = t + 0.5 * dt
        old = fc.State(t, still.x, 0.0 * shape)
        new = fc.State(t + dt, still.x, dt * middle**degree * shape)
        history, t = history.after(hanging, method.traits, old, new), t + dt
    error = history.error(hanging, method.traits, still)
    A = np.column_stack([np.ones(len(X)), X[:, 0], X[:, 1]])  # rigid motions of z on a plane
    w = np.sqrt(weights)[:, None]
    rigid, *_ = np.linalg.lstsq(w * A, w[:, 0] * shape[:, 2], rcond=None)
    size = math.sqrt((weights * (shape[:, 2] - A @ rigid) ** 2).sum())
    q, constant = method.traits.drift
    dt = 0.01
    expected = constant * dt ** (q + 2) * math.factorial(degree) * size
    assert error.over(dt) == pytest.approx(expected, rel=1e-9)


def test_a_march_goes_on_bit_for_bit(hanging):
    run = hanging, fc.BDF2()
    steps = list(fc.march(*run, hanging.rest(), 1 / 60, 0.25, solver="pcg"))
    state, info = steps[9]
    again = list(fc.march(*run, state, 1 / 60, 0.25, solver="pcg", memory=info.memory))
    assert np.array_equal(again[-1][0].x, steps[-1][0].x)
    forgot = replace(info.memory, history=StepHistory())
    other = list(fc.march(*run, state, 1 / 60, 0.25, solver="pcg", memory=forgot))
    assert not np.array_equal(other[0][0].x, steps[10][0].x)


def test_a_fixed_residual_and_energy_momentum_are_not_estimated(hanging):
    for method, newton in ((fc.BDF2(), fc.Newton(tolerance=1e-6)), (fc.EnergyMomentum(), None)):
        _, counts = end(hanging, method, 1 / 60, 0.1, newton)
        assert counts.estimated == 0
        assert counts.residual <= 1e-6


def test_a_run_says_how_large_the_error_of_newton_is(hanging):
    result = fc.run(hanging, fc.BDF2(), hanging.rest(), 1 / 60, 0.2)
    words = result.newton_error_in_words
    assert "error of Newton's iteration about" in words
    assert words.endswith("of 12 steps")
    fixed = fc.run(hanging, fc.BDF2(), hanging.rest(), 1 / 60, 0.2, newton=fc.Newton(1e-6))
    assert fixed.newton_error_in_words == ""
