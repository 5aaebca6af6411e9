"""The largest stable time step of every method, from the operators before any run.

For a mode with k = ω² and d = 2 ζ ω each method but forward Euler is stable as long as

    a dt² k + b dt d < 1,    (a, b) = `traits.stability`, (0, 0) if A-stable.

Where M⁻¹K and M⁻¹D share no modes, each solution x ∝ μⁿ z still obeys the scalar law with the
Rayleigh quotients of z, and the first one to grow has μ = −1. Hence the limit is the dt at which
the largest eigenvalue of M⁻¹ (a dt² K + b dt D) is 1, for positive semi-definite K and D.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from scipy.linalg import eigh, eigvals
from scipy.sparse import issparse
from scipy.sparse.linalg import ArpackError, LinearOperator, aslinearoperator, eigsh, splu

from fecloth.errors import InputError, SolveFailed
from fecloth.integrators.explicit import ForwardEuler
from fecloth.stability.amplification_matrix import resolve_method
from fecloth.stability.lanczos_estimate import step_of_rates
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System

# Free directions up to which forward Euler's limit comes from all eigenvalues: the matrices are
# dense, and their eigenvalues take time that grows with the cube of this number.
MOST_DENSE_DIRECTIONS = 400
# Damping below this share of the largest damping counts as none: eigenvalues have an error of
# round-off, and forward Euler's limit divides by the damping.
NEGLIGIBLE_DAMPING = 1e-9
# Iterations of the power method for a bound by rows: each makes it smaller, none unsafe.
POWER_ITERATIONS = 20


def critical_dt(system: System, state: State, method="symplectic_euler") -> float:
    """Return the largest stable step of a method on the system, linearised at a state [s].

    With Ω = ω dt for each mode, as the methods are coded:

    =================================  ==========================================================
    `SymplecticEuler`                  Ω < 2 (√(1 + ζ²) − ζ), the force at (x, v)
    `CentralDifference`                Ω < 2 (√(1 + 4 ζ²) − 2 ζ), at the predicted velocity
    `ForwardEuler`                     Ω ≤ 2ζ, or 2/(ζ + √(ζ² − 1)) where ζ > 1
    `Newmark`, 2β < γ                  Ω < (ζ g + √(ζ² g² + c))/c, g = γ − ½, c = γ/2 − β (Hughes
                                       2000, The Finite Element Method, section 9.1)
    all others                         any: infinite
    =================================  ==========================================================

    The largest eigenvalue comes from Lanczos' method on the directions that the pins leave free.
    Of K and D only the symmetric part is used. Directions with negative stiffness are left out,
    because they are unstable at any step.

    The limit of an A-stable method is infinite, for linear problems: no mode of K and D at one
    state grows at any step. A nonlinear cloth may gain energy nevertheless (as with the midpoint
    rule, the trapezoidal rule and generalised-α), and Newton's iteration may find no solution.

    Forward Euler needs damping in every mode: a taut sheet has transverse modes that
    strain-rate damping leaves undamped, and its limit is 0, as without any damping. Up to 400
    free directions it is the least over all eigenvalues of (λ²M + λD + K) z = 0 of 2 |Re
    λ|/|λ|², as |1 + dt λ| ≤ 1 requires, whether or not K and D have the same modes. With more
    directions it is a safe dt,

        min(least of d/k, 2/largest d)   over all directions, k, d their Rayleigh quotients,

    which equals the limit if the modes are the same and ζ ≤ 0.7 for all of them, and is at
    least half of it if they are the same. In both cases damping below 1e-9 of the largest
    counts as none.

    A cloth that stretches in the run becomes stiffer, and the limit falls: compute it again
    there (`estimate` does so cheaply). Raises `SolveFailed` if K or D is not finite at the
    state, or the eigenvalue is not found.

    Parameters
    ----------
    system, state
        What moves, and where it is linearised.
    method
        A method, its class, or its name, as "central_difference".

    Returns
    -------
    float
        dt [s]; infinite for an A-stable method, and where nothing is stiff or damped.
    """
    check_system(system, state, "critical_dt")
    method = resolve_method(method)
    if isinstance(method, ForwardEuler):
        with _as_solve_failed():
            return _forward_euler(*_free_operators(system, state))
    a, b = _limit(method)
    if a == 0:  # A-stable
        return math.inf
    K, D, M = _free_operators(system, state)
    with _as_solve_failed():
        if D is not None:
            D = b * D
        return _smallest_step(a * K, D, M)


@contextmanager
def _as_solve_failed() -> Iterator[None]:
    """Turn the errors of an eigenproblem into `SolveFailed`."""
    try:  # SciPy raises a ValueError for numbers that are not finite
        yield
    except (ValueError, ArpackError, np.linalg.LinAlgError) as error:
        raise SolveFailed(f"the stable step cannot be computed ({error})") from error


def element_bound(system: System, method="symplectic_euler") -> float:
    """Return a step that is stable at rest [s], at most `critical_dt`, by `rate_bounds`.

    It takes one assembly and no eigenvalues. With a lumped mass the step is up to 1.3 times
    smaller than `critical_dt` (StVK sheets 1.1 times), with a consistent one up to 1.7 times.
    A stretched cloth is stiffer than at rest, and the step may be unstable: use `critical_dt`,
    which takes the state. Raises `SolveFailed` if K or D is not finite at rest, as with a gas.

    Forward Euler needs a lower bound of the damping, which rows do not give: its step is 0 if
    anything is stiff.
    """
    method = resolve_method(method)
    stiffness, damping = rate_bounds(system)
    if isinstance(method, ForwardEuler):
        if stiffness > 0:
            return 0.0
        return step_of_rates(0.0, 0.5 * damping)
    a, b = _limit(method)
    if a:
        return step_of_rates(a * stiffness, max(b, 0.0) * damping)
    return math.inf


def rate_bounds(system: System) -> tuple[float, float]:
    """Return upper bounds of the eigenvalues of M⁻¹K [1/s²] and M⁻¹D [1/s] at rest.

    Pins are left out, as they only make the largest eigenvalue smaller. The largest eigenvalue
    of M⁻¹A is at most the largest Σ_j |A_ij| w_j/(m_i w_i) over the rows i, for any w > 0
    (Collatz 1942, Einschließungssatz für die charakteristischen Zahlen von Matrizen, Math. Z.
    48). A consistent mass is at least a part of its scaled diagonal, which counts in its place.
    Raises `SolveFailed` if K or D is not finite.
    """
    if system.mass_kind == "consistent":
        part = system.cloth.least_mass
    else:
        part = 1.0
    mass = np.repeat(part * system.diagonal_mass, 3)  # one for each component of each node
    rest = system.rest()
    stiffness = _row_bound(system.stiffness(rest), mass)
    damping = _row_bound(system.damping(rest), mass)
    return stiffness, damping


def _row_bound(A, mass: np.ndarray) -> float:
    """Return an upper bound of the eigenvalues of M⁻¹A, see `rate_bounds`.

    A (3n, 3n) is sparse, and counts by its symmetric part; `mass` is (3n,). Any weights w > 0
    give a bound. The weights of the power method, w ← w + M⁻¹|A| w, give small ones.
    """
    absolute = abs(A + A.T) / 2
    w = np.ones(len(mass))
    bound = math.inf
    for _ in range(POWER_ITERATIONS):
        product = absolute @ w / mass
        if not np.isfinite(product).all():
            raise SolveFailed("K or D is not finite at rest: no step is known to be stable")
        bound = min(bound, float((product / w).max()))
        # scaled: both summands have the same largest entry, whatever the units of A and M
        w += product / max(product.max(), np.finfo(float).tiny) * w.max()
    return bound


def _limit(method) -> tuple[float, float]:
    """(a, b) of the method's `traits.stability`."""
    if method.traits.stability is None:
        what = f"{type(method).__name__}.traits.stability = None"
        raise InputError(what, "must be (a, b): the method states no limit", "stability")
    return method.traits.stability


