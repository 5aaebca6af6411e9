"""The `System` of a whole cloth whose terms and matrix are shared among processes."""

from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sparse

from fecloth import terms as named
from fecloth.distributed import partition
from fecloth.distributed.crew import Crew, Link, RemoteTerm
from fecloth.distributed.distributed_solver import KINDS, DistributedSolver
from fecloth.errors import InputError, brief
from fecloth.linalg.block_matrix import BlockMatrix, MatrixLayout
from fecloth.linalg.protocol import LinearSolver
from fecloth.mesh.cloth import Cloth
from fecloth.system.reaction_limits import ReactionLimits
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms import protocol
from fecloth.terms.springs.springs import KnownSprings
from fecloth.terms.traits import TermTraits, parameters_of, traits_of


class DistributedSystem(System):
    """A `System` in the first of several processes, which drives the others.

    It has the whole mesh and state; the terms with elements, the matrix and the linear solver are
    in parts on all processes. What acts on single nodes, such as gravity, stays here. To all else
    it is a `System`: methods, ledger and files know nothing of the parts.
    """

    is_whole: ClassVar[bool] = False
    link: ClassVar[Link]  # of each its own, no field

    def __init__(self, *arguments, link: Link, threads="auto", **options):
        object.__setattr__(self, "link", link)
        super().__init__(*arguments, threads=1 if threads == "auto" else threads, **options)

    @cached_property
    def parts(self) -> list[partition.Part]:
        _refuse(self.terms)
        rings = max((traits_of(term).reach for term in self.terms), default=TermTraits.reach)
        size = self.link.size
        owner = partition.find_owners(self.cloth, size)
        return [partition.make_part(self.cloth, owner, rank, rings) for rank in range(size)]

    @cached_property
    def _is_shared(self) -> list[bool]:
        """Whether each term couples nodes, so that its loops are shared."""
        part = self.parts[0].cloth()
        return [_couples(term, part, self.cloth) for term in self.terms]

    @cached_property
    def layout(self) -> MatrixLayout:
        """Of the terms on single nodes: the diagonal."""
        pairs = zip(self.terms, self._is_shared, strict=True)
        single = [protocol.stencil(term, self.cloth) for term, is_shared in pairs if not is_shared]
        return MatrixLayout(len(self.cloth.X), tuple(s for s in single if s is not None))

    @cached_property
    def crew(self) -> Crew:
        start = self.rest() if self.start is None else self.start
        pairs = zip(self.terms, self._is_shared, strict=True)
        shared = [self._known(term) for term, is_shared in pairs if is_shared]
        descriptions = []
        for part in self.parts:
            there = State(start.t, start.x[part.nodes], start.v[part.nodes])
            pins = partition.cut_pins(part, self.constraints.groups)
            own_terms = [
                partition.cut_springs(part, term) if isinstance(term, KnownSprings) else term
                for term in shared
            ]
            own = self.fabric, own_terms, pins, self.mass_kind, self.grain, there
            descriptions.append(partition.PartDescription(part, *own))
        return Crew.begin(self.link, descriptions)

    def _known(self, term):
        """The term, or its springs where a part does not know their stiffness."""
        is_net = isinstance(term, named.Springs) and term.kind == "structural"
        return term.springs(self.panel) if is_net else term

    @cached_property
    def bound(self) -> tuple:
        """The terms: terms on single nodes are bound here, the others on all processes."""
        shared = iter(self.crew.here.terms.items())
        return tuple(
            RemoteTerm(self.crew, *next(shared))
            if is_shared
            else protocol.bound(term, self.panel, self.layout.slots)
            for term, is_shared in zip(self.terms, self._is_shared, strict=True)
        )

    @cached_property
    def reaction_limits(self) -> ReactionLimits:
        """For `force_size`; each process knows the forces of its nodes."""
        nodes, most = zip(*self.crew.call("reaction_limits"), strict=True)
        return ReactionLimits(np.concatenate(nodes), np.concatenate(most))

    def force(self, state: State) -> np.ndarray:
        """(n, 3) sum of all terms' forces [N]; shared terms take one call."""
        f = np.zeros_like(state.x)
        keys = tuple(term.key for term in self.bound if isinstance(term, RemoteTerm))
        if keys:
            self.crew.place(state.x, state.v)
            self.crew.gather(self.crew.call("force", keys, state.t), f)
        for term in self.bound:
            if not isinstance(term, RemoteTerm):
                term.add_force(state.x, state.v, state.t, f)
        return f

    def assemble(
        self, J: BlockMatrix, state: State, wx=0.0, wv=0.0, wa=0.0, definite=False
    ) -> BlockMatrix:
        """The matrix on all processes; J is its part on single nodes."""
        self.crew.call("clear")
        return super().assemble(J, state, wx, wv, wa, definite)

    def add_tangents(
        self, J: BlockMatrix, state: State, wx=0.0, wv=0.0, wa=0.0, definite=False
    ) -> BlockMatrix:
        if wa != 0.0:
            self.crew.call("add_mass", wa)
        return super().add_tangents(J, state, wx, wv, 0.0, definite)

    def project(self, J: BlockMatrix) -> BlockMatrix:
        """The matrix on all processes plus J, projected there."""
        diagonal = J.values if J.values.any() else None
        rows = (lambda part: (None,)) if diagonal is None else lambda part: (diagonal[part.nodes],)
        self.crew.each("project", rows)
        return J

    def linear_solver(self, choice: str, symmetric: bool) -> tuple[LinearSolver, BlockMatrix, str]:
        """A solver of PETSc on all processes, and why it was chosen."""
        if choice not in KINDS:
            allowed = f"must be one of {', '.join(KINDS)} on several processes"
            raise InputError(f"solver = {brief(choice)}", allowed, "mpiexec")
        why = f"PETSc on {self.link.size} processes"
        solver = DistributedSolver(self.crew, len(self.cloth.X), choice, symmetric)
        return solver, BlockMatrix.zeros(self.layout.pattern), why

    def usage(self) -> dict[str, object]:
        return {"processes": self.crew.call("usage")}

    def stiffness(self, state: State) -> sparse.csr_matrix:
        raise _in_parts("the matrix K")

    def damping(self, state: State) -> sparse.csr_matrix:
        raise _in_parts("the matrix D")


def _in_parts(what: str) -> InputError:
    allowed = "is in parts on several processes"
    return InputError(what, allowed, "mpiexec", "Run on one process for this.")


def _refuse(terms: Sequence) -> None:
    for term in terms:
        name, traits = type(term).__name__, traits_of(term)
        if not traits.shared:
            allowed = "cannot be shared among processes yet"
            names = [other for other, each in named.TRAITS.items() if each.shared]
            remedy = f"Run on one process, or use only {', '.join(names)}."
            raise InputError(name, allowed, "mpiexec", remedy)
        if traits.kind == "bending" and isinstance(parameters_of(term).get("rest"), tuple):
            allowed = "must be one angle or a text on several processes"
            raise InputError(f"{name} with a rest angle for each hinge", allowed, "mpiexec")


def _couples(term, part: Cloth, cloth: Cloth) -> bool:
    """Whether a term couples nodes; what names nodes is asked for the whole cloth."""
    try:
        stencil = protocol.stencil(term, part)
    except InputError:
        stencil = protocol.stencil(term, cloth)
    return stencil is not None and stencil.shape[1] > 1
