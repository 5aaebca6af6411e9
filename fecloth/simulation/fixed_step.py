"""Steps of one size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real

import numpy as np

from fecloth.errors import InputError
from fecloth.integrators.protocol import Integrator, MethodTraits, take_step
from fecloth.integrators.step import Step
from fecloth.simulation.stability_limited import refuse_unstable
from fecloth.simulation.step_times import check_mass, step_times
from fecloth.system.state import State
from fecloth.system.system import System


@dataclass(frozen=True)
class FixedStep:
    """A method with steps of one size, shortened only to end at a stop or at the end.

    Parameters
    ----------
    method
        The method that takes them.
    dt
        The step [s].

    Raises
    ------
    InputError
        For a dt that is no number > 0.
    """

    method: Integrator
    dt: float

    def __post_init__(self):
        if not isinstance(self.dt, Real) or isinstance(self.dt, bool):
            remedy = "Or leave it out and let Adaptive(method) or Auto() choose the steps."
            if self.method.traits.error_constant is None:
                name = type(self.method).__name__
                remedy = (
                    f"{name} has no traits.error_constant, so that fecloth cannot choose its steps."
                )
            if self.method.traits.explicit:
                remedy = "Leave it out for the largest stable step."
            raise InputError(f"dt = {self.dt!r}", "must be a number [s]", "march", remedy)
        if not (math.isfinite(self.dt) and self.dt > 0):
            raise InputError(f"dt = {self.dt!r}", "must be finite and > 0 [s]", "march")

    @cached_property
    def traits(self) -> MethodTraits:
        """Those of the method; `march` takes no other dt."""
        return replace(self.method.traits, chooses_dt=True)

    def end_times(self, t: float, t_end: float | None, stops: Sequence[float] = ()) -> np.ndarray:
        """Return the end of every step."""
        return step_times(t, self.dt, t_end, stops)

    def check_start(self, system: System, state: State, insist: str = "") -> None:
        """Raise `InputError` if dt is beyond the stability limit; see `refuse_unstable`."""
        refuse_unstable(system, self.method, state, self.dt, insist)

    def check(self, system: System) -> None:
        """Raise `InputError` for a system that the method cannot step."""
        check_mass(self.method, system)

    def step(
        self, system: System, state: State, horizon: float, solver, memory=None, history=None
    ) -> Step:
        """One step of the method, to the next end of a step."""
        return take_step(self.method, system, state, horizon, solver, memory, history)

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Numerical dissipation [J] of a step, by the method's own formula."""
        return self.method.numerical(system, old, step)
