"""What each process does for its part of the cloth, when the first one asks."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fecloth.distributed.part_system import PartDescription
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.runs.environment import peak_memory
from fecloth.terms.step_difference import StepDifference

Rows = np.ndarray


class Worker:
    """The part of a process: its system, its rows of the matrix, and its share of the solver.

    Positions and velocities of a part hold its ghosts too; forces and other results are those of
    the nodes or triangles that it owns. `key` names a bound term: its number in the system, or
    what `over_step` was given.
    """

    def __init__(self, description: PartDescription):
        self.part, self.system = description.part, description.make()
        self.terms: dict[Any, Any] = dict(enumerate(self.system.bound))
        self.x = self.v = np.zeros((len(self.part.nodes), 3))
        self.solver: Any = None
        self._matrix: BlockMatrix | None = None
        cells = self.part.counted(self.system.cloth.triangles)
        self.own_cells = np.flatnonzero(cells)

    @property
    def matrix(self) -> BlockMatrix:
        """The part's matrix, of which the rows of its own nodes are those of the whole one."""
        if self._matrix is None:
            self._matrix = BlockMatrix.zeros(self.system.pattern)
        return self._matrix

    def place_x(self, x: np.ndarray) -> None:
        self.x = x

    def place_v(self, v: np.ndarray) -> None:
        self.v = v

    def names(self) -> list[str]:
        """The names of the terms."""
        return [term.name for term in self.system.bound]

    # --- forces and energies --------------------------------------------------------------------

    def force(self, keys: Sequence, t: float) -> Rows:
        """The sum of the forces of some terms."""
        f = np.zeros_like(self.x)
        for key in keys:
            self.terms[key].add_force(self.x, self.v, t, f)
        return f[self.part.own]

    def energy(self, key, t: float) -> float:
        return float(self.terms[key].energy(self.x, t))

    def power(self, key, t: float) -> float:
        return float(self.terms[key].power(self.x, self.v, t))

    def supply(self, key, t: float) -> float:
        return float(self.terms[key].supply(self.x, self.v, t))

    def dissipation(self, key) -> float:
        return float(self.terms[key].dissipation(self.x))

    def work_of_clamps(self, key, old, new, stages) -> float:
        return float(self.terms[key].work_of_clamps(old, new, stages))

    def stress(self, key) -> Rows:
        """What the term adds to the stress of frames, of the triangles that count here."""
        out = np.zeros((len(self.part.cells), 4))
        self.terms[key].add_stress(self.x, out)
        return out[self.own_cells]

    def strain_error(self, key, t: float) -> Rows:
        error: np.ndarray = self.terms[key].strain_error(self.x, t)
        return error[self.own_cells]

    def rate_bounds(self, key, mass: np.ndarray) -> tuple[float, float]:
        bounds: tuple[float, float] = self.terms[key].rate_bounds(mass)
        return bounds

    def reaction_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of the whole cloth, and their limits, of `ReactionLimits`."""
        limits = self.system.reaction_limits
        own = self.part.is_own[limits.nodes]
        return self.part.nodes[limits.nodes[own]], limits.most[own]

    def over_step(self, key, new, step: StepDifference) -> None:
        """Keep the term over a step by the key `new`."""
        self.terms[new] = self.terms[key].over_step(step)

    def forget(self, keys: Sequence) -> None:
        """Drop terms over earlier steps."""
        for key in keys:
            self.terms.pop(key, None)

    # --- the matrix -----------------------------------------------------------------------------

    def clear(self) -> None:
        self.matrix.values.fill(0.0)

    def add_mass(self, wa: float) -> None:
        self.system.add_tangents(self.matrix, self.system.rest(), wa=wa)

    def add_tangent(self, key, t: float, wx: float, wv: float, definite: bool) -> None:
        self.terms[key].add_tangent(self.x, self.v, t, wx, wv, self.matrix, definite)

    def project(self, diagonal: np.ndarray | None) -> None:
        """Add blocks (n, 3, 3) to the diagonal, and project the matrix onto free directions."""
        if diagonal is not None:
            self.matrix.values[self.matrix.pattern.diagonal] += diagonal
        self.system.project(self.matrix)

    # --- the linear solver ----------------------------------------------------------------------

    def create_solver(self, kind: str, symmetric: bool, owned: Sequence[int], numbers) -> None:
        """Make the part's share of the solver, or another one; see `PetscSolver`."""
        if self.solver is None:
            from fecloth.distributed.petsc_solver import PetscSolver

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
        found: tuple = self.solver.solve(b, rtol, guess)
        return found

    def usage(self) -> dict[str, float | int | None]:
        """What the process has used so far."""
        return {
            "nodes": int(self.part.is_own.sum()),
            "ghosts": int((~self.part.is_own).sum()),
            "peak_memory_MB": peak_memory(),
            "cpu_seconds": time.process_time(),
        }


def cut_step(step: StepDifference, nodes) -> StepDifference:
    """A step with the rows of some nodes."""
    past = tuple((weight, x[nodes]) for weight, x in step.past)
    return replace(step, start=step.start[nodes], past=past)
