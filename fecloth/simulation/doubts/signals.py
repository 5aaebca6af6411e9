"""Motions of pins and loads that act between the ends of fixed steps, found before the run."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import partial

import numpy as np

from fecloth.quantities.formula import Formula
from fecloth.quantities.time_function import TimeFunction
from fecloth.simulation.step_times import step_times
from fecloth.simulation.within_step import LOADS, PINS, uneven
from fecloth.system.motion import Motion
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.custom.force import VARIABLES, BoundUserForce, FormulaForce
from fecloth.terms.loads.air_velocity import Field, Formulas, Gusts, Uniform
from fecloth.terms.springs.tether import BoundTether

MISSED = 0.25  # of a motion or load; a sine at 4 steps a period has 0.2, at 3 steps 0.33
GOOD = 0.12  # of it, at the dt that a warning proposes
# evaluations at most: of formulas of time, of those at NODES, of functions, of forces
FORMULAS, PLACES, FUNCTIONS, FORCES = 2**17, 2**15, 2**13, 2**8
NODES = 16  # at which a force on all nodes is compared
# sample times as fractions of a step; uneven, so that no oscillation is zero at all of them
INSIDE = {FORMULAS: uneven(64), PLACES: uneven(32), FUNCTIONS: uneven(16), FORCES: uneven(5)}
NEAR = 5  # steps on each side of the one that misses most
HALVINGS = 12  # of dt, at most, in the search for one that is short enough
ROUND_OFF = 1e-9  # of the largest value; less is no deviation
SLIGHT = 1e-3  # of the way of a motion; less does not matter beside its uniform part


@dataclass(frozen=True, eq=False)
class Signal:
    """Something that depends on time."""

    name: str  # what the warning calls it
    values: Callable[[np.ndarray], np.ndarray]  # function of times (m,) that returns (m, k)
    most: int  # largest number of times
    moves: bool = False  # whether it is a motion, of which a uniform one counts as none
    # Fractions of a step at which `Adaptive` looks at it.
    samples: np.ndarray = field(default_factory=lambda: LOADS)


def find_missed(system: System, state: State, dt: float | None, t_end: float) -> Iterator[str]:
    """Yield a sentence for each motion or load that mostly acts between the ends of steps of `dt`.

    Its values inside the steps are compared with the straight lines between those at their ends,
    on the average over time. Of long runs a part of the steps is looked at, evenly spread, so that
    a single short pulse can be missed there. For chosen steps, dt = None, see
    `short_pulses`.
    """
    if dt is None:
        return
    for signal in signals(system, state):
        with suppress(Exception):  # whatever a user's function may raise: the run will tell it
            share = missed_share(signal, state.t, dt, t_end)
            if share > MISSED and (_share_near_worst(signal, state.t, dt, t_end, dt) > MISSED):
                yield _sentence(signal, share, state.t, dt, t_end)


def _sentence(signal: Signal, share: float, t: float, dt: float, t_end: float) -> str:
    words = (
        f"{signal.name} acts between the ends of the steps: {100 * min(share, 1):.0f} % of it is "
        f"not seen by steps of {dt:g} s"
    )
    shorter = dt * 0.5 ** np.arange(1, HALVINGS)
    good = (d for d in shorter if _sees(signal, t, dt, d, t_end))
    if found := next(good, None):
        return f"{words}; take dt <= {found:.2g} s"
    return f"{words}; take a much smaller dt, or let it act for longer"


def _sees(signal: Signal, t: float, dt: float, shorter: float, t_end: float) -> bool:
    """Return whether shorter steps see a signal, on the whole and where steps of dt see it least.

    Of a run of many steps the whole is left out: what its few samples meet is chance.
    """
    if _share_near_worst(signal, t, dt, t_end, shorter) > GOOD:
        return False
    is_long = (t_end - t) / shorter > _most_steps(signal)
    return is_long or missed_share(signal, t, shorter, t_end) <= GOOD


def _share_near_worst(signal: Signal, t: float, dt: float, t_end: float, chosen: float) -> float:
    """Return the share that steps `chosen` miss in the NEAR steps of dt around the worst one."""
    ends = np.append(t, step_times(t, dt, t_end))
    steps, missed, _ = _missed(signal, ends)
    worst = steps[missed.max(axis=1).argmax()]
    begin, end = ends[max(0, worst - NEAR)], ends[min(worst + 1 + NEAR, len(ends) - 1)]
    return missed_share(signal, begin, chosen, end)


def _most_steps(signal: Signal) -> int:
    """Return how many steps of two grids, with their samples, make the most evaluations."""
    return max(1, signal.most // (2 * len(INSIDE[signal.most]) + 4))


def missed_share(signal: Signal, t: float, dt: float, t_end: float) -> float:
    """Return ∫ |g − its line through the ends of each step| dt / ∫ |g| dt of a signal g(t).

    Of a motion, g is the rest beside the uniform motion nearest to it. The share is the larger one
    of the steps and of steps shifted by half of one: two steps a period may meet each extreme of
    an oscillation by chance.
    """
    ends = np.append(t, step_times(t, dt, t_end))
    grids = (ends, ends[:-1] + 0.5 * np.diff(ends)) if len(ends) > 2 else (ends,)
    return max(_share(signal, grid) for grid in grids)


def _share(signal: Signal, ends: np.ndarray) -> float:
    _, missed, whole = _missed(signal, ends)
    return float(missed.sum(axis=0).max() / whole.max()) if missed.any() else 0.0


def _missed(signal: Signal, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return steps (m,), the integrals of what each of them misses (m, k), and of all (k,)."""
    s = INSIDE[signal.most]
    steps = len(ends) - 1
    seen = np.linspace(0, steps - 1, min(steps, _most_steps(signal))).round().astype(int)
    begin, size = ends[seen, None], np.diff(ends)[seen, None]
    times = begin + size * np.concatenate([[0.0], s, [1.0]])
    g = signal.values(times.ravel()).reshape(*times.shape, -1)
    least = ROUND_OFF * np.abs(g).max()
    if signal.moves:
        least = max(least, SLIGHT * np.ptp(g.reshape(-1, g.shape[-1]), axis=0).max())
        g = _without_uniform_motion(times, g)
    lines = g[:, :1] + (g[:, -1:] - g[:, :1]) * s[:, None]
    missed = np.abs(g[:, 1:-1] - lines).mean(axis=1) * size
    whole = (np.abs(g[:, 1:-1]).mean(axis=1) * size).sum(axis=0)
    if not missed.sum(axis=0).max() > least * size.sum():
        missed[:] = 0.0
    return seen, missed, whole


