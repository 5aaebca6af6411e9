"""A stage of an implicit step whose residual, tangent and potential are joined calls.

Python needs 10 to 50 µs to call a kernel, and a Newton iteration of 800 triangles calls thirty of
them within 2 ms. Here the kernels of all terms are joined into a few compiled functions without
arguments, which serve every step: what changes from step to step is in arrays. The bits are
those of the calls one by one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from fecloth.compiled.calls import AnyCall, JoinedCalls, Present, join, join_each
from fecloth.compiled.jit import Array, rounded_kernel
from fecloth.linalg.block_matrix import BlockMatrix, add_mass
from fecloth.nonlinear.stage import Stage
from fecloth.system.constraints import project_rows
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.loops.shared_loop import SUM_BLOCKS
from fecloth.terms.protocol import BoundTerm, calls_of


@dataclass(frozen=True, eq=False)
class StageArrays:
    """The arrays on which the joined calls of a stage work.

    Attributes
    ----------
    t
        (1,) time at which the forces balance [s].
    wx, wv, wa
        (1,) weights of the unknown in x, v and a, see `Stage`.
    mass_weight
        (1,) weight of M in the matrix.
    x0, v0, a0
        (n, 3) x, v and a for q = 0.
    q
        (n, 3) the unknown.
    x, v, a
        (n, 3) x, v and a for q.
    f, R
        (n, 3) the forces and the residual [N].
    own_forces
        (terms, n, 3) the force of each term [N].
    energies
        (terms, SUM_BLOCKS) parts of the energy of each term [J].
    """

    t: np.ndarray
    wx: np.ndarray
    wv: np.ndarray
    wa: np.ndarray
    mass_weight: np.ndarray
    x0: np.ndarray
    v0: np.ndarray
    a0: np.ndarray
    q: np.ndarray
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    f: np.ndarray
    R: np.ndarray
    own_forces: np.ndarray
    energies: np.ndarray

    @classmethod
    def of(cls, nodes: int, terms: int) -> Self:
        """Arrays for a number of nodes and of terms."""
        numbers = {name: np.zeros(1) for name in ("t", "wx", "wv", "wa", "mass_weight")}
        names = ("x0", "v0", "a0", "q", "x", "v", "a", "f", "R")
        fields = {name: np.zeros((nodes, 3)) for name in names}
        own_forces = np.zeros((terms, nodes, 3))
        return cls(
            **numbers, **fields, own_forces=own_forces, energies=np.zeros((terms, SUM_BLOCKS))
        )

    def place_call(self) -> AnyCall:
        """The call that sets x, v and a for q."""
        weights = Present(self.wx), Present(self.wv), Present(self.wa)
        return place, (*weights, self.x0, self.v0, self.a0, self.q, self.x, self.v, self.a)


@dataclass(eq=False)
class JoinedStage:
    """The joined calls of the stages of a run, for a system whose terms have compiled kernels.

    Attributes
    ----------
    source
        The system for which the calls were made.
    terms
        Its terms; a term over a step is a copy with arrays of its own.
    matrix
        The matrix that `assemble` fills.
    arrays
        What the calls work on.
    """

    source: System
    terms: tuple[BoundTerm, ...]
    matrix: BlockMatrix
    arrays: StageArrays
    _joined: dict[str, JoinedCalls] = field(default_factory=dict)
    _placed: np.ndarray | None = None  # the q of the present x, v and a
    _has_forces: bool = False  # whether f are the forces there

    @classmethod
    def of(cls, system: System, matrix: BlockMatrix) -> Self | None:
        """Join the calls of a system; None if a term needs Python, or if threads may share it."""
        if not system.is_whole or system.team.shares(len(system.cloth.triangles)):
            return None
        terms = tuple(_own_copy(term) for term in system.bound)
        arrays = StageArrays.of(len(system.cloth.X), len(terms))
        stage = cls(system, terms, matrix, arrays)
        needed = {
            "residual": stage._residual_calls(),
            "own forces": stage._calls_of_own_forces(),
            "tangent": stage._tangent_calls(definite=False),
        }
        lists = {name: calls for name, calls in needed.items() if calls is not None}
        if len(lists) < len(needed):
            return None
        energies = stage._energy_calls()
        if energies is not None:
            lists["energies"] = energies
        stage._joined.update(join_each({"place": [arrays.place_call()], **lists}))
        return stage

    def serves(self, system: System, matrix: BlockMatrix) -> bool:
        """Whether the calls serve another system, such as the same one over another step."""
        if system.constraints is not self.source.constraints or matrix is not self.matrix:
            return False
        pairs = zip(self.source.bound, system.bound, strict=True)
        return all(old is new or _differ_in_arrays(old, new) for old, new in pairs)

    def begin(self, system: System, stage: Stage) -> None:
        """Take the stage of a step, of the system over that step."""
        arrays = self.arrays
        arrays.t[0] = stage.t
        arrays.wx[0] = stage.wx
        arrays.wv[0] = stage.wv
        arrays.wa[0] = stage.wa
        arrays.x0[...] = stage.x
        arrays.v0[...] = stage.v
        arrays.a0[...] = stage.a
        for own, term in zip(self.terms, system.bound, strict=True):
            for array, new in zip(own.step_arrays, term.step_arrays, strict=True):
                array[...] = new
        self._placed = None
        self._has_forces = False

    # --- evaluation ---------------------------------------------------------------------------

    def residual(self, q: np.ndarray) -> np.ndarray:
        """R = M a − f (n, 3) of the free directions [N]."""
        self._place(q)
        self._joined["residual"]()
        self._has_forces = True
        return self.arrays.R.copy()

    def force_at(self, state: State) -> np.ndarray | None:
        """The forces (n, 3) [N] of a state if they were evaluated there last, else None."""
        arrays = self.arrays
        is_there = (
            self._has_forces
            and state.t == arrays.t[0]
            and np.array_equal(state.x, arrays.x)
            and np.array_equal(state.v, arrays.v)
        )
        return arrays.f.copy() if is_there else None

    def first_residual(self, q: np.ndarray) -> tuple[np.ndarray, float]:
        """R (n, 3), and ‖M a‖ + Σ ‖f_term‖ with reactions [N]."""
        self._place(q)
        self._joined["own forces"]()
        system = self.source
        inertia = system.scalar_mass @ self.arrays.a
        R = inertia.copy()
        scale = system.force_size(inertia)
        for f in self.arrays.own_forces:
            R -= f
            scale += system.force_size(f)
        return system.constraints.project(R), scale

    def assemble(self, q: np.ndarray, mass_weight: float, definite: bool) -> None:
        """Fill the matrix with `mass_weight` M + wv D + wx K, projected."""
        name = "definite tangent" if definite else "tangent"
        if name not in self._joined:  # few runs need it
            self._joined[name] = join(self._tangent_calls(definite) or [])
        self._place(q)
        self.arrays.mass_weight[0] = mass_weight
        self._joined[name]()

    @property
    def has_energies(self) -> bool:
        """Whether the energies of all terms with an energy are joined calls."""
        return "energies" in self._joined

    def energy(self, q: np.ndarray) -> float:
        """The sum of the energies of the terms [J]; see `has_energies`."""
        self._place(q)
        self.arrays.energies.fill(0.0)
        self._joined["energies"]()
        parts = self.arrays.energies.tolist()
        return sum(
            float(sum(sums))
            for term, sums in zip(self.terms, parts, strict=True)
            if term.has_energy
        )

    def _place(self, q: np.ndarray) -> None:
        """Set x, v and a for q, an array that does not change any more."""
        if self._placed is not q:
            self.arrays.q[...] = q
            self._joined["place"]()
            self._placed = q
            self._has_forces = False

    # --- joining ------------------------------------------------------------------------------

    def _residual_calls(self) -> list[AnyCall] | None:
        """The calls that fill R; None if a term needs Python."""
        arrays = self.arrays
        of_terms = self._calls("add_force", "force_calls", lambda of, k: of(*self._at, arrays.f))
        if of_terms is None:
            return None
        mass = self.source.scalar_mass
        constraints = self.source.constraints
        return [
            (clear_rows, (arrays.f,)),
            *of_terms,
            (balance, (mass.indptr, mass.indices, mass.data, arrays.a, arrays.f, arrays.R)),
            (project_rows, (constraints.nodes, constraints.projectors, arrays.R)),
        ]

    def _calls_of_own_forces(self) -> list[AnyCall] | None:
        """The calls that fill the forces of each term; None if a term needs Python."""
        own_forces = self.arrays.own_forces
        of_terms = self._calls(
            "add_force", "force_calls", lambda of, k: of(*self._at, own_forces[k])
        )
        if of_terms is None:
            return None
        return [*((clear_rows, (f,)) for f in own_forces), *of_terms]

    def _tangent_calls(self, definite: bool) -> list[AnyCall] | None:
        """The calls that fill the matrix; None if a term needs Python."""
        arrays = self.arrays
        matrix = self.matrix
        weights = Present(arrays.wx), Present(arrays.wv)
        x, v, t = self._at
        of_terms = self._calls(
            "add_tangent", "tangent_calls", lambda of, k: of(x, v, t, *weights, matrix, definite)
        )
        if of_terms is None:
            return None
        system = self.source
        of_mass = system.mass_slots, system.scalar_mass.data, Present(arrays.mass_weight)
        return [
            (clear_blocks, (matrix.values,)),
            (add_mass, (*of_mass, matrix.values)),
            *of_terms,
            system.projection.call(matrix),
        ]

    def _energy_calls(self) -> list[AnyCall] | None:
        """The calls that fill the parts of the energies; None if a term needs Python."""
        energies = self.arrays.energies
        x, _, t = self._at
        return self._calls(
            "energy",
            "energy_calls",
            lambda of, k: of(x, t, energies[k]) if self.terms[k].has_energy else [],
        )

    @property
    def _at(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, v and t of the stage."""
        return self.arrays.x, self.arrays.v, self.arrays.t

    def _calls(
        self, function: str, calls: str, make: Callable[[Any, int], Sequence[AnyCall] | None]
    ) -> list[AnyCall] | None:
        """The calls of all terms in order; None if a term needs Python for its `function`.

        ``make(of, k)`` calls the function `of` of term k, whose name is `calls`.
        """
        all_calls: list[AnyCall] = []
        for k, term in enumerate(self.terms):
            of = calls_of(term, function, calls)
            of_term = None if of is None else make(of, k)
            if of_term is None:
                return None
            all_calls += of_term
        return all_calls


