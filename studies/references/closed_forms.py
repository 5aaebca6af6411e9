"""Solutions that share no code with the triangles, for tests, studies and benchmarks.

* `hanging_strip`: a strip under its own weight, St. Venant-Kirchhoff, closed form.
* `strip_wave`: the small longitudinal standing wave of a strip, closed form.
* `falling_disk.trampoline`: a clamped disk under gravity that is switched on.

SI units; stiffness Y per width [N/m], density ρ per reference area [kg/m²].
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def hanging_strip(
    X: ArrayLike,
    length: float,
    tensile_stiffness: float,
    areal_density: float,
    gravity: float = 9.81,
) -> Array:
    """Return the downward displacement u(X) of a strip that hangs from X = 0.

    For ν = 0 the problem is one-dimensional. With the stretch λ and S = Y (λ² − 1)/2, the balance
    of the part below X is λ S = ρ g (L − X). With e = λ − 1 and κ = Y/(2 ρ g) this gives

        L − X = κ e (1 + e) (2 + e),    u = ∫ e dX = κ [e² + 2 e³ + ¾ e⁴] from e(X) to e(0),

    without quadrature.

    Parameters
    ----------
    X
        Reference positions, 0 (clamp) to length (free end) [m].
    length, tensile_stiffness, areal_density, gravity
        L [m], Y [N/m], ρ [kg/m²], g [m/s²]; all positive.

    Returns
    -------
    ndarray
        u, the shape of X [m].
    """
    position = np.asarray(X, float)
    scale = tensile_stiffness / (2 * areal_density * gravity)
    clamp = _hanging_strain(np.array(length / scale))
    here = _hanging_strain((length - position) / scale)
    # Near the clamp, e(0)² − e(X)² and the other differences would lose digits. The common factor
    # e(0) − e(X) = X / (κ q) is computed separately; q is the difference quotient of
    # e (1 + e) (2 + e).
    quotient = clamp**2 + clamp * here + here**2 + 3 * (clamp + here) + 2
    total = clamp + here
    product = total + 2 * (clamp**2 + clamp * here + here**2)
    product += 0.75 * total * (clamp**2 + here**2)
    return position / quotient * product


def hanging_strip_strain(
    X: ArrayLike,
    length: float,
    tensile_stiffness: float,
    areal_density: float,
    gravity: float = 9.81,
) -> Array:
    """Return ∂u/∂X = e for the strip of `hanging_strip`, with the same parameters."""
    scale = tensile_stiffness / (2 * areal_density * gravity)
    return _hanging_strain((length - np.asarray(X, float)) / scale)


def hanging_strip_tip(
    length: float, tensile_stiffness: float, areal_density: float, gravity: float = 9.81
) -> float:
    """Return the downward displacement of the free end, κ (e² + 2 e³ + ¾ e⁴), e at the clamp [m].

    Parameters as in `hanging_strip`.
    """
    return float(hanging_strip(length, length, tensile_stiffness, areal_density, gravity))


def hanging_strip_mean(
    length: float, tensile_stiffness: float, areal_density: float, gravity: float = 9.81
) -> float:
    """Return the mean over X in [0, L] of the downward displacement [m].

    Integration by parts gives ∫ u dX = ∫ (L − X) e dX, a polynomial in e at the clamp:

        mean u = κ²/L (4/3 e³ + 9/2 e⁴ + 26/5 e⁵ + 5/2 e⁶ + 3/7 e⁷).

    Parameters as in `hanging_strip`. For small loads it is ρ g L² / (3 Y).
    """
    scale = tensile_stiffness / (2 * areal_density * gravity)
    e = float(_hanging_strain(np.array(length / scale)))
    polynomial = e**3 * (4 / 3 + e * (9 / 2 + e * (26 / 5 + e * (5 / 2 + e * 3 / 7))))
    return scale**2 / length * polynomial


def strip_wave_frequency(
    length: float, tensile_stiffness: float, areal_density: float, mode: int = 1
) -> float:
    """Return the angular frequency ω = (2 mode − 1) π/(2 L) √(Y/ρ) of `strip_wave` [1/s]."""
    return _wave_number(length, mode) * math.sqrt(tensile_stiffness / areal_density)


def strip_wave(
    X: ArrayLike,
    t: ArrayLike,
    length: float,
    tensile_stiffness: float,
    areal_density: float,
    amplitude: float,
    mode: int = 1,
) -> Array:
    """Return a small longitudinal standing wave of a strip, clamped at X = 0, free at X = L.

        u = A sin(k X) cos(ω t),    k = (2 mode − 1) π/(2 L),    ω = k √(Y/ρ)

    solves ρ u_tt = Y u_XX for ν = 0, at rest at t = 0. The relative difference from a
    St. Venant-Kirchhoff strip is of the order of the largest strain, k A.

    Parameters
    ----------
    X, t
        Reference positions in [0, L] [m] and times [s]; broadcast against each other.
    length, tensile_stiffness, areal_density
        L [m], Y [N/m], ρ [kg/m²]; positive.
    amplitude
        A, the displacement of the free end at t = 0, up to the sign (−1)^(mode − 1) [m].
    mode
        1, 2, ...: the strip holds 2 mode − 1 quarter waves.

    Returns
    -------
    ndarray
        u [m].
    """
    omega = strip_wave_frequency(length, tensile_stiffness, areal_density, mode)
    shape = np.sin(_wave_number(length, mode) * np.asarray(X, float))
    return amplitude * shape * np.cos(omega * np.asarray(t, float))


def _hanging_strain(load: Array) -> Array:
    """Return the root e ≥ 0 of e (1 + e) (2 + e) = load, with load = 2 ρ g (L − X)/Y ≥ 0."""
    # The left side is increasing and convex for e ≥ 0, and the start lies above the root: Newton's
    # iteration decreases to the root. 7 steps reach round-off for any load.
    e = np.minimum(load / 2, np.cbrt(load))
    for _ in range(7):
        e = e - (e * (1 + e) * (2 + e) - load) / (2 + e * (6 + 3 * e))
    return e


def _wave_number(length: float, mode: int) -> float:
    return (2 * mode - 1) * math.pi / (2 * length)
