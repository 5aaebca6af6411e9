"""The compiled calls that add all forces of a system, for one thread or for several."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fecloth.compiled.calls import AnyCall, Call, Calls, JoinedCalls, SharedCall, join
from fecloth.compiled.jit import Array
from fecloth.compiled.threads import Member, members, wait
from fecloth.integrators.fused_columns import Column, Moves, subtract_from
from fecloth.integrators.fused_loops import copy
from fecloth.system.system import System
from fecloth.terms.loops.array_updates import BY_ROWS


def force_calls(
    system: System, columns: tuple[Column, ...], moves: Moves, f: Array
) -> Calls | None:
    """The calls that add all forces to f, with those that take out the columns' parts."""
    calls: list[AnyCall] = []
    of_term = {column.name: column for column in columns}
    x, v = moves.x, moves.ahead
    for name, term in zip(system.names, system.bound, strict=True):
        own = compiled_force(term, x, v, f)
        if own is None:
            return None
        column = of_term.get(name)
        if column is None:
            calls += own
            continue
        elastic = compiled_force(term, x, np.zeros_like(v), column.base) if term.has_energy else []
        calls += [(copy, (f, column.base)), *(elastic or []), *own, column.at_force(f, moves)]
    return calls


def compiled_force(term: Any, x: np.ndarray, v: np.ndarray, f: np.ndarray) -> Calls | None:
    """Return the calls of a term's force, or None where it needs Python.

    A class that overrides `add_force` alone has inherited the calls of another force.
    """
    kinds = type(term).__mro__
    force = next(kind for kind in kinds if "add_force" in vars(kind))
    calls = next((kind for kind in kinds if "force_calls" in vars(kind)), None)
    if calls is None or not issubclass(calls, force):
        return None
    found: Calls | None = term.force_calls(x, v, 0.0, f)
    return found


@dataclass(frozen=True, eq=False)
class SharedForces:
    """Forces for several threads, which wait for each other after each call."""

    # Of each thread.
    calls: tuple[JoinedCalls, ...]
    members: list[Member]

    @classmethod
    def of(cls, calls: Calls, threads: int) -> SharedForces:
        """Divide calls among threads; what cannot be divided is for the first thread."""
        all_ = members(threads)
        lists: list[list[Call]] = [[] for _ in all_]
        for each in calls:
            for own, member in zip(lists, all_, strict=True):
                own += [*_calls_of(each, member.thread, threads), (wait, (member,))]
        return cls(tuple(map(join, lists)), all_)

    def start(self) -> None:
        """Let the threads meet for the first time again."""
        self.members[0].meeting[0] = 0
        for member in self.members:
            member.round_[0] = 1


def _calls_of(each: AnyCall, p: int, threads: int) -> list[Call]:
    """What thread p does of a call."""
    if isinstance(each, SharedCall):
        return each.of_thread(p)
    function, arguments = each
    if function in BY_ROWS or function in (copy, subtract_from):
        own = (_rows_of(value, p, threads) for value in arguments)
        return [(function, tuple(own))]
    return [each] if p == 0 else []


def _rows_of(value: object, p: int, threads: int) -> object:
    if not isinstance(value, np.ndarray):
        return value
    return value[len(value) * p // threads : len(value) * (p + 1) // threads]
