"""The only loop over time: a generator of states, and `run`, which collects what it yields."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from . import asked, linear
from .atlimit import AtLimit, refuse_unstable
from .auto import Auto
from .blocks import BlockMatrix
from .errors import FeclothWarning, InputError, SolveFailed, StepFailed, brief, floats
from .jumps import jumping
from .newton import Counts, Newton, NewtonFailed, Solver
from .observe import Observer, Probe
from .record import Ledger, doubt, slight
from .system import State, System
from .terms.membrane import largest_stretch, principal_stretches

MOST_STEPS = 10**8  # whose end times alone take 0.8 GB
MOST_GROWTH = 4.0  # of the kinetic energy that there can be: no usable step has shown more


@dataclass(frozen=True, eq=False)
class Memory:
    """What `march` needs, beside the state, to go on as if it had never stopped.

    Attributes
    ----------
    step, start
        Steps so far, and the time at which the first of them began [s].
    q
        The method's own: `Step.q` of the last one.
    """

    step: int
    start: float
    q: object


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
    memory
        With which `march` goes on from here.
    """

    step: int
    t: float
    dt: float
    old: State
    result: object
    memory: Memory

    @property
    def counts(self):
        """Newton and linear iterations, relative residual, seconds of assembly and solve."""
        return self.result.counts


def solver_for(
    system: System, method, dt: float, choice: str = "auto", options: Newton | None = None
) -> tuple[Solver, str]:
    """The solver of a run, and in words why it was chosen.

    `choice` is "auto", "direct", "pardiso", "superlu" or "pcg". "auto" starts with conjugate
    gradients and goes over to a factorisation, and back, by the work it counts; see `cheapest`.
    """
    _refuse_no_method(method)
    asked.number("dt", dt, 0.0, "solver_for")
    if getattr(method, "explicit", False):
        method.check(system)
        return Solver(None, None, options or Newton()), "no linear solver: explicit"
    if choice not in ("auto", *linear.NAMES):
        allowed = f"must be one of auto, {', '.join(linear.NAMES)}"
        raise InputError(f"solver = {brief(choice)}", allowed, "march")
    options = options or Newton()
    symmetric = system.symmetric and getattr(method, "symmetric", True)
    symmetric |= options.definiteness == "clamp"  # clamped tangents all are
    if choice == "auto":
        stiffness, damping = system.rate_bounds()
        wx, wv, wa = method.weights(dt)
        condition = 1 + (wx * stiffness + wv * damping) / wa
        chosen, why = linear.choose(condition, len(system.cloth.X), symmetric)
    else:
        chosen, why = linear.named(choice, symmetric), "asked for"
    matrix = BlockMatrix.zeros(system.pattern)
    return Solver(chosen, matrix, options), f"{chosen.name} ({why})"


def march(
    system: System,
    method,
    state: State,
    dt: float | None = None,
    t_end: float | None = None,
    *,
    stops: Sequence[float] = (),
    solver: str | Solver = "auto",
    newton: Newton | None = None,
    most_stretch: float = 20.0,
    memory: Memory | None = None,
) -> Iterator[tuple[State, StepInfo]]:
    """Step from `state` to `t_end` and yield each new state with its `StepInfo`.

    Parameters
    ----------
    system, method, state
        What moves, the integrator, and the start; the pins start from where `state` has them.
    dt
        Step [s]. All steps are dt, except that those before a stop or `t_end` are shortened to
        end there. None for `Adaptive`, which chooses its steps, and for explicit methods, which
        then take 0.9 of their largest stable step (`AtLimit`).
    t_end, stops
        End time, and times between at which a step must end [s].
    solver
        "auto", "direct", "pardiso", "superlu", "pcg", or a `Solver` made by `solver_for`.
    newton
        Options of the nonlinear solve.
    most_stretch
        A step that leaves a triangle stretched by more has failed, so that a blow-up ends before
        its numbers overflow. Looked at after each implicit step and each eighth explicit one.
    memory
        `StepInfo.memory` of an earlier march with the same arguments, which goes on from its
        state: bit for bit, if that had dropped what its solver kept at this step (`Solver.drop`).

    Raises
    ------
    InputError
        For a dt or t_end that makes no step, or an explicit dt beyond the stability limit.
    StepFailed
        If a step does not converge, makes a value that is not finite or stretches a triangle
        beyond `most_stretch`; its `state` is the last one that was found good.
    """
    _refuse_arguments(system, method, state, newton, most_stretch)
    begin, resumed = memory or Memory(0, state.t, None), memory is not None
    targets = _left(_targets(method, begin.start, dt, t_end, stops), state.t)
    if resumed and isinstance(method, Auto):
        raise InputError("memory with Auto()", "needs the method that Auto chose", "march")
    opening = replace(state, t=begin.start)
    method, solver, _ = settled(system, method, opening, dt, t_end, solver, newton)
    if not resumed:  # the limit is asked for at the start only
        refuse_unstable(system, method, state, dt)
    look = 8 if getattr(method, "explicit", False) else 1
    number, guess, good = begin.step, begin.q, state
    for target in targets:
        while state.t < target:
            number, size = number + 1, target - state.t
            try:
                result = method.step(system, state, size, solver, guess)
            except (NewtonFailed, SolveFailed) as failure:
                raise step_failed(system, state, number, size, failure) from failure
            new = _arrived(result.state, target, size)
            last = new.t == targets[-1]
            if problem := _problem(system, new, most_stretch, number % look == 0 or last):
                raise step_failed(system, good, number, new.t - state.t, problem)
            good = new if number % look == 0 else good
            after = Memory(number, begin.start, result.q)
            result = replace(result, state=new)
            info = StepInfo(number, new.t, new.t - state.t, state, result, after)
            state, guess = new, result.q
            yield state, info


