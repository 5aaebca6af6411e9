"""The sag of a square membrane under its weight, by polynomials in place of triangles.

The square is held along its border. The displacement is a sum of polynomials that vanish there.
The energy of the StVK membrane with its weight is integrated by Gauss's rule, and its minimum is
the solution. With 5, 6 and 8 polynomials along each side the sag of studies/scenes/sag.toml is
35.8686, 35.8693 and 35.8696 mm.

    E = ½ (∇u + ∇uᵀ + ∇uᵀ ∇u),   W = ½ Y/(1 − ν²) ((1 − ν) E:E + ν (tr E)²),   u = (u, v, w)
"""

import numpy as np
from numpy.polynomial.legendre import Legendre, leggauss
from scipy.optimize import minimize


def sag(
    width: float,
    tensile_stiffness: float,
    poisson_ratio: float,
    areal_density: float,
    count: int = 7,
    gravity: float = 9.81,
) -> float:
    """Return how far the middle of the square falls [m].

    Parameters
    ----------
    width
        Side of the square [m].
    tensile_stiffness
        Y [N/m].
    poisson_ratio
        ν [-].
    areal_density
        ρ [kg/m²].
    count
        Number of polynomials along each side.
    gravity
        g [m/s²].
    """
    points, weights = leggauss(3 * count)
    bubbles = [_bubble(k) for k in range(2 * count)]
    value = np.array([bubble(points) for bubble in bubbles])
    slope = np.array([bubble.deriv()(points) for bubble in bubbles]) * 2 / width
    even = slice(0, None, 2)
    odd = slice(1, None, 2)
    area = np.outer(weights, weights) * (width / 2) ** 2
    load = areal_density * gravity

    def fields(c: np.ndarray) -> tuple[np.ndarray, ...]:
        """The gradients of u, v and w along X and Y, and w, at the points."""
        a, b = c.reshape(2, count, count)
        u_x = slope[odd].T @ a @ value[even]
        u_y = value[odd].T @ a @ slope[even]
        w_x = slope[even].T @ b @ value[even]
        w_y = value[even].T @ b @ slope[even]
        # by symmetry v(X, Y) = u(Y, X)
        return u_x, u_y, u_y.T, u_x.T, w_x, w_y, value[even].T @ b @ value[even]

    def energy(c: np.ndarray) -> tuple[float, np.ndarray]:
        """The energy [J] and its derivatives by the coefficients."""
        u_x, u_y, v_x, v_y, w_x, w_y, w = fields(c)
        E11 = u_x + 0.5 * (u_x**2 + v_x**2 + w_x**2)
        E22 = v_y + 0.5 * (u_y**2 + v_y**2 + w_y**2)
        E12 = 0.5 * (u_y + v_x + u_x * u_y + v_x * v_y + w_x * w_y)
        factor = tensile_stiffness / (1 - poisson_ratio**2)
        S11 = factor * (E11 + poisson_ratio * E22)
        S22 = factor * (E22 + poisson_ratio * E11)
        S12 = factor * (1 - poisson_ratio) * E12
        W = 0.5 * (S11 * E11 + S22 * E22) + S12 * E12
        # P = F S, row by row, weighted with the area of each point
        P_ux = area * ((1 + u_x) * S11 + u_y * S12)
        P_uy = area * ((1 + u_x) * S12 + u_y * S22)
        P_vx = area * (v_x * S11 + (1 + v_y) * S12)
        P_vy = area * (v_x * S12 + (1 + v_y) * S22)
        P_wx = area * (w_x * S11 + w_y * S12)
        P_wy = area * (w_x * S12 + w_y * S22)
        by_a = slope[odd] @ (P_ux + P_vy.T) @ value[even].T
        by_a += value[odd] @ (P_uy + P_vx.T) @ slope[even].T
        by_b = slope[even] @ P_wx @ value[even].T + value[even] @ P_wy @ slope[even].T
        by_b += value[even] @ (area * load) @ value[even].T
        total = float((area * (W + load * w)).sum())
        return total, np.concatenate([by_a.ravel(), by_b.ravel()])

    start = np.zeros((2, count, count))
    start[1, 0, 0] = -0.03 * width
    options = {"maxiter": 20_000, "maxfun": 40_000, "gtol": 1e-12, "ftol": 1e-16, "maxcor": 50}
    result = minimize(energy, start.ravel(), jac=True, method="L-BFGS-B", options=options)
    middle = np.array([bubble(0.0) for bubble in bubbles[even]])
    return float(-middle @ result.x.reshape(2, count, count)[1] @ middle)


def _bubble(degree: int) -> Legendre:
    """Return (1 − ξ²) times the Legendre polynomial of a degree."""
    return Legendre([2 / 3, 0, -2 / 3]) * Legendre.basis(degree)
