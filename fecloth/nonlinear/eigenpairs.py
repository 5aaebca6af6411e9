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

FIRST = 1e-8  # of the mean of K over the mean of M: the first shift
GROWTH, MOST = 10.0, 18  # factor between two shifts, and their number
ROUND_OFF = 1e-11  # of the mean of K over the mean of M: eigenvalues below are 0
ANOTHER = 1e-8  # relative to its distance from the shift: an eigenvalue less than the last found
RTOL = 1e-10  # of each linear solve
TOLERANCE, RESTARTS = 1e-11, 100  # of ARPACK: relative residual, and the most restarts


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """Solutions of K u = λ M u, the least λ first."""

    values: np.ndarray  # (count,) λ, ascending
    # (count, n, 3) u with u · M u = 1; zero in the held directions. The largest component is
    # positive.
    vectors: np.ndarray
    zero: float  # |λ| that is not larger may be round-off
    # ‖K − Kᵀ‖ / ‖K + Kᵀ‖ of the free directions: these are the solutions for ½ (K + Kᵀ).
    asymmetry: float


def least_eigenpairs(system: System, state: State, count: int, unit_mass=False) -> Eigenpairs:
    """The `count` least eigenvalues of K u = λ M u at `state`, for v = 0, by Lanczos iteration.

    K is the sum of all terms' exact tangents, also tangents of low rank, and u is in the
    directions that pins and slides allow. The iteration is on (K + s M)⁻¹ M with s > 0, whose
    largest eigenvalues 1/(λ + s) belong to the least λ. s is the first of 1e-8, 1e-7, … times
    the ratio of K to M in the mean for which K + s M has a Cholesky factor: then −s lies below
    every λ, and a free body or an unstable state has a factor too. Of an eigenvalue with
    several vectors the iteration may find one only; so it is repeated without the vectors
    found, until it finds no eigenvalue that is less than the last of them.

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
    whole = (Z @ vectors).T
    largest = np.take_along_axis(whole, abs(whole).argmax(axis=1)[:, None], axis=1)
    shapes = (whole * np.sign(largest)).reshape(count, -1, 3)
    return Eigenpairs(values, shapes, ROUND_OFF * pencil.scale, pencil.asymmetry)


@dataclass(frozen=True, eq=False)
class _Pencil:
    """K and M at a state."""

    system: System
    stiffness: BlockMatrix  # the symmetric part of K without its parts of low rank, all nodes
    updates: list[tuple[float, np.ndarray]]  # (c, u) of these parts, in the free directions
    nodal: sparse.csr_matrix
    mass: sparse.csr_matrix  # (f, f) M of the free directions
    scale: float  # the mean of |K| over the mean of M, by their diagonals
    asymmetry: float  # as for `Eigenpairs`

    @classmethod
    def at(cls, system: System, state: State, unit_mass: bool) -> Self:
        K = system.assemble(BlockMatrix.zeros(system.pattern, system.team), state, wx=1.0)
        asymmetry = 0.0 if system.symmetric else _symmetrise(system, K)
        project = system.constraints.project
        Z = system.admissible
        updates = [(c, project(u)) for c, u in system.dense(state)]
        n = len(state.x)
        if unit_mass:
            nodal = sparse.identity(n, format="csr")
        else:
            nodal = system.scalar_mass
        mass = (Z.T @ sparse.kron(nodal, sparse.identity(3), format="csr") @ Z).tocsr()
        if (part := system.coupling(state, wx=1.0)) is not None:
            K = K.plus(part)
        diagonal = np.einsum("bii->b", abs(K.values[K.pattern.diagonal]))
        scale = float(diagonal.sum() / (3 * nodal.diagonal().sum())) or 1.0
        return cls(system, K, updates, nodal, mass, scale, asymmetry)

    def invert(self) -> tuple[LinearOperator, float]:
        """Return (K + s M)⁻¹ of the free directions, and s."""
        for power in range(MOST):
            shift = FIRST * self.scale * GROWTH**power
            try:
                return self._inverse(shift), shift
            except SolveFailed as failure:  # not positive definite, or singular within round-off
                last = failure
        raise last

    def _inverse(self, shift: float) -> LinearOperator:
        pattern = self.stiffness.pattern
        Z = self.system.admissible
        J = BlockMatrix(pattern, self.stiffness.values.copy())
        mass = (shift * self.nodal).tocoo()
        slots = pattern.slots(np.column_stack([mass.row, mass.col]).astype(np.int32))[:, 0, 1]
        J.values[slots] += mass.data[:, None, None] * np.eye(3)
        solver = select.direct()
        solver.prepare(self.system.project(J))
        if self.updates:
            update = LowRankUpdate.prepare(solver, self.updates, RTOL)
        else:
            update = None
        if update:
            update.require_definite(self.updates)

        def apply(b: np.ndarray) -> np.ndarray:
            y, _ = solver.solve((Z @ b.ravel()).reshape(-1, 3), RTOL)
            return Z.T @ (update.apply(y) if update else y).ravel()

        size = Z.shape[1]
        apply(np.ones(size))  # fails here where J is singular within round-off
        return LinearOperator((size, size), apply, dtype=float)


def _symmetrise(system: System, K: BlockMatrix) -> float:
    """Replace K by its symmetric part; return the asymmetry on the free directions."""
    pattern = system.pattern
    pairs = np.column_stack([pattern.rows, pattern.indices])
    transposed = pattern.slots(pairs)[:, 1, 0]
    free = BlockMatrix(pattern, K.values.copy())
    system.project(free)
    other = free.values[transposed].transpose(0, 2, 1)
    asymmetry = np.linalg.norm(free.values - other) / np.linalg.norm(free.values + other)
    K.values[:] = 0.5 * (K.values + K.values[transposed].transpose(0, 2, 1))
    return float(np.nan_to_num(asymmetry))


def find_all(
    inverse: LinearOperator, M: sparse.csr_matrix, shift: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least eigenvalues and their vectors (f, count), with all of equal eigenvalues."""
    random = np.random.default_rng(0)  # the same numbers in every run
    size = M.shape[0]
    values = np.zeros(0)
    vectors = np.zeros((size, 0))
    while True:
        scaled = vectors / (values + shift)

        def deflated(b: np.ndarray, vectors=vectors, scaled=scaled) -> np.ndarray:
            return inverse.matvec(b) - scaled @ (vectors.T @ b.ravel())

        operator = LinearOperator(inverse.shape, deflated, dtype=float)
        wanted = max(count - len(values), 1)
        more, others = _iterate(operator, M, shift, wanted, random.standard_normal(size))
        if len(values) == count and more[0] + shift >= (1 - ANOTHER) * (values[-1] + shift):
            return values, vectors
        values = np.append(values, more)
        vectors = np.column_stack([vectors, others])
        order = np.argsort(values)[:count]
        values = values[order]
        vectors = vectors[:, order]


