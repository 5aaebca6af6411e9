"""The error in time of the next step, estimated from the steps before it."""

from dataclasses import dataclass, replace

import numpy as np

from fecloth.integrators.protocol import MethodTraits, drift_of
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.error_left import StepError
from fecloth.simulation.rigid_motion import derivative, rms_without_rigid
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered


@remembered
@dataclass(frozen=True, eq=False)
class StepHistory:
    """The mean accelerations of the last steps, for the tolerance "auto" of Newton's iteration.

    A method with the drift (q, κ) moves a mode of frequency ω and amplitude A away from the
    solution by κ (ω dt)^(q + 1) A in each step (`TimeError`). An error of x and dt v by δ
    moves it away by up to δ/(ω dt), as a wrong velocity goes on. The errors are equal where δ
    is

        κ (ω dt)^(q + 2) A,   over all modes   κ dt^(q + 2) |d^(q + 2) x / dt^(q + 2)|

    as a mass-weighted root mean square over the nodes without its rigid part. The derivative
    is a divided difference of the last q + 1 accelerations of the free directions.

    Attributes
    ----------
    times
        The middle of each of these steps [s].
    accelerations
        Their mean accelerations, (n, 3) each [m/s²].
    """

    times: tuple[float, ...] = ()
    accelerations: tuple[np.ndarray, ...] = ()

    def after(self, system: System, traits: MethodTraits, old: State, new: State) -> "StepHistory":
        """Return the history after a step between two states."""
        drift = drift_of(traits)
        if drift is None:
            return self
        q, _ = drift
        times = (*self.times, 0.5 * (old.t + new.t))
        a = system.constraints.project((new.v - old.v) / (new.t - old.t))
        accelerations = (*self.accelerations, a)
        return StepHistory(times[-(q + 1) :], accelerations[-(q + 1) :])

    def error(self, system: System, traits: MethodTraits, state: State) -> StepError | None:
        """Return the error in time of the next step; None in the first steps, or without κ."""
        drift = drift_of(traits)
        if drift is None or len(self.times) < drift[0] + 1:
            return None
        q, constant = drift
        change = derivative(self.times, self.accelerations)
        rate = rms_without_rigid(system.diagonal_mass, state.x, change)
        return StepError(constant * rate, q + 2)

    def inform(
        self, solver: SolverContext, system: System, traits: MethodTraits, state: State
    ) -> SolverContext:
        """Return the solver with the error in time of the next step."""
        return replace(solver, step_error=self.error(system, traits, state))


def needs_history(solver: SolverContext | None, traits: MethodTraits) -> bool:
    """Return whether steps with this solver end Newton's iteration by their error in time."""
    if solver is None or solver.linear is None:
        return False
    return traits.solves and solver.options.tolerance == "auto"
