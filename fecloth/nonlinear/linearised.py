"""The linear equation of a derivative, solved by corrections with an approximate tangent."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from fecloth.errors import FeclothError, SolveFailed
from fecloth.linalg.low_rank_update import LowRankUpdate

SWEEPS = 12  # corrections with a matrix
SLOW = 0.5  # contraction of the corrections above which it is
FAST = 0.2  # after a contraction below it, slow corrections are the round-off of the residual
INNER = 1e-2  # relative residual of each linear solve
CLOSE = 1e-6  # of the unknown: corrections below it that do not shrink are round-off
FIRST = 0.3  # contraction that is assumed where none is known
VECTORS, RESTARTS = 60, 5  # of GMRES

Map = Callable[[np.ndarray], np.ndarray]


class NoDerivative(FeclothError):
    """A derivative does not exist, or cannot be computed; the message says why."""

    def __str__(self) -> str:
        return f"no derivative here: {super().__str__()}"


def inverse(linear: Any, updates: list[tuple[float, np.ndarray]]) -> Map:
    """b ↦ (J + Σ c u uᵀ)⁻¹ b, by a linear solver that has the factor of J; `updates` are (c, u)."""
    if not updates:
        return lambda b: linear.solve(b, INNER)[0]
    update = LowRankUpdate.prepare(linear, updates, INNER)
    return lambda b: update.apply(linear.solve(b, INNER)[0])


class Corrected(NamedTuple):
    """The unknown, and the contraction of the corrections by each solver that was used."""

    y: np.ndarray  # (n, 3)
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

    `solvers` return b ↦ J⁻¹ b for approximate J, the cheapest first; the next one is taken
    where corrections do not shrink by half, and after all GMRES with the last. `known` is by
    what factor corrections of each shrink, as far as it is known. The error is relative to
    `size_of(y)`, and round-off makes corrections of the size `floor`. Raises `NoDerivative` if
    no matrix has a factor, or GMRES does not end.
    """
    solve = None
    contractions = dict[str, float]()
    for name, prepare in solvers.items():
        try:
            solve = prepare()
            last = math.inf
            fastest = SLOW
            for _ in range(SWEEPS):
                step = solve(residual(y))
                y = y - step
                size = float(np.linalg.norm(step))
                measured = math.isfinite(last)
                if measured:
                    contraction = size / last
                else:
                    contraction = known.get(name, FIRST)
                if measured and contraction < 1:
                    contractions.setdefault(name, contraction)
                if contraction < 1:
                    left = size * contraction / (1 - contraction)
                else:
                    left = math.inf
                if size <= floor or left <= tolerance * size_of(y):
                    return Corrected(y, contractions)
                if contraction > SLOW and measured:
                    break
                last = size
                fastest = min(fastest, contraction)
            if fastest < FAST or size <= CLOSE * size_of(y):  # what is left is round-off
                return Corrected(y, contractions)
        except SolveFailed:
            continue
    if solve is None:
        raise NoDerivative("the tangent has no factor: it is singular")
    return Corrected(_by_gmres(residual, y, solve, size_of, tolerance), contractions)


def _by_gmres(
    residual: Map,
    y: np.ndarray,
    solve: Map,
    size_of: Callable[[np.ndarray], float],
    tolerance: float,
) -> np.ndarray:
    """Solve residual(y) = 0 by GMRES, with differences of the residual as products."""
    r = residual(y)

    def product(z: np.ndarray) -> np.ndarray:
        z = z.reshape(y.shape)
        unit = size_of(y) / (np.linalg.norm(z) or 1.0)
        return ((residual(y + unit * z) - r) / unit).ravel()

    def precondition(b: np.ndarray) -> np.ndarray:
        return solve(b.reshape(y.shape)).ravel()

    A, M = (LinearOperator((y.size, y.size), f, dtype=float) for f in (product, precondition))
    step, info = gmres(A, r.ravel(), M=M, rtol=tolerance, restart=VECTORS, maxiter=RESTARTS)
    if info:
        raise NoDerivative("the equation of the derivative is singular, as where a fold changes")
    return y - step.reshape(y.shape)
