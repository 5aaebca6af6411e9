"""What a run is about to do, in words, before its first step."""

import math
from collections.abc import Iterator

from fecloth.errors import amount
from fecloth.linalg import mkl_pardiso
from fecloth.scene.problem import Problem
from fecloth.simulation import dimensionless
from fecloth.simulation.doubts.pins import rotation_about_pins
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.method_choice import Auto
from fecloth.system.system import System
from fecloth.terms.loops.bound_condition import BoundCondition

# Bytes of a factor for each block and log₂ n. Midpoints of edges are eliminated with little
# fill.
FILL = {"P1": 47, "P2": 30}
SHARED, WHOLE = 750, 370  # bytes for each block of a process, and each triangle, with GAMG
MULTIGRID = 2200, 20  # bytes of its levels for each node and block, at the peak; P2: 0.7 of that


def plan(problem: Problem, why: str) -> list[str]:
    """Return lines on sizes, terms, method, solver, threads, memory, weight and explicit steps."""
    system = problem.system
    n = len(problem.system.cloth.X)
    name = f"{'quadratic ' * (system.cloth.element == 'P2')}triangle"
    lines = [
        f"{n} nodes, {amount(len(system.cloth.triangles), name)}, "
        f"area {system.cloth.area:.6g} m², {system.constraints.count_free(n)} free dofs",
        f"terms: {', '.join(system.names) or 'none'}",
        f"pins: {_pins(system)}",
        _course(problem),
        f"linear solver: {why}",
        _threads_and_memory(problem),
        *_length_lines(system),
        *problem.notes(),
    ]
    limit = math.inf if problem.is_static else problem.planned.explicit_limit
    if math.isfinite(limit):
        speed = max(map(dimensionless.wave_speed, system.panel.fabrics))
        fastest = f"fastest wave in the fabric {speed:.3g} m/s"
        needs = f"an explicit method would need dt <= {limit:.3g} s (at the start)"
        if system.mass_kind != "lumped":
            needs = 'a consistent mass allows no explicit method, mass = "lumped" would'
        lines.append(f"{fastest}; {needs}")
    return lines


def _pins(system: System) -> str:
    counts = [
        f"{name} ({amount(len(nodes), 'node')}{', clamped' if pin.clamp else ''})"
        for name, (pin, nodes) in system.constraints.groups.items()
    ]
    turns = not system.panel.clamps and rotation_about_pins(system, system.rest().x) is not None
    words = ", ".join(counts) or "none"
    if turns:
        return f"{words}, on a line, about which the cloth is free to turn"
    return words


def _course(problem: Problem) -> str:
    if problem.is_static:
        return str(problem.method)
    steps = problem.steps
    dt = problem.dt
    if isinstance(steps, Adaptive | Auto):
        by = f"rtol = {steps.rtol:g}"
    else:
        by = "stability"
    if dt:
        words = f"dt = {dt:g} s"
    else:
        words = f'steps chosen by {by}, as dt is left out or "auto",'
    return f"{problem.method}, {words} to t = {problem.t_end:g} s"


def _threads_and_memory(problem: Problem) -> str:
    loops = problem.system.team.words(len(problem.system.cloth.triangles))
    if problem.method.traits.explicit:
        return f"{loops}, about {estimate_memory(problem.system, 'explicit'):.0f} MB"
    if problem.linear in ("pcg", "multigrid"):
        return f"{loops}, about {estimate_memory(problem.system, problem.linear):.0f} MB"
    iterated = estimate_memory(problem.system, "pcg")
    factored, count = estimate_memory(problem.system), mkl_pardiso.threads()  # None: not loaded
    words = f"{loops}{f', {count} in factorisations' if count else ''}"
    return f"{words}; about {iterated:.0f} MB, with a factor of the matrix {factored:.0f} MB"


def _length_lines(system: System) -> Iterator[str]:
    """Yield weight over bending stiffness, which tells whether bending matters, and wrinkles."""
    if number := dimensionless.weight_over_stiffness(system):
        length = dimensionless.unsupported_length(system)
        is_around = dimensionless.is_surrounded_by_pins(system)
        if is_around:
            reach = "twice the reach from the pins around"
        else:
            reach = "the reach from the pins"
        words = f"ρ g L³/B = {number:.3g} with L = {length:.3g} m, {reach}"
        yield f"weight over bending stiffness: {words}"
    if wave := dimensionless.wrinkle_length(system):
        edge = dimensionless.mean_edge(system)
        yield f"wrinkles under its own weight: about {wave:.2g} m long, edges {edge:.2g} m"


def estimate_memory(system: System, solver: str = "direct") -> float:
    """Estimate the peak memory of a run [MB].

    A constant for the program, and bytes in proportion to the n nodes, to the entries of the
    gradients (triangles × quadrature points × nodes), to the triangles (a frame), to the b
    blocks of the matrix and, for a factor, to b log₂ n; and the arrays of interpolated strains
    and of plates. Explicit runs have no matrix; there the hinges and springs count. Fitted to
    runs.
    """
    n = len(system.cloth.X)
    blocks = 0 if solver == "explicit" else len(system.pattern.indices)
    used: float = 258 * n + 157 * math.prod(system.cloth.gradients.shape[:3]) + 150 * blocks
    used += 500 * len(system.cloth.triangles)
    for term in system.bound:  # the arrays of interpolated strains and of plates
        used += term.nbytes(explicit=solver == "explicit")
        if solver == "explicit" and isinstance(term, BoundCondition):
            used += 150 * len(term.nodes)
    used += 18 * blocks  # less than the matrix: what binding takes is free by then
    if solver == "pcg":
        used += 110 * blocks  # the matrices of the error in time
    if solver == "multigrid":
        used += MULTIGRID[0] * n + MULTIGRID[1] * blocks
    if solver == "direct":
        used += (FILL[system.cloth.element] * math.log2(n) + 130) * blocks + 23e6
    return 225 + used / 1e6


def memory_of_each(system: System, count: int) -> float:
    """Estimate the peak memory [MB] of the first of `count` processes that share a system."""
    # Within 10 % of StVK with hinges, 200,000 and 2,000,000 triangles on two processes.
    blocks = len(system.pattern.indices)
    triangles = len(system.cloth.triangles)
    return 220 + (SHARED * blocks / count + WHOLE * triangles) / 1e6
