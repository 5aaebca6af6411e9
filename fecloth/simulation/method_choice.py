"""Choice of the method by the work that a run is predicted to take."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Annotated

import numpy as np

from fecloth.errors import InputError, StepFailed, errors_of
from fecloth.integrators.bdf2 import BDF2
from fecloth.integrators.explicit import CentralDifference
from fecloth.integrators.fused_steps import FusedSteps
from fecloth.integrators.newmark import GeneralizedAlpha
from fecloth.integrators.protocol import MethodTraits, has_symmetric_matrix
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.prices import StepPrices
from fecloth.linalg.select import AutoSolver
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.options import Newton
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import TIME
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.fused_march import ROWS
from fecloth.simulation.step_times import ChosenSteps
from fecloth.simulation.steps import Memory, Place, Plan, steps
from fecloth.system.state import State
from fecloth.system.system import System

MOST_STEPS = 12  # of a trial: enough for a usual number of iterations
SHARE = 0.05  # of the work of the cheaper run predicted so far: a trial takes no more
# Work of an implicit run over the prediction: a motion that begins at rest needs shorter steps
# later. The mean of the runs of studies.evidence.benchmarks.auto_method.
LATER = 1.8
LUMPED_ONLY = "a consistent mass leaves no explicit method"


@dataclass(frozen=True)
class Trial:
    """The work of a method over a whole run, predicted from its first steps.

    Attributes
    ----------
    method
        The method, ready for `march`.
    dt
        A step at the end of the trial [s].
    work
        Of the run, in block products; infinite if the trial failed.
    """

    method: Adaptive
    dt: float = math.nan
    work: float = math.inf

    @property
    def name(self) -> str:
        """The method's name."""
        return type(self.method.method).__name__


@checks_arguments
@dataclass(frozen=True)
class Auto(ChosenSteps):
    """`Adaptive` around central differences or generalised-α, the one predicted to be faster.

    Both take their first steps at the tolerance; the work of the run is the work of a step
    over its length. An explicit step is never longer than stability allows, an implicit one
    costs as much as some tens of explicit ones; so the stiff, the finely meshed, the damped
    and the slow go to the implicit method, and what moves with its own waves to the explicit
    one.

    Work is counted, in iterations and steps, at the prices of `fecloth.linalg.prices`. So the
    choice is the same in every run and on every machine, whichever linear solver the run takes.
    The first steps do not predict later changes of the motion.

    With contact it is `Adaptive` around `BDF2`, without a trial.

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

    def candidates(self, system: System) -> tuple[Adaptive, ...]:
        """Return the methods to choose from."""
        if any(term.needs_end for term in system.bound):
            return (self._candidate(BDF2()),)
        if system.mass_kind != "lumped":
            return (self._candidate(GeneralizedAlpha()),)
        return self._candidate(GeneralizedAlpha()), self._candidate(CentralDifference())

    def _candidate(self, method) -> Adaptive:
        return Adaptive(method, self.rtol, self.atol, self.longest)

    def step(self, *_):
        """Raise `InputError`: `march` chooses a method before the first step."""
        raise InputError("Auto()", "is for march and run, which choose the method", "step")

    def choose(
        self,
        system: System,
        state: State,
        t_end: float,
        newton: Newton | None = None,
        stops: Sequence[float] = (),
    ) -> tuple[Adaptive, str]:
        """Return the method that is predicted to be faster, and in words why.

        Parameters
        ----------
        system, state, t_end, stops
            The run: what moves, its start, its end, and times at which a step must end [s].
        newton
            Options of the nonlinear solve.
        """
        implicit, *rest = self.candidates(system)
        if not rest:
            has_contact = type(implicit.method) is BDF2
            return implicit, "contact leaves BDF2" if has_contact else LUMPED_ONLY
        targets = self.end_times(state.t, t_end, stops)
        explicit = try_explicit(rest[0], system, state, targets)
        rival = try_implicit(implicit, system, state, targets, newton, explicit.work)
        best, other = sorted((explicit, rival), key=lambda trial: trial.work)
        words = f"{best.name} at dt = {best.dt:.2g} s"
        if math.isinf(other.work):
            return best.method, f"predicted: {words}; {other.name} failed"
        part = best.work / other.work
        return best.method, (
            f"predicted: {words} takes {part:.2g} of the work of {other.name} "
            f"at dt = {other.dt:.2g} s"
        )


def try_explicit(method: Adaptive, system: System, state: State, targets: np.ndarray) -> Trial:
    """Return the trial of an explicit method.

    `targets` are the times at which a step must end [s].
    """
    try:
        *_, last = _first_steps(method, system, state, targets)
    except StepFailed:
        return Trial(method)
    control = last.memory.method_memory
    dt = min(control.dt, control.stable_dt)
    count = math.ceil((targets[-1] - state.t) / dt)
    prices = StepPrices.of(system.pattern)
    rows = count
    keeps_history = system.start_history(state) is not None
    if control.is_at_limit and not keeps_history and FusedSteps.bind(system):
        rows = min(count, max(ROWS, len(targets)))
    work = rows * prices.row + (count - rows) * prices.fused
    return Trial(method, dt, work)


def try_implicit(
    method: Adaptive,
    system: System,
    state: State,
    targets: np.ndarray,
    newton: Newton | None,
    rival: float,
) -> Trial:
    """Return the trial of an implicit method, beside a `rival` whose run takes so much work.

    Its linear solver is "auto" without a factorisation, as not every machine has the same one;
    the run has one, at the price of a factor with PARDISO. Matrices without symmetry are clamped.
    """
    options = newton or Newton()
    is_symmetric = has_symmetric_matrix(system, method)
    if not is_symmetric:
        options = replace(options, definiteness="clamp")
    solver = AutoSolver(system.pattern, direct=None)
    context = SolverContext(solver, BlockMatrix.zeros(system.pattern, system.team), options)
    prices = StepPrices.of(system.pattern)
    duration = targets[-1] - state.t
    works: list[float] = []
    sizes: list[float] = []
    try:
        for info in _first_steps(method, system, state, targets, context):
            newton_steps = info.counts.newton
            factors = newton_steps * solver.estimate("direct")
            linear = min(solver.work, factors) if is_symmetric else factors
            works.append(linear + newton_steps * prices.iteration + prices.implicit_row)
            sizes.append(info.dt)
            solver.work = 0.0
            second_half = slice(len(works) // 2, None)
            dt = float(np.mean(sizes[second_half]))
            count = LATER * max(duration / dt, len(targets))
            trial = Trial(method, dt, float(np.mean(works[second_half])) * count)
            if sum(works) > SHARE * min(trial.work, rival):
                break
    except StepFailed:
        return Trial(method)
    return trial


def _first_steps(method: Adaptive, system: System, state: State, targets: np.ndarray, solver=None):
    """Yield the first steps of a run; raise `StepFailed` as `march` does."""
    plan = Plan(
        system=system,
        method=method,
        solver=solver or SolverContext(None, None, Newton()),
        targets=targets,
        first=1,
        most_stretch=math.inf,
    )
    memory = Memory(0, state.t, None, term_history=system.start_history(state))
    for _, info in islice(steps(plan, Place(state, memory, checked=state)), MOST_STEPS):
        yield info
