"""Motions of pins and loads that act between fixed steps, or too shortly for chosen steps.

Of long runs a part is looked at, evenly spread, so that a single short pulse can be missed
there.
"""

import math
from collections.abc import Iterator

import numpy as np

from fecloth.errors import amount
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.planned_run import PlannedRun, check_each
from fecloth.simulation.doubts.signals import ROUND_OFF_OF_SIGNAL, Signal, Span
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.step_times import step_times
from fecloth.simulation.within_step import LOADS, PINS

# Share of a motion or load; a sine at 4 steps a period has 0.2, at 3 steps 0.33.
LARGEST_MISSED = 0.25
# Share of it that the dt of a remedy may miss: half of what causes a doubt.
MISSED_BY_REMEDY = 0.12
STEPS_AROUND = 5  # steps on each side of the step that misses most
HALVINGS_OF_STEP = 12  # of dt, at most, in the search for a step that is short enough
LEAST_MOTION = 1e-3  # over the way of a motion; less does not matter beside its uniform part

LEAST_ACTION = 0.1  # over the largest deviation; below it a load does not act
LONGEST_PULSE = 0.25  # of the run; what acts for longer is met by one of the samples in a step
LEAST_PULSE = 0.05  # over the largest value of a load; a smaller deviation does not matter
# Longest step that sees a load well, over the time for which the load acts.
STEP_OVER_PULSE = 0.25


# --- between steps of a fixed size -------------------------------------------


