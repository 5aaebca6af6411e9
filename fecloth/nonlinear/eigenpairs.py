"""The least eigenvalues of K, or of M⁻¹K, on the free directions, by a sparse factor."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from fecloth.errors import SolveFailed
from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.low_rank_update import LowRankUpdate
from fecloth.system.state import State
from fecloth.system.system import System

SHIFTS = tuple(10.0**n for n in range(-8, 10))  # of the mean of K over the mean of M
# Of the mean of K over the mean of M: eigenvalues below may be round-off, and count as 0.
ZERO_EIGENVALUE = 1e-11
# An eigenvalue is less than the last one if its distance from the shift is less by this part.
# A smaller difference is the error of the iteration.
LESS_EIGENVALUE = 1e-8
LINEAR_RESIDUAL = 1e-10  # relative, of each linear solve
ARPACK_TOLERANCE = 1e-11  # relative residual of an eigenpair; no linear solve is much sharper
ARPACK_RESTARTS = 100  # at the most; what was found by then is taken


# The asymmetry of K over K: up to it no frequency changes visibly.
SYMMETRIC_STIFFNESS = 1e-6


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """Solutions of K u = λ M u, the least λ first.

    Attributes
    ----------
    values
        (count,) λ, ascending.
    vectors
        (count, n, 3) u with u · M u = 1; zero in the held directions. The largest component is
        positive.
    zero
        A |λ| that is not larger than this may be round-off.
    asymmetry
        ‖K − Kᵀ‖ / ‖K + Kᵀ‖ on the free directions. The solutions are those of ½ (K + Kᵀ).
    """

    values: np.ndarray
    vectors: np.ndarray
    zero: float
    asymmetry: float

    @property
    def are_symmetric(self) -> bool:
        """Whether K is symmetric but for round-off."""
        return self.asymmetry <= SYMMETRIC_STIFFNESS

    @property
    def is_unstable(self) -> bool:
        """Whether a value is negative and K symmetric, so that a disturbance grows.

        A negative value of the symmetric part alone says nothing about the motion.
        """
        return self.are_symmetric and bool(self.values[0] < -self.zero)


def least_eigenpairs(system: System, state: State, count: int, unit_mass=False) -> Eigenpairs:
    """The `count` least eigenvalues of K u = λ M u at `state`, for v = 0, by Lanczos iteration.

    K is the sum of all terms' exact tangents, also tangents of low rank, and u is in the
    directions that pins and slides allow. The iteration is on (K + s M)⁻¹ M with s > 0, whose
    largest eigenvalues 1/(λ + s) belong to the least λ. s is the first of 1e-8, 1e-7, … times
    the ratio of K to M in the mean for which K + s M has a Cholesky factor. Then −s lies below
    every λ, and a free body or an unstable state has a factor, too. Of an eigenvalue with
    several vectors the iteration may find one only. So it is repeated without the vectors that
    were found, until it finds no eigenvalue that is less than the last of them.

    With `unit_mass` M is the identity, and λ are the eigenvalues of K [N/m], else ω² [1/s²].
    `count` must be less than the number of free degrees of freedom.

    Source: Ericsson and Ruhe (1980), The spectral transformation Lanczos method, for the shift;
    the iteration is ARPACK's, by SciPy's `eigsh`.
    """
    still = State(state.t, state.x, np.zeros_like(state.x))
    pencil = _Pencil.at(system, still, unit_mass)
    inverse, shift = pencil.invert()
    Z = system.admissible
    M = pencil.mass
    values, vectors = find_all(inverse, M, shift, count)
    modes = (Z @ vectors).T  # (count, 3n), with zeros in the held directions
    largest = np.take_along_axis(modes, abs(modes).argmax(axis=1)[:, None], axis=1)
    shapes = (modes * np.sign(largest)).reshape(count, -1, 3)
    zero = ZERO_EIGENVALUE * pencil.scale
    return Eigenpairs(values, shapes, zero, pencil.asymmetry)


@dataclass(frozen=True, eq=False)
class _Pencil:
    """K and M at a state.

    Attributes
    ----------
    system
        The cloth and its terms.
    stiffness
        The symmetric part of K without its parts of low rank, of all nodes.
    updates
        (c, u) of these parts, in the free directions.
    nodal
        (n, n) M of one component.
    mass
        (f, f) M of the free directions.
    scale
        The mean of |K| over the mean of M, by their diagonals.
    asymmetry
        As for `Eigenpairs`.
    """

    system: System
    stiffness: BlockMatrix
    updates: list[tuple[float, np.ndarray]]
    nodal: sparse.csr_matrix
    mass: sparse.csr_matrix
    scale: float
    asymmetry: float

    @classmethod
    def at(cls, system: System, state: State, unit_mass: bool) -> Self:
        """Assemble K and M at a state; with `unit_mass` M is the identity."""
        K = system.assemble(BlockMatrix.zeros(system.pattern, system.team), state, wx=1.0)
        asymmetry = 0.0 if system.symmetric else symmetrise(system, K)
        reduce = system.constraints.reduce
        Z = system.admissible
        updates = [(c, reduce(u)) for c, u in system.dense(state)]
        n = len(state.x)
        if unit_mass:
            nodal = sparse.identity(n, format="csr")
        else:
            nodal = system.scalar_mass
        mass = (Z.T @ sparse.kron(nodal, sparse.identity(3), format="csr") @ Z).tocsr()
        # blocks of terms that couple nodes outside the pattern, such as contact
        if (coupling := system.coupling(state, wx=1.0)) is not None:
            K = K.plus(coupling)
        diagonal = np.einsum("bii->b", abs(K.values[K.pattern.diagonal]))
        # A K of zeros gives no scale: then any will do.
        scale = float(diagonal.sum() / (3 * nodal.diagonal().sum())) or 1.0
        return cls(system, K, updates, nodal, mass, scale, asymmetry)

    def invert(self) -> tuple[LinearOperator, float]:
        """(K + s M)⁻¹ of the free directions, and s; raise `SolveFailed` without any."""
        for part in SHIFTS:
            shift = part * self.scale
            try:
                return self._inverse(shift), shift
            except SolveFailed as failure:  # not positive definite, or singular within round-off
                last = failure
        raise last

    def _inverse(self, shift: float) -> LinearOperator:
        """(K + shift × M)⁻¹ of the free directions; raise `SolveFailed` without a factor.

        The factor is one of Cholesky, so that it also fails where the matrix is not positive
        definite.
        """
        pattern = self.stiffness.pattern
        Z = self.system.admissible
        J = BlockMatrix(pattern, self.stiffness.values.copy())
        mass = (shift * self.nodal).tocoo()
        slots = pattern.slots(np.column_stack([mass.row, mass.col]).astype(np.int32))[:, 0, 1]
        J.values[slots] += mass.data[:, None, None] * np.eye(3)
        solver = select.direct()
        solver.prepare(self.system.project(J))
        update = None
        if self.updates:
            update = LowRankUpdate.prepare(solver, self.updates, LINEAR_RESIDUAL)
            update.require_definite(self.updates)

        def apply(b: np.ndarray) -> np.ndarray:
            whole = self.system.constraints.project((Z @ b.ravel()).reshape(-1, 3))
            y, _ = solver.solve(whole, LINEAR_RESIDUAL)
            if update:  # the parts of low rank, which are not in the matrix
                y = update.apply(y)
            return Z.T @ y.ravel()

        size = Z.shape[1]
        apply(np.ones(size))  # fails here where J is singular within round-off
        return LinearOperator((size, size), apply, dtype=float)


def symmetrise(system: System, K: BlockMatrix) -> float:
    """Replace the values of K by those of its symmetric part; return its asymmetry before.

    That is ‖K − Kᵀ‖ / ‖K + Kᵀ‖ on the free directions; 0 for a K of zeros there, or where the
    ratio is no number.
    """
    pattern = system.pattern
    pairs = np.column_stack([pattern.rows, pattern.indices])
    mirrored = pattern.slots(pairs)[:, 1, 0]  # where the block (j, i) is, for each block (i, j)

    def transpose(values: np.ndarray) -> np.ndarray:
        return values[mirrored].transpose(0, 2, 1)

    free = system.project(BlockMatrix(pattern, K.values.copy())).values
    K.values[:] = 0.5 * (K.values + transpose(K.values))
    size = np.linalg.norm(free + transpose(free))
    if not size:
        return 0.0
    asymmetry = np.linalg.norm(free - transpose(free)) / size
    return float(np.nan_to_num(asymmetry))


def find_all(
    inverse: LinearOperator, M: sparse.csr_matrix, shift: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The `count` least eigenvalues λ of K u = λ M u and their vectors (f, count).

    `inverse` is (K + shift × M)⁻¹ on the f free directions. Lanczos' iteration may find only one
    of several vectors with the same eigenvalue. So it is repeated with an inverse from which the
    vectors found so far are removed, until it finds nothing less than the last of them.
    """
    random = np.random.default_rng(0)  # the same numbers in every run
    size = M.shape[0]
    values = np.zeros(0)
    vectors = np.zeros((size, 0))
    while True:
        # The inverse is Σ u uᵀ / (λ + shift): this takes the part of each known u out of it.
        scaled = vectors / (values + shift)

        def deflated(b: np.ndarray, vectors=vectors, scaled=scaled) -> np.ndarray:
            return inverse.matvec(b) - scaled @ (vectors.T @ b.ravel())

        operator = LinearOperator(inverse.shape, deflated, dtype=float)
        wanted = max(count - len(values), 1)
        start = random.standard_normal(size)
        new_values, new_vectors = _iterate_lanczos(operator, M, shift, wanted, start)
        if len(values) == count:
            least_distance = (1 - LESS_EIGENVALUE) * (values[-1] + shift)
            if new_values[0] + shift >= least_distance:
                return values, vectors
        values = np.append(values, new_values)
        vectors = np.column_stack([vectors, new_vectors])
        order = np.argsort(values)[:count]
        values = values[order]
        vectors = vectors[:, order]


