"""The `System` of a whole cloth whose terms and matrix are shared among processes."""

import time
from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sparse

from fecloth import terms as named
from fecloth.distributed import partition
from fecloth.distributed.crew import Crew, Link, RemoteTerm
from fecloth.distributed.petsc_solver import TooManyIterations
from fecloth.errors import IndefiniteMatrix, InputError, SolveFailed, brief
from fecloth.linalg.block_matrix import BlockMatrix, MatrixLayout
from fecloth.linalg.protocol import LinearSolver, SolveInfo
from fecloth.mesh.cloth import Cloth
from fecloth.system.reaction_limits import ReactionLimits
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms import protocol
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.traits import TermTraits, parameters_of, traits_of

KINDS = {"auto": "block Jacobi", "pcg": "block Jacobi", "multigrid": "GAMG", "direct": "MUMPS"}
# Iterations with block Jacobi after which "auto" takes GAMG, whose setup costs as much.
MOST_JACOBI_ITERATIONS = 150
# Times the iterations of a new hierarchy of GAMG: then another one is made.
WORN_HIERARCHY = 2.0


class DistributedSolver:
    """PETSc's solver on all processes: a `LinearSolver`.

    "auto" begins with block Jacobi, which is best for short steps, and takes GAMG from the first
    solve on that needs more than 150 iterations. The hierarchy of GAMG is kept, while the matrix
    changes, until the iterations double. After a failure the solver is made anew.

    Attributes
    ----------
    first, last
        Iterations of the first solve with the present preconditioner, and of the last solve;
        `first` is 0 before that first solve.
    numbers
        (n,) the row of the matrix of each node. The rows of the nodes that a process owns
        follow one another, as PETSc requires.
    spoiled
        Whether the preconditioner was of a matrix that failed.
    """

    def __init__(self, crew: Crew, nodes: int, choice: str, symmetric: bool):
        self.crew = crew
        self.choice = choice
        self.kind = KINDS[choice]
        self.symmetric = symmetric
        self.prepared = 0
        self.keeps_state = True
        self.x = np.zeros((nodes, 3))
        self.seconds_factor = 0.0
        self.first = 0
        self.last = 0
        self.numbers = np.empty(nodes, np.int32)
        first_row = 0
        for part in crew.parts:
            count = int(part.is_own.sum())
            self.numbers[part.own_nodes] = np.arange(first_row, first_row + count)
            first_row += count
        self._create()

    def _create(self) -> None:
        """Make a solver of the present kind on all processes."""
        crew = self.crew
        owned = [int(part.is_own.sum()) for part in crew.parts]

        def arguments(part: partition.Part) -> tuple:
            return self.kind, self.symmetric, owned, self.numbers[part.nodes]

        crew.call_each("create_solver", arguments)
        self.first = 0
        self.spoiled = False

    @property
    def name(self) -> str:
        return f"PETSc {self.kind}"

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Note the positions: GAMG must know their rigid motions."""
        self.x = x

    def drop(self) -> None:
        """Forget the hierarchy, and with "auto" the choice."""
        if self.kind != KINDS[self.choice]:
            self.kind = KINDS[self.choice]
            self._create()
        self.first = self.last = 0

    def prepare(self, A: BlockMatrix) -> None:
        """Take the matrix that the processes hold; A is what one process knows of it."""
        if self.choice == "auto" and self.kind != "GAMG" and self.last > MOST_JACOBI_ITERATIONS:
            self._take_gamg()
        is_worn = self.last > WORN_HIERARCHY * self.first
        self._prepare(anew=self.first == 0 or is_worn)
        self.prepared += 1

    def _prepare(self, anew: bool) -> None:
        """Take the present matrix, with a new preconditioner or the old one."""
        begin = time.perf_counter()
        if self.spoiled:  # it would keep what it has found out about an indefinite matrix
            self._create()
        self.crew.call_each("prepare", lambda part: (self.x[part.own_nodes], anew))
        self.first = 0 if anew else self.first
        self.seconds_factor = time.perf_counter() - begin

    def _take_gamg(self) -> None:
        """Take GAMG from now on."""
        self.kind = "GAMG"
        self._create()

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """The solution x (n, 3) of A x = b to the relative residual `rtol`, and its `SolveInfo`.

        A solve that fails is repeated once with a new preconditioner, if that may help: if it
        had an old hierarchy of GAMG, or if "auto" can go over to GAMG. Raise `SolveFailed` if
        it still fails, and `IndefiniteMatrix` where the matrix is not positive definite.
        """
        b = np.ascontiguousarray(b, dtype=float)
        if not b.any():
            return np.zeros_like(b), SolveInfo(self.name, 0, 0.0, self.seconds_factor, 0.0)
        begin = time.perf_counter()
        has_solved_before = self.first > 0  # with the present preconditioner
        try:
            shares = self._solve(b, rtol, guess)
        except SolveFailed as failure:
            # A preconditioner that has solved before is sound, so the matrix is indefinite. A
            # `SpoiledPreconditioner`, also an `IndefiniteMatrix`, tells nothing of the matrix.
            if has_solved_before and type(failure) is IndefiniteMatrix:
                raise
            self.first = 0
            self.spoiled = True
            is_slow = isinstance(failure, TooManyIterations) and self.kind == "block Jacobi"
            if is_slow and self.choice == "auto":
                self._take_gamg()
            elif not (has_solved_before and self.kind == "GAMG"):
                raise
            self._prepare(anew=True)
            shares = self._solve(b, rtol, guess)
        # each process returns the x of its nodes, and the same iterations and residual
        x_of_parts, iterations, residual = zip(*shares, strict=True)
        x = np.empty_like(b)
        for part, own_x in zip(self.crew.parts, x_of_parts, strict=True):
            x[part.own_nodes] = own_x
        self.last = iterations[0]
        self.first = self.first or max(self.last, 1)
        seconds = time.perf_counter() - begin
        return x, SolveInfo(self.name, self.last, residual[0], self.seconds_factor, seconds)

    def _solve(self, b: np.ndarray, rtol: float, guess: np.ndarray | None) -> list:
        """What `PetscSolver.solve` returns on each process, for its rows of b and the guess."""

        def arguments(part: partition.Part) -> tuple:
            own_guess = None if guess is None else guess[part.own_nodes]
            return b[part.own_nodes], rtol, own_guess

        return self.crew.call_each("solve", arguments)


class DistributedSystem(System):
    """A `System` in the first of several processes, which drives the others.

    It has the whole mesh and state; the terms with elements, the matrix and the linear solver
    are in parts on all processes. What acts on single nodes, such as gravity, stays here. To
    all else it is a `System`: methods, ledger and files know nothing of the parts.
    """

    is_whole: ClassVar[bool] = False

    def __init__(self, *arguments, link: Link, threads="auto", **options):
        self.link = link
        super().__init__(*arguments, threads=1 if threads == "auto" else threads, **options)

    @cached_property
    def parts(self) -> list[partition.Part]:
        """The part of each process; terms and pins that cannot be shared are refused."""
        _refuse_unshared(self.terms)
        if self.seams:
            remedy = "Run on one process."
            what = self.seams[0].label
            raise InputError(what, "cannot be sewn on several processes yet", "mpiexec", remedy)
        if self.releases:
            what = f"a pin with until = {self.releases[0]:g} s"
            remedy = "Run on one process."
            raise InputError(what, "cannot let go on several processes yet", "mpiexec", remedy)
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
        own_terms = [term for term, is_shared in pairs if not is_shared]
        stencils = [protocol.stencil(term, self.cloth) for term in own_terms]
        coupled = tuple(stencil for stencil in stencils if stencil is not None)
        return MatrixLayout(len(self.cloth.X), coupled)

    @cached_property
    def crew(self) -> Crew:
        """The workers of all processes, which are made at the first use.

        Each gets its part of the mesh, the terms that couple nodes, the pins and the start.
        """
        start = self.rest() if self.start is None else self.start
        pairs = zip(self.terms, self._is_shared, strict=True)
        shared_terms = [self._as_known(term) for term, is_shared in pairs if is_shared]
        descriptions = []
        for part in self.parts:
            description = partition.PartDescription(
                part=part,
                fabric=self.fabric,
                terms=[partition.cut_term(part, term) for term in shared_terms],
                pins=partition.cut_pins(part, self.constraints.groups),
                mass=self.mass_kind,
                grain=self.grain,
                start=State(start.t, start.x[part.nodes], start.v[part.nodes]),
            )
            descriptions.append(description)
        return Crew.begin(self.link, descriptions)

    def _as_known(self, term):
        """The term, or its springs or edges where a part does not know them."""
        if isinstance(term, named.Springs) and term.kind == "structural":
            return term.springs(self.panel)
        if isinstance(term, named.EdgeForce):
            return term.known(self.cloth)
        return term

    @cached_property
    def bound(self) -> tuple:
        """The bound terms, in the order of `terms`.

        Terms on single nodes are bound here for the whole cloth. Terms that couple nodes are
        bound by the workers on their parts, in the same order.
        """
        terms_of_worker = iter(self.crew.here.terms.items())
        bound: list[BoundTerm] = []
        for term, is_shared in zip(self.terms, self._is_shared, strict=True):
            if is_shared:
                key, local = next(terms_of_worker)
                bound.append(RemoteTerm(self.crew, key, local))
            else:
                bound.append(protocol.bound(term, self.panel, self.layout.slots))
        return tuple(bound)

    @cached_property
    def reaction_limits(self) -> ReactionLimits:
        """For `force_size`; each process knows the forces of its nodes."""
        nodes, most = zip(*self.crew.call("reaction_limits"), strict=True)
        return ReactionLimits(np.concatenate(nodes), np.concatenate(most))

    def force(self, state: State) -> np.ndarray:
        """The sum (n, 3) of all terms' forces [N].

        The shared terms take one call of all processes together, because each call costs time.
        """
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
        self,
        J: BlockMatrix,
        state: State,
        wx=0.0,
        wv=0.0,
        wa=0.0,
        definite=False,
        kept: bool | None = None,
    ) -> BlockMatrix:
        if wa != 0.0:
            self.crew.call("add_mass", wa)
        return super().add_tangents(J, state, wx, wv, 0.0, definite, kept)

    def project(self, J: BlockMatrix) -> BlockMatrix:
        """The matrix on all processes plus J, projected there."""
        diagonal = J.values if J.values.any() else None
        self.crew.call_each(
            "project", lambda part: (None if diagonal is None else diagonal[part.nodes],)
        )
        return J

    def shared_solver(self, choice: str, symmetric: bool) -> tuple[LinearSolver, BlockMatrix, str]:
        """A solver of PETSc on all processes, and why it was chosen."""
        if choice not in KINDS:
            allowed = f"must be one of {', '.join(KINDS)} on several processes"
            raise InputError(f"solver = {brief(choice)}", allowed, "mpiexec")
        why = f"PETSc on {self.link.size} processes"
        solver = DistributedSolver(self.crew, len(self.cloth.X), choice, symmetric)
        return solver, BlockMatrix.zeros(self.layout.pattern), why

    def usage(self) -> dict[str, object]:
        """What summary.json says of the processes."""
        return {"processes": self.crew.call("usage")}

    def stiffness(self, state: State) -> sparse.csr_matrix:
        """Refused: it is in parts."""
        raise _in_parts("the matrix K")

    def damping(self, state: State) -> sparse.csr_matrix:
        """Refused: it is in parts."""
        raise _in_parts("the matrix D")


def _in_parts(what: str) -> InputError:
    allowed = "is in parts on several processes"
    return InputError(what, allowed, "mpiexec", "Run on one process for this.")


def _refuse_unshared(terms: Sequence) -> None:
    """Raise `InputError` for a term that cannot be shared among processes.

    That is a term whose traits say so, and bending with a rest angle for each hinge of the whole
    cloth.
    """
    for term in terms:
        name = type(term).__name__
        traits = traits_of(term)
        if not traits.shared:
            allowed = "cannot be shared among processes yet"
            names = [other for other, its_traits in named.TRAITS.items() if its_traits.shared]
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
