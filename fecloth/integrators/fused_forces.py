"""The compiled calls of fused steps: all forces, and their columns in the energy ledger."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from fecloth.compiled.calls import AnyCall, Call, Calls, JoinedCalls, SharedCall, join
from fecloth.compiled.jit import Array, kernel, rounded_kernel
from fecloth.compiled.threads import Member, members, wait
from fecloth.integrators.fused_loops import copy
from fecloth.integrators.numerical_dissipation import has_power_column, has_work_column
from fecloth.system.system import System
from fecloth.terms.loops.array_updates import BY_ROWS
from fecloth.terms.protocol import calls_of


@dataclass(frozen=True, eq=False)
class Moves:
    """The arrays of a step, which all columns share.

    Attributes
    ----------
    size, t
        (1,) size of the step, and the time at which the forces are evaluated [s].
    x, old_x
        (n, 3) positions now, and at the begin of the step [m].
    v, old_v
        (n, 3) velocities now, and at the begin of the step [m/s].
    ahead
        (n, 3) velocities that the forces see [m/s].
    """

    size: np.ndarray
    t: np.ndarray
    x: np.ndarray
    old_x: np.ndarray
    v: np.ndarray
    old_v: np.ndarray
    ahead: np.ndarray


class Sums(NamedTuple):
    """What a column adds up over steps, as arrays in which kernels write.

    Attributes
    ----------
    power, last_power
        (1,) ∫ d · v dt [J], and d · v at the last stage [W].
    path
        (1,) sum of d · Δx, with the mean d of each step [J].
    work
        (1,) sum of d · dt v̄, with the mean d of each step [J].
    impulse, last_total
        (3,) ∫ Σ d dt [N s], and Σ d at the last stage [N]; Σ is the sum over the nodes.
    supplied, last_supplied
        (1,) work of air without one steady velocity [J], and its power at the last stage [W].
    """

    power: np.ndarray
    last_power: np.ndarray
    path: np.ndarray
    work: np.ndarray
    impulse: np.ndarray
    last_total: np.ndarray
    supplied: np.ndarray
    last_supplied: np.ndarray

    @classmethod
    def zero(cls) -> Self:
        """Sums over no step."""
        return cls(
            power=np.zeros(1),
            last_power=np.zeros(1),
            path=np.zeros(1),
            work=np.zeros(1),
            impulse=np.zeros(3),
            last_total=np.zeros(3),
            supplied=np.zeros(1),
            last_supplied=np.zeros(1),
        )


@dataclass(frozen=True, eq=False)
class Column:
    """The part d of a term's force that the ledger has in columns, at both ends of a step.

    Attributes
    ----------
    name
        Name of the term.
    dissipates, supplies
        Whether the term has a column of dissipation, and one of work.
    by_power
        Whether its columns are integrals of power; otherwise of force along a displacement.
    air
        (3,) velocity u of the air [m/s], against which the term dissipates. It is 0 for air
        without one steady velocity.
    supply
        (1,) power of such air now [W].
    base
        (n, 3) the force without d [N].
    force, last
        (n, 3) d now, and at the begin of the step [N].
    sums
        What the steps so far have added up.
    """

    name: str
    dissipates: bool
    supplies: bool
    by_power: bool
    air: np.ndarray
    supply: np.ndarray
    base: np.ndarray
    force: np.ndarray
    last: np.ndarray
    sums: Sums

    def at_force(self, f: np.ndarray, moves: Moves) -> Call:
        """Return the call that follows the term's own calls, when f contains its force.

        A column by power is added up here; for others d is stored, and `at_end` adds it up,
        because their work needs the velocity at the end of the step.
        """
        if not self.by_power:
            return subtract_from, (f, self.base, self.force)
        arguments = (
            moves.size,
            moves.x,
            moves.old_x,
            moves.ahead,
            f,
            self.base,
            self.last,
            self.supply,
            self.sums,
        )
        return add_power, arguments

    def at_end(self, moves: Moves) -> Calls:
        """Return the calls at the end of a step: none for a column by power, see `at_force`."""
        if self.by_power:
            return []
        arguments = (
            moves.size,
            moves.x,
            moves.old_x,
            moves.v,
            moves.old_v,
            self.force,
            self.last,
            self.sums,
        )
        return [(add_work, arguments)]

    def start(self) -> None:
        """Begin again, after the forces were evaluated at the begin of the first step."""
        sums = self.sums
        for total in (sums.power, sums.path, sums.work, sums.impulse, sums.supplied):
            total[:] = 0.0
        if not self.by_power:
            self.last[:] = self.force

    @property
    def dissipated(self) -> float:
        """∫ −d · (v − u) dt [J]."""
        return self._work_of_air - float(self.sums.power[0])

    @property
    def work(self) -> float:
        """∫ d · u dt of the air, otherwise Σ d · dt v̄ [J]."""
        if self.by_power:
            return self._work_of_air
        return float(self.sums.work[0])

    @property
    def _work_of_air(self) -> float:
        return float(self.sums.impulse @ self.air + self.sums.supplied[0])

    @property
    def unrecorded(self) -> float:
        """See `numerical_dissipation`: sum of d · (Δx − dt v), or of d · (Δx − dt v̄) [J]."""
        recorded = self.sums.power if self.by_power else self.sums.work
        return float(self.sums.path[0] - recorded[0])


def bind_columns(system: System, shape: tuple[int, int]) -> tuple[Column, ...] | None:
    """Return the columns of a system's terms; terms without columns are left out.

    None if a term has columns that need Python: if it has an energy, as a tether, and moves.
    `shape` is (n, 3).
    """
    columns = []
    for name, term in zip(system.names, system.bound, strict=True):
        by_power = has_power_column(term)
        if not (by_power or has_work_column(term)):
            continue
        if term.has_energy and term.supplies:
            return None
        steady = term.steady_air if by_power and term.supplies else None
        column = Column(
            name=name,
            dissipates=term.dissipative,
            supplies=term.supplies,
            by_power=by_power,
            air=np.zeros(3) if steady is None else steady,
            supply=np.zeros(1),
            base=np.zeros(shape),
            force=np.zeros(shape),
            last=np.zeros(shape),
            sums=Sums.zero(),
        )
        columns.append(column)
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
    size: Array,
    x: Array,
    old: Array,
    v: Array,
    f: Array,
    base: Array,
    last: Array,
    supply: Array,
    sums: Sums,
) -> None:
    """Add a step's integrals of d = f − base to the sums; last = d.

    They are by the trapezoidal rule. `size` (1,) is the size dt of the step, `x` and `old`
    (n, 3) are the positions at its end and its begin, and v are the velocities that the force
    has seen. `supply` (1,) is the power of unsteady air.
    """
    half = 0.5 * size[0]
    sums.supplied[0] += half * (sums.last_supplied[0] + supply[0])
    sums.last_supplied[0] = supply[0]
    # a sum for each component: they do not wait for one another
    power1 = 0.0
    power2 = 0.0
    power3 = 0.0
    path1 = 0.0
    path2 = 0.0
    path3 = 0.0
    d1 = 0.0
    d2 = 0.0
    d3 = 0.0
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
    sums.power[0] += half * (sums.last_power[0] + power)
    sums.last_power[0] = power
    sums.path[0] += 0.5 * (path1 + path2 + path3)
    for k, total in enumerate((d1, d2, d3)):
        sums.impulse[k] += half * (sums.last_total[k] + total)
        sums.last_total[k] = total


@kernel
def add_work(
    size: Array, x: Array, old_x: Array, v: Array, old_v: Array, d: Array, last: Array, sums: Sums
) -> None:
    """Add the work of d (n, 3) in a step to the sums; last = d.

    The parameters are as in `add_power`; v and `old_v` are the velocities at the end and at the
    begin of the step. ``work`` is ¼ dt Σ (d + last) · (v + old_v) = Σ d̄ · dt v̄.
    """
    path = 0.0
    work = 0.0
    for i in range(len(d)):
        for k in range(3):
            twice_mean = d[i, k] + last[i, k]
            path += twice_mean * (x[i, k] - old_x[i, k])
            work += twice_mean * (v[i, k] + old_v[i, k])
            last[i, k] = d[i, k]
    sums.path[0] += 0.5 * path
    sums.work[0] += 0.25 * size[0] * work


def force_calls(
    system: System, columns: tuple[Column, ...], moves: Moves, f: Array
) -> Calls | None:
    """Return the calls that add all forces to f (n, 3), with the calls of the columns in between.

    The result is None if a force needs Python. Before a term with a column adds its force, the
    sum of f and of the term's elastic force is kept as the column's `base`. So f − base is the
    part d afterwards.
    """
    calls: list[AnyCall] = []
    columns_by_name = {column.name: column for column in columns}
    x = moves.x
    v = moves.ahead
    for name, term in zip(system.names, system.bound, strict=True):
        calls_of_force = compiled_force(term, x, v, moves.t, f)
        if calls_of_force is None:
            return None
        column = columns_by_name.get(name)
        if column is None:
            calls += calls_of_force
            continue
        calls.append((copy, (f, column.base)))
        if term.has_energy:  # at v = 0 its force is the elastic force alone
            calls += compiled_force(term, x, np.zeros_like(v), moves.t, column.base) or []
        calls += calls_of_force
        if column.by_power and column.supplies and term.steady_air is None:
            calls_of_supply = term.supply_calls(x, v, moves.t, column.supply)
            if calls_of_supply is None:
                return None
            calls += calls_of_supply
        calls.append(column.at_force(f, moves))
    return calls


def compiled_force(term: Any, x: Array, v: Array, t: Array, f: Array) -> Calls | None:
    """Return the calls of a term's force, or None where it needs Python.

    The arguments are as for `BoundTerm.force_calls`.
    """
    its_calls = calls_of(term, "add_force", "force_calls")
    if its_calls is None:
        return None
    return its_calls(x, v, t, f)


@dataclass(frozen=True, eq=False)
class SharedForces:
    """Forces for several threads, which wait for each other after each call.

    Attributes
    ----------
    calls
        The calls of each thread, joined.
    members
        The threads.
    """

    calls: tuple[JoinedCalls, ...]
    members: list[Member]

    @classmethod
    def divide(cls, calls: Calls, threads: int) -> Self:
        """Divide calls among threads; what cannot be divided is for the first thread."""
        all_members = members(threads)
        calls_of_threads: list[list[AnyCall]] = [[] for _ in all_members]
        for shared in calls:
            for own, member in zip(calls_of_threads, all_members, strict=True):
                own += [*_part_of_call(shared, member.thread, threads), (wait, (member,))]
        return cls(tuple(map(join, calls_of_threads)), all_members)

    def start(self) -> None:
        """Let the threads meet for the first time again."""
        self.members[0].meeting[0] = 0
        for member in self.members:
            member.round_[0] = 1


def _part_of_call(call: AnyCall, p: int, threads: int) -> Calls:
    """Return the calls that thread p makes in place of one call for all nodes.

    It gets its own part of a call that can be divided. The first thread, p = 0, makes a call
    that cannot be divided, and the others make none.
    """
    if isinstance(call, SharedCall):
        return call.of_thread(p)
    function, arguments = call[:2]
    if function in BY_ROWS or function in (copy, subtract_from):
        rows = (_rows_of(value, p, threads) for value in arguments)
        return [(function, tuple(rows))]
    if p == 0:
        return [call]
    return []


def _rows_of(value: object, p: int, threads: int) -> object:
    """The rows of an array that thread p works on; what is no array stays as it is."""
    if not isinstance(value, np.ndarray):
        return value
    return value[len(value) * p // threads : len(value) * (p + 1) // threads]
