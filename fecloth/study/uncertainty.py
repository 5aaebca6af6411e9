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
taken if it is smaller: this is not in the papers. Values that oscillate or diverge get at
least three times their range.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from fecloth.errors import InputError, amount

SAFE = 1.25
UNSAFE = 3.0
LEAST, ABOVE = 0.5, 0.1  # orders that are trusted: from 0.5 to the theoretical one + 0.1
SEARCHED = 0.05, 12.0  # orders that are searched
ROUND_OFF = 1e-11  # relative to the values; what solvers leave


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
        "monotone", "oscillating", "diverging" or "constant" (equal to round-off).
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
    """Return the estimate from three or more different levels in any order, or `InputError`."""
    order = np.argsort(sizes)
    h = np.asarray(sizes, float)[order]
    fine_first = np.asarray(values, float)[order]
    if len(h) < 3 or not (np.diff(h) > 0).all():
        what = f"{amount(len(np.unique(h)), 'level')} of different size"
        raise InputError(what, "must be at least 3", "estimate_uncertainty")
    spread = float(np.ptp(fine_first))
    if spread <= ROUND_OFF * np.abs(fine_first).max():
        first = float(fine_first[0])
        return Estimate(
            first, first, spread, math.nan, theory, "constant", 0.0, spread, "round-off"
        )
    if len(h) == 3:
        return _grid_convergence_index(h, fine_first, theory)
    return _least_squares(h, fine_first, theory)


def is_reasonable(order: float, theory: float) -> bool:
    """Whether an observed order may be used to extrapolate."""
    return LEAST <= order <= theory + ABOVE


def _grid_convergence_index(h: np.ndarray, values: np.ndarray, theory: float) -> Estimate:
    fine = values[1] - values[0]
    coarse = values[2] - values[1]
    name = "grid convergence index"
    spread = float(np.ptp(values))
    first = float(values[0])
    half = spread / 2
    nothing = Estimate(first, first, 3 * spread, math.nan, theory, "", 0.0, half, name)
    if fine * coarse <= 0:
        return replace(nothing, behaviour="oscillating")
    order = observed_order(h, values)
    if not order > 0:
        return replace(nothing, order=order, behaviour="diverging")
    if is_reasonable(order, theory):
        p, factor = (order, SAFE)
    else:
        p, factor = (theory, UNSAFE)
    error = float(fine / ((h[1] / h[0]) ** p - 1))  # φ₁ − φ₀ with the sign reversed
    return replace(
        nothing,
        limit=float(values[0]) - error,
        uncertainty=factor * abs(error),
        order=order,
        behaviour="monotone",
    )


def observed_order(h: np.ndarray, values: np.ndarray) -> float:
    """Return p of three levels, fine to coarse: (h₃^p − h₂^p)/(h₂^p − h₁^p) = Δφ₃₂/Δφ₂₁."""
    # It is negative where the differences grow, and NaN where their sign changes.
    fine = values[1] - values[0]
    coarse = values[2] - values[1]
    if fine * coarse <= 0:
        return math.nan
    x = np.log(h / h[0])

    def mismatch(p: float) -> float:
        low = np.expm1(p * x[1])
        high = np.exp(p * x[1]) * np.expm1(p * (x[2] - x[1]))
        return math.log(high / low) - math.log(coarse / fine)

    at_zero = math.log((x[2] - x[1]) / x[1]) - math.log(coarse / fine)
    if at_zero >= 0:
        if mismatch(-1.0) > 0:
            return -1.0
        return float(brentq(mismatch, -1.0, -1e-9))
    if mismatch(SEARCHED[1]) < 0:
        return SEARCHED[1]
    return float(brentq(mismatch, 1e-9, SEARCHED[1]))


@dataclass(frozen=True)
class _Fit:
    """φ₀ + Σ α h^p by weighted least squares, its standard deviation and the observed order."""

    limit: float
    finest: float
    deviation: float
    order: float


