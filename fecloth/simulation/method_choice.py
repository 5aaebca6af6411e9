"""Choice of the method by its predicted cost at a tolerance."""

import math
import time
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth.errors import InputError, SolveFailed, errors_of
from fecloth.integrators.bdf2 import BDF2
from fecloth.integrators.explicit import CentralDifference
from fecloth.integrators.newmark import GeneralizedAlpha
from fecloth.integrators.protocol import MethodTraits
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
    """The cost of a method over a whole run, predicted from its first steps."""

    method: Adaptive  # ready for `march`
    dt: float  # mean step in the second half of the trial [s]
    seconds: float  # wall seconds for the run, less compilation; infinite if it failed

    def __str__(self) -> str:
        name = type(self.method.method).__name__
        if math.isinf(self.seconds):
            return f"{name} failed"
        return f"{name} {self.seconds:.2g} s at dt = {self.dt:.2g} s"


@checks_arguments
@dataclass(frozen=True)
class Auto(ChosenSteps):
    """`Adaptive` around central differences or generalised-α, whichever is predicted to be faster.

    Both take their first steps at the tolerance; the cost of the run is the cost of a step
    over its length. An explicit step is never longer than stability allows, an implicit one
    costs as much as some tens of explicit ones; so the stiff, the finely meshed, the damped
    and the slow go to the implicit method, and what moves with its own waves to the explicit
    one (studies/benchmarks/method_choice.py).

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
        """Choose the method by trial steps and `record(method, old, step)`; return it and why."""
        if any(term.needs_end for term in system.bound):
            return self._candidate(BDF2()), "contact leaves BDF2 and backward Euler"
        implicit = self._candidate(GeneralizedAlpha())
        if system.mass_kind != "lumped":
            return implicit, "a consistent mass leaves no explicit method"
        explicit = self._candidate(CentralDifference())
        solver = solver_of(implicit)
        first = _trial(system, state, t_end, explicit, None, MOST_EXPLICIT_STEPS, math.inf, record)
        most = MOST_IMPLICIT_STEPS
        rival = first.seconds
        second = _trial(system, state, t_end, implicit, solver, most, rival, record)
        best, other = sorted((first, second), key=lambda trial: trial.seconds)
        return best.method, f"predicted: {best}, {other}"


def _trial(
    system, state, t_end, method, solver, most: int, rival: float, record=lambda *step: None
) -> Trial:
    """Time the first `most` steps; stop early once the comparison with `rival` [s] is decided."""
    start = state.t
    memory = None
    history = StepHistory()
    records = system.start_history(state)
    is_informed = needs_history(solver)
    seconds: list[float] = []
    sizes: list[float] = []
    trial = Trial(method, 0.0, math.inf)
    while len(sizes) < most and state.t < t_end and not _is_decided(trial, rival, seconds):
        begin = time.perf_counter()
        if is_informed:
            solver = history.inform(solver, system, method.traits, state)
        try:
            step = method.step(system, state, t_end - state.t, solver, memory, records)
        except (NewtonFailed, SolveFailed):
            return Trial(method, 0.0, math.inf)
        record(method, state, step)
        if is_informed:
            history = history.after(system, method.traits, state, step.state)
        seconds.append(time.perf_counter() - begin)
        sizes.append(step.state.t - state.t)
        state = step.state
        memory = step.memory
        records = step.history
        last = slice(len(sizes) // 2, None)
        dt = float(np.mean(sizes[last]))
        each = float(np.median(seconds[last]))
        trial = Trial(method, dt, each * (t_end - start) / dt)
    if np.isfinite(state.x).all():
        return trial
    return Trial(method, 0.0, math.inf)


def _is_decided(trial: Trial, rival: float, seconds: list[float]) -> bool:
    """Return whether a trial is decided, or has taken its share of the run."""
    if DECISIVE_RATIO * trial.seconds < rival < math.inf:  # the first steps cost most
        return True
    return len(seconds) >= FEWEST_TRIAL_STEPS and sum(seconds) > COST_OF_TRIAL * min(
        trial.seconds, rival
    )
