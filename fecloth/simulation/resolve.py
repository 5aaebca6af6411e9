"""The choices before the first step: the method, its solver, and the reasons."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from fecloth import validation
from fecloth.errors import InputError, brief
from fecloth.integrators.protocol import check_method, check_offers
from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.protocol import LinearSolver
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.options import Newton
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.stability_limited import StabilityLimited
from fecloth.system.state import State
from fecloth.system.system import System


def solver_for(
    system: System, method, dt: float, choice: str = "auto", options: Newton | None = None
) -> tuple[SolverContext, str]:
    """Return the solver of a run, and in words why it was chosen.

    `choice` is "auto", "direct", "pardiso", "superlu" or "pcg". "auto" starts with conjugate
    gradients and changes to a factorisation, and back, by the work it counts; see `auto_solver`.
    """
    check_method(method)
    validation.number("dt", dt, 0.0, "solver_for")
    if method.traits.explicit:
        method.check(system)
        return SolverContext(None, None, options or Newton()), "no linear solver: explicit"
    if choice not in ("auto", *select.NAMES):
        allowed = f"must be one of auto, {', '.join(select.NAMES)}"
        raise InputError(f"solver = {brief(choice)}", allowed, "march")
    options = options or Newton()
    symmetric = system.symmetric and method.traits.symmetric
    chosen: LinearSolver
    symmetric |= options.definiteness == "clamp"  # clamped tangents all are
    if choice == "auto":
        stiffness, damping = system.rate_bounds()
        check_offers(method, ("weights",), 'march(solver="auto")')
        wx, wv, wa = method.weights(dt)
        condition = 1 + (wx * stiffness + wv * damping) / wa
        chosen, why = select.choose(condition, len(system.cloth.X), symmetric)
    else:
        chosen, why = select.named(choice, symmetric), "requested"
    matrix = BlockMatrix.zeros(system.pattern)
    return SolverContext(chosen, matrix, options), f"{chosen.name} ({why})"


def resolve(
    system: System,
    method,
    state: State,
    dt: float | None,
    t_end: float,
    solver: str | SolverContext = "auto",
    newton: Newton | None = None,
    record: Callable = lambda *step: None,
) -> tuple[object, SolverContext, str]:
    """Return the method that takes the steps, its solver, and in words why these.

    `Auto` is replaced by its choice, and an explicit method without dt by `StabilityLimited`;
    `record(method, old, step)` is the work after each step, which counts in Auto's choice.
    """
    if isinstance(solver, SolverContext):
        if isinstance(method, Auto):
            allowed = 'must be a name such as "auto" with Auto(), whose methods need one each'
            raise InputError("solver = a SolverContext", allowed, "march")
        return choose_steps(method, dt), solver, "given"

    def solver_of(candidate):
        return solver_for(system, candidate, dt or (t_end - state.t) / 1000, solver, newton)

    if not isinstance(method, Auto):
        method = choose_steps(method, dt)
        return method, *solver_of(method)
    method, why = method.choose(system, state, t_end, lambda m: solver_of(m)[0], record)
    context, reason = solver_of(method)
    return method, context, f"{reason}; {type(method.method).__name__} ({why})"


def choose_steps(method, dt: float | None, tolerances: Mapping[str, float] | None = None):
    """Return the method that takes steps of `dt`, or that chooses its steps where dt is None.

    An explicit method goes near its stability limit (`StabilityLimited`) unless `tolerances` has
    `rtol` or `atol`. With a mapping, even an empty one, any other method is controlled by its
    error (`Adaptive`). Without one it is returned unchanged, and `march` refuses it without dt.
    """
    if dt is not None or method.traits.chooses_dt:
        return method
    if method.traits.explicit and not tolerances:
        return StabilityLimited(method)
    return method if tolerances is None else Adaptive(method, **tolerances)
