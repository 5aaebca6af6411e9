"""The list of calls by which the kernels of a run are compiled before its first step.

Numba compiles a kernel, or loads its machine code from disk, when it is called with arguments of
new types. `compile_kernels` calls each function of the list once, with the terms and the arrays
of the run itself. So the first step compiles nothing, and its time is the time of a step.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from fecloth.integrators.bdf2 import BDF2
from fecloth.integrators.one_stage import StageMethod
from fecloth.integrators.protocol import has_symmetric_matrix
from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.nonlinear.increments import LoadIncrement, over_increment
from fecloth.output.frame_arrays import fields
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.rigid_motion import rms_without_rigid
from fecloth.simulation.setup import Setup
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.bending.hinge import hinge_angles
from fecloth.terms.kinematics import largest_stretch
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.step_difference import StepDifference


@dataclass(frozen=True, eq=False)
class FirstCall:
    """A call of a function that calls kernels; its result is not used.

    Attributes
    ----------
    name
        The function, such as "StVK.add_tangent".
    function
        What is called.
    arguments
        Its arguments by position. Arrays to which it adds are not used for anything else.
    """

    name: str
    function: Callable[..., object]
    arguments: tuple[Any, ...] = ()


def compile_kernels(problem: Setup) -> None:
    """Compile the kernels that the steps of a run call, or load their machine code from disk.

    The calls have the terms and the start of the run, so no error and no warning of theirs is
    suppressed. One thread makes them: a team of threads would count the time of compiling as the
    time of its loops.
    """
    with problem.system.team.pinned():
        for call in list_first_calls(problem):
            call.function(*call.arguments)


def list_first_calls(problem: Setup) -> list[FirstCall]:
    """List the calls for all that a run calls in a step, and when it records one."""
    system = problem.system
    start = problem.start
    method = find_method(problem)
    if method.traits.explicit:
        J = None
    else:
        J = BlockMatrix.zeros(system.pattern)
    over = make_system_over_step(problem, method)
    calls = list_calls_of_records(problem)
    for name, term, acting in zip(system.names, system.bound, over.bound, strict=True):
        calls += list_calls_of_term(name, term, start, J)
        if acting is not term:
            calls += list_calls_of_term(f"{name} over a step", acting, start, J)
    if J is not None:
        calls.append(FirstCall("mass", system.assemble, (J, start, 0.0, 0.0, 1.0)))
    if J is not None and system.is_whole:  # else PETSc solves, in whose processes are no kernels
        calls += list_calls_of_solvers(problem, method)
    return calls


def find_method(problem: Setup) -> Any:
    """Return the method of the steps; of `Auto` the candidate whose kernels the others share."""
    steps = problem.steps
    if not isinstance(steps, Auto):
        return steps.method
    if any(term.needs_end for term in problem.system.bound):
        return BDF2()
    return steps.candidates[0].method


def make_system_over_step(problem: Setup, method: Any) -> System:
    """Return the system with the terms as the method evaluates them over the first step."""
    system = problem.system
    start = problem.start
    history = system.start_history(start)
    if isinstance(method, LoadSteps):
        end = start.t + method.dt
        increment = LoadIncrement(system, start, 1.0, method.dt, start.t, end, history)
        return over_increment(increment)
    assert problem.t_end is not None
    dt = problem.steps.dt or problem.t_end - start.t
    if isinstance(method, StageMethod):
        records = () if history is None else (history,)  # which an older class may not take
        over: System = method.over_step(system, start, dt, *records)
        return over
    difference = StepDifference.between(start.x, dt, start.t)
    return system.over_step(difference, history, rates=method.traits.has_difference)


def list_calls_of_term(
    name: str, term: BoundTerm, state: State, J: BlockMatrix | None
) -> list[FirstCall]:
    """List the calls of a bound term; without a matrix J no tangents."""
    x = state.x
    v = state.v
    t = state.t
    calls = [FirstCall(f"{name}.add_force", term.add_force, (x, v, t, np.zeros_like(x)))]
    if term.has_energy:
        calls.append(FirstCall(f"{name}.energy", term.energy, (x, t)))
    if term.dissipative:
        calls.append(FirstCall(f"{name}.power", term.power, (x, v, t)))
    if term.limits_direction:
        calls.append(FirstCall(f"{name}.limit", term.limit, (x, np.zeros_like(x), t)))
    if J is None:
        return calls
    for definite in (False, True):
        at = x, v, t, 1.0, 1.0
        calls.append(FirstCall(f"{name}.add_tangent", term.add_tangent, (*at, J, definite)))
        if term.couples_nodes:
            calls.append(FirstCall(f"{name}.coupling", term.coupling, (*at, definite)))
    return calls


def list_calls_of_records(problem: Setup) -> list[FirstCall]:
    """List the calls that make rows of the tables, frames, and the estimates of the errors."""
    system = problem.system
    start = problem.start
    cloth = problem.cloth
    mass = system.diagonal_mass
    calls = [
        FirstCall("row", problem.row),
        FirstCall("frame", fields, (system, start)),
        FirstCall("largest_stretch", largest_stretch, (cloth, start.x)),
        FirstCall("rms", system.sums.rms, (mass, start.x)),
        FirstCall("rms_without_rigid", rms_without_rigid, (mass, start.x, start.x)),
        FirstCall("hinge_angles", hinge_angles, (cloth, start.x)),
    ]
    at = start.x, start.t
    for name, term in system.named:
        if term.recovers_strain:
            calls.append(FirstCall(f"{name}.strain_error", term.strain_error, at))
    return calls


def list_calls_of_solvers(problem: Setup, method: Any) -> Iterator[FirstCall]:
    """Yield a call for each linear solver that the steps may use.

    SuperLU stands for the factorisation of "auto": it calls all kernels that PARDISO calls, and
    does not load the MKL.
    """
    is_clamped = problem.newton is not None and problem.newton.definiteness == "clamp"
    symmetric = is_clamped or has_symmetric_matrix(problem.system, method)
    names = {"superlu" if problem.linear == "auto" else problem.linear}
    if symmetric and not problem.is_static:
        names.add("pcg")  # with which "auto" begins, and the estimate of the error in time
    for name in sorted(names):
        yield FirstCall(name, solve_example, (name, symmetric))


def solve_example(name: str, symmetric: bool) -> None:
    """Solve a well-conditioned system on the nodes of two triangles by the solver of a name."""
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    A = BlockMatrix.zeros(BlockPattern.union(triangles.max() + 1, [triangles]))
    A.values[:] = -np.eye(3)
    A.values[A.pattern.diagonal] = len(A.pattern) * np.eye(3)  # more than its row has beside it
    solver = select.create(name, symmetric)
    solver.prepare(A)
    solver.solve(np.ones((len(A.pattern), 3)))