def _without_uniform_motion(times: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Return g (m, s, k) at times (m, s) less the line in t nearest to it."""
    t = (times - times[0, 0]) / (times[-1, -1] - times[0, 0])
    A = np.stack([np.ones(t.size), t.ravel()], axis=1)
    flat = g.reshape(t.size, -1)
    return (flat - A @ np.linalg.lstsq(A, flat, rcond=None)[0]).reshape(g.shape)


def signals(system: System, state: State) -> Iterator[Signal]:
    """Yield what depends on time: motions of pins, loads, and forces of user-defined terms."""
    for name, (pin, _) in system.constraints.groups.items():
        if pin.moves:
            moved = partial(pin.sample, size=system.cloth.extent)
            values, most = each(moved), FUNCTIONS
            if isinstance(pin.motion, Motion) and pin.rotate is None:
                values, most = motion_values(pin.motion), FORMULAS
            yield Signal(f"the motion of the pin {name!r}", values, most, True, PINS)
    for name, bound in zip(system.names, system.bound, strict=True):
        for attribute, values, most in _of_term(bound, state):
            yield Signal(f"{attribute} of {name}", values, most, isinstance(bound, BoundTether))


def _of_term(bound, state: State) -> Iterator[tuple[str, Callable, int]]:
    """Yield name, function of times and number of evaluations of what depends on time in a term."""
    known, bound = False, bound.here()
    for value in _values(bound):
        if isinstance(value, Uniform):
            value = value.value
        if isinstance(value, TimeFunction):
            known = True
            if callable(value.parts):
                yield value.name, each(value), FUNCTIONS
            elif _has_time(value.parts):
                yield value.name, _formulas(value), FORMULAS
        elif isinstance(value, Field | Gusts):
            known, x = True, _few(state.x)
            function = value.function if isinstance(value, Field) else None
            if isinstance(function, Formulas) and not is_steady(function):
                place = dict(zip("xyz", x.T, strict=True))
                yield "the air velocity", _formulas_at(function.parts, place), PLACES
            elif not is_steady(function):
                yield "the air velocity", each(lambda t, u=value, x=x: u.velocity(x, t)), FORCES
    is_foreign = not type(bound).__module__.startswith("fecloth.")
    is_force = is_foreign or isinstance(bound, BoundUserForce)
    function = bound.function if isinstance(bound, BoundUserForce) else None
    if isinstance(function, FormulaForce) and not is_steady(function):
        columns = (*function.X.T, *state.x.T, *state.v.T)
        place = dict(zip(VARIABLES, map(_few, columns), strict=False))
        yield "the force", _formulas_at(function.parts, place), PLACES
    elif is_force and not known and not is_steady(function):
        yield "the force", each(lambda t: _force(bound, state, t)), FORCES


def is_steady(function: object) -> bool:
    """Return whether a function of formulas has no t in them."""
    return isinstance(function, Formulas | FormulaForce) and not _has_time(function.parts)


def _has_time(parts) -> bool:
    return any(isinstance(p, Formula) and re.search(r"\bt\b", p.text) for p in parts)


def motion_values(motion: Motion) -> Callable[[np.ndarray], np.ndarray]:
    """Return the displacement (m, k) at times (m,), of a few nodes where it differs by node."""
    if not motion.by_place or motion.X is None:
        return motion
    few = replace(motion, X=motion.X[:: max(1, len(motion.X) // NODES)])
    return lambda times: few(times[:, None]).reshape(len(times), -1)


def _values(bound) -> Iterator[object]:
    if is_dataclass(bound):
        yield from (getattr(bound, field.name) for field in fields(bound))


def _force(bound, state, t):
    f = np.zeros_like(state.x)
    bound.add_force(state.x, state.v, t, f)
    return _few(f)


def _few(values: np.ndarray) -> np.ndarray:
    """Return the values at about NODES of the nodes."""
    return values[:: max(1, len(values) // NODES)]


def _formulas_at(parts, place: dict[str, np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function of times (m,) with the values (m, k) of formulas at k places or one."""

    def values(t):
        given = place | {"t": t[:, None]}
        columns = [np.atleast_2d(p(**given) if isinstance(p, Formula) else p) for p in parts]
        shaped = [np.broadcast_to(c, (len(t), c.shape[1])) for c in columns]
        return np.concatenate(shaped, axis=1)

    return values


def _formulas(function: TimeFunction) -> Callable[[np.ndarray], np.ndarray]:
    def values(t):
        parts = (p if isinstance(p, float) else p(t=t) for p in function.parts)
        return np.stack([np.broadcast_to(part, t.shape) for part in parts], axis=-1)

    return values


def each(function: Callable) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function of times (m,) with values (m, k), by one call for each."""
    return lambda times: np.stack([np.ravel(function(float(t))) for t in times])
