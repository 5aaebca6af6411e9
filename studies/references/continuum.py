"""The continuum solutions of the work-precision scenes, which use no triangles."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from studies.references import closed_forms, falling_disk
from studies.work_precision.scenes import AMPLITUDE, LENGTH, PAPER, STRIP, SWING


def continuum(scene: str, times: np.ndarray, coarse: bool = False) -> dict[str, np.ndarray] | None:
    """Return the paths "mean" and "point" at the times [m]; None without a known solution.

    With `coarse` the solution has fewer points, enough for errors of 0.1 % and above.
    """
    if scene == "trampoline":
        disk = falling_disk.trampoline(times, elements=800 if coarse else 2400)
        return {"mean": disk.mean_deflection, "point": disk.centre}
    if scene == "wave":
        of = LENGTH, STRIP.tensile[0], STRIP.areal_density, AMPLITUDE
        tip = closed_forms.strip_wave(LENGTH, times, *of)
        return {"mean": 2 / np.pi * tip, "point": tip}  # the mean of a quarter of a sine
    if scene == "swing":
        fine, finer = (swinging_chain(times, links) for links in (60, 120))
        return {
            name: (4 * finer[name] - fine[name]) / 3 for name in fine
        }  # second order in 1/links
    return None


def swinging_chain(times: np.ndarray, links: int) -> dict[str, np.ndarray]:
    """Return the depths of the mean and the end of a falling strip that bends about one axis [m].

    The strip starts horizontally at rest. With ν = 0 nothing varies along the hinged edge, and the
    strip is a curve in a vertical plane. It is a chain of links of length l with the energy
    Y l E²/2, E = (λ² − 1)/2. Hinges between them have B θ²/(2 l), with the angle θ between two
    links. Nodes have the mass ρ l, the ends half of it. Velocity Verlet steps at a quarter of
    their limit.
    """
    l, rho, Y = SWING / links, PAPER.areal_density, PAPER.tensile[0]
    B = PAPER.bending[0]
    fastest = max(2 * math.sqrt(Y / rho) / l, 4 * math.sqrt(B / rho) / l**2)
    gap = times[1] - times[0]
    each = math.ceil(4 * gap * fastest / 2)
    rows = _fall(len(times), each, gap / each, links, l, Y, B, rho)
    return {"mean": rows[:, 0], "point": rows[:, 1]}


@njit(cache=True)
def _fall(samples, each, dt, links, l, Y, B, rho):
    """Return the mean depth and the depth of the end at each sample, (samples, 2)."""
    x, v, f = np.zeros((links + 1, 2)), np.zeros((links + 1, 2)), np.zeros((links + 1, 2))
    x[:, 0] = l * np.arange(links + 1)
    mass = np.full(links + 1, rho * l)
    mass[0] = mass[links] = 0.5 * rho * l
    rows = np.zeros((samples, 2))
    _pull(x, f, l, Y, B, mass)
    for sample in range(samples):
        for _ in range(each):
            for i in range(1, links + 1):
                for c in range(2):
                    v[i, c] += 0.5 * dt * f[i, c] / mass[i]
                    x[i, c] += dt * v[i, c]
            _pull(x, f, l, Y, B, mass)
            for i in range(1, links + 1):
                for c in range(2):
                    v[i, c] += 0.5 * dt * f[i, c] / mass[i]
        rows[sample, 0] = -np.sum(mass * x[:, 1]) / np.sum(mass)
        rows[sample, 1] = -x[links, 1]
    return rows


@njit(cache=True)
def _pull(x, f, l, Y, B, mass):
    """Set f to gravity, the tension of the links, and the moments of the hinges as couples."""
    f[:, 0] = 0.0
    f[:, 1] = -9.81 * mass
    for i in range(len(x) - 1):
        a, b = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
        S = 0.5 * Y * ((a * a + b * b) / (l * l) - 1) / l  # S λ/|d|
        f[i, 0] += S * a
        f[i, 1] += S * b
        f[i + 1, 0] -= S * a
        f[i + 1, 1] -= S * b
    for i in range(1, len(x) - 1):
        a, b = x[i, 0] - x[i - 1, 0], x[i, 1] - x[i - 1, 1]
        p, q = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
        moment = B / l * math.atan2(a * q - b * p, a * p + b * q)
        # ∂θ/∂d = ± (−d₂, d₁)/|d|²
        before, after = moment / (a * a + b * b), moment / (p * p + q * q)
        f[i - 1, 0] += before * b
        f[i - 1, 1] -= before * a
        f[i, 0] -= before * b + after * q
        f[i, 1] += before * a + after * p
        f[i + 1, 0] += after * q
        f[i + 1, 1] -= after * p
