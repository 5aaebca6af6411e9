"""Checks of derivatives and of orders of accuracy, for tests, studies and user-defined terms."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from fecloth.errors import FeclothError
from fecloth.fabric.fabric import Fabric
from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.options import Newton
from fecloth.simulation.march import march
from fecloth.system.state import State
from fecloth.system.system import System

# A relative error of a difference quotient below this is round-off: the quantity is linear.
EXACT_ERROR = 1e-8


class VerificationFailed(FeclothError):
    """A derivative or an order of accuracy that is not the expected one."""


@dataclass(frozen=True)
class Sweep:
    """Relative errors of a central difference at a sequence of steps h, and their slope.

    Attributes
    ----------
    name
        What is differentiated.
    h
        The steps, each half of the step before.
    errors
        The relative error at each step.
    """

    name: str
    h: np.ndarray
    errors: np.ndarray

    @property
    def slope(self) -> float:
        """Slope in log–log before round-off dominates: 2 if correct, NaN if it is exact."""
        smallest = max(int(np.argmin(self.errors)), 1)  # from here on, round-off dominates
        if self.errors[0] < EXACT_ERROR or smallest < 3:
            return float("nan")
        slopes = -np.diff(np.log2(self.errors[: smallest + 1]))
        return float(np.median(slopes[: max(3, len(slopes) - 2)]))

    def check(self, context: str) -> None:
        """Raise `VerificationFailed` unless the derivative is correct.

        The error must fall below 1e-5 with slope 2 ± 0.15, or be exact at the largest step.
        """
        is_exact = self.errors[0] < EXACT_ERROR  # then the errors at smaller steps are round-off
        if not is_exact and not (abs(self.slope - 2) < 0.15 and self.errors.min() < 1e-5):
            raise VerificationFailed(
                f"{self.name} of {context} is not the derivative: slope {self.slope:.2f} instead "
                f"of 2, smallest relative error {self.errors.min():.1e}, "
                f"errors {' '.join(f'{error:.1e}' for error in self.errors)}"
            )


class Checked(list[Sweep]):
    """The derivatives of a term that passed: a `Sweep` for each, and a summary in words."""

    def __init__(self, sweeps: Iterable[Sweep], where: str):
        super().__init__(sweeps)
        self.where = where

    def __repr__(self) -> str:
        """Return what has passed, with the range of the slopes and the largest of the errors."""
        names = ", ".join(dict.fromkeys(sweep.name for sweep in self))
        slopes = [sweep.slope for sweep in self if not np.isnan(sweep.slope)]
        if slopes:
            by_slope = f"slopes {min(slopes):.2f} to {max(slopes):.2f}"
        else:
            by_slope = "all are linear"
        error = max(sweep.errors.min() for sweep in self)
        return (
            f"{self.where}: passed\n  {len(self)} derivatives: {names}\n"
            f"  {by_slope}, smallest relative error of each at most {error:.0e}"
        )


def check_term(
    term,
    cloth: Cloth | None = None,
    fabric: Fabric | None = None,
    states: Iterable[tuple[str, np.ndarray, np.ndarray]] | None = None,
    tangents: Sequence[str] = ("x", "v"),
    scales: Sequence[float] = (1e-3, 1.0, 1e3),
) -> Checked:
    """Check the force of a term against its energy, and its tangents against its force.

    The errors of central differences must decrease with slope 2, in each state and at each
    scale of the stiffness of the fabric. Of the bound term, `power` and `supply` are not
    checked. Raises `VerificationFailed` if a slope is not 2, or if a force is zero and
    therefore cannot be checked.

    Parameters
    ----------
    term
        A term such as ``StVK()``.
    cloth, fabric
        Default: a small rectangle with the pattern "cross", and an orthotropic fabric.
    states
        (name, x, v) of each state, x and v of shape (n, 3). Default: `trial_states`. A term that
        acts on one side only, such as a floor, needs states on that side; see the example.
    tangents
        The tangents that must be exact: "x", "v" or both.
    scales
        Factors of the stiffness of the fabric.

    Returns
    -------
    Checked
        A list of a `Sweep` for each derivative, state and scale; it prints "passed" and the
        slopes.
    """
    cloth = cloth or Cloth.rectangle(0.3, 0.2, h=0.1, pattern="cross")
    fabric = fabric or Fabric(0.2, (1000.0, 600.0), 0.3, 150.0, (2e-5, 1e-5))
    if states is None:
        states = trial_states(cloth)
    states = list(states)  # they are used for each scale, and a generator only once
    sweeps = []
    for scale in scales:
        system = System(cloth, _scaled(fabric, scale), [term])
        for name, x, v in states:
            for sweep in _sweeps(system, system.state(x, v), tangents):
                sweep.check(f"{term!r} in the {name} state at stiffness × {scale:g}")
                sweeps.append(sweep)
    if not sweeps:
        raise VerificationFailed(f"{term!r}: nothing is checked without a state and a scale")
    return Checked(sweeps, f"{term!r} in states {', '.join(name for name, _, _ in states)}")


def trial_states(cloth: Cloth, seed: int = 0) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return three states (name, x, v) for checks of derivatives.

    They are random, compressed to a stretch of 0.3, and nearly degenerate, which is sheared and
    thin. x (n, 3) are positions [m], and v (n, 3) velocities [m/s]. `seed` is of the random
    numbers.
    """
    rng = np.random.default_rng(seed)
    flat = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    size = np.sqrt(cloth.area / len(cloth.triangles))  # about an edge length
    noise = rng.standard_normal((3, *flat.shape)) * size
    speed = rng.standard_normal(flat.shape)
    rotation, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    sheared = np.array([[1.0, 0.0, 0.0], [1.5, 0.05, 0.0], [0.0, 0.0, 1.0]])
    return [
        ("random", flat @ rotation + 0.2 * noise[0], speed),
        ("compressed", 0.3 * flat @ rotation + 0.05 * noise[1], speed),
        ("nearly degenerate", flat @ sheared @ rotation + 0.005 * noise[2], speed),
    ]