def _iterate(operator, M, shift: float, wanted: int, start: np.ndarray):
    """Return the eigenvalues and vectors that Lanczos' iteration finds, at least one."""
    most = len(start)
    size = min(len(start), 2 * wanted + 20)
    try:  # with `OPinv` the first argument gives the size only
        search = {"v0": start, "ncv": size, "maxiter": RESTARTS, "tol": TOLERANCE}
        return eigsh(operator, min(wanted, most - 1), M, -shift, OPinv=operator, **search)
    except ArpackNoConvergence as failure:  # such as for many vectors of one eigenvalue
        if not len(failure.eigenvalues):
            raise SolveFailed(f"no mode was found in {RESTARTS} restarts of ARPACK") from failure
        return failure.eigenvalues, failure.eigenvectors


def least_stiffness(system: System, state: State) -> tuple[float, float]:
    """Return the least eigenvalue of K on the free directions, and what round-off may be [N/m]."""
    # It is NaN for a cloth that is held whole, and for a stiffness that is not finite.
    if not system.is_whole or system.admissible.shape[1] < 2:
        return math.nan, 0.0
    try:
        pairs = least_eigenpairs(system, state, 1, unit_mass=True)
    except SolveFailed:
        return math.nan, 0.0
    return float(pairs.values[0]), pairs.zero


def describe_instability(least: float, zero: float) -> str:
    """Return a sentence if the least eigenvalue is below round-off, or else ""."""
    if not least < -zero:
        return ""
    return (
        f"the equilibrium is unstable: the least eigenvalue of K is {least:.3g} N/m, so "
        "that a cloth which is disturbed leaves it; bend the start a little, as the first mode "
        "of `fecloth modes` does, to find a stable one"
    )
