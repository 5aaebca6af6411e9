"""Explicit steps as long as stability allows, and the refusal of those that are longer."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from .errors import InputError
from .stability import critical_dt, estimate
from .step import Step
from .system import State, System
from .terms.membrane import largest_stretch

FRACTION = 0.9  # of the limit
LASTS = 500  # steps, after which the limit is asked for again: less than a tenth of their cost
LOOK = 16  # steps, after which the largest stretch is looked at
STRETCHED = 1.02  # of the stretch at which the limit was found: the stiffness goes with its square


@dataclass(frozen=True, eq=False)
class Limited:
    """What is handed from step to step.

    Attributes
    ----------
    dt
        The step [s].
    steps
        Since the limit was asked for.
    stretch
        The largest of all triangles then.
    q
        The method's own memory.
    """

    dt: float
    steps: int
    stretch: float
    q: object = None


@dataclass(frozen=True)
class AtLimit:
    """An explicit method at 0.9 of its largest stable step, by `stability.estimate`.

    A cloth that is stretched becomes stiffer, and the limit falls: it is asked for anew where the
    largest stretch has grown by 2 %, looked at every 16 steps, and in any case after 500.

    Parameters
    ----------
    method
        `CentralDifference()` or `SymplecticEuler()`.

    Raises
    ------
    InputError
        For a method without such a limit.
    """

    method: object

    chooses_dt = True
    explicit = True

    def __post_init__(self):
        method = self.method
        explicit = getattr(method, "explicit", False) and not isinstance(method, type)
        if not (explicit and getattr(method, "critical", None)):
            allowed = "has no stable step to choose, or needs none"
            remedy = "Give dt, or take CentralDifference()."
            raise InputError(f"method {self.method!r} without a dt", allowed, "march", remedy)

    @property
    def order(self) -> int:
        return self.method.order

    @property
    def error_constant(self) -> float:
        return self.method.error_constant

    @property
    def theta(self) -> float:
        return self.method.theta

    def check(self, system: System) -> None:
        """Refuse what the method refuses."""
        self.method.check(system)

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Energy [J] that the method itself took in a step, by its own formula."""
        return self.method.numerical(system, old, step)

    def step(
        self,
        system: System,
        state: State,
        horizon: float,
        solver=None,
        guess: Limited | None = None,
    ) -> Step:
        """One step from `state` over at most `horizon` [s]."""
        limited = guess or self._asked(system, state, None)
        if limited.steps and limited.steps % LOOK == 0:
            limited = self._asked(system, state, limited)
        parts = max(1, math.ceil(horizon / limited.dt - 1e-9))
        dt = horizon / parts if parts <= 2 else limited.dt
        step = self.method.step(system, state, dt, solver, limited.q)
        return replace(step, q=replace(limited, steps=limited.steps + 1, q=step.q))

    def _asked(self, system: System, state: State, last: Limited | None) -> Limited:
        """The last step, or another one where it may not hold any longer."""
        stretch = largest_stretch(system.cloth, state.x)
        if last and last.steps < LASTS and stretch <= STRETCHED * last.stretch:
            return last
        dt = FRACTION * estimate(system, state, self.method)
        return Limited(dt, 0, stretch, last and last.q)


def refuse_unstable(system: System, method, state: State, dt: float) -> None:
    """Raise `InputError` for an explicit step beyond the limit at the start."""
    if not getattr(method, "explicit", False) or getattr(method, "beyond_limit", True):
        return
    method.check(system)
    quick = getattr(method, "critical", None) is not None
    if quick and dt <= estimate(system, state, method):
        return
    limit = critical_dt(system, state, method)
    if dt <= limit:
        return
    name = type(method).__name__
    raise InputError(
        f"dt = {dt:g} s",
        f"must be at most {limit:.4g} s: beyond it {name} is unstable",
        "march",
        f"Leave dt out, take an implicit method, or insist with {name}(beyond_limit=True).",
    )