def _scaled(fabric: Fabric, factor: float) -> Fabric:
    """Return the fabric with tensile, shear and bending stiffness times a factor."""

    def scale_pair(value):
        """Return a number or a pair times the factor as a tuple; None stays None."""
        if value is None:
            return value
        return tuple(factor * v for v in np.atleast_1d(value))

    return replace(
        fabric,
        tensile_stiffness=scale_pair(fabric.tensile),
        shear_stiffness=factor * fabric.shear,
        bending_rigidity=scale_pair(fabric.bending),
    )


def _sweeps(system: System, state: State, tangents: Sequence[str]) -> list[Sweep]:
    """Return sweeps of the derivatives of the one term of a system along a random direction.

    These are the force as the derivative of the energy, if the term has one, and the `tangents`
    "x" and "v" as derivatives of the force. Raises `VerificationFailed` if the force is zero.
    """
    direction = np.random.default_rng(1).standard_normal(state.x.shape)
    term = system.bound[0]
    size = np.sqrt(system.cloth.area / len(system.cloth.triangles))  # about an edge length
    _check_has_force(system, state, direction, size)

    def shifted(dx=0.0, dv=0.0):
        return State(state.t, state.x + dx * direction, state.v + dv * direction)

    sweeps = []
    if term.has_energy:

        def energy(h):
            return np.array([term.energy(shifted(h).x, state.t)])

        f = system.force(replace(state, v=np.zeros_like(state.v)))  # without damping of the term
        slope = -np.array([np.vdot(f, direction)])
        # Relative to the force as a whole: its part along the direction may be near zero.
        sweeps.append(_sweep("force", energy, slope, scale=float(np.linalg.norm(f)), size=size))
    if "x" in tangents:

        def force_at(dx):
            return system.force(shifted(dx)).ravel()

        exact = -(system.stiffness(state) @ direction.ravel())
        # Parts c u uᵀ of the tangent, which couple all nodes, are not in the sparse matrix.
        for c, u in system.dense(state):
            exact -= c * float(np.vdot(u, direction)) * u.ravel()
        sweeps.append(_sweep("x-tangent", force_at, exact, scale=None, size=size))
    if "v" in tangents:

        def force_with(dv):
            return system.force(shifted(dv=dv)).ravel()

        exact = -(system.damping(state) @ direction.ravel())
        sweeps.append(_sweep("v-tangent", force_with, exact, scale=None, size=1.0))  # 1 m/s
    return sweeps


