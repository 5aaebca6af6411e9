"""The choices before the first step: the method, its solver, and the reasons."""

from collections.abc import Mapping, Sequence

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, brief
from fecloth.integrators import protocol
from fecloth.linalg import select
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.linear_solver import make_linear_solver
from fecloth.nonlinear.options import Newton
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.fixed_step import FixedStep, GivenSteps
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.stability_limited import StabilityLimited
from fecloth.system.state import State
from fecloth.system.system import System


def solver_for(
    system: System, method, dt: float, choice: str = "auto", options: Newton | None = None
) -> tuple[SolverContext, str]:
    """Return the solver of a run, and in words why it was chosen.

    Parameters
    ----------
    system, method
        What moves, and the integrator.
    dt
        A typical step [s].
    choice
        "auto", which changes the solver by the work that it counts (see `select`), "direct",
        "pardiso", "rslab", "superlu", "pcg" or "multigrid".
    options
        Options of the nonlinear solve; None for the defaults.

    Raises
    ------
    InputError
        For a dt that is not > 0, and for any other choice.
    """
    protocol.check_method(method)
    validation.number("dt", dt, 0.0, "solver_for")
    if method.traits.explicit:
        method.check(system)
        return SolverContext(None, None, options or Newton()), "none, as the method is explicit"
    if choice not in ("auto", *select.NAMES):
        allowed = f"must be one of auto, {', '.join(select.NAMES)}"
        raise InputError(f"solver = {brief(choice)}", allowed, "march")
    options = options or Newton()
    symmetric = protocol.has_symmetric_matrix(system, method)
    symmetric |= options.definiteness == "clamp"  # clamped tangents all are
    chosen, matrix, why = make_linear_solver(system, choice, symmetric)
    return SolverContext(chosen, matrix, options), f"{chosen.name} ({why})"


def resolve(
    system: System,
    steps: protocol.StepChoice | Auto,
    state: State,
    t_end: float,
    solver: str | SolverContext = "auto",
    newton: Newton | None = None,
    stops: Sequence[float] = (),
) -> tuple[protocol.StepChoice, SolverContext, str]:
    """Return the choice of steps, their solver, and in words why it was chosen.

    `Auto` chooses its method here, by trial steps from `state`; `stops` are times at which a
    step must end [s]. Raises `InputError` for `Auto` with a solver that is made already.
    """
    if isinstance(solver, SolverContext):
        if isinstance(steps, Auto):
            allowed = 'must be a name such as "auto" with Auto(), whose methods need one each'
            raise InputError("solver = a SolverContext", allowed, "march")
        return steps, solver, "given"

    def solver_of(chosen: protocol.StepChoice) -> tuple[SolverContext, str]:
        dt = chosen.dt or (t_end - state.t) / 1000
        return solver_for(system, chosen.method, dt, solver, newton)

    if isinstance(steps, LoadSteps):
        return steps, *steps.solver(system, solver)
    if not isinstance(steps, Auto):
        return steps, *solver_of(steps)
    chosen, why = steps.choose(system, state, t_end, newton, stops)
    context, reason = solver_of(chosen)
    return chosen, context, f"{reason}; {type(chosen.method).__name__} ({why})"


def choose_steps(
    method, dt: float | Sequence[float] | None, tolerances: Mapping[str, float] | None = None
) -> protocol.StepChoice | Auto:
    """Decide which steps a run takes; a method that chooses its own is returned unchanged.

    The steps have the size `dt` [s], or the sizes of a list `dt`. Without dt, an explicit method
    goes near its stability limit (`StabilityLimited`), unless `tolerances` has `rtol` or `atol`.
    With `tolerances`, even an empty mapping, any other method is controlled by its error
    (`Adaptive`). Raises `InputError` for a dt that makes no step, for a dt with a method that
    chooses its own, and for none where neither rule applies.
    """
    protocol.check_method(method)
    if method.traits.chooses_dt:
        if dt is not None:
            allowed = f"must be left out: {type(method).__name__} chooses its steps"
            raise InputError(f"dt = {dt!r}", allowed, "march")
        protocol.check_offers(method, ("end_times", "check_start", "dt"), "march")
        return method
    if dt is None and method.traits.explicit and not tolerances:
        return StabilityLimited(method)
    if dt is None and tolerances is not None:
        return Adaptive(method, **tolerances)
    if isinstance(dt, list | tuple) or (isinstance(dt, np.ndarray) and dt.ndim):
        return GivenSteps(method, tuple(dt))
    return FixedStep(method, dt)  # type: ignore[arg-type]  # it refuses None


def method_to_report(steps: protocol.StepChoice | Auto):
    """Return the method as reports name it: the choice of its steps, unless they are fixed.

    Of fixed steps it is the method itself, because dt is reported separately.
    """
    if steps.dt:
        return steps.method
    return steps
