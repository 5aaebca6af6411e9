"""What each process does for its part of the cloth, when the first one asks."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fecloth.distributed.partition import Part, PartDescription
from fecloth.distributed.petsc_solver import PetscSolver
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.runs.environment import peak_memory
from fecloth.terms.step_difference import StepDifference

Rows = np.ndarray


def total(parts: Sequence[Part], shares: Sequence[float]) -> float:
    """The sum over the parts."""
    return float(sum(shares))


def cells(parts: Sequence[Part], shares: Sequence[Any]) -> Any:
    """The array of all triangles of the cloth, from the rows that each part returned.

    A share has a row for each triangle that counts in its part. Shares may also be mappings or
    records (dataclasses) of such arrays, or None for all parts: the result is of the same kind.
    """
    first_share = shares[0]
    if isinstance(first_share, Mapping):
        return {name: cells(parts, [share[name] for share in shares]) for name in first_share}
    if first_share is None:
        return None
    if not isinstance(first_share, np.ndarray):
        record: Any = first_share
        return replace(record, **cells(parts, [vars(share) for share in shares]))
    out = np.zeros((sum(map(len, shares)), *first_share.shape[1:]))
    for part, own_rows in zip(parts, shares, strict=True):
        out[part.cells[part.counted(part.triangles)]] = own_rows
    return out


def rows(value: Any, which: np.ndarray) -> Any:
    """The rows `which` of an array with a row for each triangle.

    Of a mapping or a record, these rows of all its arrays.
    """
    if value is None:
        return None
    if isinstance(value, Mapping):
        return {name: rows(array, which) for name, array in value.items()}
    if isinstance(value, np.ndarray):
        return value[which]
    return replace(value, **rows(vars(value), which))


@dataclass(frozen=True)
class Ability:
    """How an ability of a bound term is asked of all processes.

    Attributes
    ----------
    gather
        Makes the whole of what the parts return.
    placed
        Number of its first arguments, x and v, that each process has by `Worker.place`.
    width
        Columns of the array of triangles to which it adds, its last argument; 0 if it returns
        its result.
    """

    gather: Callable[[Sequence[Part], Sequence], Any]
    placed: int = 1
    width: int = 0


ABILITIES = {
    "energy": Ability(total),
    "beyond": Ability(total),
    "power": Ability(total, placed=2),
    "supply": Ability(total, placed=2),
    "dissipation": Ability(total),
    "work_of_clamps": Ability(total, placed=0),
    "strain_error": Ability(cells),
    "cells": Ability(cells),
    "start_history": Ability(cells),
    "commit": Ability(cells),
    "add_stress": Ability(cells, width=4),
}


class Worker:
    """The part of a process: its system, its rows of the matrix, and its share of the solver.

    Positions and velocities hold ghosts too; results only what it owns. `key` names a bound
    term.
    """

    def __init__(self, description: PartDescription):
        self.part = description.part
        self.system = description.make()
        self.terms: dict[Any, Any] = dict(enumerate(self.system.bound))
        self.x = self.v = np.zeros((len(self.part.nodes), 3))
        self.solver: Any = None  # a `PetscSolver` from `create_solver` on
        self._matrix: BlockMatrix | None = None
        self.own_cells = np.flatnonzero(self.part.counted(self.system.cloth.triangles))

    @property
    def matrix(self) -> BlockMatrix:
        """The part's matrix; the rows of its own nodes are rows of the whole matrix."""
        if self._matrix is None:
            self._matrix = BlockMatrix.zeros(self.system.pattern)
        return self._matrix

    def place(self, name: str, y: np.ndarray) -> None:
        """Take positions ("x") or velocities ("v")."""
        setattr(self, name, y)

    def names(self) -> list[str]:
        """The names of the part's terms."""
        return [term.name for term in self.system.bound]

    def force(self, keys: Sequence, t: float) -> Rows:
        """The sum of the forces of some terms."""
        f = np.zeros_like(self.x)
        for key in keys:
            self.terms[key].add_force(self.x, self.v, t, f)
        return f[self.part.own]

    def ask(self, key, name: str, arguments: tuple) -> Any:
        """What the ability `name`, one of `ABILITIES`, of a term returns for the part.

        It takes the positions and velocities of the last `place`, and `arguments` after them. Rows
        of triangles are returned only for the triangles that count in this part.
        """
        ability = ABILITIES[name]
        function = getattr(self.terms[key], name)
        placed = (self.x, self.v)[: ability.placed]
        if ability.width:  # it adds to its last argument
            out = np.zeros((len(self.part.cells), ability.width))
            function(*placed, *arguments, out)
        else:
            out = function(*placed, *arguments)
        if ability.gather is cells:
            return rows(out, self.own_cells)
        return out

    def reaction_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of the whole cloth, and their limits, of `ReactionLimits`."""
        limits = self.system.reaction_limits
        own = self.part.is_own[limits.nodes]
        return self.part.nodes[limits.nodes[own]], limits.largest[own]

    def over_step(self, key, new, step: StepDifference) -> None:
        """Keep the term over a step by the key `new`."""
        self.terms[new] = self.terms[key].over_step(step)

    def with_history(self, key, new, record: Any) -> None:
        """Keep the term with its record by the key `new`."""
        self.terms[new] = self.terms[key].with_history(record)

    def forget(self, keys: Sequence) -> None:
        """Forget terms over a step, or with a record."""
        for key in keys:
            self.terms.pop(key, None)

    def clear(self) -> None:
        """Set the part's matrix to zero."""
        self.matrix.values.fill(0.0)

    def add_mass(self, wa: float) -> None:
        """Add wa M to the part's matrix."""
        self.system.add_tangents(self.matrix, self.system.rest(), wa=wa)

    def add_tangent(self, key, t: float, wx: float, wv: float, definite: bool) -> None:
        """Add the tangent of a term to the part's matrix."""
        self.terms[key].add_tangent(self.x, self.v, t, wx, wv, self.matrix, definite)

    def project(self, diagonal: np.ndarray | None) -> None:
        """Add blocks (n, 3, 3) to the diagonal, and project the matrix onto free directions."""
        if diagonal is not None:
            self.matrix.values[self.matrix.pattern.diagonal] += diagonal
        self.system.project(self.matrix)

    def create_solver(self, kind: str, symmetric: bool, owned: Sequence[int], numbers) -> None:
        """Make the part's share of the solver, or another one; see `PetscSolver`."""
        if self.solver is None:
            self.solver = PetscSolver(self.part, self.matrix, owned, numbers)
        self.solver.begin(kind, symmetric)

    def close(self) -> None:
        """Free the memory of the solver, on all processes alike."""
        if self.solver:
            self.solver.destroy()
            self.solver = None

    def prepare(self, shape: np.ndarray, anew: bool) -> float:
        """Hand the matrix to the solver; `shape` (own, 3) are positions for rigid motions."""
        seconds: float = self.solver.prepare(shape, anew)
        return seconds

    def solve(self, b: np.ndarray, rtol: float, guess: np.ndarray | None) -> tuple:
        """The solver's share of the solution; see `PetscSolver.solve`."""
        solution: tuple = self.solver.solve(b, rtol, guess)
        return solution

    def usage(self) -> dict[str, float | int | None]:
        """What summary.json says of the process."""
        return {
            "nodes": int(self.part.is_own.sum()),
            "ghosts": int((~self.part.is_own).sum()),
            "peak_memory_MB": peak_memory(),
            "cpu_seconds": time.process_time(),
        }