def _check_has_force(system: System, state: State, direction: np.ndarray, size: float) -> None:
    """Raise `VerificationFailed` if the force is zero beside its change over an edge length."""
    force_scale = np.linalg.norm(system.stiffness(state) @ direction.ravel()) * size
    if not np.linalg.norm(system.force(state)) > 1e-10 * force_scale:
        raise VerificationFailed(
            f"{system.bound[0].name} has no force: choose states in which it has one, as in "
            'check_term(term, cloth, states=[("pressed", x, v)]) with x and v of shape '
            f"{state.x.shape}"
        )


def _sweep(
    name: str, function: Callable, exact: np.ndarray, scale: float | None, size: float
) -> Sweep:
    """Return the errors of central differences of ``function(h)`` for h = size/4, size/8, …

    The first steps may leave the domain of a law, where the function is not finite; they do not
    count. The errors are relative to `scale`, by default the norm of the exact derivative.

    `exact` is the derivative that is checked, and `size` the change of h over which the function
    changes much.
    """
    h = size * 0.5 ** np.arange(2, 18)
    if not scale:
        # Not 0 where the derivative is zero: then errors are relative to a small part of f/size.
        least = np.linalg.norm(function(0.0)) / size * 1e-6
        scale = float(max(np.linalg.norm(exact), least))
    with np.errstate(invalid="ignore"):  # of an energy that is infinite on both sides
        quotients = [(function(s) - function(-s)) / (2 * s) for s in h]
        errors = np.array([np.linalg.norm(quotient - exact) / scale for quotient in quotients])
    outside = np.flatnonzero(~np.isfinite(errors[: len(h) // 3]))
    inside = slice(outside.max(initial=-1) + 1, None)
    # The slopes are of logarithms, which do not exist for an error of 0.
    return Sweep(name, h[inside], np.maximum(errors[inside], 1e-16))


def observed_order(h: ArrayLike, errors: ArrayLike) -> np.ndarray:
    """Return the orders log(e_i / e_{i+1}) / log(h_i / h_{i+1}) of successive resolutions."""
    h = np.asarray(h, dtype=float)
    errors = np.asarray(errors, dtype=float)
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
    """Check the order of a method in dt, from the end states for several numbers of steps.

    The differences ‖x_i − x_{i+1}‖ of successive end states decrease by the factor 2^order.
    Raises `VerificationFailed` if the last order differs from ``method.traits.order`` by more
    than `tolerance`.

    Parameters
    ----------
    system, method, state
        The problem, the method with its claimed ``order``, and the initial state.
    t_end
        End time [s].
    steps
        Numbers of steps; each must be twice the previous one.
    tolerance
        Allowed difference between the last observed order and ``method.traits.order``.
    solver
        Name of the linear solver.

    Returns
    -------
    (len(steps) − 2,) observed orders.
    """
    newton = Newton(tolerance=1e-11)  # its error must be far below the error of the method
    ends = []
    for number in steps:
        dt = (t_end - state.t) / number
        for state_after_step, _ in march(
            system, method, state, dt, t_end, solver=solver, newton=newton
        ):
            end = state_after_step
        ends.append(np.concatenate([end.x, end.v * t_end]))  # both in m
    changes = [np.linalg.norm(a - b) for a, b in pairwise(ends)]
    orders = observed_order(1 / np.asarray(steps[:-1]), changes)
    claimed = method.traits.order
    if not abs(orders[-1] - claimed) <= tolerance:
        raise VerificationFailed(f"{method!r}: orders {orders}, expected {claimed}")
    return orders