def find_missed(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt each motion or load that mostly acts between the ends of fixed steps."""
    if not run.dt:
        return iter(())
    return check_each(run.signals, _check_for_missed, run.dt)


def find_missed_by_load_steps(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt each motion of a static problem whose way the load steps cut short.

    A pin that turns once in one load step is back where it was: nothing has turned.
    """
    if not isinstance(run.steps, LoadSteps):
        return iter(())
    motions = (signal for signal in run.signals if signal.moves)
    return check_each(motions, _check_load_steps, run.steps.load_steps)


def _check_load_steps(motion: Signal, number: int) -> Doubt | None:
    """Return a doubt if `number` load steps miss much of a motion."""
    share, _ = missed_share(motion, 1 / number, motion.span)
    if not share > LARGEST_MISSED:
        return None
    steps = amount(number, "load step")
    words = (
        f"{motion.name} turns back or turns round between the ends of {steps}: "
        f"{100 * min(share, 1):.0f} % of it is not seen"
    )
    for more in number * 2 ** np.arange(1, HALVINGS_OF_STEP):
        if _sees(motion, 1 / more, motion.span):
            return Doubt(DoubtKind.MISSED, words, f"take load_steps >= {more}")
    return Doubt(DoubtKind.MISSED, words, "take many more load_steps")


def _check_for_missed(signal: Signal, dt: float) -> Doubt | None:
    """Return a doubt if steps miss much of a signal, on the whole and where they miss most."""
    share, near = missed_share(signal, dt, signal.span)
    if not share > LARGEST_MISSED:
        return None
    share_near, _ = missed_share(signal, dt, near)
    if not share_near > LARGEST_MISSED:
        return None
    words = (
        f"{signal.name} acts between the ends of the steps: {100 * min(share, 1):.0f} % of it "
        f"is not seen by steps of {dt:g} s"
    )
    for shorter in dt * 0.5 ** np.arange(1, HALVINGS_OF_STEP):
        if _sees(signal, shorter, near):
            return Doubt(DoubtKind.MISSED, words, f"take dt <= {shorter:.2g} s")
    return Doubt(DoubtKind.MISSED, words, "take a much smaller dt, or let it act for longer")


def _sees(signal: Signal, dt: float, near: Span) -> bool:
    """Return whether steps see a signal, in the whole run and in the span `near`.

    `near` is where the steps of the run missed most of it. Of a run of many steps the whole is
    left out: what its few samples meet is chance.
    """
    share_near, _ = missed_share(signal, dt, near)
    if share_near > MISSED_BY_REMEDY:
        return False
    begin, end = signal.span
    if (end - begin) / dt > _most_steps(signal):
        return True
    share, _ = missed_share(signal, dt, signal.span)
    return share <= MISSED_BY_REMEDY


def missed_share(signal: Signal, dt: float, span: Span) -> tuple[float, Span]:
    """Return the share of a signal that steps miss, and the span of the steps that miss most.

    The share is ∫ |g − its line through the ends of each step| dt / ∫ |g| dt of a signal g(t).
    Of a motion, g is the rest beside the uniform motion nearest to it. The share is the larger
    one of the steps and of steps shifted by half of one: two steps a period may meet each
    extreme of an oscillation by chance. Samples of a smooth pulse err here and there, but give
    the cloth the right impulse: the share of a load is at most the share of its impulse, the
    largest difference at the ends of steps over the largest change of ∫ g dt beside a uniform
    one.
    """
    ends = np.append(span[0], step_times(span[0], dt, span[1]))
    share, worst = _missed(signal, ends)
    if len(ends) > 2:
        shifted = ends[:-1] + 0.5 * np.diff(ends)
        share = max(share, _missed(signal, shifted)[0])
    first = max(0, worst - STEPS_AROUND)
    last = min(worst + 1 + STEPS_AROUND, len(ends) - 1)
    return share, (ends[first], ends[last])


def _most_steps(signal: Signal) -> int:
    """Return how many steps of two grids, with their samples, make the most evaluations."""
    return max(1, signal.effort.most // (2 * len(signal.effort.inside) + 4))


def _missed(signal: Signal, ends: np.ndarray) -> tuple[float, int]:
    """Return the share that the steps between these ends miss, and the step that misses most."""
    steps = _choose_steps(signal, len(ends) - 1)
    inside = signal.effort.inside
    sizes = np.diff(ends)[steps, None]
    times = ends[steps, None] + sizes * np.concatenate([[0.0], inside, [1.0]])
    g = signal.values(times.ravel()).reshape(*times.shape, -1)
    g, least = _without_what_steps_see(signal, times, g)
    begin = g[:, :1]
    middle = g[:, 1:-1]
    end = g[:, -1:]
    lines = begin + (end - begin) * inside[:, None]
    missed = np.abs(middle - lines).mean(axis=1) * sizes
    whole = (np.abs(middle).mean(axis=1) * sizes).sum(axis=0)
    most = missed.sum(axis=0).max()
    if not most > least * sizes.sum():
        return 0.0, int(steps[0])
    share = float(most / max(most, whole.max()))
    if not signal.moves and len(steps) == len(ends) - 1:
        share = min(share, _missed_impulse(middle, lines, sizes))
    worst = missed.max(axis=1).argmax()
    return share, int(steps[worst])


def _choose_steps(signal: Signal, number: int) -> np.ndarray:
    """Return the numbers of the steps that are looked at: all, or a part, evenly spread."""
    count = min(number, _most_steps(signal))
    return np.linspace(0, number - 1, count).round().astype(int)


def _without_what_steps_see(
    signal: Signal, times: np.ndarray, g: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return g (m, s, k) at times (m, s) without a uniform motion, and the least that counts."""
    least = ROUND_OFF_OF_SIGNAL * np.abs(g).max()
    if not signal.moves:
        return g, least
    way = np.ptp(g.reshape(-1, g.shape[-1]), axis=0).max()
    return _without_uniform_motion(times, g), max(least, LEAST_MOTION * way)


def _missed_impulse(g: np.ndarray, lines: np.ndarray, size: np.ndarray) -> float:
    """Return the share of the impulse of g (m, s, k) that its lines miss in m steps of `size`."""
    impulse = np.cumsum(g.mean(axis=1) * size, axis=0)
    missed = np.abs(np.cumsum((g - lines).mean(axis=1) * size, axis=0)).max()
    uniform = impulse[-1:] * np.cumsum(size, axis=0) / size.sum()
    beside = impulse - uniform
    change = (beside.max(axis=0, initial=0.0) - beside.min(axis=0, initial=0.0)).max()
    return float(missed / max(change, missed, 1e-300))


def _without_uniform_motion(times: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Return g (m, s, k) at times (m, s) less the line in t nearest to it."""
    t = (times - times.mean()).ravel()
    flat = g.reshape(times.size, -1)
    slope = np.einsum("a,ak->k", t, flat) / (t @ t)
    return (flat - flat.mean(axis=0) - t[:, None] * slope).reshape(g.shape)


# --- shorter than steps that are chosen in the run ---------------------------


def find_short_pulses(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt each motion or load that chosen steps may jump over.

    It acts for less than the distance between the samples that `Adaptive` takes inside its
    longest possible step, and in less than a quarter of the run.
    """
    if run.steps.dt is not None:
        return iter(())
    return check_each(run.signals, _check_for_pulse, run, longest_step(run))


def _check_for_pulse(signal: Signal, run: PlannedRun, longest: float) -> Doubt | None:
    """Return a doubt if the longest step [s], with its samples, may jump over a pulse."""
    begin, length = shortest_pulse(signal, run.ends)
    if not length < _largest_gap(signal, run) * longest:
        return None
    words = (
        f"{signal.name} acts for {length:.2g} s at t = {begin:.4g} s, and the chosen "
        f"steps, of up to {longest:.2g} s, may jump over it"
    )
    shorter = f"longest = {STEP_OVER_PULSE * length:.1g} [s]"
    remedy = f"take {shorter} for Adaptive, Auto or [time] of a scene"
    return Doubt(DoubtKind.MISSED, words, remedy)


def _largest_gap(signal: Signal, run: PlannedRun) -> float:
    """Return the largest distance of two looks at a signal, as a part of a step."""
    inside = np.zeros(0)
    if isinstance(run.steps, Adaptive | Auto):
        inside = PINS if signal.kind == "pin" else LOADS
    return float(np.diff([0.0, *inside, 1.0]).max())


def longest_step(run: PlannedRun) -> float:
    """Return an upper bound [s] of the steps that are chosen in a run."""
    sizes = np.diff(run.ends, prepend=run.state.t)
    sizes[0] /= 2  # the first step is below SAFETY of what is ahead, and so at most half of it
    bounds = [float(sizes.max())]
    if isinstance(run.steps, Adaptive | Auto) and run.steps.longest:
        bounds.append(run.steps.longest)
    if run.steps.traits.explicit:
        bounds.append(run.explicit_limit)
    return min(bounds)


def shortest_pulse(signal: Signal, ends: np.ndarray) -> tuple[float, float]:
    """Return begin and length [s] of the shortest pulse of a signal; an infinite one for none.

    A pulse is a time at which the signal deviates from its median, and before and after which it
    does not. A uniform change is taken off first. What acts at the start or the end of a run is
    no pulse, nor is one with a stop inside, of the `ends` of steps: the steps see it there.
    """
    times, deviation, least = _deviation(signal)
    none = float(times[0]), math.inf
    acts = deviation > LEAST_ACTION * deviation.max()
    if not deviation.max() > least or acts.mean() > LONGEST_PULSE:
        return none
    stops = np.searchsorted(times, ends)
    pulses = [
        (before, last)
        for before, last in _find_pulses(acts)
        if not ((stops > before + 1) & (stops <= last)).any()
    ]
    if not pulses:
        return none
    before, last = min(pulses, key=lambda pulse: pulse[1] - pulse[0])
    return float(times[before + 1]), float((last - before) * (times[1] - times[0]))


def _deviation(signal: Signal) -> tuple[np.ndarray, np.ndarray, float]:
    """Return even times (m,), how far a signal deviates there (m,), and the least that matters.

    It deviates from its median, after a uniform change has been taken off: the difference of the
    medians of both halves of the run.
    """
    times, g = signal.samples
    if signal.moves:
        least = LEAST_MOTION * np.ptp(g, axis=0).max()
    else:
        least = LEAST_PULSE * np.abs(g).max()
    half = len(times) // 2
    index = np.arange(len(times))[:, None]
    change = np.median(g[-half:], axis=0) - np.median(g[:half], axis=0)
    g = g - change * index / (len(times) - half)
    g -= np.median(g, axis=0)
    g = np.abs(g, out=g)  # in place: these may be 100 MB
    return times, g.max(axis=1), least


def _find_pulses(acts: np.ndarray) -> list[tuple[int, int]]:
    """Return the sample before each pulse and its last one; `acts` (m,) is true in pulses."""
    changes = np.diff(acts.astype(int))
    begins = np.flatnonzero(changes > 0)
    finishes = np.flatnonzero(changes < 0)
    if len(begins):  # what acts at the start of the run has no begin
        finishes = finishes[finishes > begins[0]]
    return list(zip(begins, finishes, strict=False))
