"""A stage of an implicit step whose residual, tangent and potential are joined calls.

Python needs 10 to 50 µs to call a kernel, and a Newton iteration of 800 triangles calls thirty of
them within 2 ms. Here the kernels of all terms are joined into a few compiled functions without
arguments, which serve every step: what changes from step to step is in arrays. The bits are
those of the calls one by one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from fecloth.compiled.calls import AnyCall, JoinedCalls, Present, join_each
from fecloth.linalg.block_matrix import BlockMatrix, add_mass
from fecloth.nonlinear.stage import Stage
from fecloth.nonlinear.stage_arrays import (
    StageArrays,
    balance,
    copy_blocks,
)
from fecloth.system.constraints import project_rows
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.loops.array_updates import clear
from fecloth.terms.protocol import BoundTerm, calls_of


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
    kept
        The matrix of the tangents that several iterations share; None without such tangents.
    arrays
        What the calls work on.
    """

    source: System
    terms: tuple[BoundTerm, ...]
    matrix: BlockMatrix
    kept: BlockMatrix | None
    arrays: StageArrays
    _joined: dict[str, JoinedCalls] = field(default_factory=dict)
    _placed: np.ndarray | None = None  # the q of the present x, v and a
    _has_forces: bool = False  # whether f are the forces there
    _may_join_definite: bool = True  # until it was tried

    @classmethod
    def of(cls, system: System, matrix: BlockMatrix, kept: BlockMatrix | None) -> Self | None:
        """Join the calls of a system; None if a term needs Python, or if threads may share it.

        A subclass of `System` with a `force` of its own needs Python, too.
        """
        has_own_force = type(system).force is not System.force
        is_shared = system.team.shares(len(system.cloth.triangles))
        if has_own_force or is_shared or not system.is_whole:
            return None
        terms = tuple(_own_copy(term) for term in system.bound)
        arrays = StageArrays.of(len(system.cloth.X), len(terms))
        stage = cls(system, terms, matrix, kept, arrays)
        lists = _complete(
            {
                "residual": stage._residual_calls(),
                "own forces": stage._calls_of_own_forces(),
                **stage._tangent_lists(definite=False),
            }
        )
        if lists is None:
            return None
        energies = stage._energy_calls()
        if energies is not None:
            lists["energies"] = energies
        stage._joined.update(join_each({"place": [arrays.place_call()], **lists}))
        return stage

    def serves(self, system: System, matrix: BlockMatrix, kept: BlockMatrix | None) -> bool:
        """Whether the calls serve another system, such as the same one over another step."""
        has_matrices = matrix is self.matrix and kept is self.kept
        if system.constraints is not self.source.constraints or not has_matrices:
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
        return system.constraints.reduce(R), scale

    def can_assemble(self, definite: bool) -> bool:
        """Whether the tangents, or definite ones, of all terms are joined calls."""
        if definite and self._may_join_definite:  # few runs need them
            self._may_join_definite = False
            lists = _complete(self._tangent_lists(definite))
            if lists is not None:
                self._joined.update(join_each(lists))
        return f"{_kind(definite)} tangent" in self._joined

    def assemble(self, q: np.ndarray, mass_weight: float, definite: bool, renew: bool) -> None:
        """Fill the matrix with `mass_weight` M + wv D + wx K, projected; see `can_assemble`.

        With `renew` the tangents that several iterations share are evaluated anew, too.
        """
        kind = _kind(definite)
        self._place(q)
        self.arrays.mass_weight[0] = mass_weight
        if renew:
            self._joined[f"{kind} kept tangent"]()
        self._joined[f"{kind} tangent"]()

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
            (clear, (arrays.f.reshape(-1),)),
            *of_terms,
            *constraints.followers.gather_calls(arrays.f),
            (balance, (mass.indptr, mass.indices, mass.data, arrays.a, arrays.f, arrays.R)),
            (project_rows, (*constraints.without_own, arrays.R)),
        ]

    def _calls_of_own_forces(self) -> list[AnyCall] | None:
        """The calls that fill the forces of each term; None if a term needs Python."""
        own_forces = self.arrays.own_forces
        of_terms = self._calls(
            "add_force", "force_calls", lambda of, k: of(*self._at, own_forces[k])
        )
        if of_terms is None:
            return None
        return [*((clear, (f.reshape(-1),)) for f in own_forces), *of_terms]

    def _tangent_lists(self, definite: bool) -> dict[str, list[AnyCall] | None]:
        """The calls that fill both matrices, by their names; None if a term needs Python."""
        system = self.source
        values = self.matrix.values
        of_mass = system.mass_slots, system.scalar_mass.data, Present(self.arrays.mass_weight)
        kind = _kind(definite)
        lists: dict[str, list[AnyCall] | None] = {}
        begin: list[AnyCall] = [(clear, (values.reshape(-1),))]
        if self.kept is not None:
            slow = self._calls_of_tangents(definite, self.kept, kept=True)
            begin = [(copy_blocks, (self.kept.values, values))]
            kept_numbers = self.kept.values.reshape(-1)
            lists[f"{kind} kept tangent"] = (
                None if slow is None else [(clear, (kept_numbers,)), *slow]
            )
        fast = self._calls_of_tangents(definite, self.matrix, kept=False)
        lists[f"{kind} tangent"] = None
        if fast is not None:
            of_matrix = (add_mass, (*of_mass, values)), *fast, system.projection.call(self.matrix)
            lists[f"{kind} tangent"] = [*begin, *of_matrix]
        return lists

    def _calls_of_tangents(
        self, definite: bool, J: BlockMatrix, kept: bool
    ) -> list[AnyCall] | None:
        """The calls that add to J the tangents that iterations share, or all others."""
        weights = Present(self.arrays.wx), Present(self.arrays.wv)
        x, v, t = self._at

        def make(of: Any, k: int) -> Sequence[AnyCall] | None:
            if self.terms[k].keeps_tangent != kept:
                return []
            calls: Sequence[AnyCall] | None = of(x, v, t, *weights, J, definite)
            return calls

        return self._calls("add_tangent", "tangent_calls", make)

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


Lists = dict[str, list[AnyCall]]


def _complete(lists: Mapping[str, list[AnyCall] | None]) -> Lists | None:
    """The lists of calls; None if one of them is missing."""
    complete = {name: calls for name, calls in lists.items() if calls is not None}
    return complete if len(complete) == len(lists) else None


def _kind(definite: bool) -> str:
    return "definite" if definite else "exact"


def _own_copy(term: Any) -> Any:
    """A copy of a term over a step, with arrays of its own; any other term itself."""
    return replace(term) if term.step_arrays else term


def _differ_in_arrays(old: BoundTerm, new: BoundTerm) -> bool:
    """Whether two terms over steps differ in nothing but their `step_arrays`."""
    if type(old) is not type(new):
        return False
    pairs = list(zip(old.step_arrays, new.step_arrays, strict=False))
    return bool(pairs) and all(a.shape == b.shape and a.dtype == b.dtype for a, b in pairs)
