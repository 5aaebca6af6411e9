"""The linear equation of a derivative, solved by corrections with an approximate tangent."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from fecloth.errors import FeclothError, SolveFailed
from fecloth.linalg.low_rank_update import LowRankUpdate
from fecloth.nonlinear.error_left import SLOWEST_CONTRACTION
from fecloth.nonlinear.options import Newton

MOST_CORRECTIONS = 12  # with one matrix; at SLOWEST_CONTRACTION they gain a factor of 4,000
# Corrections that no longer shrink are the round-off of the residual if one before shrank by this
# factor, as with a good matrix, …
GOOD_CONTRACTION = 0.2
# … or if they are below this part of the unknown.
ROUND_OFF_OF_UNKNOWN = 1e-6
ASSUMED_CONTRACTION = 0.3  # of the first correction with a matrix of which none is known
# Vectors between two restarts of GMRES, and its most restarts. It follows where no matrix is good,
# and is slow there.
GMRES_VECTORS = 60
GMRES_RESTARTS = 5

Map = Callable[[np.ndarray], np.ndarray]


class NoDerivative(FeclothError):
    """A derivative does not exist, or cannot be computed; the message says why."""

    def __str__(self) -> str:
        return f"no derivative here: {super().__str__()}"


def inverse(linear: Any, updates: list[tuple[float, np.ndarray]]) -> Map:
    """b ↦ (J + Σ c u uᵀ)⁻¹ b for `updates` (c, u), by a linear solver with the factor of J."""
    rtol = Newton.forcing  # as in Newton's iteration: the next correction makes up for the rest
    if not updates:
        return lambda b: linear.solve(b, rtol)[0]
    update = LowRankUpdate.prepare(linear, updates, rtol)
    return lambda b: update.apply(linear.solve(b, rtol)[0])


class Corrected(NamedTuple):
    """The unknown (n, 3), and the contraction by each solver that was used."""

    y: np.ndarray
    contractions: dict[str, float]


def correct(
    residual: Map,
    y: np.ndarray,
    solvers: Mapping[str, Callable[[], Map]],
    known: Mapping[str, float],
    size_of: Callable[[np.ndarray], float],
    tolerance: float,
    floor: float,
) -> Corrected:
    """Solve residual(y) = 0, which is linear in y (n, 3), by y ← y − J⁻¹ residual(y).

    Return the solution, and the contraction that was measured for each solver. Raise
    `NoDerivative` if no matrix has a factor, or if GMRES does not converge.

    Parameters
    ----------
    residual
        A function of y that is linear up to a constant.
    y
        (n, 3) where to begin.
    solvers
        By name: what makes b ↦ J⁻¹ b for an approximate J, the cheapest first. The next one is
        taken where corrections do not shrink by half, and after all GMRES with the last one.
    known
        By name: the factor by which corrections shrink, as far as it is known.
    size_of
        The size of y, to which the error is relative.
    tolerance
        The relative error of y at which the corrections end.
    floor
        The size of corrections that are round-off.
    """
    solve = None
    contractions = dict[str, float]()
    for name, prepare in solvers.items():
        try:
            solve = prepare()
        except SolveFailed:  # this matrix is singular; another one may have a factor
            continue
        expected = known.get(name, ASSUMED_CONTRACTION)
        attempt = _correct_with(solve, residual, y, expected, size_of, tolerance, floor)
        y = attempt.y
        if attempt.contraction is not None:
            contractions[name] = attempt.contraction
        if attempt.is_solved:
            return Corrected(y, contractions)
    if solve is None:
        raise NoDerivative("the tangent has no factor: it is singular")
    return Corrected(_by_gmres(residual, y, solve, size_of, tolerance), contractions)


class _Attempt(NamedTuple):
    """What corrections with one matrix gave: y, whether it is solved, and their contraction.

    The contraction is the first one that was measured and is below 1; None without any.
    """

    y: np.ndarray
    is_solved: bool
    contraction: float | None


def _correct_with(
    solve: Map,
    residual: Map,
    y: np.ndarray,
    expected: float,
    size_of: Callable[[np.ndarray], float],
    tolerance: float,
    floor: float,
) -> _Attempt:
    """Correct y by y ← y − J⁻¹ residual(y) with one matrix, while the corrections shrink.

    `solve` is b ↦ J⁻¹ b. The contraction is the length of a correction over the length of the
    correction before. Until there are two corrections it is `expected`. The other arguments
    are as for `correct`.
    """
    size_before = math.inf
    fastest_contraction = SLOWEST_CONTRACTION
    first_contraction = None
    for _ in range(MOST_CORRECTIONS):
        try:
            step = solve(residual(y))
        except SolveFailed:
            return _Attempt(y, is_solved=False, contraction=first_contraction)
        y = y - step
        size = float(np.linalg.norm(step))
        is_measured = math.isfinite(size_before)
        contraction = size / size_before if is_measured else expected
        if is_measured and contraction < 1 and first_contraction is None:
            first_contraction = contraction
        if contraction < 1:  # the sum of all further corrections, as a geometric series
            error_left = size * contraction / (1 - contraction)
        else:
            error_left = math.inf
        if size <= floor or error_left <= tolerance * size_of(y):
            return _Attempt(y, is_solved=True, contraction=first_contraction)
        if is_measured and contraction > SLOWEST_CONTRACTION:
            break
        size_before = size
        fastest_contraction = min(fastest_contraction, contraction)
    # Corrections that no longer shrink are round-off if the matrix is good or they are small:
    # then y is as exact as it can be.
    is_small = size <= ROUND_OFF_OF_UNKNOWN * size_of(y)
    is_round_off = fastest_contraction < GOOD_CONTRACTION or is_small
    return _Attempt(y, is_solved=is_round_off, contraction=first_contraction)


def _by_gmres(
    residual: Map,
    y: np.ndarray,
    solve: Map,
    size_of: Callable[[np.ndarray], float],
    tolerance: float,
) -> np.ndarray:
    """Solve residual(y) = 0 by GMRES and return y.

    Raise `NoDerivative` if it does not converge. The product of the matrix with a vector is a
    difference of the residual, because residual(y) is linear up to a constant. `solve`, the
    inverse of the last approximate matrix, is the preconditioner.
    """
    r = residual(y)

    def product(z: np.ndarray) -> np.ndarray:
        """The exact matrix times z (3n,)."""
        z = z.reshape(y.shape)
        # A change of y as large as y itself, so that round-off does not matter.
        scale = size_of(y) / (np.linalg.norm(z) or 1.0)
        return ((residual(y + scale * z) - r) / scale).ravel()

    def precondition(b: np.ndarray) -> np.ndarray:
        """An approximation of the inverse matrix times b (3n,)."""
        return solve(b.reshape(y.shape)).ravel()

    shape = (y.size, y.size)
    step, info = gmres(
        LinearOperator(shape, product, dtype=float),
        r.ravel(),
        M=LinearOperator(shape, precondition, dtype=float),
        rtol=tolerance,
        restart=GMRES_VECTORS,
        maxiter=GMRES_RESTARTS,
    )
    if info:
        raise NoDerivative("the equation of the derivative is singular, as where a fold changes")
    return y - step.reshape(y.shape)
