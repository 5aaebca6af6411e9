"""Increments of the loads stay on their branch of equilibria, or a doubt says where they left."""

import warnings

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear import increments
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.statistics import Counts
from fecloth.simulation.load_steps import LoadSteps


def twisted_strip():
    """A strip between two clamps, of which the right one makes a whole turn about its axis."""
    cloth = fc.Cloth.rectangle(0.3, 0.05, h=0.025, pattern="right")
    fabric = fc.Fabric(0.2, 5000.0, 0.3, bending_rigidity=1e-5)
    turn = fc.Rotation((0.3, 0.025, 0), (1, 0, 0), "2*pi*t")
    pins = [fc.Pin("left", clamp=True), fc.Pin("right", clamp=True, rotate=turn)]
    return fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending()], pins)


def energy(system, x):
    return sum(system.energies(fc.State(1.0, x, 0 * x)).values())


def test_a_twisted_strip_is_the_same_in_few_and_in_many_steps():
    """Each number leads to the strip that has one turn along it."""
    system = twisted_strip()
    ends = [fc.equilibrium(system, system.rest(), load_steps=n) for n in (4, 6, 24)]
    energies = [energy(system, end.x) for end in ends]
    assert energies == pytest.approx([0.16295] * 3, rel=1e-4)
    # from the left to the right, what lies across the strip makes one turn
    X = system.cloth.X
    low, high = (np.flatnonzero(abs(X[:, 1] - y) < 1e-9) for y in (0.0, 0.05))
    low, high = (side[np.argsort(X[side, 0])] for side in (low, high))
    across = (ends[0].x[high] - ends[0].x[low])[:, 1:]
    angle = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    assert abs(angle[-1] - angle[0]) == pytest.approx(2 * np.pi)


def test_pins_that_move_are_never_moved_in_one_jump():
    """A tolerance that round-off forbids is no reason to try a whole turn at once: that is flat."""
    system = twisted_strip()
    with pytest.raises(fc.EquilibriumFailed):
        fc.equilibrium(system, system.rest(), load_steps=24, tolerance=1e-11)


@pytest.fixture
def solve_by(monkeypatch):
    """Let a function of the factor on the loads lift the nodes, or say None for no solution.

    It returns the list of factors that are solved for.
    """

    def use(height, newton=9):
        solved = []

        def solve(equation, guess, context, report):
            solved.append(equation.load)
            lift = height(equation.load)
            if lift is None:
                raise increments.EquilibriumFailed("no", 1.0, None, "")
            x = equation.system.rest().x + [0, 0, lift]
            return increments.Solved(x, Counts(newton=newton))

        monkeypatch.setattr(increments, "solve_static", solve)
        return solved

    return use


def increase(first=0.125, contact=(), context=None):
    cloth = fc.Cloth.rectangle(0.5, 0.5, 0.25, "right")
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK(), *contact])
    return increments.increase_loads(system, system.rest(), context, first)


def test_a_smooth_course_is_not_halved(solve_by):
    solved = solve_by(lambda load: load + load**2)
    assert increase().course.jumps == ()
    assert len(solved) == 8


@pytest.mark.parametrize(("newton", "count"), [(6, 6), (8, 6), (10, 9)])
def test_an_increment_grows_again_after_a_solution_in_eight_iterations(newton, count, solve_by):
    """Of four increments the first fails, so that it is halved."""
    solved = solve_by(lambda load: None if solved == [0.25] else 0.0, newton)
    increase(0.25)
    assert solved[1] == 0.125
    assert len(solved) == count


def test_an_increment_is_halved_to_a_64th(solve_by):
    solved = solve_by(lambda load: None)
    with pytest.raises(fc.EquilibriumFailed, match="load stepping ended at 0 of the loads"):
        increase(0.25)
    assert solved == [0.25 / 2**k for k in range(7)] + [1.0]


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_where_small_loads_have_no_solution_all_are_tried_at_once(friction, solve_by):
    """A sheet without bending that does not touch yet: little load holds it less than much."""
    solve_by(lambda load: None if load < 0.9 else 0.0, newton=5)
    plane = fc.Obstacle(fc.shapes.Plane((0, 0, -1), (0, 0, 1)), 1e-3, friction)
    context = SolverContext(None, None, fc.Newton())
    if friction:
        with pytest.raises(fc.EquilibriumFailed):
            increase(0.25, [plane], context)
    else:
        assert increase(0.25, [plane], context).solved.counts.newton == 5


@pytest.mark.parametrize(("part", "is_halved"), [(0.98, False), (1.02, True)])
def test_a_solution_twice_as_far_as_its_prediction_is_the_last_one_on_the_branch(
    part, is_halved, solve_by
):
    """The course leads from 0.5 to 0.625, and the solution is `part` of that way beyond."""
    solved = solve_by(lambda load: load + part * max(0.0, load - 0.5))
    increase()
    assert (0.5625 in solved) == is_halved


def test_a_jump_is_told_where_it_is(solve_by):
    solve_by(lambda load: load + 3.0 * (load > 0.55))
    (jump,) = increase().course.jumps
    assert 0.55 < jump <= 0.625


def test_a_jump_of_the_cloth_is_among_the_doubts_of_an_equilibrium_and_of_a_run(solve_by):
    solve_by(lambda load: load + 3.0 * (load > 0.55))
    cloth = fc.Cloth.rectangle(0.5, 0.5, 0.25, "right")
    pin = fc.Pin("left", motion=(0, 0, "t"))
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK()], [pin])
    with warnings.catch_warnings(action="ignore"):
        end = fc.equilibrium(system, system.rest(), load_steps=8)
        run = fc.run(system, LoadSteps(8), system.rest(), t_end=1.0)
    for result in (end, run):
        assert fc.DoubtKind.BRANCH in {doubt.kind for doubt in result.doubts}


# --- loads that are small or too large ------------------------------------------------------------


@pytest.mark.parametrize("clamp", [True, False])
def test_a_load_below_the_round_off_in_the_plane_bends_the_cloth(clamp):
    """A strip with a clamp is linear; a membrane between two sides sags by the cube root."""
    cloth = fc.Cloth.rectangle(0.3, 0.1, h=0.025)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    terms = [fc.StVK(), fc.PlateBending()] if clamp else [fc.StVK()]
    pins = [fc.Pin("left", clamp=True)] if clamp else ["left", "right"]
    sags = []
    for g in (1e-6, 1e-9):
        system = fc.System(cloth, fabric, [*terms, fc.Gravity((0, 0, -g))], pins)
        sags.append(-fc.equilibrium(system, system.rest()).x[:, 2].min())
    assert sags[0] / sags[1] == pytest.approx(1000.0 if clamp else 10.0, rel=1e-3)


def test_a_balloon_beyond_its_limit_pressure_is_not_told_to_be_pinned():
    cloth = fc.Cloth.disk(0.5, 0.2)
    terms = [fc.NeoHookean(), fc.Pressure(5000.0)]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.5), terms, ["boundary"])
    with pytest.raises(fc.EquilibriumFailed) as caught:
        fc.equilibrium(system, system.rest())
    assert caught.value.remedy == increments.TOO_MUCH_LOAD
