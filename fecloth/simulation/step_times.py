"""When steps end: at multiples of dt, at stops, at the end."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np

from fecloth.errors import InputError, floats
from fecloth.integrators.protocol import MethodTraits, chooses_method, method_of
from fecloth.integrators.step import Step
from fecloth.system.state import State
from fecloth.system.system import System

MOST_STEPS = 10**8  # whose end times alone take 0.8 GB
# Rounding of the time over a step: a coarser clock changes the velocity visibly.
COARSEST_CLOCK = 1e-3
# Over a step: times, or sizes of steps, that differ by less are the same: the clock's round-off.
SAME_TIME = 1e-9
SMALLER = "Take a smaller dt."
EARLIER = "Start earlier, as at t_start = 0, or take a larger dt."


def end_times(t: float, t_end: float | None, stops: Sequence[float] = ()) -> np.ndarray:
    """Return the stops after t and before t_end, in order, and t_end [s].

    Raises `InputError` for a t_end that is no time after t, and for stops outside the run.
    """
    if t_end is None:
        remedy = "The shape at rest, without time, is fc.equilibrium(system, state)."
        raise InputError("t_end is missing", "must be the end of the run [s]", "march", remedy)
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
    apart = np.diff(times) > SAME_TIME * (t_end - t)
    return np.append(times[1:-1][apart[:-1] & apart[1:]], t_end)


def with_releases(
    system: System,
    steps: Any,
    t: float,
    t_end: float | None,
    stops: Sequence[float] = (),
) -> Sequence[float]:
    """Return the stops, and the times in the run at which pins let go [s].

    Any other stop that differs from such a time by round-off only is left out. `steps` is the
    choice of the steps of a run from t to `t_end`, as for `march`.
    """
    if not system.releases:
        return stops
    end = float(steps.end_times(t, t_end, stops)[-1])
    least = SAME_TIME * (end - t)
    releases = [time for time in system.releases if t + least < time < end - least]
    others = [stop for stop in stops if all(abs(stop - time) > least for time in releases)]
    return sorted([*others, *releases])


def step_times(t: float, dt: float, t_end: float | None, stops: Sequence[float] = ()) -> np.ndarray:
    """Return the end time of every step [s], t + i dt without accumulated round-off.

    Raises `InputError` for times as `end_times`, for more than `MOST_STEPS` steps, and for a dt
    that the floating-point time does not resolve.
    """
    targets = end_times(t, t_end, stops)
    if problem := coarse_clock(max(abs(t), abs(targets[-1])), dt):
        raise InputError(f"dt = {dt:g} s", problem, "march", EARLIER)
    pieces = []
    for target in targets:
        steps = count_steps(target - t, dt)
        if steps > MOST_STEPS:
            allowed = f"makes {steps:.2g} steps, and must make at most {MOST_STEPS:.0e}"
            raise InputError(f"dt = {dt:g} s", allowed, "march", "A bare number is in seconds.")
        pieces.append(t + dt * np.arange(1, steps + 1))
        pieces[-1][-1] = t = target
    return np.concatenate(pieces)


def count_steps(span: float, dt: float) -> int:
    """Return how many steps of at most dt make a span [s]; a rest by round-off is no step."""
    return max(1, math.ceil(span / dt - SAME_TIME))


def fit_step(dt: float, horizon: float) -> float:
    """Return dt [s], or the horizon or half of it if two such steps reach the end."""
    steps = count_steps(horizon, dt)
    if steps <= 2:
        return horizon / steps
    return dt


def given_times(
    t: float, sizes: Sequence[float], t_end: float | None, stops: Sequence[float] = ()
) -> np.ndarray:
    """Return the end time of every step of these sizes [s]; by default the last one is `t_end`.

    Raises `InputError` for a `t_end` or stops that are no ends of steps, and for sizes that the
    floating-point time does not resolve.
    """
    if problem := coarse_clock(max(abs(t), abs(t + sum(sizes))), min(sizes)):
        raise InputError(f"dt = {min(sizes):g} s", problem, "march", EARLIER)
    last = t_end
    if last is None:
        last = float(np.add.accumulate([t, *sizes])[-1])
    targets = end_times(t, last, stops)
    ends = []
    for size in sizes:
        ends.append(t + size)
        near = targets[np.argmin(abs(targets - ends[-1]))]
        if abs(near - ends[-1]) <= SAME_TIME * size:
            ends[-1] = float(near)
        t = ends[-1]
    missed = np.setdiff1d(targets, ends)
    if last in missed or ends[-1] != last:
        allowed = f"must be the end of the last step, at {ends[-1]:.9g} s, or be left out"
        raise InputError(f"t_end = {last:.9g}", f"with a list dt: {allowed}", "march")
    if len(missed):
        nearest = min(ends, key=lambda end: abs(end - missed[0]))
        allowed = f"must be at the end of a step of the list dt; the nearest is {nearest:.9g} s"
        raise InputError(f"stops: {missed[0]:.9g} s", allowed, "march")
    return np.array(ends)


def coarse_clock(t: float, dt: float) -> str:
    """Say that a step is not resolved by the floating-point time t, or return ""."""
    tick = math.ulp(t)
    if not math.isfinite(tick) or tick <= COARSEST_CLOCK * dt:
        return ""
    most = f"{COARSEST_CLOCK:g} dt"
    return f"the time t = {t:g} s is known to {tick:.1e} s only, which must be below {most}"


class ChosenSteps:
    """Base of choices of steps, by default of no fixed size; see `protocol.StepChoice`."""

    method: Any
    dt: None = None

    @cached_property
    def traits(self) -> MethodTraits:
        """The traits of the method; `march` takes no other dt."""
        return replace(self.method.traits, chooses_dt=True)

    def end_times(self, t: float, t_end: float | None, stops: Sequence[float] = ()) -> np.ndarray:
        """Return the times at which a step must end [s]."""
        return end_times(t, t_end, stops)

    def check(self, system: System) -> None:
        """Raise `InputError` for a system that an explicit method cannot move."""
        method = method_of(self)
        if method.traits.explicit and not chooses_method(self):  # Auto has no method yet
            method.check(system)

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Return the energy that the method dissipates in a step [J]."""
        return self.method.numerical(system, old, step)

    def check_start(self, system: System, state: State, insist: str = "") -> None:
        """Nothing to refuse: the steps are chosen so that the method can take them."""


def targets_after(targets: np.ndarray, t: float) -> np.ndarray:
    """Return the targets after t [s]; `InputError` if there are none."""
    if not targets[-1] > t:
        raise InputError(f"t_end = {targets[-1]}", f"must be > {t} [s]", "march")
    return targets[targets > t]
