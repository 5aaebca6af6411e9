"""A run before its first step, as the doubts about it look at it."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from fecloth.integrators.one_stage import BackwardEuler
from fecloth.integrators.protocol import StepChoice
from fecloth.simulation.doubts.signals import Signal, find_signals
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.resolve import method_to_report
from fecloth.stability.lanczos_estimate import largest_rates, step_of_rates
from fecloth.system.state import State
from fecloth.system.system import System

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """A run before its first step.

    Attributes
    ----------
    system, state
        What moves, and its start.
    steps
        The choice of its steps.
    ends
        (k,) times at which a step must end [s]; the last one is the end of the run.
    """

    system: System
    state: State
    steps: StepChoice | Auto
    ends: np.ndarray

    @property
    def t_end(self) -> float:
        """The end of the run [s]."""
        return float(self.ends[-1])

    @property
    def dt(self) -> float | None:
        """The step [s] if it is fixed and resolves a motion, else None."""
        if isinstance(self.steps, LoadSteps):
            return None
        dt = self.steps.dt
        if dt and self._settles(dt):
            return None
        return dt

    def _settles(self, dt: float) -> bool:
        """Whether a few steps of backward Euler, minutes long, seek a state of rest."""
        is_euler = isinstance(self.method, BackwardEuler)
        return is_euler and dt >= 100 and (self.t_end - self.state.t) / dt <= 10

    @property
    def method(self) -> Any:
        """The method as reports name it; see `method_to_report`."""
        return method_to_report(self.steps)

    @cached_property
    def rates(self) -> tuple[float, float]:
        """The `largest_rates` at the start; 0 where they are not known."""
        return attempt(largest_rates, self.system, self.state, otherwise=(0.0, 0.0))

    @property
    def explicit_limit(self) -> float:
        """The longest step [s] of central differences at the start; infinite if not known."""
        return step_of_rates(0.25 * self.rates[0], self.rates[1])

    @cached_property
    def signals(self) -> tuple[Signal, ...]:
        """Motions and loads that depend on time; see `find_signals`."""
        is_fixed = self.steps.dt is not None
        return tuple(find_signals(self.system, self.state, self.t_end, is_fixed))


def attempt(function: Callable[..., T], *arguments: Any, otherwise: T) -> T:
    """Return `function(*arguments)`, or `otherwise` if it raises.

    It is for functions that call functions of the user, which may raise anything.
    """
    try:
        return function(*arguments)
    except Exception:
        return otherwise


def check_each(
    signals: Iterable[Signal], check: Callable[..., T | None], *given: Any
) -> Iterator[T]:
    """Yield what `check(signal, *given)` notices in the signals whose functions do not fail."""
    noticed = (attempt(check, signal, *given, otherwise=None) for signal in signals)
    return (result for result in noticed if result is not None)