@dataclass(eq=False)
class LastStage:
    """The joined calls of the last stage, which serve the next steps of a run too.

    Attributes
    ----------
    joined
        The calls; None where a term has no such calls.
    refused
        The classes of the terms then.
    """

    joined: JoinedStage | None = None
    refused: tuple[type, ...] = ()

    def join(self, system: System, stage: Stage, matrix: BlockMatrix) -> JoinedStage | None:
        """The joined calls of a stage of a step, if its terms have such calls."""
        if self.joined is None or not self.joined.serves(system, matrix):
            classes = tuple(type(term) for term in system.bound)
            self.joined = None if classes == self.refused else JoinedStage.of(system, matrix)
            if self.joined is None:
                self.refused = classes
                return None
        self.joined.begin(system, stage)
        return self.joined


def _own_copy(term: Any) -> Any:
    """A copy of a term over a step, with arrays of its own; any other term itself."""
    return replace(term) if term.step_arrays else term


def _differ_in_arrays(old: BoundTerm, new: BoundTerm) -> bool:
    """Whether two terms over steps differ in nothing but their `step_arrays`."""
    if type(old) is not type(new):
        return False
    pairs = list(zip(old.step_arrays, new.step_arrays, strict=False))
    return bool(pairs) and all(a.shape == b.shape and a.dtype == b.dtype for a, b in pairs)


