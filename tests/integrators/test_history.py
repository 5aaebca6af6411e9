"""What terms remember of earlier steps: handed from step to step, kept, and given back."""

from dataclasses import dataclass

import numpy as np
import pytest
from conftest import taut_start
from support.sliders import Sliders, SlidersOverStep
from support.tiers import stories_except

import fecloth as fc
from fecloth.integrators import METHODS
from fecloth.simulation.fixed_step import FixedStep
from fecloth.simulation.load_steps import LoadSteps

TIGHT = fc.Newton(tolerance=1e-11, reuse=False)
DT, STEPS = 2e-4, 12


@pytest.fixture(scope="module")
def system(small, isotropic):
    terms = [fc.StVK(), Sliders(k=20.0, most=0.003), fc.Gravity()]
    return fc.System(small, isotropic, terms, pins=["left"])


def same(first, second):
    return np.array_equal(first.place, second.place) and np.array_equal(first.heat, second.heat)


@pytest.mark.stories
def test_steps_that_are_rejected_leave_no_trace(system):
    """A push that the first attempts overlook is taken in shorter steps, from the same record."""

    def push(x, v, t):
        return np.full_like(x, 100.0 if t > 0.05 else 0.0)

    pushed = system.replace(terms=[*system.terms, fc.UserForce(push)])
    adaptive = fc.Adaptive(fc.BackwardEuler(), rtol=0.05)
    start, bound = pushed.rest(), pushed.bound[1]
    record, rejected = bound.start_history(start.x, 0.0), 0
    for state, info in fc.march(pushed, adaptive, start, t_end=0.06, newton=TIGHT):
        record = SlidersOverStep(**vars(bound.with_history(record))).commit(state.x, state.t)
        assert same(record, info.result.history[1])
        rejected += info.counts.rejected
    assert rejected > 0


def test_load_steps_remember_each_increment(small, isotropic):
    """Springs that slip where a strip is drawn by its weight: the ends of many and of few steps
    are those of the path; with one step all of it is one increment."""
    terms = [fc.StVK(), Sliders(k=2.0, most=1e-5), fc.Gravity((9.81, 0, 0))]
    system = fc.System(small, isotropic, terms, pins=["left"])
    start, bound = system.rest(), system.bound[1]
    steps = list(fc.march(system, LoadSteps(8), start, t_end=1.0))
    record = bound.start_history(start.x, 0.0)
    for state, info in steps:
        record = SlidersOverStep(**vars(bound.with_history(record))).commit(state.x, 0.0)
        assert same(record, info.result.history[1])
    assert record.heat > 0
    assert abs(record.place - start.x).max() > 0
    several = fc.equilibrium(system, start, load_steps=8)
    np.testing.assert_array_equal(several.x, steps[-1][0].x)
    once = fc.equilibrium(system, start)
    np.testing.assert_allclose(once.x, several.x, atol=1e-6)  # no node turns back
    result = fc.run(system, LoadSteps(8), start, t_end=1.0)
    assert result.energies["dissipated:Sliders"][-1] == pytest.approx(float(record.heat))


@dataclass(frozen=True)
class Old(fc.BackwardEuler):
    """A method as users wrote it before terms had a history."""

    def step(self, system, state, dt, solver, memory=None):
        return super().step(system, state, dt, solver, memory)


@dataclass(frozen=True)
class OldOver(fc.ImplicitMidpoint):
    def over_step(self, system, state, dt):
        return system


@pytest.mark.parametrize("steps", [Old(), OldOver(), FixedStep(Old(), DT), fc.Adaptive(Old())])
def test_a_method_without_history_is_refused_only_where_a_term_has_one(steps, system):
    start = taut_start(system)
    dt = None if steps.traits.chooses_dt else DT
    said = r"(step|over_step)\(...\): must take an argument `history`: Sliders remembers"
    with pytest.raises(fc.InputError, match=said):
        next(fc.march(system, steps, start, dt, 0.01))
    plain = system.replace(terms=[fc.StVK(), fc.Gravity()])
    next(fc.march(plain, steps, start, dt, 0.01))


def test_a_record_that_is_lost_is_refused(system):
    class Forgets(SlidersOverStep):
        def commit(self, x, t):
            return None

    history = system.start_history(system.rest())
    assert system.start_history(system.rest())[0] is None
    over = system.with_bound(
        Forgets(**vars(term)) if record else term
        for term, record in zip(system.bound, history, strict=True)
    )
    with pytest.raises(fc.InputError, match=r"Sliders.*commit\(x, t\) = None: must be the record"):
        over.commit(system.rest(), history)


@pytest.mark.parametrize(
    "name",
    stories_except(
        ["backward_euler", "bdf2", "newmark", "generalized_alpha", "energy_momentum"], "bdf2"
    ),
)
def test_the_ledger_closes_with_what_slips(name, system):
    """The remainders of runs with and without the term differ by less than 0.1 % of the heat."""
    run = {"solver": "direct", "newton": TIGHT}
    alone = system.replace(terms=[fc.StVK(), fc.Gravity()])
    energies, without = (
        fc.run(each, METHODS[name](), taut_start(each), DT / 2, STEPS * DT, **run).energies
        for each in (system, alone)
    )
    heat, least = energies["dissipated:Sliders"], abs(without["remainder"]).max()
    assert heat[-1] > 1e-5
    assert (np.diff(heat) >= 0).all()
    assert abs(energies["remainder"]).max() < 1.1 * least + 1e-3 * heat[-1]
