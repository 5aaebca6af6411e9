"""The largest stable time step of explicit methods, from the operators before any run."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, aslinearoperator, eigsh

from .errors import InputError
from .system import State, System

DAMPING = {"symplectic": 1.0, "central_difference": 2.0}  # c in dt² k + 2 c dt d < 4


def critical_dt(system: System, state: State, method: str = "symplectic") -> float:
    """The largest stable step of a method on the system, linearised at a state [s].

    With a mode's k = ω² and d = 2 ζ ω the methods as they are coded are stable for

        dt² k + 2 dt d < 4,    ω dt < 2 (√(1 + ζ²) − ζ)     "symplectic", the force at (x, v)
        dt² k + 4 dt d < 4,    ω dt < 2 (√(1 + 4 ζ²) − 2 ζ)  "central_difference", the force at
                                                            the predicted velocity

    and both for ω dt < 2 without damping. Where M⁻¹K and M⁻¹D share no modes, each solution
    x ∝ μⁿ z still obeys the scalar law with the Rayleigh quotients of z, and the first one to
    grow has μ = −1. Hence the limit is the dt at which the largest eigenvalue of
    M⁻¹ (dt² K + 2 c dt D), c = 1 or 2, is 4, for positive semi-definite K and D: found by Lanczos'
    method on the directions that the pins leave free. Of K and D that are not symmetric the
    symmetric part is taken, and negative stiffness, which no step cures, is passed over.

    That holds for small motions about `state`. A cloth that stretches in the run becomes stiffer,
    so that the limit falls; ask again there.

    Parameters
    ----------
    system, state
        What moves, and where it is linearised.
    method
        "symplectic" or "central_difference".

    Returns
    -------
    float
        dt [s]; infinite where nothing is stiff or damped.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.StVK()], pins=["left"])
    >>> dt = fc.critical_dt(system, system.rest())
    >>> bool(fc.stability.element_bound(system) <= dt < 0.1 * (0.2 / 1000) ** 0.5)
    True
    """
    c = _damping(method)
    K, D, M = _free_operators(system, state)
    stiffness, _ = _largest(K, M)
    dt = _limit(max(stiffness, 0.0), 0.0)
    if D is None:
        return dt
    D = c * D
    damping, _ = _largest(D, M)
    if damping <= 0:
        return dt
    # No z gives less than the limit, and the z of the largest eigenvalue at some dt ever closer
    # ones: Newton's iteration from above.
    dt = min(dt, _limit(0.0, damping))
    for _ in range(20):
        _, z = _largest(dt**2 * K + 2 * dt * D, M)
        k, d, m = (float(np.vdot(z, A @ z)) for A in (K, D, M))
        last, dt = dt, _limit(max(k / m, 0.0), d / m)
        if dt >= last * (1 - 1e-9):
            break
    return dt


def element_bound(system: System, method: str = "symplectic") -> float:
    """A step that is stable at rest [s], at most that of `critical_dt`, by `System.rate_bounds`.

    The largest eigenvalues of the single triangles bound that of the cloth (Irons and Treharne
    1971); pins only lower it. It costs no more than a few force evaluations. Its price on StVK
    sheets at rest without pins, the step of `critical_dt` over this one:

    ===================================  ============
    rows of triangles: right, cross      1.06, 1.23
    rows of triangles: equilateral       1.30
    Gmsh, least angle above 30°          1.3 to 1.5
    with one sliver of 12°, of 3°        2.8, 5.7
    ===================================  ============

    Where strain-rate damping governs the step, the price is the square of these. It is higher too
    where the stiffest triangles are pinned: 2.2 for the rows of equilateral ones, cut in half
    along two edges, with a pinned boundary. In a stretched state the cloth is stiffer than at
    rest, and the bound may fail: `critical_dt` knows the state.
    """
    stiffness, damping = system.rate_bounds()
    return _limit(stiffness, _damping(method) * damping)


def _damping(method: str) -> float:
    """c of a method."""
    if method not in DAMPING:
        allowed = f"must be one of {', '.join(DAMPING)}; implicit methods have no such limit"
        raise InputError(f"method = {method!r}", allowed, "stability")
    return DAMPING[method]


def _limit(stiffness: float, damping: float) -> float:
    """The dt of dt² k + 2 dt d = 4."""
    total = damping + math.sqrt(damping**2 + 4 * stiffness)
    return 4 / total if total > 0 else math.inf


def _free_operators(system: System, state: State):
    """ZᵀKZ, ZᵀDZ (None without damping) and ZᵀMZ, with K's dense parts; K and D symmetric."""
    Z = system.admissible
    if Z.shape[1] == 0:
        raise InputError("no free direction", "needs a node that moves", "critical_dt")

    def free(A):
        A = (Z.T @ A @ Z).tocsr()
        return (A + A.T) / 2

    damped = any(term.velocity_dependent for term in system.bound)
    K, D = free(system.stiffness(state)), free(system.damping(state)) if damped else None
    for c, u in system.dense(state):
        w = math.sqrt(c) * (Z.T @ u.ravel())
        part = LinearOperator(K.shape, lambda y, w=w: w * np.vdot(w, y), dtype=float)
        K, D = aslinearoperator(K) + part, D if D is None else aslinearoperator(D)
    return K, D, free(system.mass)


def _largest(A, M) -> tuple[float, np.ndarray]:
    """Largest eigenvalue of M⁻¹A, A symmetric, M symmetric and positive definite; a vector."""
    n, lumped = A.shape[0], M.nnz == M.shape[0]
    if n <= 3:  # Lanczos needs more dimensions
        values, vectors = eigh(A @ np.eye(n), M.toarray())
        return float(values[-1]), vectors[:, -1]
    start = np.random.default_rng(0).standard_normal(n)  # the same answer in each run
    if not (A @ start).any():  # nothing stiff
        return 0.0, start
    root = 1 / np.sqrt(M.diagonal()) if lumped else np.ones(n)
    # M^-1/2 A M^-1/2, where M is diagonal
    scaled = LinearOperator(A.shape, lambda y: root * (A @ (root * y.ravel())), dtype=float)
    values, vectors = eigsh(scaled, k=1, M=None if lumped else M, which="LA", v0=start, tol=1e-10)
    return float(values[0]), root * vectors[:, 0]