def settled(
    system: System,
    method,
    state: State,
    dt: float | None,
    t_end: float,
    solver: str | Solver = "auto",
    newton: Newton | None = None,
    record: Callable = lambda *step: None,
) -> tuple[object, Solver, str]:
    """The method that takes the steps, its solver, and in words why those.

    `Auto` is replaced by its choice, and an explicit method that is given no dt by `AtLimit`;
    `record(method, old, step)` is what follows each step, and counts in Auto's choice.
    """
    if isinstance(solver, Solver):
        if isinstance(method, Auto):
            allowed = 'must be a name such as "auto" with Auto(), whose methods need one each'
            raise InputError("solver = a Solver", allowed, "march")
        return _stepping(method, dt), solver, "given"

    def solver_of(one):
        return solver_for(system, one, dt or (t_end - state.t) / 1000, solver, newton)

    if not isinstance(method, Auto):
        method = _stepping(method, dt)
        return method, *solver_of(method)
    way = system, state, t_end, lambda one: solver_of(one)[0], record
    method, why = method.settled(*way)
    solver, reason = solver_of(method)
    return method, solver, f"{reason}; {type(method.method).__name__} ({why})"


def _stepping(method, dt):
    """The method; an explicit one that is given no dt, with steps near its limit."""
    explicit = getattr(method, "explicit", False) and not getattr(method, "chooses_dt", False)
    return AtLimit(method) if dt is None and explicit else method


def _refuse_arguments(system, method, state, newton, most_stretch):
    """Refuse what is swapped, of another type or of another cloth."""
    _refuse_no_method(method)
    asked.of(system, state, "march")
    if newton is not None:
        asked.instance("newton", newton, Newton, "Newton(tolerance=1e-8)", "march")
    asked.number("most_stretch", most_stretch, 1.0, "march", infinite=True)


def _refuse_no_method(method):
    if isinstance(method, type) or not hasattr(method, "step"):
        allowed = "must be a method such as BackwardEuler() or Auto()"
        remedy = "The method comes before the state." if isinstance(method, State) else ""
        raise InputError(f"method {brief(method)}", allowed, "march", remedy)


def _targets(method, t, dt, t_end, stops):
    """When a step must end; refuses what is no method, and steps that none can take."""
    _refuse_no_method(method)
    if getattr(method, "explicit", False) and (dt is None or isinstance(dt, str)):
        if dt is not None:
            remedy = "Leave it out for the largest stable step."
            raise InputError(f"dt = {dt!r}", "must be a number [s]", "march", remedy)
        return end_times(t, t_end, stops)
    if not getattr(method, "chooses_dt", False):
        return step_times(t, dt, t_end, stops)
    if dt is not None:
        allowed = f"must be left out: {type(method).__name__} chooses its steps"
        raise InputError(f"dt = {dt!r}", allowed, "march")
    return end_times(t, t_end, stops)


