"""Solutions that share no code with the triangles: for tests, studies and benchmarks.

* `hanging_strip`: a strip under its own weight, St. Venant-Kirchhoff, closed form.
* `trampoline`: a clamped disk on which gravity is switched on, one-dimensional in the radius.
* `strip_wave`: the small longitudinal standing wave of a strip, closed form.

SI units; stiffness Y per width [N/m], density ρ per reference area [kg/m²].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def hanging_strip(
    X: ArrayLike,
    length: float,
    tensile_stiffness: float,
    areal_density: float,
    gravity: float = 9.81,
) -> Array:
    """Downward displacement u(X) of a strip that hangs from X = 0 under its own weight.

    Exactly one-dimensional for ν = 0. With the stretch λ and S = Y (λ² − 1)/2 the balance of the
    part below X reads λ S = ρ g (L − X). With e = λ − 1 and κ = Y/(2 ρ g) it is

        L − X = κ e (1 + e) (2 + e),    u = ∫ e dX = κ [e² + 2 e³ + ¾ e⁴] from e(X) to e(0),

    so no quadrature is needed.

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

    Raises
    ------
    ValueError
        For a constant that is not positive and finite, or an X outside the strip.
    """
    _positive(
        length=length,
        tensile_stiffness=tensile_stiffness,
        areal_density=areal_density,
        gravity=gravity,
    )
    position = _inside(X, length)
    scale = tensile_stiffness / (2 * areal_density * gravity)
    clamp = _hanging_strain(np.array(length / scale))
    here = _hanging_strain((length - position) / scale)
    # e(0)² − e(X)² and its like are differences of close numbers near the clamp; with the factor
    # e(0) − e(X) = X / (κ q) taken out they keep their digits. q is the difference quotient of
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
    """∂u/∂X = e of `hanging_strip`, whose parameters it takes."""
    _positive(
        length=length,
        tensile_stiffness=tensile_stiffness,
        areal_density=areal_density,
        gravity=gravity,
    )
    scale = tensile_stiffness / (2 * areal_density * gravity)
    return _hanging_strain((length - _inside(X, length)) / scale)


def hanging_strip_tip(
    length: float, tensile_stiffness: float, areal_density: float, gravity: float = 9.81
) -> float:
    """Downward displacement of the free end, κ (e² + 2 e³ + ¾ e⁴) with e at the clamp [m].

    Parameters and errors as in `hanging_strip`.
    """
    return float(hanging_strip(length, length, tensile_stiffness, areal_density, gravity))


def hanging_strip_mean(
    length: float, tensile_stiffness: float, areal_density: float, gravity: float = 9.81
) -> float:
    """Mean over X in [0, L] of the downward displacement [m].

    By parts, ∫ u dX = ∫ (L − X) e dX, again a polynomial in e at the clamp:

        mean u = κ²/L (4/3 e³ + 9/2 e⁴ + 26/5 e⁵ + 5/2 e⁶ + 3/7 e⁷).

    Parameters and errors as in `hanging_strip`. Small loads: ρ g L² / (3 Y).
    """
    _positive(
        length=length,
        tensile_stiffness=tensile_stiffness,
        areal_density=areal_density,
        gravity=gravity,
    )
    scale = tensile_stiffness / (2 * areal_density * gravity)
    e = float(_hanging_strain(np.array(length / scale)))
    polynomial = e**3 * (4 / 3 + e * (9 / 2 + e * (26 / 5 + e * (5 / 2 + e * 3 / 7))))
    return scale**2 / length * polynomial


def strip_wave_frequency(
    length: float, tensile_stiffness: float, areal_density: float, mode: int = 1
) -> float:
    """Angular frequency ω = (2 mode − 1) π/(2 L) √(Y/ρ) of `strip_wave` [1/s]."""
    _positive(
        length=length, tensile_stiffness=tensile_stiffness, areal_density=areal_density, mode=mode
    )
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
    """Small longitudinal standing wave of a strip, ν = 0, clamped at X = 0 and free at X = L.

        u = A sin(k X) cos(ω t),    k = (2 mode − 1) π/(2 L),    ω = k √(Y/ρ)

    solves ρ u_tt = Y u_XX, at rest at t = 0. A St. Venant-Kirchhoff strip departs from it by a
    relative amount of the order of its largest strain, k A.

    Parameters
    ----------
    X, t
        Reference positions in [0, L] [m] and times [s]; broadcast against each other.
    length, tensile_stiffness, areal_density
        L [m], Y [N/m], ρ [kg/m²]; positive.
    amplitude
        A, the displacement of the free end at t = 0, up to the sign (−1)^(mode − 1) [m].
    mode
        1, 2, ...: number of quarter-wave branches, 2 mode − 1 quarter waves on the strip.

    Returns
    -------
    ndarray
        u [m].

    Raises
    ------
    ValueError
        For a constant that is not admissible, or an X outside the strip.
    """
    omega = strip_wave_frequency(length, tensile_stiffness, areal_density, mode)
    if not math.isfinite(amplitude):
        raise ValueError(f"amplitude = {amplitude!r} must be finite")
    shape = np.sin(_wave_number(length, mode) * _inside(X, length))
    return amplitude * shape * np.cos(omega * np.asarray(t, float))


@dataclass(frozen=True)
class Trampoline:
    """Motion of the disk of `trampoline`, one row for each of the times.

    Attributes
    ----------
    times
        t, as given [s].
    mean_deflection
        (1/(π a²)) ∫ w dA over the reference disk, downward positive [m].
    centre
        w(0, t) [m].
    kinetic_energy, elastic_energy
        Of the whole disk [J]. Their sum is gravity's work ρ g π a² mean_deflection, up to the
        error of the time step.
    least_stress
        Smallest of the second Piola-Kirchhoff stresses S_r, S_θ over the disk at that time [N/m];
        negative: a real cloth would wrinkle there.
    """

    times: Array
    mean_deflection: Array
    centre: Array
    kinetic_energy: Array
    elastic_energy: Array
    least_stress: Array


def trampoline(
    times: ArrayLike,
    radius: float = 0.5,
    tensile_stiffness: float = 1000.0,
    poisson_ratio: float = 0.3,
    areal_density: float = 0.2,
    gravity: float = 9.81,
    elements: int = 400,
    courant: float = 0.5,
) -> Trampoline:
    """Fall of a disk, clamped at its rim, flat and unstressed until gravity acts at t = 0.

    Axisymmetric, undamped, no bending. With the radial displacement u(R, t) and the deflection
    w(R, t),

        λ_r² = (1 + u')² + w'²,    λ_θ = 1 + u/R,    E = (λ² − 1)/2,
        W = Y/(2 (1 − ν²)) (E_r² + E_θ² + 2 ν E_r E_θ),

    and the action ∫∫ (ρ (u_t² + w_t²)/2 − W + ρ g w) 2πR dR dt is made stationary: linear
    elements in R of equal size with one Gauss point, each node carrying the mass of the ring
    between the neighbouring midpoints, and velocity Verlet in time (E. Hairer, C. Lubich,
    G. Wanner, Acta Numerica 12 (2003) 399-450). Each gap between two times is cut into equal
    steps, so that the times are met exactly.

    Parameters
    ----------
    times
        Times of the output, ≥ 0 and strictly increasing [s].
    radius, tensile_stiffness, areal_density, gravity
        a [m], Y [N/m], ρ [kg/m²], g [m/s²]; positive.
    poisson_ratio
        ν of plane stress, −1 < ν < 1 [-].
    elements
        Number of elements along the radius, at least 2.
    courant
        Largest step over h √(ρ (1 − ν²)/Y), the time a radial wave of the unstretched disk takes
        through an element; stable below 1, less as the disk stretches.

    Returns
    -------
    Trampoline
        The motion at the times.

    Raises
    ------
    ValueError
        For a constant or a time that is not admissible.
    RuntimeError
        Where the disk stretched so far that the step was no longer stable; lower courant.

    Notes
    -----
    Default values, t ≤ 0.2 s, against 4800 elements: the mean deflection is off by less than
    1e-4 of its peak, 23.7 mm; the centre is in free fall to rounding until 0.112 s, and off by
    up to 0.6 mm after 0.117 s, when the front from the rim has focused there. Each halving of h
    halves these, no better: the focused front leaves kinks behind. From 0.17 s on, fine meshes
    show short spells of compression (1 N/m) within a few elements of the centre.
    """
    _positive(
        radius=radius,
        tensile_stiffness=tensile_stiffness,
        areal_density=areal_density,
        gravity=gravity,
        courant=courant,
    )
    if not -1 < poisson_ratio < 1:
        raise ValueError(f"poisson_ratio = {poisson_ratio!r} must lie in (-1, 1)")
    if elements != int(elements) or elements < 2:
        raise ValueError(f"elements = {elements!r} must be a whole number, at least 2")
    instants = np.array(times, dtype=float, ndmin=1)
    gaps = np.diff(instants, prepend=0.0)
    if instants.ndim != 1 or not np.isfinite(instants).all():
        raise ValueError("times must be one row of finite numbers")
    if (gaps[1:] <= 0).any() or (gaps[:1] < 0).any():
        raise ValueError("times must be at least 0 and strictly increasing")

    plane = tensile_stiffness / (1 - poisson_ratio**2)
    limit = courant * radius / elements * math.sqrt(areal_density / plane)
    steps = np.ceil(gaps / limit).astype(np.int64)
    mass = areal_density * _ring_areas(radius, int(elements))
    rows, stiffening = _march(gaps, steps, mass, radius, plane, poisson_ratio, gravity)
    # Not "courant² stiffening > 1": NaN, which an unstable run ends in, has to count as failed.
    if not courant**2 * stiffening < 1:
        raise RuntimeError(
            f"trampoline: the disk stretched too far for courant = {courant!r} "
            f"(its radial stiffness grew by the factor {stiffening:.3g}); lower courant"
        )
    return Trampoline(instants, *rows.T)


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} = {value!r} must be positive and finite")


def _inside(X: ArrayLike, length: float) -> Array:
    position = np.asarray(X, float)
    if not np.all((position >= 0) & (position <= length)):
        raise ValueError(f"X must lie in [0, length] = [0, {length!r}]")
    return position


def _hanging_strain(load: Array) -> Array:
    """Root e ≥ 0 of e (1 + e) (2 + e) = load, for load = 2 ρ g (L − X)/Y ≥ 0."""
    # The left side is increasing and convex for e ≥ 0 and both guesses lie above the root, so
    # Newton comes down to it without overshooting; 7 steps reach rounding for any load.
    e = np.minimum(load / 2, np.cbrt(load))
    for _ in range(7):
        e = e - (e * (1 + e) * (2 + e) - load) / (2 + e * (6 + 3 * e))
    return e


def _wave_number(length: float, mode: int) -> float:
    if mode != int(mode):
        raise ValueError(f"mode = {mode!r} must be a whole number")
    return (2 * mode - 1) * math.pi / (2 * length)


def _ring_areas(radius: float, elements: int) -> Array:
    """Area of the ring of each node, from midpoint to midpoint; they add up to π a²."""
    # Not the row sums of the consistent mass: at the centre those give π h²/3 for the disk of
    # radius h/2, which gets the acceleration there wrong by a quarter on any mesh.
    h = radius / elements
    edges = np.concatenate([[0.0], (np.arange(elements) + 0.5) * h, [radius]])
    return math.pi * np.diff(edges**2)


@njit(cache=True)
def _internal(u, w, h, plane, nu, fu, fw):
    """Set fu, fw to the elastic forces on the nodes; return energy, least stress, stiffening."""
    fu[:] = 0.0
    fw[:] = 0.0
    energy = 0.0
    least = np.inf
    stiffening = 1.0
    for i in range(u.size - 1):
        middle = (i + 0.5) * h
        area = 2 * np.pi * middle * h
        stretch = 1 + (u[i + 1] - u[i]) / h
        slope = (w[i + 1] - w[i]) / h
        hoop = 1 + 0.5 * (u[i] + u[i + 1]) / middle
        strain_r = 0.5 * (stretch * stretch + slope * slope - 1)
        strain_t = 0.5 * (hoop * hoop - 1)
        stress_r = plane * (strain_r + nu * strain_t)
        stress_t = plane * (strain_t + nu * strain_r)
        energy += 0.5 * area * (stress_r * strain_r + stress_t * strain_t)
        least = min(least, stress_r, stress_t)
        # largest eigenvalue of ∂P_r/∂(u', w') over its value at rest
        stiffening = max(stiffening, 1 + 2 * strain_r + stress_r / plane)
        radial = stress_r * stretch * area / h
        vertical = stress_r * slope * area / h
        ring = 0.5 * stress_t * hoop * area / middle
        fu[i] += radial - ring
        fu[i + 1] -= radial + ring
        fw[i] += vertical
        fw[i + 1] -= vertical
    fu[0] = 0.0  # the axis stays on the axis
    return energy, least, stiffening


@njit(cache=True)
def _kick(velocity, force, mass, acceleration, dt):
    # without the last node: the rim is clamped
    for i in range(velocity.size - 1):
        velocity[i] += dt * (force[i] / mass[i] + acceleration)


@njit(cache=True)
def _march(gaps, steps, mass, radius, plane, nu, gravity):
    """March over the gaps; rows (mean, centre, kinetic, elastic, least stress), stiffening."""
    nodes = mass.size
    h = radius / (nodes - 1)
    u, w, fu, fw = np.zeros(nodes), np.zeros(nodes), np.zeros(nodes), np.zeros(nodes)
    vu, vw = np.zeros(nodes), np.zeros(nodes)
    rows = np.zeros((gaps.size, 5))
    energy, least, worst = _internal(u, w, h, plane, nu, fu, fw)
    for k in range(gaps.size):
        dt = gaps[k] / max(steps[k], 1)
        for _ in range(steps[k]):
            _kick(vu, fu, mass, 0.0, 0.5 * dt)
            _kick(vw, fw, mass, gravity, 0.5 * dt)
            u += dt * vu
            w += dt * vw
            energy, least, stiffening = _internal(u, w, h, plane, nu, fu, fw)
            if not stiffening < 1e6:  # blown up, perhaps NaN, which max() could lose
                return rows, np.inf
            worst = max(worst, stiffening)
            _kick(vu, fu, mass, 0.0, 0.5 * dt)
            _kick(vw, fw, mass, gravity, 0.5 * dt)
        rows[k, 0] = np.sum(mass * w) / np.sum(mass)
        rows[k, 1] = w[0]
        rows[k, 2] = 0.5 * np.sum(mass * (vu * vu + vw * vw))
        rows[k, 3] = energy
        rows[k, 4] = least
    return rows, worst
