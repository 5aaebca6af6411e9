"""What the points of a fit tell: covariance, what is not told, and whether the law can meet them.

With the residuals r in units of their uncertainty and J = ∂r/∂u, the covariance of u is J⁺ Σ
J⁺ᵀ, J⁺ = (JᵀJ)⁻¹Jᵀ, where Σ is 1 for independent errors and, for the mean of R repeats, their
sample covariance over R. Singular values s of J are the inverse of the uncertainties of
combinations of u. Source: Seber and Wild (1989), Nonlinear Regression, chapters 2 and 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.sparse.csgraph import connected_components

from fecloth.study.fitting.evaluation import Column, Evaluation

UNTOLD = 0.5  # standard uncertainty of u above which the data do not tell it: a factor of 1.65
LEAST_SINGULAR = 1e-2  # below it, a combination is known to no better than exp(100)
TOGETHER = 0.05  # cosine of two unknowns in what is not told, above which they are told together
LEVEL = 0.005  # probability of the scatter below which the law is wrong
COVERAGE = 0.95  # of an interval


@dataclass(frozen=True, eq=False)
class Statistics:
    """What the points tell of the unknowns."""

    covariance: np.ndarray  # (m, m) of u
    told: np.ndarray  # (m,) whether the data tell an unknown
    untold: np.ndarray  # (k, m) unit vectors of combinations of u that the data do not tell
    together: tuple[tuple[int, ...], ...]  # unknowns that are told only in combination
    misfit: float  # χ² over its degrees of freedom; NaN without any
    probability: float  # of scatter that gives as much misfit, by the least likely curve
    quantile: float  # half an interval over the standard uncertainty

    @property
    def law_fails(self) -> bool:
        return self.probability < LEVEL


def statistics(end: Evaluation) -> Statistics:
    J = end.jacobian
    r = end.residual
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    if len(s) < J.shape[1]:  # fewer points than unknowns
        U, s, Vt = np.linalg.svd(np.vstack([J, np.zeros((J.shape[1] - len(s), J.shape[1]))]))
    kept = np.maximum(s, LEAST_SINGULAR)
    spread = np.sqrt(np.sum((Vt.T / kept) ** 2, axis=1))
    known = 1 / kept <= UNTOLD
    inverse = (Vt.T / kept) @ U[: len(r), : len(s)].T  # J⁺
    freedom = len(r) - int((s > LEAST_SINGULAR).sum())
    misfit = float(r @ r) / freedom if freedom > 0 else np.nan
    covariance = _covariance(end.fitted, inverse)
    told = np.fmax(spread, np.sqrt(np.diag(covariance))) <= UNTOLD  # repeats may scatter by more
    return Statistics(
        covariance * np.fmax(misfit, 1.0),
        told,
        Vt[~known],
        _groups(Vt[~known], spread > UNTOLD),
        misfit,
        _probability(end.fitted, freedom / len(r)),
        float(stats.t.ppf(0.5 + COVERAGE / 2, _free_repeats(end.fitted, freedom))),
    )


def _covariance(columns: Sequence[Column], inverse: np.ndarray) -> np.ndarray:
    """Σ over the columns of J⁺ Σ J⁺ᵀ."""
    ends = np.cumsum([len(column.residual) for column in columns])[:-1]
    total = np.zeros((len(inverse), len(inverse)))
    for column, part in zip(columns, np.split(inverse, ends, axis=1), strict=True):
        points = column.points
        if points.scatter is None:
            total += part @ part.T
        else:
            repeats = part @ (points.scatter / points.sigma).T  # (m, R): u of each repeat
            R = repeats.shape[1]
            total += repeats @ repeats.T / (R * (R - 1))
    return total


def _free_repeats(columns: Sequence[Column], freedom: int) -> int:
    """The least degrees of freedom of an uncertainty."""
    scatters = [column.points.scatter for column in columns]
    return min([max(freedom, 1), *(len(each) - 1 for each in scatters if each is not None)])


def _groups(untold: np.ndarray, is_weak: np.ndarray) -> tuple[tuple[int, ...], ...]:
    """Unknowns that are told only together: connected by the projection P on what is not told.

    P_ij/√(P_ii P_jj) is 1 where one combination alone is not told, whatever the parts of i and
    j.
    """
    projection = np.abs(untold.T @ untold)
    parts = np.sqrt(np.diag(projection))
    linked = (projection > TOGETHER * np.outer(parts, parts)) & np.outer(is_weak, is_weak)
    count, labels = connected_components(linked, directed=False)
    groups = (np.flatnonzero((labels == label) & is_weak) for label in range(count))
    return tuple(tuple(int(i) for i in group) for group in groups if len(group))


def _probability(columns: Sequence[Column], share: float) -> float:
    """The probability that scatter alone gives such residuals, by the least likely part.

    Independent errors follow χ². The mean of R repeats follows F with R − 1 degrees of freedom
    below, and above with the number of ways in which the repeats differ, (tr Σ)²/tr Σ².
    """
    single = [column.residual for column in columns if column.points.scatter is None]
    r = np.concatenate([*single, []])
    probabilities = [1.0]
    if (freedom := share * len(r)) > 0:
        probabilities.append(float(stats.chi2.sf(r @ r, freedom)))
    for column in columns:
        scatter = column.points.scatter
        r = column.residual
        if scatter is not None and share > 0:
            values = np.linalg.svd(scatter, compute_uv=False) ** 2
            ways = values.sum() ** 2 / (values**2).sum()
            mean = r @ r / len(r) / share
            probabilities.append(float(stats.f.sf(mean, ways, len(scatter) - 1)))
    return min(probabilities)
