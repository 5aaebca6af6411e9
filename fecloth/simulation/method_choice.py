"""Choice of the method by its predicted cost at a tolerance."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth.errors import InputError, SolveFailed, errors_of
from fecloth.integrators.bdf2 import BDF2
from fecloth.integrators.explicit import CentralDifference
from fecloth.integrators.newmark import GeneralizedAlpha
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import Step
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import TIME
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.step_history import StepHistory, needs_history
from fecloth.simulation.step_times import ChosenSteps
from fecloth.system.state import State
from fecloth.system.system import System

MOST_EXPLICIT_STEPS = 20  # of a trial: enough to time them
MOST_IMPLICIT_STEPS = 12  # of a trial: enough for a usual number of iterations
FEWEST_TRIAL_STEPS = 3  # steps before a trial may stop early
COST_OF_TRIAL = 0.05  # over the cost of the cheaper run predicted so far, at most
DECISIVE_RATIO = 5.0  # of costs: a method that is cheaper by this factor ends the trial


@dataclass(frozen=True)
class Trial:
    """The cost of a method over a whole run, predicted from its first steps.

    Attributes
    ----------
    method
        The method, ready for `march`.
    dt
        Mean step in the second half of the trial [s].
    seconds
        Predicted wall seconds for the run, without compilation; infinite if it failed.
    """

    method: Adaptive
    dt: float
    seconds: float

    def __str__(self) -> str:
        name = type(self.method.method).__name__
        if math.isinf(self.seconds):
            return f"{name} failed"
        return f"{name} {self.seconds:.2g} s at dt = {self.dt:.2g} s"


@checks_arguments
@dataclass(frozen=True)
class Auto(ChosenSteps):
    """`Adaptive` around central differences or generalised-α, the one predicted to be faster.

    Both take their first steps at the tolerance; the cost of the run is the cost of a step
    over its length. An explicit step is never longer than stability allows, an implicit one
    costs as much as some tens of explicit ones; so the stiff, the finely meshed, the damped
    and the slow go to the implicit method, and what moves with its own waves to the explicit
    one.

    With contact it is `Adaptive` around `BDF2`, without a trial.

    The trial ends as soon as one is five times cheaper, or has taken a twentieth of the run. The
    first steps do not predict later changes of the motion. The choice depends on wall time, so
    that it can vary between runs where both methods cost the same.

    Parameters
    ----------
    rtol, atol, longest
        As for `Adaptive`.
    """

    rtol: float = 1e-3
    atol: float = 0.0
    longest: Annotated[float | None, TIME] = None

    traits = MethodTraits(order=2, chooses_dt=True)

    def __post_init__(self):
        with errors_of("Auto"):
            self._candidate(GeneralizedAlpha())  # refuses the parameters

    @property
    def candidates(self) -> tuple[Adaptive, Adaptive]:
        """The two methods to choose from."""
        return self._candidate(GeneralizedAlpha()), self._candidate(CentralDifference())

    def _candidate(self, method) -> Adaptive:
        return Adaptive(method, self.rtol, self.atol, self.longest)

    def step(self, *_):
        """Raise `InputError`: `march` chooses a method before the first step."""
        raise InputError("Auto()", "is for march and run, which choose the method", "step")

    def choose(
        self, system: System, state: State, t_end: float, solver_of, record=lambda *step: None
    ) -> tuple[Adaptive, str]:
        """Return the method that is predicted to be faster, and in words why.

        Parameters
        ----------
        system, state, t_end
            The run: what moves, its start and its end [s].
        solver_of
            Function of a method that returns its solver.
        record
            Called as `record(method, old, step)` after each trial step, so that the cost of
            recording counts too.
        """
        if any(term.needs_end for term in system.bound):
            return self._candidate(BDF2()), "contact leaves BDF2 and backward Euler"
        implicit = self._candidate(GeneralizedAlpha())
        if system.mass_kind != "lumped":
            return implicit, "a consistent mass leaves no explicit method"
        explicit = self._candidate(CentralDifference())
        solver = solver_of(implicit)
        run = TrialRun(system, state, t_end, record)
        first = run.predict_cost(explicit, None, MOST_EXPLICIT_STEPS, rival=math.inf)
        second = run.predict_cost(implicit, solver, MOST_IMPLICIT_STEPS, rival=first.seconds)
        best, other = sorted((first, second), key=lambda trial: trial.seconds)
        return best.method, f"predicted: {best}, {other}"


@dataclass(frozen=True, eq=False)
class TrialRun:
    """A run whose first steps are tried: what moves, its start, its end [s], the recording."""

    system: System
    start: State
    t_end: float
    record: Callable

    def predict_cost(
        self, method: Adaptive, solver: SolverContext | None, most: int, rival: float
    ) -> Trial:
        """Time the first steps of a method, and predict the cost of the whole run with it.

        There are up to `most` steps, and fewer once the comparison with a `rival`, which takes
        so many seconds, is decided.
        """
        failed = Trial(method, 0.0, math.inf)
        trial = failed
        seconds: list[float] = []
        sizes: list[float] = []
        state = self.start
        begin = time.perf_counter()
        try:
            for old, step in self._steps(method, solver):
                self.record(method, old, step)
                end = time.perf_counter()
                seconds.append(end - begin)
                sizes.append(step.state.t - old.t)
                state = step.state
                trial = self._predict(method, sizes, seconds)
                if len(sizes) == most or _is_decided(trial, rival, seconds):
                    break
                begin = time.perf_counter()
        except (NewtonFailed, SolveFailed):
            return failed
        if np.isfinite(state.x).all():
            return trial
        return failed

    def _steps(
        self, method: Adaptive, solver: SolverContext | None
    ) -> Iterator[tuple[State, Step]]:
        """Yield the state before each step, and the step, up to the end of the run."""
        state = self.start
        memory = None
        history = StepHistory()
        records = self.system.start_history(state)
        while state.t < self.t_end:
            context = solver
            if solver and needs_history(solver, method.traits):
                context = history.inform(solver, self.system, method.traits, state)
            horizon = self.t_end - state.t
            step = method.step(self.system, state, horizon, context, memory, records)
            yield state, step
            if needs_history(solver, method.traits):
                history = history.after(self.system, method.traits, state, step.state)
            state = step.state
            memory = step.memory
            records = step.history

    def _predict(self, method: Adaptive, sizes: list[float], seconds: list[float]) -> Trial:
        """Return the trial after steps of these sizes [s], which took so many seconds."""
        second_half = slice(len(sizes) // 2, None)
        dt = float(np.mean(sizes[second_half]))
        seconds_of_step = float(np.median(seconds[second_half]))
        steps = (self.t_end - self.start.t) / dt
        return Trial(method, dt, seconds_of_step * steps)


def _is_decided(trial: Trial, rival: float, seconds: list[float]) -> bool:
    """Return whether a trial is decided, or has taken its share of the run."""
    if DECISIVE_RATIO * trial.seconds < rival < math.inf:  # the first steps cost most
        return True
    share = COST_OF_TRIAL * min(trial.seconds, rival)
    return len(seconds) >= FEWEST_TRIAL_STEPS and sum(seconds) > share
