"""What the points of a fit tell: covariance, unknowns that are not told, a law that is wrong.

Let r be the residuals in units of their uncertainty, and J = ∂r/∂u. The covariance of u is
J⁺ Σ J⁺ᵀ with J⁺ = (JᵀJ)⁻¹Jᵀ. Σ is, for the mean of R repeats, their sample covariance over R. Of
other curves it is ρ^|i−j|, with the correlation ρ of residuals that follow each other: n points
count as n (1 − ρ)/(1 + ρ) independent ones (Box, Jenkins and Reinsel 1994, Time Series Analysis,
section 3.2). Singular values s of J are the inverse of the uncertainties of
combinations of u. Source: Seber and Wild (1989), Nonlinear Regression, chapters 2 and 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.special import chdtrc, fdtrc, stdtrit  # scipy.stats takes most of a second

from fecloth.study.fitting.evaluation import Column, Evaluation
from fecloth.study.fitting.mistakes import far_points

# Standard uncertainty of u above which the data do not tell it: a factor of exp(0.5) = 1.65.
LARGEST_UNCERTAINTY = 0.5
# A combination with a smaller singular value is known to no better than a factor of exp(100): it
# takes no degree of freedom, and its uncertainty stays finite.
LEAST_SINGULAR = 1e-2
# Two unknowns are told together where their cosine in what is not told is above this; see
# `_groups`. It is 1 where one combination alone is not told, and 0 where they are independent.
LEAST_COSINE_OF_TOGETHER = 0.05
WRONG_LAW = 0.005  # the law is wrong if scatter alone is less probable: one fit in 200
COVERAGE = 0.95  # of an interval


@dataclass(frozen=True, eq=False)
class Statistics:
    """What the points tell of the m unknowns.

    Attributes
    ----------
    covariance
        (m, m) covariance of u.
    told
        (m,) whether the data tell an unknown.
    untold
        (k, m) unit vectors of combinations of u that the data do not tell.
    together
        Groups of unknowns that are told only in combination.
    misfit
        χ² over its degrees of freedom; NaN without any.
    probability
        Probability that scatter alone gives as much misfit, by the least likely curve without
        its points far off; 1 if the search has not converged, which says nothing of the law.
    quantile
        Half an interval over the standard uncertainty.
    """

    covariance: np.ndarray
    told: np.ndarray
    untold: np.ndarray
    together: tuple[tuple[int, ...], ...]
    misfit: float
    probability: float
    quantile: float

    @property
    def law_fails(self) -> bool:
        """Whether the residuals are too large to be scatter."""
        return self.probability < WRONG_LAW


def statistics(end: Evaluation) -> Statistics:
    """Return what the points tell of the unknowns at the end of a fit.

    It follows from the singular values of J, see the head of this module. The covariance is
    multiplied by the misfit where this is above 1.
    """
    r = end.residual
    inverse, s, Vt = pseudo_inverse(end.jacobian)
    s_above_0 = np.maximum(s, LEAST_SINGULAR)  # to divide by
    freedom = len(r) - int((s > LEAST_SINGULAR).sum())
    misfit = float(r @ r) / freedom if freedom > 0 else np.nan
    covariance = covariance_of_points(end.fitted, inverse)
    uncertainty = np.sqrt(np.sum((Vt.T / s_above_0) ** 2, axis=1))
    # repeats may scatter by more than their sigma says
    larger_uncertainty = np.fmax(uncertainty, np.sqrt(np.diag(covariance)))
    untold = Vt[1 / s_above_0 > LARGEST_UNCERTAINTY]
    free_repeats = _free_repeats(end.fitted, freedom)
    probability = 1.0
    if end.is_converged:
        probability = _probability(_without_far_points(end.fitted), freedom / len(r))
    return Statistics(
        covariance=covariance * np.fmax(misfit, 1.0),
        told=(larger_uncertainty <= LARGEST_UNCERTAINTY) & end.is_converged,
        untold=untold,
        together=_groups(untold, uncertainty > LARGEST_UNCERTAINTY),
        misfit=misfit,
        probability=probability,
        quantile=float(stdtrit(free_repeats, 0.5 + COVERAGE / 2)),
    )


def pseudo_inverse(J: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return J⁺ (m, n), the m singular values s of J (n, m), and Vᵀ (m, m).

    Singular values below `LEAST_SINGULAR` count as this, so that J⁺ stays finite.
    """
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    if len(s) < J.shape[1]:
        # with fewer points than unknowns, rows of zeros give the missing singular values, 0
        padding = np.zeros((J.shape[1] - len(s), J.shape[1]))
        U, s, Vt = np.linalg.svd(np.vstack([J, padding]))
    inverse = (Vt.T / np.maximum(s, LEAST_SINGULAR)) @ U[: len(J), : len(s)].T
    return inverse, s, Vt


