"""How much specimens differ, how far the law is off, and what both mean for the constants.

Curve k of a specimen is y = s f(x; u) (1 + δ) + noise, where f is its change from the start.
ln s has the standard deviation τ over specimens, and δ the standard deviation κ over directions:
the smallest form of the model discrepancy of Kennedy and O'Hagan (2001), Bayesian Calibration of
Computer Models, J. R. Statist. Soc. B 63, 425-464, equation 5.

Let x = f/σ. A specimen whose curve k is larger by the factor 1 + ε moves the fitted unknowns by
ε m_k with m_k = J⁺ x. The amplitude of a curve, ln(measured/computed) over all its points, is
a = ln(1 − z·r) with z = x/(x·x); a change of u changes it by −A·u with A = z J. So a curve d
that is predicted by the curves k with R_k specimens each is off by a variance

    v = τ² (1/R_d + Σ_k w_k²/R_k) + κ² Σ_g (δ_gd − Σ_{k in g} w_k)² + noise,   w_k = A·m_k

where g are directions, and δ_gd = 1 if d is of direction g. τ² is the variance of amplitudes in
one direction. κ is chosen so that curves that are left out of the fit, each in turn, are off by
as much as v says: the mean of a²/v is 1.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtrit

from fecloth.study.fitting.amplitude import Curve, read_curve
from fecloth.study.fitting.evaluation import Column, Evaluation
from fecloth.study.fitting.statistics import (
    COVERAGE,
    LARGEST_UNCERTAINTY,
    covariance_of_points,
    pseudo_inverse,
)

LARGEST_LAW = 10.0  # of κ, where a curve would be off by a factor exp(10)
# A law that is off by κ changes a prediction by less than this part of κ: it has no say in it.
NO_SHARE_OF_LAW = 1e-3


@dataclass(frozen=True, eq=False)
class Solved:
    """What curves tell of the unknowns: moves m_k, and the covariance by the noise of points.

    Attributes
    ----------
    curves
        The K curves.
    moves
        (K, m) changes of u if the curve of a specimen is larger, by its relative change.
    noise
        (m, m) covariance of u by the noise of points.
    step
        (m,) change of u to the least squares of these curves.
    """

    curves: Sequence[Curve]
    moves: np.ndarray
    noise: np.ndarray
    step: np.ndarray

    @classmethod
    def of(cls, curves: Sequence[Curve], others: Sequence[Column]) -> "Solved":
        """Fit the curves, and the `others`, which have no amplitude, to first order."""
        columns = [*(curve.column for curve in curves), *others]
        r = np.concatenate([column.residual for column in columns])
        inverse, _, _ = pseudo_inverse(np.concatenate([column.jacobian for column in columns]))
        ends = np.cumsum([len(column.residual) for column in columns])[:-1]
        parts = np.split(inverse, ends, axis=1)
        moves = [part @ curve.x for part, curve in zip(parts, curves, strict=False)]
        shapes = [*(curve.shape for curve in curves), *others]
        noise = covariance_of_points(shapes, inverse)
        return cls(curves, np.array(moves), noise, -inverse @ r)

    def by_direction(self, weights: np.ndarray) -> dict[Hashable, np.ndarray]:
        """Return the sums of weights (K, ...) of the curves of each direction."""
        sums: dict[Hashable, np.ndarray] = {}
        for curve, weight in zip(self.curves, weights, strict=True):
            sums[curve.direction] = sums.get(curve.direction, 0.0) + weight
        return sums

    def parts(self, curve: Curve) -> "Parts":
        """Return the parts of the variance v of the amplitude of another curve."""
        A = curve.slopes
        w = self.moves @ A
        counts = np.array([known.count for known in self.curves])
        of_directions = self.by_direction(w)
        own = of_directions.pop(curve.direction, 0.0)
        of_law = float((1.0 - own) ** 2)
        return Parts(
            specimens=float(np.sum(w**2 / counts)),
            own_specimens=1 / curve.count,
            law=float(sum(np.square(list(of_directions.values())))) + of_law,
            noise=float(A @ self.noise @ A),
            own_noise=curve.noise,
        )


@dataclass(frozen=True)
class Parts:
    """The factors of τ² and κ², and the noise, in the variance of a predicted amplitude."""

    specimens: float
    own_specimens: float
    law: float
    noise: float
    own_noise: float


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """τ and κ, and what follows from them.

    Attributes
    ----------
    specimens
        τ; NaN if no direction has two specimens and nobody states it.
    law
        κ; NaN if no curve is told by the others, or τ is not known.
    both
        √(τ² + κ²) where τ is not known; NaN if no curve is told by the others, or τ is known.
    experiments
        The number of specimens.
    is_stated
        Whether the user states τ.
    solved
        What the fitted curves tell.
    """

    specimens: float
    law: float
    both: float
    experiments: int
    is_stated: bool
    solved: Solved

    @property
    def quantile(self) -> float:
        """Half of an interval over the standard uncertainty: Student's t, experiments less one.

        The normal distribution where τ is stated.
        """
        free = np.inf if self.is_stated else max(self.experiments - 1, 1)
        return float(stdtrit(free, 0.5 + COVERAGE / 2))

    def covariance(self, is_new: bool) -> np.ndarray:
        """Return the covariance (m, m) of u: of the mean, or of new specimens of all directions.

        τ must be known. A law that no curve puts to the test has no part.
        """
        M = self.solved.moves
        counts = np.array([curve.count for curve in self.solved.curves])
        of_directions = np.array(list(self.solved.by_direction(M).values()))
        new = self.specimens**2 if is_new else 0.0
        V = self.solved.noise + self.specimens**2 * (M.T / counts) @ M
        return V + (np.nan_to_num(self.law) ** 2 + new) * of_directions.T @ of_directions

    def variance(self, curve: Curve) -> float:
        """Return the variance v of the amplitude of a curve that was not fitted.

        It is NaN where a part is not known, or where the constants are not told: where they
        alone leave the amplitude uncertain by more than a factor exp(`LARGEST_UNCERTAINTY`).
        """
        parts = self.solved.parts(curve)
        # without τ, the sum of both stands as one part in its place
        tau, kappa = self.specimens, self.law
        if np.isnan(tau):
            tau, kappa = self.both, 0.0
        law = kappa**2 if parts.law > NO_SHARE_OF_LAW**2 else 0.0
        by_constants = tau**2 * parts.specimens + law * max(parts.law - 1.0, 0.0) + parts.noise
        own = tau**2 * parts.own_specimens + law * min(parts.law, 1.0)
        if not by_constants <= LARGEST_UNCERTAINTY**2:
            return np.nan
        return by_constants + own + parts.own_noise


def find_discrepancy(end: Evaluation, stated: float | None) -> Discrepancy | None:
    """Return τ and κ of the fitted columns at the end of a fit; None if these have no amplitude.

    `stated` is τ as the user states it; None to take it from the specimens.
    """
    pairs = [(column, read_curve(column)) for column in end.fitted]
    curves = [curve for _, curve in pairs if curve]
    others = [column for column, curve in pairs if not curve]
    if not curves:
        return None
    specimens = spread_of_specimens(curves) if stated is None else stated
    scale = spread_by_others(curves, others, np.nan_to_num(specimens))
    is_known = np.isfinite(specimens)
    counts: dict[int, int] = {}
    for curve in curves:
        number = id(curve.column.specimen)
        counts[number] = max(counts.get(number, 0), curve.count)
    return Discrepancy(
        specimens=specimens,
        law=scale if is_known else np.nan,
        both=np.nan if is_known else scale,
        experiments=sum(counts.values()),
        is_stated=stated is not None,
        solved=Solved.of(curves, others),
    )


def spread_of_specimens(curves: Sequence[Curve]) -> float:
    """Return τ: the standard deviation of amplitudes in one direction; NaN without two of one."""
    groups: dict[Hashable, list[np.ndarray]] = {}
    for curve in curves:
        groups.setdefault(curve.direction, []).append(curve.amplitudes)
    square, free = 0.0, 0
    for group in groups.values():
        amplitudes = np.concatenate(group)
        square += float(np.sum((amplitudes - amplitudes.mean()) ** 2))
        free += len(amplitudes) - 1
    return np.sqrt(square / free) if free else np.nan


def spread_by_others(curves: Sequence[Curve], others: Sequence[Column], specimens: float) -> float:
    """Return κ for the given τ: how far curves are off the fit to the other ones.

    The curves of each direction are left out in turn. A curve does not count where the noise of
    points alone leaves its amplitude uncertain by more than a factor exp(`LARGEST_UNCERTAINTY`).
    Return NaN if none counts.
    """
    squares = []
    known = []  # parts of the variance that do not depend on κ
    of_law = []
    for direction in dict.fromkeys(curve.direction for curve in curves):
        kept = [curve for curve in curves if curve.direction != direction]
        if not kept:
            continue
        solved = Solved.of(kept, others)
        for curve in curves:
            if curve.direction != direction:
                continue
            parts = solved.parts(curve)
            if parts.noise > LARGEST_UNCERTAINTY**2:
                continue
            off = curve.amplitude - curve.slopes @ solved.step
            squares.append(off**2)
            of_specimens = specimens**2 * (parts.specimens + parts.own_specimens)
            known.append(of_specimens + parts.noise + parts.own_noise)
            of_law.append(parts.law)
    if not squares:
        return np.nan

    def excess(kappa: float) -> float:
        variances = np.array(known) + kappa**2 * np.array(of_law)
        return float(np.mean(np.array(squares) / variances)) - 1.0

    if excess(0.0) <= 0:
        return 0.0
    return float(brentq(excess, 0.0, LARGEST_LAW))
