"""A kept factor: when it serves, what replaces it, and when keeping it no longer pays."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear.context import FactorReuse
from fecloth.nonlinear.newton import NewtonFailed, StageEquation
from fecloth.nonlinear.remedies import Remedy
from fecloth.simulation.resolve import solver_for


@pytest.fixture(scope="module")
def drum():
    """A disk, flat and at rest, clamped at the rim, about to fall: in tension throughout."""
    cloth = fc.Cloth.disk(0.5, h=0.06)
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    return fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["boundary"])


def fallen(system, solver, dts, state=None):
    """The state after steps of the given sizes, and the counts of each."""
    state, counts = state or system.rest(), []
    for dt in dts:
        step = fc.ImplicitMidpoint().step(system, state, dt, solver)
        state, counts = step.state, [*counts, step.counts]
    return state, counts


def direct(system, name="direct", **options):
    return solver_for(system, fc.ImplicitMidpoint(), 1e-3, name, fc.Newton(**options))[0]


@pytest.mark.stories
@pytest.mark.parametrize("name", ["direct", "superlu"])
def test_reused_factors_change_the_result_within_the_tolerance(drum, name):
    runs = [fallen(drum, direct(drum, name, reuse=reuse), [1e-3] * 60) for reuse in (True, False)]
    (kept, few), (full, many) = runs
    deflection = np.abs(full.x[:, 2]).max()
    assert deflection > 0.01
    assert np.abs(kept.x - full.x).max() < 1e-5 * deflection
    assert all(c.residual <= 1e-6 for c in few)
    assert all(c.factorisations == c.newton for c in many)
    assert sum(c.factorisations for c in few) < 0.4 * sum(c.factorisations for c in many)


def test_a_linear_problem_is_factorised_once(sheet, isotropic):
    terms = [fc.Gravity(), fc.MassDamping(1.0)]
    system = fc.System(sheet, isotropic, terms, pins=["left"])
    _, counts = fallen(system, direct(system), [1e-3] * 20)
    assert [c.factorisations for c in counts] == [1] + [0] * 19
    assert all(c.newton == 1 and c.residual < 1e-10 for c in counts)


def key_of(system, stage, shift=0.0):
    return StageEquation(system, stage, "on_failure").key(Remedy(shift, False))


def test_another_matrix_takes_another_factor(drum):
    """With other weights, σ, system, or after another `prepare`."""
    solver = direct(drum)
    state, counts = fallen(drum, solver, [1e-3] * 3)
    assert counts[-1].factorisations == 0
    _, counts = fallen(drum, solver, [1.01e-3], state)
    assert counts[0].factorisations > 0
    midpoint, euler = fc.ImplicitMidpoint(), fc.BackwardEuler()
    stage, others = midpoint.stage(state, 1.01e-3), midpoint.stage(state, 1e-3)
    heavy = fc.Fabric(0.4, 1000.0, 0.3)
    other = fc.System(drum.cloth, heavy, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    key = key_of(drum, stage)
    assert solver.factor_reuse.is_usable(key, solver.linear)
    for wrong in (
        key_of(drum, others),
        key_of(drum, euler.stage(state, 1.01e-3)),
        key_of(drum, stage, shift=0.25),
        key_of(other, stage),
    ):
        assert not solver.factor_reuse.is_usable(wrong, solver.linear)
    solver.linear.prepare(drum.project(drum.assemble(solver.matrix, state, wa=1.0)))
    assert not solver.factor_reuse.is_usable(key, solver.linear)
    after, counts = fallen(drum, solver, [1.01e-3], state)
    fresh, _ = fallen(drum, direct(drum), [1.01e-3], state)
    assert counts[0].factorisations > 0
    assert np.array_equal(after.x, fresh.x)


def test_after_drop_steps_do_not_depend_on_earlier_ones(drum):
    solver = direct(drum)
    state, _ = fallen(drum, solver, [1e-3] * 10)
    kept, _ = fallen(drum, solver, [1e-3] * 5, state)
    solver.factor_reuse.drop()
    dropped, _ = fallen(drum, solver, [1e-3] * 5, state)
    fresh, _ = fallen(drum, direct(drum), [1e-3] * 5, state)
    assert np.array_equal(dropped.x, fresh.x)
    assert not np.array_equal(kept.x, fresh.x)


def test_a_failure_drops_the_factor(drum):
    solver = direct(drum)
    state, _ = fallen(drum, solver, [1e-3] * 3)
    assert solver.factor_reuse.key is not None
    wrong = fc.State(state.t, np.where(state.x == state.x.max(), np.nan, state.x), state.v)
    with pytest.raises(NewtonFailed, match="not finite"):
        fallen(drum, solver, [1e-3], wrong)
    assert solver.factor_reuse == FactorReuse()


def test_factor_is_dropped_after_a_step_above_average_cost():
    class Linear:
        name, prepared = "pardiso", 0

    reuse, steps = FactorReuse(), 0
    reuse.record_factor(("system",), Linear)
    while reuse.key:  # 0, 1, 2, … iterations: 5 + 0 + 1 + 2 in 3 steps are 2.67, less than the next
        for _ in range(steps):
            reuse.record_iteration(1e-3, 1e-2, Linear)
        reuse.end_step(steps, Linear)
        steps += 1
    assert steps == 4