def covariance_of_points(columns: Sequence[Column], inverse: np.ndarray) -> np.ndarray:
    """Return the covariance (m, m) by the points of columns: the sum of J⁺ Σ J⁺ᵀ over these.

    `inverse` is J⁺ (m, n) of the points of all columns; the errors of different columns are
    independent. For a mean of repeats Σ is the sample covariance of the R repeats over R. For
    another column it is ρ^|i−j| along the curve.
    """
    ends = np.cumsum([len(column.residual) for column in columns])[:-1]
    covariance = np.zeros((len(inverse), len(inverse)))
    for column, inverse_of_column in zip(columns, np.split(inverse, ends, axis=1), strict=True):
        points = column.points
        if points.scatter is not None:
            # (m, R): by how much each repeat alone would move u
            moves = inverse_of_column @ (points.scatter / points.sigma).T
            R = moves.shape[1]
            covariance += moves @ moves.T / (R * (R - 1))
            continue
        order = np.arange(len(column.residual))
        rho = 0.0
        if points.along is not None:
            repeats = 0 * order if points.repeats is None else points.repeats
            order = np.lexsort((points.along, repeats))
            rho = lag_correlation(column.residual[order])
        ordered = inverse_of_column[:, order]
        distance = np.abs(np.subtract.outer(np.arange(len(order)), np.arange(len(order))))
        covariance += ordered @ rho**distance @ ordered.T
    return covariance


def lag_correlation(r: np.ndarray) -> float:
    """Return the correlation ρ ≥ 0 of residuals (n,) with the next ones, along a curve."""
    square = float(r @ r)
    return max(float(r[:-1] @ r[1:]) / square, 0.0) if square else 0.0


def _free_repeats(columns: Sequence[Column], freedom: int) -> int:
    """The least degrees of freedom of an uncertainty."""
    free = [max(freedom, 1)]
    for column in columns:
        if column.points.scatter is not None:
            free.append(len(column.points.scatter) - 1)
    return min(free)


def _groups(untold: np.ndarray, is_weak: np.ndarray) -> tuple[tuple[int, ...], ...]:
    """Unknowns that are told only together: connected by the projection P on what is not told.

    P_ij/√(P_ii P_jj) is 1 where one combination alone is not told, whatever the parts of i and
    j.
    """
    projection = np.abs(untold.T @ untold)
    parts = np.sqrt(np.diag(projection))
    is_linked = projection > LEAST_COSINE_OF_TOGETHER * np.outer(parts, parts)
    linked = is_linked & np.outer(is_weak, is_weak)
    count, labels = connected_components(linked, directed=False)
    groups = (np.flatnonzero((labels == label) & is_weak) for label in range(count))
    return tuple(tuple(int(i) for i in group) for group in groups if len(group))


def _without_far_points(columns: Sequence[Column]) -> Sequence[Column]:
    """Return the columns as they would be fitted without their points far off, to first order."""
    far = [far_points(column) for column in columns]
    if not any(map(len, far)):
        return columns
    kept = [
        replace(
            column,
            residual=np.delete(column.residual, rows),
            jacobian=np.delete(column.jacobian, rows, axis=0),
        )
        for column, rows in zip(columns, far, strict=True)
    ]
    inverse, _, _ = pseudo_inverse(np.concatenate([column.jacobian for column in kept]))
    step = -inverse @ np.concatenate([column.residual for column in kept])
    return [replace(column, residual=column.residual + column.jacobian @ step) for column in kept]


def _probability(columns: Sequence[Column], share: float) -> float:
    """Return the probability that scatter alone gives such large residuals.

    Each column is tested alone: the least probability times the number of columns is returned
    (Bonferroni). Independent errors follow χ². The mean of R repeats follows the F distribution
    with w and w (R − 1) degrees of freedom: w = (tr Σ)²/tr Σ² is the number of independent ways
    in which the repeats differ.

    `share` is the number of degrees of freedom over the number of points. Each column has this
    share of its points as degrees of freedom; without any, it says nothing.
    """
    if share <= 0:
        return 1.0
    probabilities = []
    for column in columns:
        scatter = column.points.scatter
        r = column.residual
        if scatter is None:
            probabilities.append(float(chdtrc(share * len(r), r @ r)))
        elif scatter.any():
            eigenvalues = np.linalg.svd(scatter, compute_uv=False) ** 2  # of Σ, up to a factor
            ways = eigenvalues.sum() ** 2 / (eigenvalues**2).sum()
            mean_square = r @ r / len(r) / share
            free = ways * (len(scatter) - 1)
            probabilities.append(float(fdtrc(ways, free, mean_square)))
    return min(1.0, len(probabilities) * min(probabilities, default=1.0))
