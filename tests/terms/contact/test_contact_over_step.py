"""Friction over a step: its derivatives, the velocity of what moves, and what it remembers."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
from conftest import flat
from support.obstacles import check_slopes
from support.rundirs import restart_at
from support.tiers import stories_except

import fecloth as fc
from fecloth.runs import restart
from fecloth.terms.step_difference import Increment, StepDifference

GAP, DT, KAPPA = 2e-3, 2e-3, 30.0  # so soft that it stays in the gap
FABRIC = fc.Fabric(0.2, 200.0, 0.3, bending_rigidity=1e-5)
KINDS = ["Obstacle", "MeshObstacle", "SelfContact"]


def system_on(kind, folder, friction=0.3):
    """A sheet that slides on a moving ball, a mesh that turns or another sheet, and its start."""
    sheet, turn = (
        fc.Cloth.rectangle(0.1, 0.06, 0.03),
        fc.Rotation((0, 0, 0), (0, 0, 1), "t + 9*t**2"),
    )
    x, pins = flat(sheet) + [0, 0, 0.85 * GAP], []
    if kind == "Obstacle":
        shape = fc.shapes.Sphere(
            (0.05, 0.03, -1.0), 1.0, motion=("0.1*t + t**2", 0, 0), rotate=turn
        )
        contact = fc.Obstacle(shape, GAP, friction, KAPPA, restitution=1.0)
        x[:, 2] += np.sqrt(1 - ((x[:, :2] - [0.05, 0.03]) ** 2).sum(axis=1)) - 1
    elif kind == "MeshObstacle":
        pytest.importorskip("ipctk")
        corners = np.array([[-0.9, -1, 0], [1, -0.8, 0], [-0.2, 1, 0.0]])
        meshio.write_points_cells(
            folder / "table.ply", corners, [("triangle", np.int32([[0, 1, 2]]))]
        )
        contact = fc.MeshObstacle(
            folder / "table.ply", GAP, friction, KAPPA, rotate=turn, restitution=1.0
        )
    else:
        pytest.importorskip("ipctk")
        lower = fc.Cloth.rectangle(0.3, 0.2, 0.1)
        sheet = fc.Cloth.join([sheet, lower], ["upper", "lower"])
        x = np.vstack([x + [0.083, 0.051, 0], flat(lower)])
        contact, pins = fc.SelfContact(GAP, friction, stiffness=KAPPA, restitution=1.0), ["lower"]
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), contact]
    system = fc.System(sheet, FABRIC, terms, pins)
    v = np.tile([0.2, 0.1, 0.0], (len(x), 1))
    v[system.constraints.nodes] = 0.0
    return system, system.state(x, v)


def carried(system, x, begin, end):
    """Positions at a later time on the body of the contact, from positions at its begin."""
    body = system.bound[-1].body
    return x if body is None else body.pose(end).to_space(body.pose(begin).to_body(x))


def marched(system, method, state, steps, **known):
    options = {"solver": "direct", "newton": fc.Newton(reuse=False), **known}
    return list(fc.march(system, method, state, DT, steps * DT, **options))


@pytest.mark.parametrize("of_loads", [False, True], ids=["step", "increment"])
@pytest.mark.parametrize("speed", [0.3, 3e-5], ids=["slides", "creeps"])
@pytest.mark.parametrize("kind", KINDS)
def test_force_and_tangent_are_derivatives(kind, speed, of_loads, tmp_path, rng):
    """The force of the energy over the step, the tangent and the coupling of the force.

    Over an increment of the loads, friction has the normal forces of another place at its end.
    """
    system, state = system_on(kind, tmp_path)
    t, x = 0.3 * DT, state.x
    step = StepDifference.between(x, DT, t - DT)
    place = Increment(t, carried(system, x, t - DT, t) - [0, 0, 1e-4])
    over = system.over_step(replace(step, increment=place if of_loads else None))
    end = x + DT * speed * rng.standard_normal(x.shape) * [1, 1, 0.01]
    end = end + carried(system, x, t - DT, t) - x
    check_slopes(over, end, t, rng, size=1e-9 if speed > 1e-3 else 1e-10)


@pytest.mark.parametrize("lagged", stories_except(["step", "begin", "end"], "begin"))
@pytest.mark.parametrize("kind", ["Obstacle", "MeshObstacle"])
def test_a_cloth_that_goes_along_does_not_rub(kind, lagged, tmp_path):
    """On what turns and gets faster: its velocity is the mean over the step, or the increment."""
    system, state = system_on(kind, tmp_path)
    t = 0.1
    begin = carried(system, state.x, 0.0, t)
    end = carried(system, begin, t, t + DT)
    step = StepDifference.between(begin, DT, t)
    if lagged != "step":
        place = Increment(t + DT, end if lagged == "end" else None)
        step = replace(step, increment=place)
    term = system.bound[-1].over_step(step)
    left_behind = term.dissipation(begin)
    assert term.dissipation(end) < 1e-12 * left_behind


@pytest.mark.parametrize(
    "method", stories_except([fc.BackwardEuler(), fc.BDF2()], fc.BDF2()), ids=["be", "bdf2"]
)
@pytest.mark.parametrize("kind", stories_except(KINDS, "Obstacle"))
def test_a_run_goes_on_from_a_restart_file_bit_for_bit(kind, method, tmp_path):
    system, start = system_on(kind, tmp_path)
    steps = marched(system, method, start, 8)
    state, info = steps[3]
    np.testing.assert_array_equal(info.result.history[-1].place, state.x)
    assert info.result.over.bound[-1].dissipation(state.x) > 0.0  # it slides
    computed = restart.read(restart.write(tmp_path, restart_at(state, info.memory))).progress
    np.testing.assert_array_equal(computed.memory.term_history[-1].place, state.x)
    *_, (end, _) = marched(system, method, computed.state, 8, memory=computed.memory)
    np.testing.assert_array_equal(end.x, steps[-1][0].x)
    np.testing.assert_array_equal(end.v, steps[-1][0].v)


@pytest.mark.parametrize("kind", KINDS)
def test_friction_is_that_of_the_committed_place(kind, tmp_path):
    """Of a cloth that was pressed on and has been lifted off since, and the other way round."""
    system, state = system_on(kind, tmp_path)
    x, term = state.x, system.bound[-1]
    free = np.ones((len(x), 1))
    free[system.constraints.nodes] = 0.0
    lifted = x + free * [0, 0, GAP]
    end = x + DT * free * [0.2, 0.1, 0.0]
    heat = {}
    for name, place in (("pressed", x), ("lifted", lifted)):
        step = StepDifference.between(lifted if name == "pressed" else x, DT, 0.0)
        record = term.start_history(place, 0.0)
        over = term.over_step(replace(step, history=record))
        heat[name] = over.dissipation(end)
        np.testing.assert_array_equal(over.commit(end, DT).place, end)
    assert heat["pressed"] > 0.0 == heat["lifted"]


@pytest.mark.parametrize("kind", KINDS)
def test_without_friction_there_is_no_history(kind, tmp_path):
    system, state = system_on(kind, tmp_path, friction=0.0)
    assert system.start_history(state) is None
    over = system.bound[-1].over_step(StepDifference.between(state.x, DT, 0.0))
    assert over.commit(state.x, DT) is None