def _left(targets, t):
    """The targets after t."""
    if not targets[-1] > t:
        raise InputError(f"t_end = {targets[-1]}", f"must be > {t} [s]", "march")
    return targets[targets > t]


def _arrived(state, target, size):
    """The state at exactly the target, if it is there but for round-off."""
    return replace(state, t=target) if abs(target - state.t) <= 1e-9 * size else state


def _problem(system, state, most_stretch, look):
    """What is wrong with a new state, or None."""
    if not (np.isfinite(state.x).all() and np.isfinite(state.v).all()):
        return _Problem("a position or velocity is not finite")
    stretch = largest_stretch(system.cloth, state.x) if look else 0.0
    if stretch <= most_stretch:
        return None
    return _Problem(f"a triangle is stretched to {stretch:.3g} times, beyond {most_stretch:g}")


@dataclass(frozen=True)
class _Problem:
    """Why a step has failed, as `NewtonFailed` says it."""

    reason: str
    residual: float = math.nan
    remedy: str = "Take a smaller dt."


def end_times(t: float, t_end: float, stops: Sequence[float] = ()) -> np.ndarray:
    """The stops after t and before t_end, in order, and t_end."""
    if not isinstance(t_end, Real) or isinstance(t_end, bool):
        raise InputError(f"t_end = {t_end!r}", "must be a number [s]", "march")
    if not (math.isfinite(t_end) and t_end > t):
        raise InputError(f"t_end = {t_end!r}", f"must be finite and > {t} [s]", "march")
    stops = np.unique(floats("stops", stops, "march"))
    if not np.isfinite(stops).all():
        raise InputError(f"stops = {stops.tolist()}", "must be finite [s]", "march")
    outside = stops[(stops < t) | (stops > t_end * (1 + 1e-12))]
    if len(outside):
        allowed = f"must lie in the run, from {t:g} to {t_end:g} s"
        raise InputError(f"stops: {outside[0]:g}", allowed, "march")
    times = np.concatenate([[t], stops[(stops > t) & (stops < t_end)], [t_end]])
    apart = np.diff(times) > 1e-9 * (t_end - t)  # what is closer to the next one is the same
    return np.append(times[1:-1][apart[:-1] & apart[1:]], t_end)


def step_times(t: float, dt: float, t_end: float, stops: Sequence[float] = ()) -> np.ndarray:
    """The end time of every step; t + i dt without accumulated round-off."""
    if not isinstance(dt, Real) or isinstance(dt, bool):
        remedy = "Or leave it out and let Adaptive(method) or Auto() choose the steps."
        raise InputError(f"dt = {dt!r}", "must be a number [s]", "march", remedy)
    if not (math.isfinite(dt) and dt > 0):
        raise InputError(f"dt = {dt!r}", "must be finite and > 0 [s]", "march")
    pieces = []
    for target in end_times(t, t_end, stops):
        steps = max(1, math.ceil((target - t) / dt - 1e-9))
        if steps > MOST_STEPS:
            allowed = f"makes {steps:.2g} steps, and must make at most {MOST_STEPS:.0e}"
            raise InputError(f"dt = {dt:g} s", allowed, "march", "Is it in seconds?")
        pieces.append(t + dt * np.arange(1, steps + 1))
        pieces[-1][-1] = t = target
    return np.concatenate(pieces)


