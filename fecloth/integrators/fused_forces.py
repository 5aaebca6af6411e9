"""The compiled calls of fused steps: all forces, and what the energy ledger has of them."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from fecloth.compiled.calls import AnyCall, Call, Calls, JoinedCalls, SharedCall, join
from fecloth.compiled.jit import Array, kernel, rounded_kernel
from fecloth.compiled.threads import Member, members, wait
from fecloth.integrators.fused_loops import copy
from fecloth.integrators.numerical_dissipation import has_power_column, has_work_column
from fecloth.system.system import System
from fecloth.terms.loops.array_updates import BY_ROWS

POWER, LAST, PATH, WORK = 0, 1, 2, 3  # places in `Column.sums`; from 4 on the impulse and its last


@dataclass(frozen=True, eq=False)
class Moves:
    """The arrays of a step, which all columns share."""

    clock: np.ndarray  # (1,) size of the step [s]
    # (n, 3) positions [m] and velocities [m/s] now, and at the begin of the step.
    x: np.ndarray
    old_x: np.ndarray
    v: np.ndarray
    old_v: np.ndarray
    ahead: np.ndarray  # (n, 3) the velocities that the forces see


@dataclass(frozen=True, eq=False)
class Column:
    """The part d of a term's force that the ledger has in columns, at both ends of a step."""

    # Of the term; whether it has a column of dissipation, and one of work.
    name: str
    dissipates: bool
    supplies: bool
    # Whether its columns are integrals of power; otherwise of force along a displacement.
    by_power: bool
    air: np.ndarray  # (3,) velocity of the air [m/s], against which it dissipates
    # (n, 3) the force without d; d now; d at the begin of the step.
    base: np.ndarray
    force: np.ndarray
    last: np.ndarray
    # (10,): ∫ d · v; d · v at the last stage; the means of d · Δx and d · dt v̄; ∫ Σ d and Σ d
    # at the last stage.
    sums: np.ndarray

    def at_force(self, f: np.ndarray, moves: Moves) -> Call:
        """The call after the term has added its force."""
        if not self.by_power:
            return subtract_from, (f, self.base, self.force)
        arrays = moves.clock, moves.x, moves.old_x, moves.ahead
        return add_power, (*arrays, f, self.base, self.last, self.sums)

    def at_end(self, moves: Moves) -> Calls:
        if self.by_power:
            return []
        arrays = moves.clock, moves.x, moves.old_x, moves.v, moves.old_v
        return [(add_work, (*arrays, self.force, self.last, self.sums))]

    def start(self) -> None:
        """Begin again, after the forces were evaluated at the begin of the first step."""
        self.sums[[POWER, PATH, WORK, 4, 5, 6]] = 0.0
        if not self.by_power:
            self.last[:] = self.force

    @property
    def dissipated(self) -> float:
        """∫ −d · (v − u) dt [J]."""
        return float(self.sums[4:7] @ self.air - self.sums[POWER])

    @property
    def work(self) -> float:
        """∫ d · u dt of the air, otherwise Σ d · dt v̄ [J]."""
        return float(self.sums[4:7] @ self.air if self.by_power else self.sums[WORK])

    @property
    def unrecorded(self) -> float:
        """See `numerical_dissipation`: mean of d · (Δx − dt v), or of d · (Δx − dt v̄)."""
        return float(self.sums[PATH] - self.sums[POWER if self.by_power else WORK])


def bind_columns(system: System, shape: tuple[int, int]) -> tuple[Column, ...] | None:
    """Return the columns of a system, or None where a term's are not known from its force."""
    columns = []
    for name, term in zip(system.names, system.bound, strict=True):
        by_power = has_power_column(term)
        supplies = term.supplies
        if not (by_power or has_work_column(term)):
            continue
        air = term.steady_air if by_power and supplies else np.zeros(3)
        if air is None:
            return None
        arrays = *np.zeros((3, *shape)), np.zeros(10)
        columns.append(Column(name, term.dissipative, supplies, by_power, air, *arrays))
    return tuple(columns)


@rounded_kernel
def subtract_from(f: Array, base: Array, difference: Array) -> None:
    """difference (n, 3) = f − base."""
    f = f.reshape(-1)
    base = base.reshape(-1)
    difference = difference.reshape(-1)
    for i in range(len(f)):
        difference[i] = f[i] - base[i]


@kernel
def add_power(
    clock: Array, x: Array, old: Array, v: Array, f: Array, base: Array, last: Array, sums: Array
) -> None:
    """Add the power of d = f − base in a step to the sums; last = d."""
    half = 0.5 * clock[0]
    power1 = 0.0
    power2 = 0.0
    power3 = 0.0
    path1 = 0.0
    path2 = 0.0
    path3 = 0.0
    d1, d2, d3 = 0.0, 0.0, 0.0
    for i in range(len(f)):
        a, b, c = f[i, 0] - base[i, 0], f[i, 1] - base[i, 1], f[i, 2] - base[i, 2]
        power1 += a * v[i, 0]
        power2 += b * v[i, 1]
        power3 += c * v[i, 2]
        path1 += (a + last[i, 0]) * (x[i, 0] - old[i, 0])
        path2 += (b + last[i, 1]) * (x[i, 1] - old[i, 1])
        path3 += (c + last[i, 2]) * (x[i, 2] - old[i, 2])
        d1 += a
        d2 += b
        d3 += c
        last[i, 0] = a
        last[i, 1] = b
        last[i, 2] = c
    power = power1 + power2 + power3
    sums[POWER] += half * (sums[LAST] + power)
    sums[LAST] = power
    sums[PATH] += 0.5 * (path1 + path2 + path3)
    for k, total in enumerate((d1, d2, d3)):
        sums[4 + k] += half * (sums[7 + k] + total)
        sums[7 + k] = total


@kernel
def add_work(
    clock: Array, x: Array, old_x: Array, v: Array, old_v: Array, d: Array, last: Array, sums: Array
) -> None:
    """Add the work of d in a step to the sums; last = d."""
    path = 0.0
    work = 0.0
    for i in range(len(d)):
        for k in range(3):
            both = d[i, k] + last[i, k]
            path += both * (x[i, k] - old_x[i, k])
            work += both * (v[i, k] + old_v[i, k])
            last[i, k] = d[i, k]
    sums[PATH] += 0.5 * path
    sums[WORK] += 0.25 * clock[0] * work


def force_calls(
    system: System, columns: tuple[Column, ...], moves: Moves, f: Array
) -> Calls | None:
    """The calls that add all forces to f, and the calls that take out the columns' parts."""
    calls: list[AnyCall] = []
    of_term = {column.name: column for column in columns}
    x = moves.x
    v = moves.ahead
    for name, term in zip(system.names, system.bound, strict=True):
        own = compiled_force(term, x, v, f)
        if own is None:
            return None
        column = of_term.get(name)
        if column is None:
            calls += own
            continue
        if term.has_energy:
            elastic = compiled_force(term, x, np.zeros_like(v), column.base)
        else:
            elastic = []
        calls += [(copy, (f, column.base)), *(elastic or []), *own, column.at_force(f, moves)]
    return calls


def compiled_force(term: Any, x: np.ndarray, v: np.ndarray, f: np.ndarray) -> Calls | None:
    """Return the calls of a term's force, or None where it needs Python."""
    # A class that overrides `add_force` alone has inherited the calls of another force.
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
    def divide(cls, calls: Calls, threads: int) -> Self:
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
