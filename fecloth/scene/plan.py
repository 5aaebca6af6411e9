"""What a run is about to do, in words, before its first step."""

import math
from collections.abc import Iterator, Mapping
from itertools import repeat

from fecloth.errors import amount, brief
from fecloth.fabric.fabric import Fabric
from fecloth.linalg import mkl_pardiso
from fecloth.mesh.cloth import Cloth
from fecloth.scene.problem import Problem
from fecloth.simulation import dimensionless
from fecloth.simulation.doubts.pins import rotation_about_pins
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.method_choice import Auto
from fecloth.system.seams import Seam
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.loops.bound_condition import BoundCondition

# Bytes of a factor for each block and log₂ n. Midpoints of edges are eliminated with little
# fill.
FILL = {"P1": 47, "P2": 30}
# Bytes of the levels of multigrid at the peak; P2 needs 0.7 of that. For P1 within 12 %, tested.
MULTIGRID_PER_NODE = 2200
MULTIGRID_PER_BLOCK = 20
# Bytes of the first of several processes with GAMG, fitted to two runs: see `memory_of_each`.
GAMG_PER_OWN_BLOCK = 750
GAMG_PER_TRIANGLE = 370


def plan(problem: Problem, why: str) -> list[str]:
    """Return lines that say, before its first step, what a run is about to do.

    They state the sources of fabrics, sizes, terms, pins, seams, method, linear solver, threads,
    memory, the weight compared with the bending stiffness, wrinkles, the notes of the problem
    and, for a motion, the largest step of an explicit method. `why` says which linear solver was
    chosen, and why.
    """
    system = problem.system
    n = len(problem.system.cloth.X)
    if system.cloth.element == "P2":
        element_name = "quadratic triangle"
    else:
        element_name = "triangle"
    return [
        *sources(system.fabric),
        f"{n} nodes, {amount(len(system.cloth.triangles), element_name)}, "
        f"area {system.cloth.area:.6g} m², {system.constraints.count_free(n)} free dofs",
        f"terms: {', '.join(system.names) or 'none'}",
        f"pins: {_describe_pins(system, problem.start)}",
        *map(_describe_seam, system.seams, repeat(system.cloth)),
        _describe_steps(problem),
        f"linear solver: {why}",
        _describe_threads_and_memory(problem),
        *_length_lines(system),
        *problem.notes(),
        *describe_limit(problem),
    ]


def describe_limit(problem: Problem) -> list[str]:
    """Return a line on the largest step of an explicit method; none where there is no limit."""
    limit = math.inf if problem.is_static else problem.planned.explicit_limit
    if not math.isfinite(limit):  # infinite: no term limits an explicit step
        return []
    system = problem.system
    speed = max(map(dimensionless.wave_speed, system.panel.fabrics))
    needs = f"an explicit method would need dt <= {limit:.3g} s (at the start)"
    if system.mass_kind != "lumped":
        needs = 'a consistent mass allows no explicit method, mass = "lumped" would'
    return [f"fastest wave in the fabric {speed:.3g} m/s; {needs}"]


def sources(fabric: Fabric | Mapping[str, Fabric]) -> list[str]:
    """Return a line with the source of each fabric that has one."""
    if isinstance(fabric, Fabric):
        fabric = {"fabric": fabric}
    return [f"{name}: {value.source}" for name, value in fabric.items() if value.source]


def _describe_pins(system: System, start: State) -> str:
    """Return in words how many nodes each pin holds, and whether the cloth can turn about them.

    It can turn if all pins are on a line and none is clamped.
    """
    counts = []
    for name, (pin, nodes) in system.constraints.groups.items():
        clamped = ", clamped" if pin.clamp else ""
        counts.append(f"{name} ({amount(len(nodes), 'node')}{clamped})")
    turns = not system.panel.clamps and rotation_about_pins(system, start.x) is not None
    words = ", ".join(counts) or "none"
    if turns:
        return f"{words}, on a line, about which the cloth is free to turn"
    return words


def _describe_seam(seam: Seam, cloth: Cloth) -> str:
    """Return a line on a seam: its edges, how many nodes follow, how it bends and closes."""
    leading, following = seam.edges(cloth)
    bends = {0.0: "turns freely", "cloth": "bends as the cloth"}
    words = [
        f"seam: {brief(leading.where)} leads {brief(following.where)}",
        f"{len(leading.half_edges)} and {len(following.half_edges)} edges",
        bends.get(seam.stiffness, f"bends with {seam.stiffness} N"),
    ]
    if seam.close is not None:
        words.append(f"closes until {seam.close:g} s")
    return ", ".join(words)