@rounded_kernel
def place(
    wx: float,
    wv: float,
    wa: float,
    x0: Array,
    v0: Array,
    a0: Array,
    q: Array,
    x: Array,
    v: Array,
    a: Array,
) -> None:
    """x = x0 + wx q, v = v0 + wv q and a = a0 + wa q of arrays (n, 3)."""
    for i in range(len(q)):
        for k in range(3):
            x[i, k] = x0[i, k] + wx * q[i, k]
            v[i, k] = v0[i, k] + wv * q[i, k]
            a[i, k] = a0[i, k] + wa * q[i, k]


@rounded_kernel
def clear_rows(f: Array) -> None:
    """f (n, 3) = 0."""
    for i in range(len(f)):
        for k in range(3):
            f[i, k] = 0.0


@rounded_kernel
def clear_blocks(values: Array) -> None:
    """values (b, 3, 3) = 0."""
    entries = values.reshape(-1)
    for i in range(len(entries)):
        entries[i] = 0.0


@rounded_kernel
def balance(indptr: Array, indices: Array, mass: Array, a: Array, f: Array, R: Array) -> None:
    """R (n, 3) = M a − f, with M (n, n) by compressed rows of one component."""
    for i in range(len(R)):
        y1, y2, y3 = 0.0, 0.0, 0.0
        for s in range(indptr[i], indptr[i + 1]):
            m = mass[s]
            j = indices[s]
            y1 += m * a[j, 0]
            y2 += m * a[j, 1]
            y3 += m * a[j, 2]
        R[i, 0] = y1 - f[i, 0]
        R[i, 1] = y2 - f[i, 1]
        R[i, 2] = y3 - f[i, 2]
