"""Jumps in the motion of a pin or an obstacle, which no step size can resolve."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.planned_run import PlannedRun, check_each
from fecloth.simulation.doubts.signals import ROUND_OFF_OF_SIGNAL, Signal, Values, find_signals
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

NEAR = 1e-9  # of the run: so much beside a jump are the values before and after it
MOST_JUMPS = 8  # jumps of a pin that are looked for
HALVINGS_OF_JUMP = 30  # of an interval, after which what is left of a change is a jump
LEAST_JUMP = 1e-6  # over the extent of the cloth; a smaller jump moves nothing that can be seen
PROPOSED_SPEED = 1.0  # m/s, of the motion that a doubt proposes in place of a jump


@remembered
@dataclass(frozen=True)
class Jump:
    """The largest jump of a motion.

    Attributes
    ----------
    size
        How far it jumps [m].
    doubt
        The doubt about it, in words.
    """

    size: float
    doubt: Doubt


def find_motion_jumps(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt each pin and obstacle whose motion jumps, and say when and how far."""
    jumps = _largest_jumps(run.signals, LEAST_JUMP * run.system.cloth.extent)
    return (jump.doubt for jump in jumps)


def find_jumping_motions(system: System, start: State, t_end: float) -> tuple[Jump, ...]:
    """Return the largest jump of each pin and obstacle that jumps."""
    signals = find_signals(system, start, t_end, True)
    return tuple(_largest_jumps(signals, LEAST_JUMP * system.cloth.extent))


def _largest_jumps(signals: Iterable[Signal], least: float) -> Iterator[Jump]:
    motions = (signal for signal in signals if signal.kind in ("pin", "obstacle"))
    return check_each(motions, _largest_jump, least)


def _largest_jump(motion: Signal, least: float) -> Jump | None:
    """Return the largest jump of a motion, None if none is larger than `least` [m]."""
    if motion.is_smooth:
        return None
    jumps = find_jumps(*motion.samples, motion.values, least)
    if not jumps:
        return None
    t, size = max(jumps, key=lambda jump: jump[1])
    later = t + max(size / PROPOSED_SPEED, 0.01)
    more = ""
    if len(jumps) > 1:
        more = f", the largest of {len(jumps)} jumps"
    words = (
        f"{motion.name} jumps by {size:.3g} m at t = {t:.6g} s{more}: no step resolves a jump, "
        "and its effect on the cloth depends on dt"
    )
    remedy = (
        f"let the {motion.kind} move in a finite time, as "
        f"{size:.3g} * smoothstep({t:.6g}, {later:.6g}, t) does"
    )
    return Jump(float(size), Doubt(DoubtKind.JUMP, words, remedy))


def find_load_jumps(loads: Iterable[Signal]) -> np.ndarray:
    """Return when any of the loads jumps (k,) [s], in the order of time.

    Of a load with very many jumps the largest ones are found.
    """
    found = check_each(loads, _jump_times)
    return np.unique(np.concatenate([np.zeros(0), *found]))


def _jump_times(load: Signal) -> list[float]:
    """Return when a load jumps [s]."""
    if load.is_smooth:
        return []
    times, g = load.samples
    most = load.effort.most // HALVINGS_OF_JUMP
    least = ROUND_OFF_OF_SIGNAL * np.abs(g).max()
    return [t for t, _ in find_jumps(times, g, load.values, least, most)]


def find_jumps(
    times: np.ndarray, g: np.ndarray, values: Values, least: float, most: int = MOST_JUMPS
) -> list[tuple[float, float]]:
    """Return the time and the size of each jump of a signal, in their order.

    The intervals that differ most from their neighbours are halved until a jump remains, or
    none. A motion that goes there and back within an interval is missed.

    Parameters
    ----------
    times, g
        (m,) even times, and the values there (m, k).
    values
        The signal as a function of times.
    least
        Size of a change that counts as a jump.
    most
        Number of intervals that are halved.
    """
    begin = times[0]
    end = times[-1]
    near = NEAR * (end - begin)  # jumps that are not farther apart are one
    jumps: list[tuple[float, float]] = []
    intervals = _intervals_that_may_jump(g, least, most)
    for t, left in zip(*_halve(values, times, g, intervals), strict=True):
        is_known = jumps and t - jumps[-1][0] <= near
        if not left > least or is_known:
            continue
        around = np.clip([t - near, t + near], begin, end)
        size = float(np.abs(np.diff(values(around), axis=0)).max())
        if t - begin <= near:
            t = begin
        jumps.append((float(t), size))
    return jumps


def _intervals_that_may_jump(g: np.ndarray, least: float, most: int) -> np.ndarray:
    """Return the intervals in which g (m, k) changes most beside the intervals next to them."""
    changes = np.diff(g, axis=0)
    changes = np.abs(changes, out=changes).max(axis=1)  # in place: these may be 100 MB
    before = np.append(changes[1], changes[:-1])
    after = np.append(changes[1:], changes[-2])
    excess = np.where(changes > least, changes - np.minimum(before, after), 0.0)
    candidates = np.argsort(-excess, kind="stable")[:most]
    return np.sort(candidates[changes[candidates] > least])


def _halve(
    values: Values, times: np.ndarray, g: np.ndarray, intervals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the time of the largest change in each interval, and the change that is left."""
    a = times[intervals]
    b = times[intervals + 1]
    at_a = g[intervals]
    at_b = g[intervals + 1]
    for _ in range(HALVINGS_OF_JUMP if len(intervals) else 0):
        middle = 0.5 * (a + b)
        at_middle = np.asarray(values(middle), float).reshape(at_a.shape)
        is_before = np.abs(at_middle - at_a).max(axis=1) > np.abs(at_b - at_middle).max(axis=1)
        a = np.where(is_before, a, middle)
        b = np.where(is_before, middle, b)
        at_a = np.where(is_before[:, None], at_a, at_middle)
        at_b = np.where(is_before[:, None], at_middle, at_b)
    return b, np.abs(at_b - at_a).max(axis=1, initial=0.0)
