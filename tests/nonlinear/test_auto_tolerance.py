"""The tolerance "auto": Newton's iteration ends where its error is small against that in time."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear import steps as steps_module
from fecloth.nonlinear.error_left import ALLOWED_OF_CONTACT_FORCES, ErrorInPlace, ErrorLeft
from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.progress import Pause, Progress
from fecloth.nonlinear.steps import Steps
from fecloth.simulation.step_history import StepHistory, needs_history

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


@pytest.mark.parametrize(
    ("norm", "push", "known"),
    [
        (0.8 * ALLOWED_OF_CONTACT_FORCES, 1.0, True),
        (1.25 * ALLOWED_OF_CONTACT_FORCES, 1.0, False),
        (1.0, 0.0, True),
    ],
)
def test_where_contacts_push_the_residual_is_a_tenth_of_their_forces(hanging, norm, push, known):
    """Where nothing touches, `push` is 0 and nothing is asked of the residual."""
    assert ALLOWED_OF_CONTACT_FORCES == 0.1
    shape = np.ones((len(hanging.cloth.X), 3))
    left = ErrorLeft(in_time=1.0, push=lambda y: push * y[0, 0])
    for length in (1.0, 1e-3):
        left.correct(hanging, length * shape, whole=True)
    left.move(shape, norm, 1e3)
    assert left.is_small is known


@pytest.mark.stories
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


# --- the error left in the positions of an equilibrium --------------------------------------------


def in_place(system, lengths, whole=True, moved=1.0, residual=1e-10):
    """The estimate after corrections of these lengths, each of one node."""
    n = len(system.cloth.X)
    left, shape = ErrorInPlace(start=np.zeros((n, 3))), np.zeros((n, 3))
    shape[n // 2, 1] = 1.0
    for length in lengths:
        left.correct(system, length * shape, whole)
        left.move(moved * shape, residual, 1.0)
    return left


def test_the_error_in_place_is_known_after_two_corrections_that_shrink(hanging):
    assert in_place(hanging, [1e-2, 1e-4]).error == np.inf
    assert in_place(hanging, [1e-2, 1e-4, 1e-6]).error == pytest.approx(1e-8 / 0.99)
    assert in_place(hanging, [1e-2, 2e-2, 1e-6]).error == np.inf  # short by chance
    assert in_place(hanging, [1e-2, 1e-4, 1e-6], whole=False).error == np.inf


@pytest.mark.parametrize(("part", "small"), [(0.8, True), (1.25, False)])
def test_a_millionth_of_the_largest_displacement_and_a_residual_of_1e_9_are_small(
    hanging, part, small
):
    lengths = [1e-2, 1e-4, 1e-6]
    moved = 1e-8 / 0.99 / (part * 1e-6)
    assert in_place(hanging, lengths, moved=moved).is_small is small
    assert in_place(hanging, lengths, residual=part * 1e-9).is_small is small


@pytest.mark.parametrize(("part", "stagnates"), [(0.8, False), (1.25, True)])
def test_a_correction_longer_than_half_of_the_one_before_stagnates(hanging, part, stagnates):
    left = in_place(hanging, [1e-4, part * 0.5e-4])
    assert left.stagnates is stagnates
    assert left.is_needed is not stagnates
    if stagnates:
        assert left.left == 1e-4


def test_the_error_is_at_least_the_round_off_of_the_positions(hanging):
    left = in_place(hanging, [1e-2, 1e-6, 1e-12])
    assert left.left == left.error > 0.0
    left.start = np.full_like(left.start, 1e6)
    assert left.left == pytest.approx(np.sqrt(3) * 1e6 * 2**-52)


def stiff_strip(bending=1e-4):
    """A clamped strip that its weight turns by more than a right angle: Y L²/B = 2e6."""
    cloth = fc.Cloth.rectangle(0.1, 0.025, h=0.0125, pattern="right")
    fabric = fc.Fabric(0.2, 2e4, 0.3, bending_rigidity=bending)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    return fc.System(cloth, fabric, terms, pins=[fc.Pin("left", clamp=True)])


def test_whole_steps_in_a_row_spare_most_iterations(monkeypatch):
    system = stiff_strip()
    short = fc.equilibrium(system, system.rest())
    monkeypatch.setattr(steps_module, "MOST_WHOLE_STEPS", 0)
    long = fc.equilibrium(system, system.rest())
    assert short.iterations < 0.3 * long.iterations
    assert short.factorisations < 0.6 * long.factorisations
    np.testing.assert_allclose(short.x, long.x, rtol=0, atol=1e-9)


@pytest.mark.parametrize("bending", [1e-4, 1e-6])
def test_the_default_is_a_hundred_thousandth_from_a_sharper_solution(bending):
    system = stiff_strip(bending)
    end = fc.equilibrium(system, system.rest())
    again = fc.equilibrium(system, system.state(end.x))
    moved = abs(end.x - system.rest().x).max()
    assert abs(again.x - end.x).max() < 1e-5 * moved
    assert end.solver_error < 1e-6 * moved


# --- whole steps in a row -------------------------------------------------------------------------


NO_PAUSE = Pause()


def explorer(falls_at, explores=True, longest=10.0):
    """Steps of length 1 whose potential falls after so many of them."""
    steps = object.__new__(Steps)
    steps.equation = SimpleNamespace(
        potential=lambda y: -1.0 if y[0, 0] >= falls_at else float(y[0, 0] > 0.0),
        explores=explores,
        wx=1.0,
        longest=longest,
    )
    steps.directions = SimpleNamespace(find=lambda *arguments: np.ones((1, 3)), exact=None)
    steps.at = lambda y, scale: Point(y, y, 1.0, scale)
    return steps


def explore(steps, alpha=0.5, pause=NO_PAUSE):
    """The progress of `explore` from 0, where the search also ended."""
    point = Point(np.zeros((1, 3)), np.zeros((1, 3)), 1.0, 1.0)
    searched = Progress(0, point, None, 1.0, length=alpha, pause=pause)
    return steps.explore(searched, np.ones((1, 3)), searched)


@pytest.mark.parametrize(
    ("falls_at", "given", "alpha", "way"),
    [
        (1, {}, 0.5, 1),
        (12, {}, 0.5, 12),
        (13, {}, 0.5, 0),  # up to twelve are tried
        (1, {}, 1.0, 0),  # only after a shortened step
        (1, {"explores": False}, 0.5, 0),  # of a static equation
        (0.5, {"longest": 0.5}, 0.5, 0.5),  # no longer than the cloth
    ],
)
def test_whole_steps_in_a_row(falls_at, given, alpha, way):
    """The way that is taken, and 0 where the end of the search is."""
    ended = explore(explorer(falls_at, **given), alpha)
    assert float(ended.point.y[0, 0]) == way


def test_after_steps_in_vain_the_search_goes_on_alone_for_1_2_and_4_iterations():
    steps = explorer(99)
    pause = Pause()
    lengths = []
    for _ in range(3):
        pause = explore(steps, pause=pause).pause
        lengths.append(pause.left)
        while pause.left:
            pause = explore(steps, pause=pause).pause
    assert lengths == [1, 2, 4]


def test_whole_steps_that_helped_end_the_longer_pauses():
    assert explore(explorer(1), pause=Pause(left=0, length=4)).pause == NO_PAUSE


@pytest.mark.parametrize(
    ("method", "tolerance", "needs"),
    [
        (fc.BackwardEuler(), "auto", True),
        (fc.BackwardEuler(), 1e-6, False),
        (fc.LinearlyImplicitEuler(), "auto", False),  # it has no iteration that could end
    ],
)
def test_the_error_in_time_is_estimated_where_an_iteration_ends_by_it(
    hanging, method, tolerance, needs
):
    newton = fc.Newton(tolerance=tolerance)
    context, _ = fc.solver_for(hanging, method, 1e-3, "pcg", newton)
    assert needs_history(context, method.traits) == needs