def _iterate_lanczos(operator, M, shift: float, wanted: int, start: np.ndarray):
    """The eigenvalues and the vectors (f, …) that Lanczos' iteration finds.

    It looks for as many as `wanted`, beginning with the vector `start`, and returns at least
    one. Raise `SolveFailed` if it finds none.
    """
    size = len(start)
    try:
        return eigsh(
            operator,  # with `OPinv` it gives the size only
            k=min(wanted, size - 1),
            M=M,
            sigma=-shift,
            OPinv=operator,
            v0=start,
            ncv=min(size, 2 * wanted + 20),
            maxiter=ARPACK_RESTARTS,
            tol=ARPACK_TOLERANCE,
        )
    except ArpackNoConvergence as failure:  # such as for many vectors of one eigenvalue
        if not len(failure.eigenvalues):
            reason = f"no mode was found in {ARPACK_RESTARTS} restarts of ARPACK"
            raise SolveFailed(reason) from failure
        return failure.eigenvalues, failure.eigenvectors


def least_stiffness(system: System, state: State) -> tuple[float, float]:
    """The least eigenvalue of K on the free directions, and what may be round-off [N/m].

    It is NaN for a cloth that is held whole, and for a stiffness that is not finite. So it is
    where K is not symmetric, as under loads that follow the cloth, and the least eigenvalue of
    its symmetric part is negative.
    """
    if not system.is_whole or system.admissible.shape[1] < 2:
        return math.nan, 0.0
    try:
        pairs = least_eigenpairs(system, state, 1, unit_mass=True)
    except SolveFailed:
        return math.nan, 0.0
    least = float(pairs.values[0])
    if least < -pairs.zero and not pairs.are_symmetric:
        return math.nan, pairs.zero
    return least, pairs.zero
