"""Steps of one size, and steps whose sizes are given one by one."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from fecloth.errors import InputError, SolveFailed, brief, floats
from fecloth.integrators.protocol import Integrator, check_step, take_step
from fecloth.integrators.step import Step
from fecloth.nonlinear.equation import has_limits
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.simulation.stability_limited import refuse_unstable
from fecloth.simulation.step_times import (
    SAME_TIME,
    SMALLER,
    ChosenSteps,
    given_times,
    step_times,
)
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

# Of a step that fails: down to 1/256 of dt, where a failure has another cause.
MOST_HALVINGS = 8


def none_short_enough(
    dt: float, cause: str | NewtonFailed | SolveFailed, remedy: str = SMALLER
) -> NewtonFailed:
    """Return the error of a step that failed at all sizes; dt [s] is the last that was tried."""
    reason = getattr(cause, "reason", str(cause))
    residual = getattr(cause, "residual", math.nan)
    return NewtonFailed(f"no step is short enough: at {dt:.2g} s {reason}", residual, remedy)


@remembered
@dataclass(frozen=True, eq=False)
class HalvedMemory:
    """The memory of `FixedStep` with contact.

    Attributes
    ----------
    size
        The size to try next [s].
    method_memory
        The memory of the method.
    """

    size: float
    method_memory: object = None


@dataclass(frozen=True)
class FixedStep(ChosenSteps):
    """A method with steps of one size, shortened only to end at a stop or at the end.

    With contact a step that fails is repeated over half of its time, down to 1/256 of dt; after
    each step the next one is twice as long again, up to dt.

    Parameters
    ----------
    method
        The method that takes the steps.
    dt
        The step [s].

    Raises
    ------
    InputError
        For a dt that is not a finite number > 0.
    """

    method: Integrator
    dt: float  # type: ignore[assignment]  # None in the base, which fixes no size

    def __post_init__(self):
        if not isinstance(self.dt, Real) or isinstance(self.dt, bool):
            remedy = "Or leave it out and let Adaptive(method) or Auto() choose the steps."
            if self.method.traits.error_constant is None:
                name = type(self.method).__name__
                remedy = f"Without {name}.traits.error_constant fecloth cannot choose its steps."
            if self.method.traits.explicit:
                remedy = "Leave it out for the largest stable step."
            raise InputError(f"dt = {self.dt!r}", "must be a number [s]", "march", remedy)
        if not (math.isfinite(self.dt) and self.dt > 0):
            raise InputError(f"dt = {self.dt!r}", "must be finite and > 0 [s]", "march")

    def end_times(self, t: float, t_end: float | None, stops: Sequence[float] = ()) -> np.ndarray:
        """Return the end of every step [s]."""
        return step_times(t, self.dt, t_end, stops)

    def check_start(self, system: System, state: State, insist: str = "") -> None:
        """Raise `InputError` if dt is beyond the stability limit; see `refuse_unstable`."""
        refuse_unstable(system, self.method, state, self.dt, insist)

    def step(
        self, system: System, state: State, horizon: float, solver, memory=None, history=None
    ) -> Step:
        """Take one step of the method, over the horizon [s], or less far with contact."""
        if not has_limits(system):
            return take_step(self.method, system, state, horizon, solver, memory, history)
        memory = memory or HalvedMemory(self.dt)
        allowed = memory.size
        last = memory.method_memory
        rejected = 0
        while True:
            size = horizon
            if horizon > allowed * (1 + SAME_TIME):
                size = allowed
            try:
                step = take_step(self.method, system, state, size, solver, last, history)
                break
            except (NewtonFailed, SolveFailed) as failure:
                allowed = size / 2
                rejected += 1
                if allowed < self.dt / 2**MOST_HALVINGS:
                    raise none_short_enough(size, failure) from failure
        after = HalvedMemory(min(2 * allowed, self.dt), step.memory)
        counts = replace(step.counts, rejected=rejected)
        return replace(step, memory=after, counts=counts, size=size)


@remembered
@dataclass(frozen=True, eq=False)
class GivenMemory:
    """The memory of `GivenSteps`.

    Attributes
    ----------
    number
        Number of the steps so far.
    method_memory
        The memory of the method.
    """

    number: int
    method_memory: object = None


@dataclass(frozen=True, repr=False)
class GivenSteps(ChosenSteps):
    """A method with steps of given sizes, as the ``StepInfo.size`` of another run.

    Given the sizes, stops and end of a run of `Adaptive`, it repeats that run bit for bit, if
    the solver keeps nothing of the attempts that were rejected there (`Newton(reuse=False)`
    with a direct one).

    Parameters
    ----------
    method
        The method that takes the steps.
    sizes
        The sizes of all steps, in order [s].

    Raises
    ------
    InputError
        For no sizes, and for a size that is not a finite number > 0.
    """

    method: Integrator
    sizes: tuple[float, ...]

    def __post_init__(self):
        sizes = floats("dt", self.sizes, "march")
        if sizes.ndim != 1 or not len(sizes) or not (np.isfinite(sizes) & (sizes > 0)).all():
            allowed = "must be a number, or a list of at least one, finite and > 0 [s]"
            raise InputError(f"dt = {brief(self.sizes)}", allowed, "march")
        object.__setattr__(self, "sizes", tuple(sizes.tolist()))

    def end_times(self, t: float, t_end: float | None, stops: Sequence[float] = ()) -> np.ndarray:
        """Return the end of every step, at which the stops and `t_end` must lie."""
        return given_times(t, self.sizes, t_end, stops)

    def check_start(self, system: System, state: State, insist: str = "") -> None:
        """Raise `InputError` if the longest step is beyond the stability limit at the start."""
        refuse_unstable(system, self.method, state, max(self.sizes), insist)

    def step(
        self, system: System, state: State, horizon: float, solver, memory=None, history=None
    ) -> Step:
        """Take the next of the steps."""
        memory = memory or GivenMemory(0)
        size = self.sizes[memory.number]
        last = memory.method_memory
        step = take_step(self.method, system, state, size, solver, last, history)
        if memory.number == 0:
            check_step(step, self.method)
        after = GivenMemory(memory.number + 1, step.memory)
        return replace(step, memory=after, size=size)

    def __repr__(self) -> str:
        least = min(self.sizes)
        most = max(self.sizes)
        return f"GivenSteps({self.method!r}, {len(self.sizes)} of {least:g} to {most:g} s)"
