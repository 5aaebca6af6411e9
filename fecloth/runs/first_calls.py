"""The list of calls by which the kernels of a run are compiled before its first step.

Numba compiles a kernel, or loads its machine code from disk, when it is called with arguments of
new types. `compile_kernels` calls each function of the list once, with the terms and the arrays
of the run itself. So the first step compiles nothing, and its time is the time of a step.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

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
    """List a call of each function with kernels that a run calls in a step or to record it."""
    system = problem.system
    start = problem.start
    method = find_method(problem)
    system_over_step = make_system_over_step(problem, method)
    J = None if method.traits.explicit else BlockMatrix.zeros(system.pattern)
    calls = list_calls_of_records(problem)
    terms = zip(system.names, system.bound, system_over_step.bound, strict=True)
    for name, term, term_over_step in terms:
        calls += list_calls_of_term(name, term, start, J)
        # Contact and friction, for example, become other objects over a step.
        if term_over_step is not term:
            calls += list_calls_of_term(f"{name} over a step", term_over_step, start, J)
    if J is None:
        return calls
    weights_of_mass_alone = (0.0, 0.0, 1.0)  # wx, wv and wa: the matrix is M
    arguments = (J, start, *weights_of_mass_alone)
    calls.append(FirstCall("mass", system.assemble, arguments))
    # Several processes solve by PETSc, which calls no kernels.
    if system.is_whole:
        calls.append(FirstCall("pins", system.project, (J,)))
        still = np.zeros_like(start.x)
        calls.append(FirstCall("pins", system.constraints.project, (still,)))
        calls += list_calls_of_solvers(problem, method)
    return calls


def find_method(problem: Setup) -> Any:
    """Return the method of the steps; of `Auto` the candidate whose kernels the others share.

    An equilibrium without load steps is found in one load step.
    """
    steps = problem.steps or LoadSteps()
    if not isinstance(steps, Auto):
        return steps.method
    assert problem.t_end is not None
    return steps.candidates(problem.system)[0].method


def make_system_over_step(problem: Setup, method: Any) -> System:
    """Return the system with the terms as the method evaluates them over the first step.

    Where dt is chosen during the run, this step is as long as the whole run: the kernels depend
    on the types of numbers, not on their values.
    """
    system = problem.system
    start = problem.start
    history = system.start_history(start)
    if isinstance(method, LoadSteps):
        end = start.t + method.dt
        increment = LoadIncrement(
            system,
            start,
            load=1.0,
            size=method.dt,
            begin=start.t,
            end=end,
            history=history,
        )
        return over_increment(increment)
    assert problem.t_end is not None
    dt = problem.steps.dt or problem.t_end - start.t
    if isinstance(method, StageMethod):
        # A user's method of an older fecloth may have no argument for the history.
        arguments = () if history is None else (history,)
        system_over_step: System = method.over_step(system, start, dt, *arguments)
        return system_over_step
    difference = StepDifference.between(start.x, dt, start.t)
    return system.over_step(difference, history, rates=method.traits.has_difference)


def list_calls_of_term(
    name: str, term: BoundTerm, state: State, J: BlockMatrix | None
) -> list[FirstCall]:
    """List the calls of a bound term: force, energy, power, limit and, if J is given, tangents.

    J is the matrix to which the tangents are added; None for an explicit method. `name` is the
    name of the term, and `state` the one at which it is evaluated.
    """
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
    for definite in (False, True):  # the exact tangent, and the clamped one
        place_and_weights = (x, v, t, 1.0, 1.0)  # the weights wx and wv of the tangents
        arguments = (*place_and_weights, J, definite)
        calls.append(FirstCall(f"{name}.add_tangent", term.add_tangent, arguments))
        if term.couples_nodes:
            arguments_of_coupling = (*place_and_weights, definite)
            calls.append(FirstCall(f"{name}.coupling", term.coupling, arguments_of_coupling))
    return calls


def list_calls_of_records(problem: Setup) -> list[FirstCall]:
    """List the calls that make rows of the tables and frames, and that estimate errors."""
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
    for name, term in system.named:
        if term.recovers_strain:
            arguments = (start.x, start.t)
            calls.append(FirstCall(f"{name}.strain_error", term.strain_error, arguments))
    return calls


def list_calls_of_solvers(problem: Setup, method: Any) -> Iterator[FirstCall]:
    """Yield a call for each linear solver that the steps may use.

    SuperLU stands for the factorisation of "auto": it calls all kernels that the others call, and
    loads no library.
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
