"""Jumps in the motion of a pin or an obstacle, which no step size can resolve."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.planned_run import PlannedRun, check_each
from fecloth.simulation.doubts.signals import Signal, Values, find_signals
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

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


def find_jumps(
    times: np.ndarray, g: np.ndarray, values: Values, least: float
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
    """
    begin = times[0]
    end = times[-1]
    near = 1e-9 * (end - begin)  # jumps that are not farther apart are one
    jumps: list[tuple[float, float]] = []
    for i in _intervals_that_may_jump(g, least):
        t, left = _halve(values, times[i : i + 2], g[i : i + 2])
        is_known = jumps and t - jumps[-1][0] <= near
        if not left > least or is_known:
            continue
        around = np.clip([t - near, t + near], begin, end)
        size = float(np.abs(np.diff(values(around), axis=0)).max())
        if t - begin <= near:
            t = begin
        jumps.append((float(t), size))
    return jumps


def _intervals_that_may_jump(g: np.ndarray, least: float) -> list[int]:
    """Return the intervals in which g (m, k) changes most beside the intervals next to them."""
    changes = np.diff(g, axis=0)
    changes = np.abs(changes, out=changes).max(axis=1)  # in place: these may be 100 MB
    before = np.append(changes[1], changes[:-1])
    after = np.append(changes[1:], changes[-2])
    excess = np.where(changes > least, changes - np.minimum(before, after), 0.0)
    most = np.argsort(-excess, kind="stable")[:MOST_JUMPS]
    return sorted(most[changes[most] > least])


def _halve(values: Values, times: np.ndarray, g: np.ndarray) -> tuple[float, float]:
    """Return the time of the largest change between two times, and the change that is left."""
    a, b = times
    at_a, at_b = g
    for _ in range(HALVINGS_OF_JUMP):
        middle = 0.5 * (a + b)
        (at_middle,) = values(np.array([middle]))
        if np.abs(at_middle - at_a).max() > np.abs(at_b - at_middle).max():
            b = middle
            at_b = at_middle
        else:
            a = middle
            at_a = at_middle
    return b, np.abs(at_b - at_a).max()
