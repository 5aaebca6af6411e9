"""Motions of pins and loads so short that steps chosen in the run may jump over them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from fecloth.integrators.protocol import StepChoice
from fecloth.simulation.between_steps import SLIGHT, Signal, signals
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.method_choice import Auto
from fecloth.stability.critical_step import element_bound
from fecloth.system.state import State
from fecloth.system.system import System

ACTS = 0.1  # of the largest deviation; below it a load does not act
RARE = 0.25  # of the run; what acts for longer is met by one of the samples in a step
SMALL = 0.05  # of the largest value of a load; a smaller deviation does not matter
QUARTER = 0.25  # of the time for which a load acts: the longest step that sees it well


def longest_step(
    steps: StepChoice | Auto, system: System, t: float, ends: np.ndarray
) -> float | None:
    """Return an upper bound [s] of steps chosen in a run from t with these stops, None if fixed."""
    if steps.dt is not None:
        return None
    sizes = np.diff(ends, prepend=t)
    sizes[0] /= 2  # the first step is below SAFETY of what is ahead, and so at most half of it
    longest = steps.longest if isinstance(steps, Adaptive | Auto) else None
    bounds = [float(sizes.max()), longest or math.inf]
    if steps.traits.explicit:
        bounds.append(element_bound(system, "central_difference"))
    return min(bounds)


def find_short_pulses(
    system: System, state: State, steps: StepChoice | Auto, ends: np.ndarray
) -> Iterator[str]:
    """Yield a sentence for each motion or load that chosen steps may jump over.

    It acts for less than the distance between the samples that `Adaptive` takes inside its longest
    possible step, and in less than a quarter of the run. `ends` (k,) has the stops and the end.
    """
    longest = longest_step(steps, system, state.t, ends)
    if longest is None:
        return
    is_sampled = isinstance(steps, Adaptive | Auto)
    for signal in signals(system, state):
        samples = signal.samples if is_sampled else np.empty(0)
        gap = float(np.diff(np.concatenate([[0.0], samples, [1.0]])).max()) * longest
        with suppress(Exception):  # whatever a user's function may raise: the run will tell it
            begin, length = shortest_pulse(signal, state.t, ends)
            if length < gap:
                yield (
                    f"{signal.name} acts for {length:.2g} s at t = {begin:.4g} s, and the chosen "
                    f"steps, of up to {longest:.2g} s, may jump over it; take "
                    f"longest = {QUARTER * length:.1g} [s] for Adaptive, Auto or [time] of a scene"
                )


def shortest_pulse(signal: Signal, t: float, ends: np.ndarray) -> tuple[float, float]:
    """Return begin and length [s] of the shortest pulse of a signal; an infinite one for none.

    A pulse is a time at which the signal deviates from its median, and before and after which it
    does not. A uniform change is taken off first. What acts at the start or the end of a run is
    no pulse, nor is one with a stop inside: the steps see it there.
    """
    times = np.linspace(t, ends[-1], signal.most)
    g = np.asarray(signal.values(times), float).reshape(len(times), -1)
    scale = np.ptp(g, axis=0).max() * SLIGHT if signal.moves else np.abs(g).max() * SMALL
    half, index = len(times) // 2, np.arange(len(times))[:, None]
    rate = np.median(g[-half:], axis=0) - np.median(g[:half], axis=0)
    g = g - rate * index / (len(times) - half)
    deviation = np.abs(g - np.median(g, axis=0)).max(axis=1)
    acts = deviation > ACTS * deviation.max()
    if not deviation.max() > scale or acts.mean() > RARE:
        return t, math.inf
    changes = np.diff(acts.astype(int))
    begins, finishes = np.flatnonzero(changes > 0), np.flatnonzero(changes < 0)
    finishes = finishes[finishes > begins[0]] if len(begins) else finishes
    stops = np.searchsorted(times, ends)
    pairs = [
        (first, last)
        for first, last in zip(begins, finishes, strict=False)
        if not ((stops > first + 1) & (stops <= last)).any()
    ]
    if not pairs:
        return t, math.inf
    first, last = min(pairs, key=lambda pair: pair[1] - pair[0])
    return float(times[first + 1]), float((last - first) * (times[1] - times[0]))
