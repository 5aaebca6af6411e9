"""Explicit steps at the stability limit, and the check of a fixed dt against it."""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

from fecloth.errors import InputError, SolveFailed, brief
from fecloth.integrators import protocol
from fecloth.integrators.step import Step
from fecloth.simulation.step_times import ChosenSteps, fit_step
from fecloth.stability import critical_dt, estimate
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import extreme_stretches
from fecloth.terms.records import remembered

STEP_OVER_LIMIT = 0.9  # the estimated limit may be a few per cent too long
# After this number the limit is computed again, at less than 10 % of their cost.
UPDATE_STEPS = 500
STEPS_BETWEEN_CHECKS = 4  # of the stretches
STRETCH_BEYOND = 1.02  # times the largest stretch so far: the stiffness grows with its square
LARGEST_GROWTH = 1.05  # of a step: the cloth may become as stiff again


@remembered
@dataclass(frozen=True, eq=False)
class LimitMemory:
    """The memory of `StabilityLimited`.

    Attributes
    ----------
    dt
        The step [s].
    steps
        Steps since the limit was computed.
    least, largest
        Extreme principal stretches of all triangles so far.
    method_memory
        The memory of the method itself.
    """

    dt: float
    steps: int
    least: float
    largest: float
    method_memory: object = None

    def is_exceeded(self, least: float, largest: float) -> bool:
        """Return whether the extreme principal stretches are now beyond the earlier ones."""
        return largest > STRETCH_BEYOND * self.largest or least * STRETCH_BEYOND < self.least


@dataclass(frozen=True)
class StabilityLimited(ChosenSteps):
    """An explicit method at 0.9 of its largest stable step, by `stability.estimate`.

    The limit is taken at the start or, without loads, at rest, whichever is less. A stretched
    cloth becomes stiffer, with some materials also a compressed one, and the limit falls. It
    is computed again if a principal stretch exceeds the earlier ones by 2 %, checked every 4
    steps, and otherwise after 500 steps. Then it may also grow, by 5 % at most.

    Parameters
    ----------
    method
        `CentralDifference()` or `SymplecticEuler()`.
    """

    method: protocol.ExplicitIntegrator

    def __post_init__(self):
        method = self.method
        has_limit = protocol.is_method(method) and method.traits.stability
        if not (has_limit and method.traits.explicit):
            allowed = "has no stable step to choose"
            remedy = "Take CentralDifference or SymplecticEuler."
            raise InputError(f"method {brief(self.method)}", allowed, "StabilityLimited", remedy)

    @cached_property
    def traits(self) -> protocol.MethodTraits:
        """The method's traits, with chosen steps, which stay below its stability limit."""
        return replace(self.method.traits, chooses_dt=True, beyond_limit=True)

    def step(
        self, system: System, state: State, horizon: float, solver=None, memory=None, history=None
    ) -> Step:
        """Take one step, at most as far as the horizon [s]."""
        now = system.with_history(history)
        limited = memory or self._start(now, state)
        if limited.steps % STEPS_BETWEEN_CHECKS == 0:
            limited = self._update(now, state, limited)
        dt = fit_step(limited.dt, horizon)
        step = protocol.take_step(
            self.method, system, state, dt, solver, limited.method_memory, history
        )
        if limited.steps == 0:
            protocol.check_step(step, self.method)
        after = replace(limited, steps=limited.steps + 1, method_memory=step.memory)
        return replace(step, memory=after, size=dt)

    def _limit(self, system: System, state: State) -> float:
        return STEP_OVER_LIMIT * estimate(system, state, self.method)

    def _start(self, system: System, state: State) -> LimitMemory:
        """Return the first memory: the lesser limit of the start and of the cloth at rest.

        At rest loads do not count, nor what has no finite stiffness there: a `Gas` has no
        volume.
        """
        dt = self._limit(system, state)
        unloaded = system.with_bound(t for t in system.bound if not t.load)
        with suppress(SolveFailed):
            dt = min(dt, self._limit(unloaded, State(state.t, system.rest().x, state.v)))
        return LimitMemory(dt, 0, *extreme_stretches(system.cloth, state.x))

    def _update(self, system: System, state: State, last: LimitMemory) -> LimitMemory:
        """Return the memory, with a new limit if the last one may no longer be valid."""
        least, largest = extreme_stretches(system.cloth, state.x)
        is_exceeded = last.is_exceeded(least, largest)
        if not is_exceeded and last.steps < UPDATE_STEPS:
            return last
        growth = 1.0 if is_exceeded else LARGEST_GROWTH
        dt = min(self._limit(system, state), growth * last.dt)
        return LimitMemory(
            dt,
            steps=0,
            least=min(least, last.least),
            largest=max(largest, last.largest),
            method_memory=last.method_memory,
        )


def refuse_unstable(system: System, method, state: State, dt: float, insist: str = "") -> None:
    """Raise `InputError` for a dt [s] beyond the stability limit at the start.

    `insist` says in the message how to take such a step all the same.
    """
    traits = method.traits
    if traits.beyond_limit:
        return
    if traits.explicit:
        method.check(system)
    if traits.explicit and traits.stability and dt <= estimate(system, state, method):
        return
    limit = critical_dt(system, state, method)
    if dt <= limit:
        return
    name = type(method).__name__
    insist = insist or f"{name}(beyond_limit=True)"
    allowed = f"must be at most {limit:.4g} s: beyond it {name} is unstable"
    remedy = "Leave dt out"
    if limit == 0:
        allowed = f"no dt is stable: {name} needs damping in every mode"
    if not traits.stability:
        remedy = "Take CentralDifference or SymplecticEuler"
    elif not traits.explicit:
        remedy = "Take beta >= gamma/2"
    remedy += f", take an implicit method, or insist with {insist}."
    raise InputError(f"dt = {dt:g} s", allowed, "march", remedy)
