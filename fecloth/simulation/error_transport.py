"""How a small error of a motion moves on with the cloth: linear equations about its state."""

import math
from dataclasses import dataclass

import numpy as np

from fecloth.errors import IndefiniteMatrix
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.protocol import LinearSolver
from fecloth.nonlinear.linear_solver import make_linear_solver
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

MOST_PARTS = 16  # of the time between two samples
GAMMA = 1 - math.sqrt(0.5)
# Of the linear solves: the estimate itself is known to a factor, not to a per mille.
RTOL_OF_TRANSPORT = 1e-2


@remembered
@dataclass(frozen=True, eq=False)
class Error:
    """An error of a motion.

    Attributes
    ----------
    x, v
        Error of the positions [m] and of the velocities [m/s], (n, 3) each.
    """

    x: np.ndarray
    v: np.ndarray

    @classmethod
    def none(cls, x: np.ndarray) -> "Error":
        """Return an error of zero, of the shape of x (n, 3)."""
        return cls(np.zeros_like(x), np.zeros_like(x))


def carry_error(
    system: System, state: State, seconds: float, error: Error, s: np.ndarray, r: np.ndarray
) -> Error:
    """Return the error after so many seconds, by steps of `Transport` about a state.

    s [m/s] and r [m/s²] (n, 3) are added to the errors of x and of v in each second. It is one
    step. Where errors grow so fast that its matrix is indefinite, it is four steps, or at most
    MOST_PARTS. Raises `SolveFailed` if that is not enough.
    """
    parts = 1
    while True:
        try:
            transport = Transport.at(system, state, seconds / parts)
            after = error
            for _ in range(parts):
                after = transport.carry(after, s, r)
            return after
        except IndefiniteMatrix:
            parts *= 4  # just below the limit growth is overestimated
            if parts > MOST_PARTS:
                raise


@dataclass(frozen=True, eq=False)
class Transport:
    """One step of the error δ of x and η of v, with K and D of a state:

        δ' = η + s,    M η' = −K δ − D η + M r

    s and r are what is added in each second. The method is L-stable, of order 2, with two
    stages (Alexander 1977, Diagonally implicit Runge–Kutta methods for stiff ODEs). A stage
    solves, with h = γ τ and γ = 1 − 1/√2,

        (M + h D + h² K) η = M b − h K a,    δ = a + h η

    An error grows where K has negative eigenvalues, as in a cloth that buckles.

    Attributes
    ----------
    system
        What moves.
    seconds
        The length τ of the step [s].
    K
        The stiffness.
    solver
        The solver of the matrix of a stage.
    """

    system: System
    seconds: float
    K: BlockMatrix
    solver: LinearSolver

    @classmethod
    def at(cls, system: System, state: State, seconds: float) -> "Transport":
        """Prepare a step of this length; raise `SolveFailed` for a matrix without a factor."""
        h = GAMMA * seconds
        zeros = BlockMatrix.zeros(system.pattern, system.team)
        K = system.assemble(zeros, state, wx=1.0)
        solver, J, _ = make_linear_solver(system, "auto", system.symmetric)
        J.values[:] = h * h * K.values
        system.project(system.add_tangents(J, state, wv=h, wa=1.0))
        solver.begin(h * h, 1.0, state.x)
        solver.prepare(system.couple(J, state, h * h, h))
        coupling = system.coupling(state, wx=1.0)
        if coupling is not None:
            K = K.plus(coupling)
        return cls(system, seconds, K, solver)

    def carry(self, error: Error, s: np.ndarray, r: np.ndarray) -> Error:
        """Return the error after the step, with s [m/s] and r [m/s²] (n, 3) added in it."""
        h = GAMMA * self.seconds
        weight = (1 - GAMMA) / GAMMA
        middle = self._stage(error.x + h * s, error.v + h * r)
        x = error.x + weight * (middle.x - error.x)
        v = error.v + weight * (middle.v - error.v)
        return self._stage(x + h * s, v + h * r)

    def _stage(self, a: np.ndarray, b: np.ndarray) -> Error:
        """Return the error at the end of a stage, from what is known before it."""
        h = GAMMA * self.seconds
        constraints = self.system.constraints
        a = constraints.expand(a)
        load = constraints.reduce(self.system.mass_times(b) - h * (self.K @ a))
        v, _ = self.solver.solve(load, RTOL_OF_TRANSPORT)
        v = constraints.followers.follow(v)
        return Error(a + h * v, v)