def step_failed(system: System, state: State, number: int, dt: float, cause) -> StepFailed:
    """The error, with the worst triangle of the last good state."""
    stretches = principal_stretches(system.cloth, state.x)
    strains = np.abs(np.log(np.maximum(stretches, 1e-300)))
    triangle, which = np.unravel_index(np.argmax(strains), strains.shape)
    remedy = getattr(cause, "remedy", "Take a smaller dt.")
    if name := jumping(system, state.t, dt, number - 1):
        remedy = f"The motion of the pin {name!r} jumps here: let it move without jumps."
    return StepFailed(
        getattr(cause, "reason", str(cause)),
        step=number,
        t=state.t,
        dt=dt,
        residual=getattr(cause, "residual", math.nan),
        stretch=float(stretches[triangle, which]),
        triangle=int(triangle),
        state=state,
        remedy=remedy,
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
    method
        What took the steps; `Auto`'s choice, and an explicit method's steps without dt.
    doubt
        In words that the energy balance does not close, or "": see `record.doubt`.
    """

    state: State
    times: np.ndarray
    energies: dict[str, np.ndarray]
    observed: dict[str, np.ndarray]
    seconds: dict[str, float]
    newton: int
    linear: int
    solver: str
    method: object
    doubt: str = ""


def run(
    system: System,
    method,
    state: State,
    dt: float | None = None,
    t_end: float | None = None,
    *,
    stops: Sequence[float] = (),
    probes: Sequence[Probe] = (),
    solver: str = "auto",
    newton: Newton | None = None,
    most_stretch: float = 20.0,
    most_growth: float = MOST_GROWTH,
    memory: Memory | None = None,
    report: Callable[[StepInfo], None] = lambda info: None,
) -> Result:
    """March to `t_end` and return the last state with the energy ledger and the probes' paths.

    Arguments as for `march`; `report` is called after every step. A step after which the cloth
    has more kinetic energy than `most_growth` times what its start, its loads and its pins can
    have given (`Ledger.available`) has failed too. Where the energy balance does not close, the
    result says so in `doubt`, and a `FeclothWarning` does.

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
    _refuse_arguments(system, method, state, newton, most_stretch)
    asked.number("most_growth", most_growth, 0.0, "run", infinite=True)
    asked.function("report", report, "lambda info: print(info.t)", "run")
    opening = replace(state, t=memory.start) if memory else state
    _targets(method, opening.t, dt, t_end, stops)  # refuse them before anything else
    ledger, observer = Ledger.open(system, state), Observer.bind(system, state, probes)

    def record(one, old, step):
        return ledger.after(system, one, old, step).row(), observer.row(old, step)

    method, chosen, why = settled(system, method, opening, dt, t_end, solver, newton, record)
    energies, observed = [ledger.row()], [observer.row(None, None)]
    counts, begin, start, turnover = Counts(), time.perf_counter(), state.t, 0.0
    options = {"stops": stops, "most_stretch": most_stretch, "memory": memory}
    for new, info in march(system, method, state, dt, t_end, solver=chosen, **options):
        state, ledger = new, balanced(system, method, ledger, info, most_growth)
        turnover = max(turnover, ledger.turnover)
        energies.append(ledger.row())
        observed.append(observer.row(info.old, info.result))
        counts = counts.plus(info.counts)
        report(info)
    seconds = counts.seconds | {"total": time.perf_counter() - begin}
    times = np.array([row["t"] for row in energies])
    if doubted := doubt(system, ledger, turnover, start):
        warnings.warn(doubted, FeclothWarning, stacklevel=2)
    kept = columns(energies), columns(observed), seconds, counts.newton, counts.linear
    return Result(state, times, *kept, why, method, doubted)


def balanced(
    system: System, method, ledger: Ledger, info: StepInfo, most: float = MOST_GROWTH
) -> Ledger:
    """The ledger after a step; a `StepFailed` where this and the last one had too much energy.

    One alone may: a load that sets in has given momentum before it has worked.
    """
    after = ledger.after(system, method, info.old, info.result)
    noise = _noise(system, info)
    grown = [one.kinetic > noise and one.growth(most) for one in (ledger, after)]
    if all(grown):
        raise step_failed(system, info.old, info.step, info.dt, _Problem(grown[1]))
    return after


def _noise(system: System, info: StepInfo) -> float:
    """Kinetic energy [J] that tells nothing.

    `record.slight`, or ½ m (64 ε |x|/dt)² if that is more, which the round-off of positions makes.
    """
    speed = 64 * np.finfo(float).eps * np.abs(info.result.state.x).max() / info.dt
    rounded = 0.5 * float(system.nodal_mass.sum()) * speed**2
    return max(rounded, slight(system, info.t - info.memory.start))


def add_seconds(a: dict[str, float], b: dict[str, float]) -> dict[str, float]:
    """Seconds by phase, summed."""
    return {key: a.get(key, 0.0) + b.get(key, 0.0) for key in {**a, **b}}


def columns(rows: list[dict[str, float]]) -> dict[str, np.ndarray]:
    """Rows of equal keys as one array for each key."""
    return {key: np.array([row[key] for row in rows]) for key in rows[0] if key != "t"}
