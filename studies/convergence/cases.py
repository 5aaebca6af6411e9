"""One case of the convergence study: a mesh or a step, and its errors."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import eigsh
from scipy.special import jn_zeros

import fecloth as fc
from studies.references import closed_forms, manufactured, time_problems

TIGHT = fc.Newton(tolerance=1e-10)
STRIP = {"length": 1.0, "tensile_stiffness": 20.0, "areal_density": 0.2}
STRETCH = 1.1  # of the vibrating sheets


def space(problem: str, element: str, pattern: str, n: int) -> dict:
    """Return the errors of the function `problem` of this file on a mesh of edge length 1/n m."""
    cloth = make_cloth(problem, element, pattern, n)
    return globals()[problem](cloth, n) | {"h": 1 / n, "nodes": len(cloth.X)}


def make_cloth(problem: str, element: str, pattern: str, n: int) -> fc.Cloth:
    if problem == "disk":
        return fc.Cloth.disk(1.0, 1 / n, element)
    return fc.Cloth.rectangle(1.0, 0.5 if problem == "strip" else 1.0, 1 / n, pattern, element)


def errors(cloth: fc.Cloth, x: np.ndarray, position, gradient) -> dict:
    return {"L2": cloth.l2_error(x, position, 10), "H1": cloth.h1_error(x, gradient, 10)}


# --- manufactured ---------------------------------------------------------------------------------


def static(cloth: fc.Cloth, n: int) -> dict:
    """Solve the equilibrium under the body force of the manufactured solution."""
    system = manufactured_system(cloth, lambda t: manufactured_load(cloth, 1.0), ["boundary"])
    state = fc.equilibrium(system, system.state(manufactured.position(cloth.X)))
    miss = abs(system.energies(state)["StVK"] - manufactured.energy())
    return errors(cloth, state.x, manufactured.position, manufactured.gradient) | {"energy": miss}


def dynamic(cloth: fc.Cloth, n: int) -> dict:
    """Run the manufactured wave with c = cos ωt and a moving boundary to about 60°.

    The step falls with h, so that its error, of order dt², does not limit the order in space.
    """
    omega, t_end = 12.0, 0.09
    rim = cloth.nodes("boundary")
    at_rim = manufactured.wave(cloth.X[rim])
    pin = fc.Pin(
        "boundary",
        lambda t: np.cos(omega * t) * at_rim,
        lambda t: -omega * np.sin(omega * t) * at_rim,
    )
    system = manufactured_system(cloth, moving_load(cloth, omega), [pin])
    steps = 2 * n if cloth.element == "P1" else round(4 * n**1.5)
    method, dt = fc.ImplicitMidpoint(), t_end / steps
    start = system.state(manufactured.position(cloth.X))
    *_, (end, _) = fc.march(system, method, start, dt, t_end, solver="direct", newton=TIGHT)
    c, speed = np.cos(omega * t_end), -omega * np.sin(omega * t_end)
    position = lambda X: manufactured.position(X, c)  # noqa: E731
    found = errors(cloth, end.x, position, lambda X: manufactured.gradient(X, c))
    energies = system.energies(end)
    miss = abs(energies["kinetic"] + energies["StVK"] - manufactured.energy(c, speed))
    return found | {"energy": miss, "steps": steps}


def manufactured_system(cloth: fc.Cloth, load, pins: list) -> fc.System:
    """Return a sheet under nodal forces load(t) (n, 3) that do not depend on its position."""
    none = np.zeros((2, len(cloth.X), 3, 3))
    force = fc.UserForce(lambda x, v, t: load(t), "node", lambda x, v, t: none)
    fabric = fc.Fabric(manufactured.DENSITY, manufactured.Y, manufactured.NU)
    return fc.System(cloth, fabric, [fc.StVK(), force], pins)


def manufactured_load(cloth: fc.Cloth, c: float) -> np.ndarray:
    """(n, 3) ∫ −Div P N_a dA [N]."""
    return cloth.load(lambda X: -manufactured.divergence(X, c), order=8)


def moving_load(cloth: fc.Cloth, omega: float):
    """∫ (ρ c̈ ∂x/∂c − Div P) N_a dA for c = cos ωt, interpolated: Div P is cubic in c."""
    known = np.cos(np.pi * np.arange(4) / 3)
    values = np.stack([manufactured_load(cloth, c).ravel() for c in known])
    cubic = np.linalg.solve(np.vander(known), values)
    inertia = cloth.load(lambda X: manufactured.DENSITY * manufactured.wave(X), order=8)

    def load(t: float) -> np.ndarray:
        c = np.cos(omega * t)
        return (c ** np.arange(3, -1, -1) @ cubic).reshape(-1, 3) - omega**2 * c * inertia

    return load


# --- closed forms ---------------------------------------------------------------------------------


def strip(cloth: fc.Cloth, n: int) -> dict:
    """Solve for a strip under its own weight with ν = 0, which keeps its width."""
    fabric = fc.Fabric(STRIP["areal_density"], STRIP["tensile_stiffness"], 0.0)
    terms = [fc.StVK(), fc.Gravity((9.81, 0.0, 0.0))]
    system = fc.System(cloth, fabric, terms, ["left"])
    state = fc.equilibrium(system, system.rest())

    def position(X):
        return np.column_stack(
            [X[:, 0] + closed_forms.hanging_strip(X[:, 0], **STRIP), X[:, 1], 0 * X[:, 0]]
        )

    def gradient(X):
        F = np.zeros((len(X), 3, 2))
        F[:, 0, 0] = 1 + closed_forms.hanging_strip_strain(X[:, 0], **STRIP)
        F[:, 1, 1] = 1
        return F

    at, weights = np.polynomial.legendre.leggauss(40)
    e = closed_forms.hanging_strip_strain((1 + at) / 2, **STRIP)
    exact = 0.5 * weights / 2 @ (STRIP["tensile_stiffness"] / 8 * ((1 + e) ** 2 - 1) ** 2)
    miss = abs(system.energies(state)["StVK"] - exact)
    return errors(cloth, state.x, position, gradient) | {"energy": miss}


def frequency(cloth: fc.Cloth, n: int) -> dict:
    """Return the relative error of ω² = 2 (π/a)² S/ρ of a taut square with a pinned boundary."""
    return {"frequency": abs(lowest_wave_number(cloth) / (np.pi * np.sqrt(2)) - 1)}


def disk(cloth: fc.Cloth, n: int) -> dict:
    """Return the relative error of ω = j/a √(S/ρ), j Bessel's first zero, of a taut disk."""
    return {"frequency": abs(lowest_wave_number(cloth) / jn_zeros(0, 1)[0] - 1)}


def lowest_wave_number(cloth: fc.Cloth) -> float:
    """Return the lowest out-of-plane ω over √(S/ρ), S the tension of the stretched sheet [1/m]."""
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK()], ["boundary"])
    K = system.stiffness(system.state(STRETCH * system.rest().x)).tocsr()[2::3, 2::3]
    inside = np.setdiff1d(np.arange(len(cloth.X)), cloth.nodes("boundary"))
    K, M = (B.tocsc()[inside][:, inside] for B in (K, system.scalar_mass))
    S = 1000.0 / 0.7 * (STRETCH**2 - 1) / 2
    return float(np.sqrt(eigsh(K, 1, M, sigma=0.0, v0=np.ones(len(inside)))[0][0] * 0.2 / S))


# --- time -----------------------------------------------------------------------------------------


def in_time(problem: str, method: str, refined: int) -> dict:
    """Return the error of a problem of `time_problems` with its steps times 2^refined."""
    task = getattr(time_problems, problem)()
    steps = round(task.steps[0] * 2.0**refined)
    error = task.error(time_problems.CASES[method], steps)
    return {"steps": steps, "dt": task.t_end / steps, "end_error": error}