def _least_squares(h: np.ndarray, values: np.ndarray, theory: float) -> Estimate:
    weights = (np.ones(len(h)), len(h) / h / np.sum(1 / h))
    free = [_fit_order(h, values, w) for w in weights]
    reasonable = [fit for fit in free if is_reasonable(fit.order, theory)]
    closest = min(reasonable or free, key=lambda fit: fit.deviation)
    spread = float(np.ptp(values)) / (len(h) - 1)
    behaviour = _behaviour(values)
    if reasonable:
        fit = closest
        uncertainty = _uncertainty(closest, values[0], spread, SAFE)
    else:
        powers = _powers(closest.order, theory)
        fits = [_fit_powers(h, values, w, p) for w in weights for p in powers]
        fit = min(fits, key=lambda fit: fit.deviation)
        uncertainty = _uncertainty(fit, values[0], spread, UNSAFE)
        if closest.order > theory:
            fit, uncertainty = _take_smaller(fit, uncertainty, closest, h, values, theory)
    limit = fit.limit
    if behaviour != "monotone":
        uncertainty = max(uncertainty, UNSAFE * np.ptp(values[:3]))
        limit = float(values[0])
    return Estimate(
        value=float(values[0]),
        limit=limit,
        uncertainty=float(uncertainty),
        order=closest.order if behaviour == "monotone" else math.nan,
        theory=theory,
        behaviour=behaviour,
        scatter=closest.deviation,
        data_range=spread,
        procedure="least squares",
    )


def _uncertainty(fit: _Fit, finest: float, spread: float, factor: float) -> float:
    parts = abs(fit.finest - fit.limit), fit.deviation + abs(finest - fit.finest)
    if fit.deviation < spread:
        return factor * parts[0] + parts[1]
    return UNSAFE * fit.deviation / spread * sum(parts)


def _take_smaller(
    fit: _Fit, uncertainty: float, free: _Fit, h: np.ndarray, values: np.ndarray, theory: float
) -> tuple[_Fit, float]:
    """Return the grid convergence index of the two finest levels, where it is the smaller one."""
    error = float(values[1] - values[0]) / ((h[1] / h[0]) ** theory - 1)
    index = UNSAFE * abs(error) + free.deviation + abs(values[0] - free.finest)
    if index >= uncertainty:
        return fit, uncertainty
    first = float(values[0])
    return _Fit(first - error, first, free.deviation, free.order), index


def _behaviour(values: np.ndarray) -> str:
    """Return how values, fine to coarse, behave; one change of sign may be scatter."""
    steps = np.diff(values)
    if (steps[:2] * steps[1:3] < 0).all():
        return "oscillating"
    if abs(steps[0]) >= np.abs(steps[1:]).max():
        return "diverging"
    return "monotone"


def _powers(order: float, theory: float) -> list[tuple[float, ...]]:
    """Return the powers of the fits with fixed order, where the free one is unreasonable."""
    if order > theory:
        low, high = (max(theory - 1, 1.0), theory)
    else:
        low, high = (1.0, max(theory, 2.0))
    single: list[tuple[float, ...]] = [(low,), (high,)]
    return single + ([(low, high)] if order < LEAST else [])


def _fit_order(h: np.ndarray, values: np.ndarray, weights: np.ndarray) -> _Fit:
    """Return the best fit with a free order: a search on a grid, then between its neighbours."""

    def deviation(p: float) -> float:
        return _fit_powers(h, values, weights, (p,)).deviation

    grid = np.geomspace(*SEARCHED, 60)
    least = int(np.argmin([deviation(p) for p in grid]))
    bounds = grid[max(least - 1, 0)], grid[min(least + 1, len(grid) - 1)]
    minimum = minimize_scalar(deviation, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    return _fit_powers(h, values, weights, (float(minimum.x),))


def _fit_powers(
    h: np.ndarray, values: np.ndarray, weights: np.ndarray, powers: tuple[float, ...]
) -> _Fit:
    """Return the fit with these powers; with p free it has one unknown more."""
    design = np.column_stack([np.ones(len(h)), *((h / h[-1]) ** p for p in powers)])
    root = np.sqrt(weights)
    solution = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
    fitted = design @ solution
    unknowns = 3 if len(powers) == 1 else 1 + len(powers)
    left = max(len(h) - unknowns, 1)
    deviation = float(np.sqrt(np.sum(weights * (values - fitted) ** 2) / left))
    return _Fit(float(solution[0]), float(fitted[0]), deviation, powers[0])