def _describe_steps(problem: Problem) -> str:
    """Return in words the method, how its steps are chosen, and the end of the run."""
    if problem.is_static:
        return str(problem.method)
    steps = problem.steps
    if problem.dt:
        words = f"dt = {problem.dt:g} s"
    elif isinstance(steps, Adaptive | Auto):
        words = f'steps chosen by rtol = {steps.rtol:g}, as dt is left out or "auto",'
    else:
        words = 'steps chosen by stability, as dt is left out or "auto",'
    return f"{problem.method}, {words} to t = {problem.t_end:g} s"


def _describe_threads_and_memory(problem: Problem) -> str:
    """Return in words the threads of the loops and of the factorisations, and the memory.

    A solver still to be chosen may iterate, or factor the matrix: then both memories are given.
    """
    loops = problem.system.team.words(len(problem.system.cloth.triangles))
    if problem.method.traits.explicit:
        return f"{loops}, about {estimate_memory(problem.system, 'explicit'):.0f} MB"
    if problem.linear in ("pcg", "multigrid"):
        return f"{loops}, about {estimate_memory(problem.system, problem.linear):.0f} MB"
    when_iterated = estimate_memory(problem.system, "pcg")
    when_factored = estimate_memory(problem.system, "direct")
    mkl_threads = mkl_pardiso.threads()  # None: the MKL is not loaded
    factorisations = f", {mkl_threads} in factorisations" if mkl_threads else ""
    memory = f"about {when_iterated:.0f} MB, with a factor of the matrix {when_factored:.0f} MB"
    return f"{loops}{factorisations}; {memory}"


def _length_lines(system: System) -> Iterator[str]:
    """Yield lines on two lengths of the cloth, each where it can be computed.

    The first has the weight compared with the bending stiffness, which tells whether bending
    matters; the second has the length of wrinkles and of edges, to compare them.
    """
    if number := dimensionless.weight_over_stiffness(system):
        length = dimensionless.unsupported_length(system)
        if dimensionless.is_surrounded_by_pins(system):
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

    `solver` is the linear solver, "direct", "pcg" or "multigrid", or "explicit" for a method
    that needs none. All numbers of bytes are fitted to the peaks of runs.

    The memory is a constant for the program, and bytes in proportion to the n nodes, to the
    entries of the gradients (triangles × quadrature points × nodes), to the triangles (a frame),
    to the b blocks of the matrix and, for a factor, to b log₂ n; and the arrays of interpolated
    strains and of plates. Explicit runs have a matrix for their error in time only; there the
    hinges and springs count, too.
    """
    n = len(system.cloth.X)
    is_explicit = solver == "explicit"
    blocks = len(system.pattern.indices)
    gradients = math.prod(system.cloth.gradients.shape[:3])
    used: float = 258 * n + 157 * gradients + 150 * blocks  # bytes
    used += 500 * len(system.cloth.triangles)
    if system.cloth.element == "P2":
        used += 3000 * n  # the recovered stress of frames
    for term in system.bound:  # the arrays of interpolated strains and of plates
        used += term.nbytes(explicit=is_explicit)
        if is_explicit and isinstance(term, BoundCondition):  # a hinge or a spring
            used += 150 * len(term.nodes)
    if any(term.keeps_tangent for term in system.bound):
        used += 72 * blocks  # the tangents that iterations share
    used += 18 * blocks  # less than the matrix: what binding takes is free by then
    if solver == "pcg" or is_explicit:
        used += 146 * blocks  # the matrices of the error in time, and A in float32
    if solver == "multigrid":
        used += MULTIGRID_PER_NODE * n + MULTIGRID_PER_BLOCK * blocks
    if solver == "direct":
        # the fill of a factor grows with log₂ n, as of a grid in the plane
        used += (FILL[system.cloth.element] * math.log2(n) + 130) * blocks + 23e6
    return 225 + used / 1e6  # the program itself takes 225 MB


def memory_of_each(system: System, count: int) -> float:
    """Estimate the peak memory [MB] of the first of `count` processes that share a system.

    It is within 10 % for StVK with hinges, on 200,000 and 2,000,000 triangles and two processes.
    """
    own_blocks = len(system.pattern.indices) / count
    triangles = len(system.cloth.triangles)
    return 220 + (GAMG_PER_OWN_BLOCK * own_blocks + GAMG_PER_TRIANGLE * triangles) / 1e6
