"""The system over a step of `EnergyMomentum`, and a damping over a step as a term by itself."""

from dataclasses import dataclass

import numpy as np

import fecloth as fc
from fecloth.terms.step_difference import StepDifference


def energy_momentum(system, start, symmetric=False):
    """The system over a step from the positions `start` (n, 3)."""
    method = fc.EnergyMomentum(tangent="symmetric" if symmetric else "exact")
    return method.over_step(system, system.state(start), 1.0)


@dataclass(frozen=True, eq=False)
class Over:
    """A term as it acts over one step, for `check_term`."""

    term: object
    step: StepDifference

    @property
    def traits(self):
        return self.term.traits

    def stencil(self, cloth):
        return self.term.stencil(cloth)

    def bind(self, panel, slots):
        return self.term.bind(panel, slots).over_step(self.step)


def random_steps(cloth, seed=0):
    """The differences of backward Euler, of BDF2 after a step of another size, and of its first."""
    rng = np.random.default_rng(seed)
    rest = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    x, v = rest + 0.03 * rng.standard_normal(rest.shape), rng.standard_normal(rest.shape)
    state, dt = fc.State(0.0, x, v), 0.01
    last = fc.integrators.bdf2.Change(0.6 * dt, 0.02 * rng.standard_normal(x.shape), v)
    return {
        "backward Euler": StepDifference(x, dt, dt, ((1.0, x),)),
        "BDF2": fc.BDF2().difference(state, dt, last),
        "first of BDF2": fc.BDF2().difference(state, dt, None),
    }
