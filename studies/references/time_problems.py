"""Three motions with known ends, computed without fecloth's time steps, for orders of methods.

1. An elastic pendulum, one spring and one mass, in large swings. 2. A longitudinal wave of finite
strain in a strip with ν = 0. Both are compared with their own equations, written in this file.
3. A damped swinging cloth with bending, compared with SciPy's Runge-Kutta method of order 8 on the
forces of the system.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS

TIGHT = fc.Newton(tolerance=1e-11)
CASES = {name: method() for name, method in {**METHODS, **EXPLICIT}.items()} | {
    "forward_euler": fc.ForwardEuler(beyond_limit=True),  # its limit without damping is 0
    "newmark_damped": fc.Newmark(0.36, 0.7),
    "generalized_alpha_0": fc.GeneralizedAlpha(0.0),
    "generalized_alpha_1": fc.GeneralizedAlpha(1.0),
}


def solve(acceleration, x, v, t_end):
    """Return x and v at `t_end` for x'' = acceleration(x, v), by DOP853 with rtol 1e-12."""

    def rate(_, y):
        x, v = y.reshape(2, -1)
        return np.concatenate([v, acceleration(x, v)])

    start = np.concatenate([x, v])
    end = solve_ivp(rate, (0, t_end), start, "DOP853", rtol=1e-12, atol=1e-14)
    assert end.success
    return end.y[:, -1].reshape(2, -1)


@dataclass(frozen=True)
class Problem:
    """A system, its start, the steps of the two finest runs, and the exact end (x, v)."""

    system: fc.System
    start: object
    t_end: float
    steps: tuple[int, int]
    x: np.ndarray
    v: np.ndarray

    def error(self, method, steps) -> float:
        """Return ‖(x, t_end v) − exact‖ after `steps` steps."""
        dt = self.t_end / steps
        run = fc.march(
            self.system, method, self.start, dt, self.t_end, solver="direct", newton=TIGHT
        )
        *_, (end, _) = run
        miss = np.concatenate([end.x - self.x, self.t_end * (end.v - self.v)])
        return float(np.linalg.norm(miss))


@cache
def pendulum() -> Problem:
    """Return a pendulum: a triangle with two nodes pinned at one point, a spring of 2 k."""
    cloth = fc.Cloth.from_arrays([[-0.1, 0], [0.1, 0], [0, -1]], [[0, 2, 1]], renumber=False)
    rest, k, t_end = np.hypot(0.1, 1.0), 0.2, 0.8
    fabric = fc.Fabric(areal_density=0.6, tensile_stiffness=1.0)
    terms = [fc.Springs(stiffness=k), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, pins=[fc.Pin([0, 1])])
    x, v = np.array([1.1, 0.0, 0.0]), np.array([0.0, 1.0, -0.5])
    mass = 0.6 * 0.1 / 3

    def acceleration(x, v):
        length = np.sqrt(x @ x)
        return -2 * k / mass * (length - rest) * x / length - np.array([0.0, 0.0, 9.81])

    start = system.state(np.array([[0, 0, 0], [0, 0, 0], x]), np.array([[0, 0, 0], [0, 0, 0], v]))
    end = np.zeros((2, 3, 3))
    end[:, 2] = solve(acceleration, x, v, t_end)
    return Problem(system, start, t_end, (100, 200), *end)


@cache
def wave() -> Problem:
    """Return a taut strip with fixed ends, one cell wide: its columns of nodes are a mass chain."""
    cells, h, stretch, t_end = 8, 1 / 8, 1.15, 0.008
    Y, rho = 800.0, 0.2
    cloth = fc.Cloth.rectangle(1.0, h, h=h, pattern="right")
    system = fc.System(cloth, fc.Fabric(rho, Y, 0.0), [fc.StVK()], pins=["left", "right"])
    X = np.linspace(0, 1, cells + 1)

    def acceleration(x, v):
        F = np.diff(np.concatenate([[0], x, [stretch]])) / h
        return np.diff(Y * F * 0.5 * (F**2 - 1)) / (rho * h)

    x0 = stretch * X + 0.03 * np.sin(2 * np.pi * X)
    v0 = 1.5 * np.sin(np.pi * X) ** 2
    chain = solve(acceleration, x0[1:-1], v0[1:-1], t_end)

    def of_cloth(values, y):
        column = np.rint(cloth.X[:, 0] / h).astype(int)
        return np.column_stack([values[column], y, np.zeros(len(column))])

    y, still = cloth.X[:, 1], np.zeros(len(cloth.X))
    start = system.state(of_cloth(x0, y), of_cloth(v0, still))
    end_x = of_cloth(np.concatenate([[0], chain[0], [stretch]]), y)
    end_v = of_cloth(np.concatenate([[0], chain[1], [0]]), still)
    return Problem(system, start, t_end, (100, 200), end_x, end_v)


@cache
def swing() -> Problem:
    """Return a curved falling sheet pinned on the left, with notable damping and bending."""
    cloth, t_end = fc.Cloth.rectangle(0.4, 0.3, h=0.1), 0.04
    fabric = fc.Fabric(0.2, 50.0, 0.3, bending_rigidity=2e-2)
    terms = [fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(2e-3), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, pins=["left"])
    x, y = cloth.X.T
    bent = np.column_stack([1.01 * x, y, 0.4 * x**2 * (1 + y)])
    start = system.state(bent, np.column_stack([0 * x, x, -2 * x]))
    free, mass = system.free, np.repeat(system.nodal_mass, 3)[system.free]
    parts = []
    for term in system.bound:
        parts.append(np.zeros_like(bent))
        term.add_force(start.x, start.v, 0.0, parts[-1])
    assert min(np.linalg.norm(f) for f in parts) > 0.2 * np.linalg.norm(parts[-1])

    def full(values, held):
        whole = held.ravel().copy()
        whole[free] = values
        return whole.reshape(-1, 3)

    def acceleration(x, v):
        state = system.state(full(x, start.x), full(v, 0 * bent))
        return system.force(state).ravel()[free] / mass

    end = solve(acceleration, start.x.ravel()[free], start.v.ravel()[free], t_end)
    return Problem(system, start, t_end, (125, 250), full(end[0], start.x), full(end[1], 0 * bent))
