"""Static equilibrium: positions at which the forces of all terms balance, f(x, v = 0, t) = 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, is_number
from fecloth.linalg import select
from fecloth.nonlinear.newton import round_off
from fecloth.nonlinear.static_newton import EquilibriumFailed, Search
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System

QUICK = 8  # iterations after which a load increment may grow again
SMALLEST = 1 / 64  # of the first load increment


@dataclass(frozen=True)
class Iteration:
    """Figures of one Newton iteration.

    Attributes
    ----------
    number
        Counted from 1.
    residual
        ‖f‖ of the free directions after it, relative to Σ ‖f_term‖.
    shift
        σ of its tangent K + σ M [1/s²]; 0 is the exact tangent.
    length
        Fraction of Newton's step, at most 1.
    load
        Factor on the loads.
    """

    number: int
    residual: float
    shift: float
    length: float
    load: float = 1.0


def equilibrium(
    system: System,
    state: State,
    *,
    load_steps: int = 1,
    tolerance: float = 1e-9,
    max_iterations: int = 200,
    solver: str = "direct",
    report: Callable[[Iteration], None] = lambda iteration: None,
) -> State:
    """The equilibrium that Newton's iteration reaches from `state`, at the loads of its time.

    Each iteration solves (K + σ M) s = f with the tangent K = −∂f/∂x of all terms. σ is zero where
    K is positive definite and its step is an improvement: near the solution the convergence is
    quadratic. Elsewhere each term's tangent is made positive semi-definite, and σ grows until the
    step is an improvement (after Nocedal and Wright 2006, Numerical Optimization, algorithm 3.3,
    who add σ alone): a flat cloth without stress has no stiffness across, and σ M stands in for
    it. With the exact K + σ M a sheet squeezed by a fifth took twice the iterations. The first σ
    moves the cloth by about a tenth of its extent under its load. Of s, s/2, s/4, … the longest is
    taken that reduces the residual, or the potential sufficiently (their eq. 3.6a), or, where a
    force has no potential, at whose end the residual does not push back hard (after Matthies and
    Strang 1979). No node moves by more than the extent of the cloth in one iteration.

    A compressed cloth has many equilibria, and which one is found depends on the start; a flat
    start without any load across stays flat. If the last `Iteration` had a shift, the tangent is
    not positive definite near the solution: it may be unstable, or not the only one around.

    Parameters
    ----------
    system, state
        What is to be balanced and where to start; pins hold their nodes where `state` has them,
        slides their held directions, and its velocity is not used.
    load_steps
        1: all loads at once. More: the forces of the loads, which are `Gravity`, `Pressure`,
        `Gas`, `Wind`, `PointForce`, `UserForce` and every term that says `load = True`,
        are multiplied by λ = 1/n, 2/n, …, 1, each solved from where the line through the last two
        solutions leads. Where that fails the increment of λ is halved, down to 1/64 of the first;
        after a solution in at most 8 iterations it doubles again, up to 1/n. For loads that turn
        the cloth far: a strip under a follower pressure that turned it by 140° took 191 iterations
        at once and 144 in ten steps, and one turned by 237° was found in steps only.
    tolerance
        On ‖f‖ of the free directions over Σ ‖f_term‖ at the same positions. It is
        never less than the round-off of the forces, 8 ε ‖K_ii x_i‖.
    max_iterations
        Of each load step; beyond it the step has failed.
    solver
        "direct", "pardiso" or "superlu".
    report
        Called with each `Iteration`.

    Returns
    -------
    State
        At the same time, with v = 0.

    Raises
    ------
    EquilibriumFailed
        If the cloth moves away as nothing holds it, or the iteration ends before the tolerance;
        the message says how many triangles are slack, which is the usual cause.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    >>> sag = -fc.equilibrium(system, system.rest()).x[:, 2].min()
    >>> print(f"{1000 * sag:.0f} mm")
    38 mm
    """
    check_system(system, state, "equilibrium")
    validation.function(
        "report", report, "lambda iteration: print(iteration.residual)", "equilibrium"
    )
    if not (is_number(tolerance) and 0 < tolerance < 1):
        raise InputError(f"tolerance = {tolerance!r}", "must lie in (0, 1)", "equilibrium")
    for name, value in (("max_iterations", max_iterations), ("load_steps", load_steps)):
        if not (isinstance(value, int) and value >= 1):
            raise InputError(f"{name} = {value!r}", "must be an integer >= 1", "equilibrium")
    if solver not in ("direct", "pardiso", "superlu"):
        allowed = "must be direct, pardiso or superlu"
        raise InputError(f"solver = {solver!r}", allowed, "equilibrium")
    start = State(state.t, state.x.copy(), np.zeros_like(state.x))
    search = Search(system, start, select.create(solver, system.symmetric))
    newton = partial(_newton, search, tolerance, max_iterations, report)
    if load_steps == 1:
        return search.state(newton(start.x)[0])
    return search.state(_increase_loads(search, newton, 1 / load_steps))


def _increase_loads(search: Search, newton: Callable, largest: float) -> np.ndarray:
    """Return x under the full loads, increased by at most the fraction `largest` at a time."""
    x, reached, increment, rate = search.start.x, 0.0, largest, 0.0
    while reached < 1:
        to = reached + increment
        search.load = to if to < 1 - 1e-9 else 1.0
        try:
            new, iterations = newton(x + (search.load - reached) * rate)
        except EquilibriumFailed as failure:
            increment /= 2
            if increment < SMALLEST * largest:
                raise search.load_step_failure(failure, x, reached) from failure
            continue
        rate = (new - x) / (search.load - reached)
        x, reached = new, search.load
        if iterations <= QUICK:
            increment = min(2 * increment, largest)
    return x


def _newton(search: Search, tolerance, max_iterations, report, x) -> tuple[np.ndarray, int]:
    """x in equilibrium with the loads times `search.load`, and the number of iterations."""
    f, scale = search.forces(x)
    search.choose_first_shift(f)
    goal = max(tolerance * scale, round_off(search.system, search.J, x, 0.0))
    for number in range(1, max_iterations + 1):
        if search.system.sums.norm(f) <= goal:
            return x, number - 1
        x, f, scale, shift, length = search.iterate(x, f, goal)
        goal = max(tolerance * scale, round_off(search.system, search.J, x, shift))
        relative = search.system.sums.norm(f) / scale if scale else 0.0
        report(Iteration(number, relative, shift, length, search.load))
        search.check_travel(x, f)
    if search.system.sums.norm(f) <= goal:
        return x, max_iterations
    raise search.failure(f"no convergence in {max_iterations} iterations", x, f)