def _smallest_step(K, D, M) -> float:
    """Return the smallest dt of dt² k + dt d = 1 over all z.

    k and d are the Rayleigh quotients of z, z·Kz/z·Mz and z·Dz/z·Mz; D is None without damping.
    The dt of any z is an upper bound. The eigenvector of dt² K + dt D with the largest
    eigenvalue gives a smaller dt, until dt is the smallest: this is Newton's iteration, from
    above.
    """
    stiffness, stiffest = _largest(K, M)
    if D is None:
        return step_of_rates(max(stiffness, 0.0), 0.0)

    def dt_of(z):
        k, d, m = (float(np.vdot(z, A @ z)) for A in (K, D, M))
        return step_of_rates(max(k / m, 0.0), d / m)

    _, most_damped = _largest(D, M)
    dt = min(dt_of(stiffest), dt_of(most_damped))
    for _ in range(20):
        if math.isinf(dt):
            break
        damping = dt * D
        if not issparse(K):  # it has dense parts, and is an operator
            damping = aslinearoperator(damping)
        dt_before = dt
        _, fastest = _largest(dt**2 * K + damping, M)
        dt = min(dt, dt_of(fastest))
        if dt >= dt_before * (1 - 1e-9):  # it no longer falls
            break
    return dt


def _forward_euler(K, D, M) -> float:
    """Return the largest stable dt of forward Euler, min 2 |Re λ|/|λ|² over the modes.

    It is 0 if a stiff mode has no damping. With more than `MOST_DENSE_DIRECTIONS` it is a safe
    dt, min(least d/k, 2/largest d), as `critical_dt` says. D is None without damping.
    """
    largest_damping = 0.0 if D is None else _largest(D, M)[0]
    if largest_damping <= 0:
        is_stiff = _largest(K, M)[0] > 0
        return 0.0 if is_stiff else math.inf
    if K.shape[0] <= MOST_DENSE_DIRECTIONS:
        return _over_all_modes(K, D, M)
    # The largest k/d is an eigenvalue of the pair (K, D + tiny M). Without damping in some
    # direction it is huge, but finite.
    tiny = NEGLIGIBLE_DAMPING * largest_damping
    B = (D + tiny * M).tocsc()
    inverse = LinearOperator(B.shape, splu(B).solve, dtype=float)
    start = np.random.default_rng(0).standard_normal(K.shape[0])
    values, vectors = eigsh(K, k=1, M=B, Minv=inverse, which="LA", v0=start, tol=1e-8)
    z = vectors[:, 0]
    if values[0] <= 0:  # nothing is stiff
        return 2 / largest_damping
    k, d, m = (float(np.vdot(z, A @ z)) for A in (K, D, M))
    if d <= tiny * m:
        return 0.0
    return min(d / k, 2 / largest_damping)


