"""The only loop over time: a generator of states, and `run`, which collects what it yields."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from . import linear
from .blocks import BlockMatrix
from .errors import InputError, SolveFailed, StepFailed
from .newton import Newton, NewtonFailed, Solver
from .record import Ledger, Observer, Probe
from .system import State, System
from .terms.membrane import principal_stretches


@dataclass(frozen=True, eq=False)
class StepInfo:
    """What one step was and took.

    Attributes
    ----------
    step, t, dt
        Number (from 1), time reached and size [s].
    result
        The method's `Step`: new state, the stage, the unknown, the counts.
    old
        The state before it.
    """

    step: int
    t: float
    dt: float
    old: State
    result: object

    @property
    def counts(self):
        """Newton and linear iterations, relative residual, seconds of assembly and solve."""
        return self.result.counts


def solver_for(
    system: System, method, dt: float, choice: str = "auto", options: Newton | None = None
) -> tuple[Solver, str]:
    """The solver of a run, and in words why it was chosen.

    `choice` is "auto", "direct", "pardiso", "superlu" or "pcg". "auto" takes conjugate gradients
    where dt times the fastest frequency predicts few iterations, else a factorisation.
    """
    if isinstance(method, type) or not hasattr(method, "step"):
        allowed = "must be a method such as BackwardEuler()"
        raise InputError(f"method {method!r}", allowed, "march")
    if getattr(method, "explicit", False):
        method.check(system)
        return Solver(None, None, options or Newton()), "no linear solver: explicit"
    symmetric = system.symmetric and getattr(method, "symmetric", True)
    if choice == "auto":
        stiffness, damping = system.rate_bounds()
        wx, wv, wa = method.weights(dt)
        condition = 1 + (wx * stiffness + wv * damping) / wa
        chosen, why = linear.choose(condition, len(system.cloth.X), symmetric)
    else:
        chosen, why = linear.named(choice, symmetric), "asked for"
    matrix = BlockMatrix.zeros(system.pattern)
    return Solver(chosen, matrix, options or Newton()), f"{chosen.name} ({why})"


def march(
    system: System,
    method,
    state: State,
    dt: float,
    t_end: float,
    *,
    solver: str | Solver = "auto",
    newton: Newton | None = None,
) -> Iterator[tuple[State, StepInfo]]:
    """Step from `state` to `t_end` and yield each new state with its `StepInfo`.

    Parameters
    ----------
    system, method, state
        What moves, the integrator, and the start; the pins start from where `state` has them.
    dt, t_end
        Step and end time [s]. All steps are dt, except that the last one is shortened to end at
        `t_end` if the interval is not a multiple of dt.
    solver
        "auto", "direct", "pardiso", "superlu", "pcg", or a `Solver` made by `solver_for`.
    newton
        Options of the nonlinear solve.

    Raises
    ------
    InputError
        For a dt or t_end that makes no step.
    StepFailed
        If a step does not converge or makes a value that is not finite; its `state` is the last
        good one.
    """
    times = step_times(state.t, dt, t_end)
    if not isinstance(solver, Solver):
        solver, _ = solver_for(system, method, dt, solver, newton)
    guess = None
    for number, t in enumerate(times, start=1):
        size = t - state.t
        try:
            result = method.step(system, state, size, solver, guess)
        except (NewtonFailed, SolveFailed) as failure:
            raise _failed(system, state, number, size, failure) from failure
        if not (np.isfinite(result.state.x).all() and np.isfinite(result.state.v).all()):
            raise _failed(system, state, number, size, None)
        result = replace(result, state=replace(result.state, t=t))
        info = StepInfo(number, t, size, state, result)
        state, guess = result.state, result.q
        yield state, info


def step_times(t: float, dt: float, t_end: float) -> np.ndarray:
    """The end time of every step; t + i dt without accumulated round-off."""
    for name, value in (("dt", dt), ("t_end", t_end)):
        if not isinstance(value, Real):
            raise InputError(f"{name} = {value!r}", "must be a number [s]", "march")
    if not (math.isfinite(dt) and dt > 0):
        raise InputError(f"dt = {dt!r}", "must be finite and > 0 [s]", "march")
    if not (math.isfinite(t_end) and t_end > t):
        raise InputError(f"t_end = {t_end!r}", f"must be finite and > {t} [s]", "march")
    steps = max(1, math.ceil((t_end - t) / dt - 1e-9))
    times = t + dt * np.arange(1, steps + 1)
    times[-1] = t_end
    return times


def _failed(system, state, number, dt, cause):
    stretches = principal_stretches(system.cloth, state.x)
    worst = int(np.argmax(np.abs(np.log(np.maximum(stretches, 1e-300))).max(axis=1)))
    stretch = stretches[worst, np.argmax(np.abs(np.log(np.maximum(stretches[worst], 1e-300))))]
    return StepFailed(
        getattr(cause, "reason", "a position or velocity is not finite"),
        step=number,
        t=state.t,
        dt=dt,
        residual=getattr(cause, "residual", math.nan),
        stretch=float(stretch),
        triangle=worst,
        state=state,
        remedy=getattr(cause, "remedy", "Take a smaller dt."),
    )


@dataclass(frozen=True, eq=False)
class Result:
    """What `run` collected.

    Attributes
    ----------
    state
        The last state.
    times
        (s + 1,) start and the end of every step [s].
    energies
        Column of the ledger → (s + 1,) [J]; see `Ledger`.
    observed
        Column → (s + 1,): probe paths, mean displacement, sag, area, reactions of the pins.
    seconds
        Wall seconds by phase.
    newton, linear
        Iterations in all.
    solver
        The linear solver and why it was chosen.
    """

    state: State
    times: np.ndarray
    energies: dict[str, np.ndarray]
    observed: dict[str, np.ndarray]
    seconds: dict[str, float]
    newton: int
    linear: int
    solver: str


def run(
    system: System,
    method,
    state: State,
    dt: float,
    t_end: float,
    *,
    probes: Sequence[Probe] = (),
    solver: str = "auto",
    newton: Newton | None = None,
    report: Callable[[StepInfo], None] = lambda info: None,
) -> Result:
    """March to `t_end` and return the last state with the energy ledger and the probes' paths.

    `report` is called after every step.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
    >>> result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), dt=0.005, t_end=0.05)
    >>> len(result.times), bool(abs(result.energies["remainder"][-1]) < 1e-3)
    (11, True)
    """
    step_times(state.t, dt, t_end)  # refuse them before anything else
    chosen, why = solver_for(system, method, dt, solver, newton)
    ledger, observer = Ledger.open(system, state), Observer.bind(system, state, probes)
    energies, observed = [ledger.row()], [observer.row(None, None)]
    seconds: dict[str, float] = {}
    counts = np.zeros(2, int)
    begin = time.perf_counter()
    for new, info in march(system, method, state, dt, t_end, solver=chosen):
        state = new
        ledger = ledger.after(system, method, info.old, info.result)
        energies.append(ledger.row())
        observed.append(observer.row(info.old, info.result))
        counts += (info.counts.newton, info.counts.linear)
        seconds = add_seconds(seconds, info.counts.seconds)
        report(info)
    seconds["total"] = time.perf_counter() - begin
    times = np.array([row["t"] for row in energies])
    return Result(state, times, columns(energies), columns(observed), seconds, *counts, why)


def add_seconds(a: dict[str, float], b: dict[str, float]) -> dict[str, float]:
    """Seconds by phase, summed."""
    return {key: a.get(key, 0.0) + b.get(key, 0.0) for key in {**a, **b}}


def columns(rows: list[dict[str, float]]) -> dict[str, np.ndarray]:
    """Rows of equal keys as one array for each key."""
    return {key: np.array([row[key] for row in rows]) for key in rows[0] if key != "t"}
