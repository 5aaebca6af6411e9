"""The loop over time: its times, its failures, and closed forms that it must meet."""

import re

import numpy as np
import pytest
from conftest import flat

import fecloth as fc
from fecloth.errors import SolveFailed
from fecloth.simulation.step_times import step_times
from studies.references import falling_disk

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")


def test_step_times_end_exactly():
    assert step_times(0.0, 0.1, 1.0)[-1] == 1.0
    assert len(step_times(0.0, 0.1, 1.0)) == 10
    np.testing.assert_allclose(step_times(0.5, 0.2, 1.0), [0.7, 0.9, 1.0])
    assert len(step_times(0.0, 1e-3, 0.2)) == 200


def test_trampoline_meets_the_radial_solution(isotropic):
    """2,000 triangles; the mean deflection to the front's arrival at the centre and past it."""
    cloth = fc.Cloth.disk(0.5, h=0.03)
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), 2e-3, 0.2)
    exact = falling_disk.trampoline(result.times[1:]).mean_deflection
    mean = -result.observed["mean_displacement.z"][1:]
    assert abs(mean - exact).max() < 0.01 * exact.max()


def test_solver_choices_agree(isotropic):
    cloth = fc.Cloth.disk(0.5, h=0.1)
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    ends = [
        fc.run(system, fc.ImplicitMidpoint(), system.rest(), 2e-3, 0.01, solver=solver).state.x
        for solver in ("superlu", "pcg", "multigrid", "auto")
    ]
    for x in ends[1:]:
        np.testing.assert_allclose(x, ends[0], atol=1e-7)


def test_solver_for_states_its_choice(isotropic):
    cloth = fc.Cloth.disk(0.5, h=0.1)
    system = fc.System(cloth, isotropic, [fc.StVK()], pins=["boundary"])
    _, reason = fc.solver_for(system, fc.ImplicitMidpoint(), 1e-4)
    assert re.fullmatch(r"pcg \(at first; a factor .* about as much as \d+ iterations\)", reason)
    _, reason = fc.solver_for(system, fc.ImplicitMidpoint(), 1e-4, "pcg")
    assert reason == "pcg (requested)"


def test_failure_carries_the_last_good_state(isotropic):
    """One Newton iteration cannot solve a violent step: the error says where and what to do."""
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.1)
    system = fc.System(cloth, isotropic, [fc.StVK()], pins=["left"])
    start = system.state(
        flat(cloth), 50 * np.random.default_rng(0).standard_normal((len(cloth.X), 3))
    )
    steps = fc.march(
        system, fc.BackwardEuler(), start, 0.1, 1.0, newton=fc.Newton(max_iterations=1)
    )
    with pytest.raises(fc.StepFailed, match="step 1 from t = 0 s with dt = 0.1 s") as failure:
        next(steps)
    assert failure.value.state is start
    assert failure.value.stretch == pytest.approx(1.0)
    assert "smaller dt" in str(failure.value)


def test_a_value_that_is_not_finite_is_an_error_at_its_step(isotropic):
    from fecloth.terms.loads.gravity import BoundGravity

    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.1)
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gravity()])
    poisoned = next(term for term in system.bound if isinstance(term, BoundGravity))
    states = fc.march(system, fc.LinearlyImplicitEuler(), system.rest(), 0.01, 0.1)
    next(states)
    poisoned.weight[0, 0] = np.nan
    with pytest.raises(fc.StepFailed, match="step 2"):
        next(states)


class Failing(fc.BackwardEuler):
    """Its third step fails."""

    def step(self, system, state, dt, solver, memory=None):
        if state.t > 0.015:
            raise SolveFailed("no solution", 1.0)
        return super().step(system, state, dt, solver, memory)


def test_a_run_that_fails_has_its_tables_so_far():
    cloth = fc.Cloth.rectangle(0.2, 0.2, 0.2, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK(), fc.Gravity()], ["left"])
    with pytest.raises(fc.StepFailed) as failed:
        fc.run(system, Failing(), system.rest(), 0.01, 0.05)
    result = failed.value.result
    np.testing.assert_allclose(result.times, [0.0, 0.01, 0.02])
    assert len(result.energies["kinetic"]) == len(result.observed["sag"]) == 3
    np.testing.assert_array_equal(result.state.x, failed.value.state.x)
