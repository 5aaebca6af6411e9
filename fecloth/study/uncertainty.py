"""The uncertainty of the finest of several values, by published procedures.

With φ_i = φ₀ + α h_i^p on sizes h₁ < h₂ < …, φ₀ the limit and p the observed order:

* Three levels: the grid convergence index (Roache 1994, J. Fluids Eng. 116, 405–413), with p of
  meshes with any ratios (Celik et al. 2008, J. Fluids Eng. 130, 078001), U = F |φ₁ − φ₀|. F =
  1.25 where p lies between 0.5 and the theoretical order P. Otherwise, if p > 0, the
  theoretical order and F = 3 are taken.
* From four levels on: least squares (Eça and Hoekstra 2014, J. Comput. Phys. 262, 104–130). Of
  the fits with p free, with equal weights and with weights ∝ 1/h, the fit with the smaller
  standard deviation σ counts; where p is unreasonable, the best of fits with fixed powers.
  With the data range Δ = (max φ − min φ)/(n − 1) and F = 1.25 (3 where p is unreasonable)

      U = F |φ_fit(h₁) − φ₀| + σ + |φ₁ − φ_fit(h₁)|                      if σ < Δ
      U = 3 σ/Δ (|φ_fit(h₁) − φ₀| + σ + |φ₁ − φ_fit(h₁)|)                otherwise.

Both are stated for order 2; here P takes its place, and the fixed powers are P − 1 and P. They
were fitted to all levels; where p > P the coarse ones spoil such a fit, and the grid
convergence index of the two finest levels with P, F = 3 and the scatter of the free fit is
taken if it is smaller: this is not in the papers. Values that oscillate, diverge or follow no
order get at least three times their range.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from fecloth.errors import InputError, amount

# The factors F of both papers: the uncertainty over the estimated error, where the observed
# order is trusted and where it is not.
SAFE = 1.25
UNSAFE = 3.0
COVERS = 2.0  # standard uncertainties cover 95 % of a normal distribution
# The observed orders p that are trusted: 0.5 <= p <= P + 0.1 (Eça and Hoekstra: 0.5 to 2.1 for
# P = 2).
LEAST_ORDER = 0.5
ORDER_ABOVE_THEORY = 0.1
# The orders among which the best fit is searched. At its ends there is no order.
LOWEST_FITTED_ORDER = 0.05
HIGHEST_FITTED_ORDER = 12.0
# Superconvergence doubles an order at most. Changes that fall faster, up to this margin, are no
# errors that become smaller: as where the coarse levels have another state.
MARGIN_OVER_DOUBLED_THEORY = 0.5
# A range of the values over their size: what differs by less is equal up to what solvers leave.
EQUAL_VALUES = 1e-11


@dataclass(frozen=True)
class Estimate:
    """What successive values say of their limit.

    Attributes
    ----------
    value
        The value of the finest level.
    limit
        The extrapolated value φ₀; the value of the finest level where there is none.
    uncertainty
        U, in the unit of the values: the exact limit is expected in value ± U.
    order
        The observed order; NaN where the values have none.
    theory
        The theoretical order.
    behaviour
        "monotone", "oscillating", "diverging", "without order" (the changes fall, but not as a
        power of the size) or "constant" (equal to round-off).
    scatter
        σ of the fit, 0 with three levels.
    data_range
        Δ; σ ≥ Δ says that the fit shows scatter only.
    procedure
        Name of the procedure.
    """

    value: float
    limit: float
    uncertainty: float
    order: float
    theory: float
    behaviour: str
    scatter: float
    data_range: float
    procedure: str


def estimate_uncertainty(
    sizes: Sequence[float], values: Sequence[float], theory: float
) -> Estimate:
    """Estimate how far the value of the finest level is from the limit of all levels.

    Values that are equal to round-off have their range as uncertainty. Else three levels are
    judged by the grid convergence index, more by least squares.

    Parameters
    ----------
    sizes
        The edge length, or the time step, of each level, in any order.
    values
        The value of each level.
    theory
        The theoretical order P.

    Raises
    ------
    InputError
        For less than three levels, or two levels of the same size.
    """
    from_fine = np.argsort(sizes)
    h = np.asarray(sizes, float)[from_fine]
    fine_first = np.asarray(values, float)[from_fine]
    if len(h) < 3 or not (np.diff(h) > 0).all():
        what = f"{amount(len(np.unique(h)), 'level')} of different size"
        raise InputError(what, "must be at least 3", "estimate_uncertainty")
    spread = float(np.ptp(fine_first))
    if spread <= EQUAL_VALUES * np.abs(fine_first).max():
        finest = float(fine_first[0])
        return Estimate(
            value=finest,
            limit=finest,
            uncertainty=spread,
            order=math.nan,
            theory=theory,
            behaviour="constant",
            scatter=0.0,
            data_range=spread,
            procedure="round-off",
        )
    if len(h) == 3:
        return _grid_convergence_index(h, fine_first, theory)
    return _least_squares(h, fine_first, theory)


def is_reasonable(order: float, theory: float) -> bool:
    """Whether an observed order may be used to extrapolate."""
    return LEAST_ORDER <= order <= theory + ORDER_ABOVE_THEORY


def judge_order(order: float, theory: float) -> str:
    """Return the behaviour of values with a fitted order.

    It is "monotone", "diverging" at the low end of the search, where the changes do not fall, or
    "without order" at the high end, and far above the theory.
    """
    if order <= 1.001 * LOWEST_FITTED_ORDER:
        return "diverging"
    most = min(2 * theory + MARGIN_OVER_DOUBLED_THEORY, 0.999 * HIGHEST_FITTED_ORDER)
    return "monotone" if order < most else "without order"


def _grid_convergence_index(h: np.ndarray, values: np.ndarray, theory: float) -> Estimate:
    """Return the estimate from three levels, fine to coarse (Roache 1994, Celik et al. 2008).

    `h` are the sizes and `values` the values of the levels, `theory` is the theoretical order P.
    Where the values oscillate, diverge or follow no order, there is no limit, and the
    uncertainty is three times their range.
    """
    finest = float(values[0])
    spread = float(np.ptp(values))
    without_limit = Estimate(
        value=finest,
        limit=finest,
        uncertainty=3 * spread,
        order=math.nan,
        theory=theory,
        behaviour="oscillating",
        scatter=0.0,
        data_range=spread / 2,
        procedure="grid convergence index",
    )
    fine_change = values[1] - values[0]
    coarse_change = values[2] - values[1]
    if fine_change * coarse_change <= 0:  # the values go up and down
        return without_limit
    order = observed_order(h, values)
    behaviour = judge_order(order, theory)
    if behaviour != "monotone":
        return replace(without_limit, behaviour=behaviour)
    p = theory
    factor = UNSAFE
    if is_reasonable(order, theory):
        p = order
        factor = SAFE
    extrapolated = float(fine_change / ((h[1] / h[0]) ** p - 1))  # φ₀ = φ₁ − this
    return replace(
        without_limit,
        limit=finest - extrapolated,
        uncertainty=factor * abs(extrapolated),
        order=order,
        behaviour="monotone",
    )


def observed_order(h: np.ndarray, values: np.ndarray) -> float:
    """Return p of three levels, fine to coarse: (h₃^p − h₂^p)/(h₂^p − h₁^p) = Δφ₃₂/Δφ₂₁.

    The order is at least −1 and at most `HIGHEST_FITTED_ORDER`. It is negative where the
    differences grow, and 0 where they stay the same. It is NaN where their sign changes.
    """
    fine_change = values[1] - values[0]
    coarse_change = values[2] - values[1]
    if fine_change * coarse_change <= 0:
        return math.nan
    log_h = np.log(h / h[0])
    log_change = math.log(coarse_change / fine_change)

    def mismatch(p: float) -> float:
        """Return the logarithm of the left side over the right side; it rises with p."""
        fine_part = np.expm1(p * log_h[1])
        coarse_part = np.exp(p * log_h[1]) * np.expm1(p * (log_h[2] - log_h[1]))
        return math.log(coarse_part / fine_part) - log_change

    # both parts of `mismatch` are 0 at p = 0, so it is evaluated beside 0 only
    if mismatch(-1e-9) <= 0 <= mismatch(1e-9):
        return 0.0
    mismatch_at_zero = math.log((log_h[2] - log_h[1]) / log_h[1]) - log_change  # its limit there
    if mismatch_at_zero >= 0:  # it rises with p, so the order is below 0
        if mismatch(-1.0) > 0:
            return -1.0
        return float(brentq(mismatch, -1.0, -1e-9))
    if mismatch(HIGHEST_FITTED_ORDER) < 0:
        return HIGHEST_FITTED_ORDER
    return float(brentq(mismatch, 1e-9, HIGHEST_FITTED_ORDER))


@dataclass(frozen=True)
class _Fit:
    """φ₀ + Σ α h^p by weighted least squares.

    Attributes
    ----------
    limit
        φ₀.
    finest
        The fitted value of the finest level, φ_fit(h₁).
    deviation
        The standard deviation σ.
    order
        The first power p.
    """

    limit: float
    finest: float
    deviation: float
    order: float


def _least_squares(h: np.ndarray, values: np.ndarray, theory: float) -> Estimate:
    """Return the estimate from four or more levels, fine to coarse (Eça and Hoekstra 2014).

    `h` are the sizes and `values` the values of the levels, `theory` is the theoretical order P.
    Where the values oscillate, diverge or follow no order, there is no limit and no order, and
    the uncertainty is at least three times the range of the three finest levels.
    """
    weightings = [np.ones(len(h)), len(h) / h / np.sum(1 / h)]  # equal ones, and ∝ 1/h
    free_fits = [_fit_order(h, values, weights) for weights in weightings]
    trusted_fits = [fit for fit in free_fits if is_reasonable(fit.order, theory)]
    closest = min(trusted_fits or free_fits, key=lambda fit: fit.deviation)
    data_range = float(np.ptp(values)) / (len(h) - 1)
    if trusted_fits:
        limit = closest.limit
        uncertainty = _uncertainty(closest, values[0], data_range, SAFE)
    else:
        limit, uncertainty = _estimate_with_fixed_powers(
            h, values, theory, weightings, closest, data_range
        )
    behaviour = _describe_behaviour(values)
    order = closest.order
    if behaviour == "monotone":
        behaviour = judge_order(order, theory)
    if behaviour != "monotone":
        uncertainty = max(uncertainty, UNSAFE * np.ptp(values[:3]))
        limit = float(values[0])
        order = math.nan
    return Estimate(
        value=float(values[0]),
        limit=limit,
        uncertainty=float(uncertainty),
        order=order,
        theory=theory,
        behaviour=behaviour,
        scatter=closest.deviation,
        data_range=data_range,
        procedure="least squares",
    )


def _estimate_with_fixed_powers(
    h: np.ndarray,
    values: np.ndarray,
    theory: float,
    weightings: Sequence[np.ndarray],
    free: _Fit,
    data_range: float,
) -> tuple[float, float]:
    """Return limit and uncertainty where the observed order cannot be trusted.

    They are of the best fit with fixed powers of h. If the observed order is above the
    theoretical one, the grid convergence index of the two finest levels is taken instead, if its
    uncertainty is the smaller one: coarse levels spoil the fits then.

    Parameters
    ----------
    h, values
        Size and value of each level, fine to coarse.
    theory
        The theoretical order P.
    weightings
        The weights of the levels, for each of the fits that are tried.
    free
        The best fit with a free order.
    data_range
        Δ, see the head of this file.
    """
    fits = []
    for weights in weightings:
        for powers in _fixed_powers(free.order, theory):
            fits.append(_fit_powers(h, values, weights, powers))
    fit = min(fits, key=lambda fit: fit.deviation)
    uncertainty = _uncertainty(fit, values[0], data_range, UNSAFE)
    if free.order > theory:
        extrapolated = float(values[1] - values[0]) / ((h[1] / h[0]) ** theory - 1)
        scatter = free.deviation + abs(values[0] - free.finest)
        convergence_index = UNSAFE * abs(extrapolated) + scatter
        if convergence_index < uncertainty:
            return float(values[0]) - extrapolated, convergence_index
    return fit.limit, uncertainty


def _uncertainty(fit: _Fit, finest: float, data_range: float, factor: float) -> float:
    """Return U of a fit with F = `factor`; `finest` is the value of the finest level."""
    error = abs(fit.finest - fit.limit)
    scatter = fit.deviation + abs(finest - fit.finest)
    if fit.deviation < data_range:
        return factor * error + scatter
    return UNSAFE * fit.deviation / data_range * (error + scatter)


def _describe_behaviour(values: np.ndarray) -> str:
    """Return how values, fine to coarse, behave; one change of sign may be scatter."""
    changes = np.diff(values)
    if (changes[:2] * changes[1:3] < 0).all():
        return "oscillating"
    if abs(changes[0]) >= np.abs(changes[1:]).max():
        return "diverging"
    return "monotone"


def _fixed_powers(order: float, theory: float) -> list[tuple[float, ...]]:
    """Return the powers of h of each fit that is tried in place of the observed order.

    A fit has one power, or two. If `order` is above P = `theory`, the powers are P − 1, but at
    least 1, and P. Else they are 1, and P, but at least 2.
    """
    if order > theory:
        return [(max(theory - 1, 1.0),), (theory,)]
    low = 1.0
    high = max(theory, 2.0)
    if order < LEAST_ORDER:
        return [(low,), (high,), (low, high)]
    return [(low,), (high,)]


def _fit_order(h: np.ndarray, values: np.ndarray, weights: np.ndarray) -> _Fit:
    """Return the best fit with a free order p, which has the least standard deviation.

    The search first tries a grid of orders; then it goes on between the neighbours of the best
    of them.
    """

    def deviation(p: float) -> float:
        return _fit_powers(h, values, weights, (p,)).deviation

    grid = np.geomspace(LOWEST_FITTED_ORDER, HIGHEST_FITTED_ORDER, 60)
    best = int(np.argmin([deviation(p) for p in grid]))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    options = {"xatol": 1e-9}
    minimum = minimize_scalar(deviation, bounds=bounds, method="bounded", options=options)
    return _fit_powers(h, values, weights, (float(minimum.x),))


def _fit_powers(
    h: np.ndarray, values: np.ndarray, weights: np.ndarray, powers: tuple[float, ...]
) -> _Fit:
    """Return the fit of φ₀ + Σ α h^p to the values, by least squares with weights.

    The sum is over the powers p. The sizes are divided by the largest one, which changes α only.
    """
    design = np.column_stack([np.ones(len(h)), *((h / h[-1]) ** p for p in powers)])
    root = np.sqrt(weights)
    coefficients = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
    fitted = design @ coefficients
    unknowns = max(1 + len(powers), 3)  # φ₀, α and p, also where p is fixed; or φ₀ and two α
    degrees_of_freedom = max(len(h) - unknowns, 1)
    variance = np.sum(weights * (values - fitted) ** 2) / degrees_of_freedom
    return _Fit(
        limit=float(coefficients[0]),
        finest=float(fitted[0]),
        deviation=float(np.sqrt(variance)),
        order=powers[0],
    )
