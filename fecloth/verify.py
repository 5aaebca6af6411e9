"""Checks by finite differences and step halving, for tests, studies and users' own terms."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fecloth.errors import FeclothError
from fecloth.fabric.fabric import Fabric
from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.options import Newton
from fecloth.simulation.march import march
from fecloth.system.system import State, System

FLOOR = 1e-8  # relative error below which a difference quotient counts as exact


class VerificationFailed(FeclothError):
    """A derivative is not the derivative, or an order is not the claimed one."""


@dataclass(frozen=True)
class Sweep:
    """Relative errors of a central difference at the steps h, and the slope they show."""

    name: str
    h: np.ndarray
    errors: np.ndarray

    @property
    def slope(self) -> float:
        """Slope in log–log over the steps before round-off takes over; 2 for a true derivative.

        NaN if the largest step is already exact: the quantity is then linear along the direction.
        """
        before = max(int(np.argmin(self.errors)), 1)
        if self.errors[0] < FLOOR or before < 3:
            return float("nan")
        slopes = -np.diff(np.log2(self.errors[: before + 1]))
        return float(np.median(slopes[: max(3, len(slopes) - 2)]))

    def check(self, context: str) -> None:
        """Raise unless the error falls below 1e-5 with slope 2 ± 0.15, or vanishes at once."""
        exact = self.errors[0] < FLOOR  # what grows from there is round-off
        if not exact and not (abs(self.slope - 2) < 0.15 and self.errors.min() < 1e-5):
            raise VerificationFailed(
                f"{self.name} of {context} is not the derivative: slope {self.slope:.2f} instead "
                f"of 2, smallest relative error {self.errors.min():.1e}, "
                f"errors {' '.join(f'{error:.1e}' for error in self.errors)}"
            )


def check_term(
    term,
    cloth: Cloth | None = None,
    fabric: Fabric | None = None,
    states: Iterable[tuple[str, np.ndarray, np.ndarray]] | None = None,
    tangents: Sequence[str] = ("x", "v"),
    scales: Sequence[float] = (1e-3, 1.0, 1e3),
) -> list[Sweep]:
    """Hold a term's force against its energy, and its tangents against its force.

    Central differences over a sweep of steps must show slope 2 in each of the given states, by
    default a random, a strongly compressed and a nearly degenerate one, at several scales of the
    fabric's stiffness.

    Parameters
    ----------
    term
        A description such as ``StVK()``.
    cloth, fabric
        Left out: a small unstructured sheet and an orthotropic fabric.
    states
        (name, x, v) each, x and v of shape (n, 3).
    tangents
        Which of "x" and "v" are claimed to be exact.
    scales
        Factors on the fabric's stiffness.

    Returns
    -------
    list of Sweep
        One for each derivative, state and scale.

    Raises
    ------
    VerificationFailed
        If a slope is not 2, or all forces vanish: then nothing has been checked.

    Examples
    --------
    >>> import fecloth as fc
    >>> sweeps = check_term(fc.StVK())
    """
    cloth = cloth or Cloth.rectangle(0.3, 0.2, h=0.1, pattern="cross")
    fabric = fabric or Fabric(0.2, (1000.0, 600.0), 0.3, 150.0, (2e-5, 1e-5))
    states = trial_states(cloth) if states is None else list(states)
    sweeps = []
    for scale in scales:
        system = System(cloth, _scaled(fabric, scale), [term])
        for name, x, v in states:
            state = system.state(x, v)
            for sweep in _sweeps(system, state, tangents):
                sweep.check(f"{term!r} in the {name} state at stiffness × {scale:g}")
                sweeps.append(sweep)
    if not sweeps:
        raise VerificationFailed(f"{term!r}: no state or no scale was given, nothing is checked")
    return sweeps


def trial_states(cloth: Cloth, seed: int = 0) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """(name, x, v): random, compressed to a stretch of 0.3, and nearly degenerate."""
    rng = np.random.default_rng(seed)
    flat = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    size = np.sqrt(cloth.area / len(cloth.triangles))
    noise = rng.standard_normal((3, *flat.shape)) * size
    speed = rng.standard_normal(flat.shape)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    sheared = np.array([[1.0, 0.0, 0.0], [1.5, 0.05, 0.0], [0.0, 0.0, 1.0]])
    return [
        ("random", flat @ turn + 0.2 * noise[0], speed),
        ("compressed", 0.3 * flat @ turn + 0.05 * noise[1], speed),
        ("nearly degenerate", flat @ sheared @ turn + 0.005 * noise[2], speed),
    ]


def _scaled(fabric: Fabric, factor: float) -> Fabric:
    def times(value):
        return value if value is None else tuple(factor * v for v in np.atleast_1d(value))

    return replace(
        fabric,
        tensile_stiffness=times(fabric.tensile),
        shear_stiffness=factor * fabric.shear,
        bending_rigidity=times(fabric.bending),
    )


def _sweeps(system: System, state: State, tangents: Sequence[str]) -> list[Sweep]:
    rng = np.random.default_rng(1)
    direction = rng.standard_normal(state.x.shape)
    term, f = system.bound[0], system.force(state)
    size = np.sqrt(system.cloth.area / len(system.cloth.triangles))
    force_of_a_shift = np.linalg.norm(system.stiffness(state) @ direction.ravel()) * size
    if not np.linalg.norm(f) > 1e-10 * force_of_a_shift:
        raise VerificationFailed(f"{term.name} gives no force: choose states that load it")

    def moved(dx=0.0, dv=0.0):
        return State(state.t, state.x + dx * direction, state.v + dv * direction)

    sweeps = []
    if term.has_energy:

        def energy(h):
            return np.array([term.energy(moved(h).x, state.t)])

        f = system.force(replace(state, v=np.zeros_like(state.v)))  # without its own damping
        slope = -np.array([np.vdot(f, direction)])
        sweeps.append(_sweep("force", energy, slope, np.linalg.norm(f), size))
    if "x" in tangents:
        exact = -(system.stiffness(state) @ direction.ravel())
        for c, u in system.dense(state):
            exact -= c * float(np.vdot(u, direction)) * u.ravel()
        sweeps.append(
            _sweep("x-tangent", lambda h: system.force(moved(h)).ravel(), exact, None, size)
        )
    if "v" in tangents:
        exact = -(system.damping(state) @ direction.ravel())
        sweeps.append(
            _sweep("v-tangent", lambda h: system.force(moved(0.0, h)).ravel(), exact, None, 1.0)
        )
    return sweeps


def _sweep(
    name: str, function: Callable, exact: np.ndarray, scale: float | None, size: float
) -> Sweep:
    """Errors of central differences of `function(h)` against `exact`, h = size/4, size/8, …"""
    h = size * 0.5 ** np.arange(2, 18)
    scale = scale or max(np.linalg.norm(exact), np.linalg.norm(function(0.0)) / size * 1e-6)
    errors = [np.linalg.norm((function(s) - function(-s)) / (2 * s) - exact) / scale for s in h]
    return Sweep(name, h, np.maximum(errors, 1e-16))


def observed_order(h: Sequence[float], errors: Sequence[float]) -> np.ndarray:
    """log(e_i / e_{i+1}) / log(h_i / h_{i+1}) between neighbouring resolutions.

    Examples
    --------
    >>> observed_order([0.1, 0.05, 0.025], [4e-2, 1e-2, 2.5e-3]).round(12)
    array([2., 2.])
    """
    h, errors = np.asarray(h, dtype=float), np.asarray(errors, dtype=float)
    return np.diff(np.log(errors)) / np.diff(np.log(h))


def check_integrator(
    system: System,
    method,
    state: State,
    t_end: float,
    steps: Sequence[int] = (20, 40, 80, 160),
    tolerance: float = 0.15,
    solver: str = "direct",
) -> np.ndarray:
    """Orders of a method in dt, from the change of the end state between step numbers.

    Each step number must be twice the one before: ‖x_i − x_{i+1}‖ then falls by 2^order.

    Returns
    -------
    (len(steps) − 2,) observed orders.

    Raises
    ------
    VerificationFailed
        If the last of them misses ``method.traits.order`` by more than `tolerance`.
    """
    newton = Newton(tolerance=1e-11)
    ends = []
    for number in steps:
        dt = (t_end - state.t) / number
        for last, _ in march(system, method, state, dt, t_end, solver=solver, newton=newton):
            end = last
        ends.append(np.concatenate([end.x, end.v * t_end]))
    changes = [np.linalg.norm(a - b) for a, b in pairwise(ends)]
    orders = observed_order(1 / np.asarray(steps[:-1]), changes)
    claimed = method.traits.order
    if not abs(orders[-1] - claimed) <= tolerance:
        raise VerificationFailed(f"{method!r}: order {orders}, claimed {claimed}")
    return orders
