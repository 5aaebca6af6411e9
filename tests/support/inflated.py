"""The inflated circular membrane: its exact shape by shooting, and the volume under a cloth."""

import functools
import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

RADIUS, STIFFNESS, NU = 0.5, 1000.0, 0.3


def enclosed(cloth, x):
    """Volume between the cloth and the plane z = 0 under it: Σ area of the shadow · mean height."""
    a, b, c = np.moveaxis(x[cloth.triangles], 1, 0)
    shadow = 0.5 * np.cross(b - a, c - a)[:, 2]
    return float(np.sum(shadow * (a + b + c)[:, 2] / 3))


@functools.cache
def shooting(p):
    """Height and volume of the exact axisymmetric StVK membrane, from the centre stretch.

    δr and δz of 2π∫ W R dR − p V with λ₁² = r′² + z′², λ₂ = r/R give (R S₁ r′)′ = S₂ r/R + p r z′
    and R S₁ z′ = −p r²/2; λ₁ comes from λ₁ S₁(λ₁, λ₂) R = √((R S₁ r′)² + p² r⁴/4).
    """
    C = STIFFNESS / (1 - NU**2)

    def stress(l1, l2):
        E1, E2 = (l1**2 - 1) / 2, (l2**2 - 1) / 2
        return C * (E1 + NU * E2), C * (E2 + NU * E1)

    def stretch(linear, right):
        """The largest root of λ³ + linear λ = right: Newton from above, where it is convex."""
        root = 1.0 + np.cbrt(right)
        for _ in range(50):
            step = (root**3 + linear * root - right) / (3 * root**2 + linear)
            root -= step
            if abs(step) < 1e-15:
                break
        return root

    def rates(R, y):
        r, h, _, _ = y
        Q, l2 = math.hypot(h, p * r * r / 2), r / R
        l1 = stretch(NU * (l2**2 - 1) - 1, 2 * Q / (R * C))
        _, S2 = stress(l1, l2)
        dr, dz = l1 * h / Q, -l1 * p * r * r / 2 / Q
        return [dr, S2 * r / R + p * r * dz, dz, -np.pi * r * r * dz]

    def solve(l0):
        start = 1e-6 * RADIUS
        S, _ = stress(l0, l0)
        y = [l0 * start, start * S * l0, 0.0, 0.0]
        return solve_ivp(rates, (start, RADIUS), y, rtol=1e-10, atol=1e-13).y[:, -1]

    l0 = brentq(lambda l0: solve(l0)[0] - RADIUS, 1 + 1e-4, 1.6, xtol=1e-13)
    _, _, z, volume = solve(l0)
    return -z, volume