def _over_all_modes(K, D, M) -> float:
    """Return min 2 |Re λ|/|λ|² over all eigenvalues λ of (λ² M + λ D + K) z = 0.

    The matrices are made dense. They become one matrix of twice the size for (ω z, λ z), where
    ω is of the size of the frequencies, so that its entries are of one size.
    """
    unit = np.eye(K.shape[0])
    k, d = (np.linalg.solve(M.toarray(), A @ unit) for A in (K, D))  # M⁻¹K and M⁻¹D
    omega = math.sqrt(max(np.linalg.norm(k, 2), np.finfo(float).tiny))
    rates = eigvals(np.block([[0 * unit, omega * unit], [-k / omega, -d]]))
    size = abs(rates).max()
    rates = rates[abs(rates) > 1e-6 * size]  # the others drift, as a free cloth does
    is_growing = (rates.real > 0) & (abs(rates.imag) < NEGLIGIBLE_DAMPING * size)
    rates = rates[~is_growing]  # directions with negative stiffness are left out
    is_damped = -rates.real > 0.1 * NEGLIGIBLE_DAMPING * size  # and not by round-off
    decay = np.where(is_damped, -rates.real, 0.0)
    return float(np.min(2 * decay / abs(rates) ** 2, initial=math.inf))


def _free_operators(system: System, state: State):
    """Return ZᵀKZ, ZᵀDZ and ZᵀMZ at a state, where the columns of Z are the free directions.

    They are sparse and symmetric: of K and D it is the symmetric part. With parts of K that
    couple all nodes ZᵀKZ is an operator that contains them. ZᵀDZ is None where no term depends
    on the velocity. Raises `InputError` if no direction is free.
    """
    Z = system.admissible
    if Z.shape[1] == 0:
        raise InputError("no free direction", "needs a node that moves", "critical_dt")

    def symmetric_free_part(A):
        A = (Z.T @ A @ Z).tocsr()
        return (A + A.T) / 2

    is_damped = any(term.velocity_dependent for term in system.bound)
    K = symmetric_free_part(system.stiffness(state))
    D = symmetric_free_part(system.damping(state)) if is_damped else None
    for c, u in system.dense(state):  # c u uᵀ = w wᵀ
        w = math.sqrt(c) * (Z.T @ u.ravel())
        part = LinearOperator(K.shape, lambda y, w=w: w * np.vdot(w, y), dtype=float)
        K = aslinearoperator(K) + part
    return K, D, symmetric_free_part(system.mass)


def _largest(A, M) -> tuple[float, np.ndarray]:
    """Return the largest eigenvalue of M⁻¹A, and its eigenvector (n,).

    A and M (n, n) are symmetric, M also definite. A may be an operator. By Lanczos' method.
    """
    n = A.shape[0]
    is_lumped = M.nnz == M.shape[0]
    if n <= 3:  # Lanczos needs more dimensions
        values, vectors = eigh(A @ np.eye(n), M.toarray())
        return float(values[-1]), vectors[:, -1]
    start = np.random.default_rng(0).standard_normal(n)  # the same answer in each run
    if not (A @ start).any():  # nothing stiff
        return 0.0, start
    scale = np.ones(n)
    if is_lumped:  # the same eigenvalue of M^-½ A M^-½, without a mass
        scale = 1 / np.sqrt(M.diagonal())
        M = None
    scaled = LinearOperator(A.shape, lambda y: scale * (A @ (scale * y.ravel())), dtype=float)
    values, vectors = eigsh(scaled, k=1, M=M, which="LA", v0=start, tol=1e-10)
    return float(values[0]), scale * vectors[:, 0]
