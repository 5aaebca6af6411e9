"""The choice of the steps is one value; a user may write another."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.simulation.fixed_step import FixedStep
from fecloth.simulation.resolve import choose_steps
from fecloth.simulation.solves import Solves
from fecloth.simulation.stability_limited import StabilityLimited
from fecloth.simulation.step_times import ChosenSteps

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")


@pytest.fixture(scope="module")
def system():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    return fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), fc.Gravity()], pins=["left"])


@dataclass(frozen=True)
class Growing(ChosenSteps):
    """Steps that grow by a tenth, as a user writes them; the memory is the next step."""

    method: fc.BackwardEuler
    first: float

    @property
    def traits(self):
        return replace(self.method.traits, chooses_dt=True)

    def step(self, system, state, horizon, solver, memory=None):
        dt = min(memory or self.first, horizon)
        return replace(self.method.step(system, state, dt, solver), memory=1.1 * dt)

    def numerical(self, system, old, step):
        return self.method.numerical(system, old, step)


@pytest.mark.parametrize(
    ("method", "dt", "tolerances", "expected"),
    [
        (fc.BDF2(), 0.01, None, FixedStep(fc.BDF2(), 0.01)),
        (fc.CentralDifference(), 1e-4, None, FixedStep(fc.CentralDifference(), 1e-4)),
        (fc.CentralDifference(), None, None, StabilityLimited(fc.CentralDifference())),
        (fc.CentralDifference(), None, {}, StabilityLimited(fc.CentralDifference())),
        (fc.CentralDifference(), None, {"rtol": 0.1}, fc.Adaptive(fc.CentralDifference(), 0.1)),
        (fc.BDF2(), None, {}, fc.Adaptive(fc.BDF2())),
        (fc.Adaptive(fc.BDF2()), None, None, fc.Adaptive(fc.BDF2())),
        (FixedStep(fc.BDF2(), 0.01), None, None, FixedStep(fc.BDF2(), 0.01)),
    ],
)
def test_method_and_dt_decide_the_steps(method, dt, tolerances, expected):
    assert choose_steps(method, dt, tolerances) == expected


def test_a_fixed_step_is_the_same_run_as_its_method_with_dt(system):
    start, method = system.rest(), fc.BDF2()
    by_value = fc.run(system, FixedStep(method, 0.01), start, t_end=0.095)
    by_dt = fc.run(system, method, start, 0.01, 0.095)
    assert np.array_equal(by_value.state.x, by_dt.state.x)
    assert by_value.method == by_dt.method == method
    assert len(by_dt.times) == 11
    assert by_dt.accounts[Solves].steps == by_dt.steps == 10


def test_a_choice_of_the_user_decides_every_step(system):
    result = fc.run(system, Growing(fc.BackwardEuler(), 0.01), system.rest(), t_end=0.2)
    sizes = np.diff(result.times)
    assert sizes[1:-1] == pytest.approx(1.1 * sizes[:-2])
    assert result.times[-1] == 0.2


@dataclass(frozen=True)
class Fails(fc.BackwardEuler):
    """A method that fails for longer steps."""

    longest: float = 0.0

    def step(self, system, state, dt, solver, memory=None):
        if dt > self.longest:
            raise NewtonFailed("too long", 1.0, "")
        return super().step(system, state, dt, solver, memory)


def test_with_contact_a_step_that_fails_is_halved_and_the_next_is_twice_as_long(system):
    floor = fc.Obstacle(fc.shapes.Plane((0, 0, -1), (0, 0, 1)))
    touching, dt = system.replace(terms=[*system.terms, floor]), 0.016
    steps = fc.march(touching, Fails(0.003), touching.rest(), dt, dt)
    told = [(info.size, info.counts.rejected) for _, info in steps]
    assert told == [(0.002, 3), *[(0.002, 1)] * 6, (0.002, 0)]  # the last one ends the run
    least = dt / 256
    list(fc.march(touching, Fails(1.01 * least), touching.rest(), dt, 2 * least))
    with pytest.raises(fc.StepFailed, match="short enough"):
        list(fc.march(touching, Fails(0.99 * least), touching.rest(), dt, 2 * least))


def test_a_choice_without_end_times_is_refused_with_the_base_class(system):
    class Bare:
        traits = fc.MethodTraits(order=1, chooses_dt=True)
        step = None

    with pytest.raises(fc.InputError, match="must have end_times.*ChosenSteps.* is a base class"):
        fc.run(system, Bare(), system.rest(), t_end=0.1)
