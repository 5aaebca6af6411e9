"""Explicit methods: forces and updates only, on the lumped mass, without any matrix.

Each has its own stability limit on dt, given for a mode of frequency ω and damping ratio ζ.
Beyond it the mode grows without bound. Pins and slides act through their projector P at the end
of each step; moved pins are exactly at their prescribed positions.
"""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fecloth.errors import InputError, flag
from fecloth.integrators.numerical_dissipation import explicit_dissipation
from fecloth.integrators.protocol import ALL_STUDIES, MethodTraits
from fecloth.integrators.step import Begin, OpensSteps, Solution, Step, ending
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.records import remembered

# `march` reports a step that overflows, because its values are not finite
quiet = np.errstate(over="ignore", invalid="ignore")


@remembered
@dataclass(frozen=True, eq=False)
class LastForce:
    """The memory of central differences.

    Attributes
    ----------
    a
        (n, 3) the acceleration M⁻¹ f of the last step [m/s²].
    at
        The state at which the force f was evaluated.
    """

    a: np.ndarray
    at: State


class ExplicitOpening(NamedTuple):
    """An explicit step that is open: ``method.open(system, state, dt, memory, history)``.

    ``method.close(opening, a)`` is the `Step` with the acceleration a (n, 3) [m/s²].

    Attributes
    ----------
    system, over
        The system, and the system over the step.
    at
        The state at which the step needs the acceleration.
    begin, end
        The state at the begin, and at the end the state of the held directions.
    dt
        Size of the step [s].
    memory
        What the method remembers of the step before.
    history
        The records that terms keep, at the begin of the step; None without any.
    opened
        The clock when the step was opened [s], for the counts.
    """

    system: System
    over: System
    at: State
    begin: State
    end: State
    dt: float
    memory: LastForce | None
    history: History | None
    opened: float

    def acceleration(self) -> np.ndarray:
        """The acceleration M⁻¹ f (n, 3) [m/s²] that the step needs."""
        return acceleration(self.over, self.at)

    def counts(self) -> Counts:
        """The counts of the step: the seconds since it was opened."""
        return Counts(seconds={"force": time.perf_counter() - self.opened})


class Explicit(OpensSteps):
    """Base of explicit methods.

    Attributes
    ----------
    constants
        The traits of the method, but for `beyond_limit`.
    forces_at
        0 for a method with forces at the begin of the step, ½ for forces at both ends.
    beyond_limit
        Whether `march` may take steps beyond the stability limit.
    """

    constants: MethodTraits
    forces_at: float
    beyond_limit: bool

    def __post_init__(self) -> None:
        flag("beyond_limit", self.beyond_limit, type(self).__name__)

    @cached_property
    def traits(self) -> MethodTraits:
        """The constants of the class, with the `beyond_limit` of this object."""
        return replace(self.constants, beyond_limit=self.beyond_limit)

    def check(self, system: System) -> None:
        """Raise `InputError` unless the mass of the system is lumped."""
        if system.mass_kind != "lumped":
            what = f"mass = {system.mass_kind!r}"
            reason = "an explicit step divides by the mass, and solves nothing"
            allowed = f"must be 'lumped': {reason}"
            remedy = 'Write mass = "lumped", or take an implicit method.'
            raise InputError(what, allowed, type(self).__name__, remedy)

    def _open(self, begin: Begin, solver: object) -> ExplicitOpening:
        """Open a step that needs the acceleration at its begin; there is nothing to solve."""
        opened = time.perf_counter()
        return ExplicitOpening(
            system=begin.system,
            over=begin.over,
            at=begin.state,
            begin=begin.state,
            end=begin.end,
            dt=begin.dt,
            memory=None,
            history=begin.history,
            opened=opened,
        )

    @quiet
    def _take(self, begin: Begin, solver: object) -> Step:
        """Take one step; raise `InputError` unless the mass of the system is lumped."""
        self.check(begin.system)
        opening = self.open(*begin)
        a = opening.acceleration()
        step: Step = self.close(opening, a)
        return replace(step, solution=Solution(self, opening, begin.memory, a))

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Numerical dissipation [J] of a step from `old`, see `explicit_dissipation`."""
        return explicit_dissipation(system, old, step, self.forces_at)


@dataclass(frozen=True)
class ForwardEuler(Explicit):
    """v₁ = v₀ + dt M⁻¹ f(x₀, v₀), x₁ = x₀ + dt v₀.

    First order. Stable for ω dt ≤ 2ζ where ζ < 1, 2/(ζ + √(ζ² − 1)) above, so for no dt
    without damping: a mode grows by √(1 + ω²dt²) a step. Keeps linear momentum, not angular,
    and gains energy; here to show why others are used. Source: Hairer, Nørsett and Wanner
    (1993), Solving Ordinary Differential Equations I, chapter I.

    Parameters
    ----------
    beyond_limit
        Whether `march` may take steps beyond the stability limit, which it refuses otherwise.
    """

    # its limit is of another form: see `critical_dt`
    constants = MethodTraits(
        order=1, explicit=True, error_constant=1 / 2, drift=(1, 1 / 2), stability=None
    )
    forces_at = 0.0
    beyond_limit: bool = False

    def close(self, opening: ExplicitOpening, a: np.ndarray) -> Step:
        """Close the step with the acceleration a (n, 3) at its begin."""
        return _euler(opening, a, new_velocity=0.0)


@dataclass(frozen=True)
class SymplecticEuler(Explicit):
    """v₁ = v₀ + dt M⁻¹ f(x₀, v₀), x₁ = x₀ + dt v₁.

    First order, stable for ω dt < 2 (√(1 + ζ²) − ζ), without damping of its own at any frequency
    below. Symplectic where nothing damps: the energy error stays bounded, of first order in dt.
    Keeps linear and angular momentum.
    Source: Hairer, Lubich and Wanner (2006), Geometric Numerical Integration, section I.1.

    Parameters
    ----------
    beyond_limit
        Whether `march` may take steps beyond the stability limit, which it refuses otherwise.
    """

    constants = replace(
        ForwardEuler.constants,
        drift=(2, 1 / 24),  # as of central differences, started half a step off
        stability=(1 / 4, 1 / 2),
        studied=("stability",),
    )
    forces_at = 0.0
    beyond_limit: bool = False

    def close(self, opening: ExplicitOpening, a: np.ndarray) -> Step:
        """Close the step with the acceleration a (n, 3) at its begin."""
        return _euler(opening, a, new_velocity=1.0)


def _euler(opening: ExplicitOpening, a: np.ndarray, new_velocity: float) -> Step:
    """Close an Euler step: x moves by the share `new_velocity` of v₁, and the rest of v₀."""
    begin = opening.begin
    dt = opening.dt
    x, v = move(begin, a, dt, new_velocity)
    new = set_held(opening.system, State(begin.t + dt, x, v), opening.end)
    return Step(new, begin, None, opening.counts(), **ending(opening, new))


@dataclass(frozen=True)
class CentralDifference(Explicit):
    """v½ = v₀ + dt/2 a₀, x₁ = x₀ + dt v½, a₁ = M⁻¹ f(x₁, v₀ + dt a₀), v₁ = v½ + dt/2 a₁.

    Velocity Verlet: the leapfrog, started with the half-step velocity. It is of second order,
    also with damping, because damping sees the predicted velocity v₀ + dt a₀; with a force at
    v½ it would be of first order. It evaluates one force in each step, which it keeps for the
    next one. `many_steps` takes many steps in one call.

    Stable for ω dt < 2 (√(1 + 4ζ²) − 2ζ): 2, 1.64, 0.83, 0.47 at ζ = 0, 0.1, 0.5, 1. Below this
    limit it has no damping of its own at any frequency. Where nothing damps it is symplectic:
    the energy error stays bounded, of second order in dt, and linear modes conserve the energy
    less dt²/8 a·M a. Keeps linear and angular momentum.

    Source: Hairer, Lubich and Wanner (2003), Geometric numerical integration illustrated by the
    Störmer–Verlet method, Acta Numerica 12, section 1.

    Parameters
    ----------
    beyond_limit
        Whether `march` may take steps beyond the stability limit, which it refuses otherwise.
    """

    constants = replace(
        SymplecticEuler.constants,
        order=2,
        error_constant=1 / 6,
        stability=(1 / 4, 1.0),
        studied=ALL_STUDIES,
    )
    forces_at = 0.5
    beyond_limit: bool = False

    def _open(self, begin: Begin, solver: object) -> ExplicitOpening:
        """Open a step that needs the acceleration a₁ at x₁ and v₀ + dt a₀.

        a₀ is the acceleration of the last step. In the first step, without a memory, it is
        evaluated here.
        """
        opened = time.perf_counter()
        system, state, dt, memory, history = begin
        if memory is None:
            a = acceleration(system.with_history(history), state)
            memory = LastForce(a, at=state)
        end = begin.end
        x, predicted_v = move(state, memory.a, dt, share=0.5)
        return ExplicitOpening(
            system=system,
            over=begin.over,
            at=set_held(system, State(state.t + dt, x, predicted_v), end),
            begin=state,
            end=end,
            dt=dt,
            memory=memory,
            history=history,
            opened=opened,
        )

    def close(self, opening: ExplicitOpening, a: np.ndarray) -> Step:
        """Close the step with the acceleration a₁ = `a` (n, 3) at x₁ and v₀ + dt a₀.

        v₁ = v₀ + dt/2 (a₀ + a₁), as both half steps of the formula together.
        """
        at = opening.at
        last = opening.memory  # a₀
        assert last is not None
        v = opening.begin.v + 0.5 * opening.dt * (last.a + a)
        opening.system.constraints.set_held(v, opening.end.v)
        new = State(at.t, at.x, v)
        return Step(
            state=new,
            balanced_at=at,
            memory=LastForce(a, at),
            counts=opening.counts(),
            accelerations=((last.at, last.a), (at, a)),
            **ending(opening, new),
        )


def acceleration(system: System, state: State) -> np.ndarray:
    """The acceleration M⁻¹ f (n, 3) [m/s²].

    Its part along held directions is not removed here: `set_held` sets what it has changed.
    """
    a: np.ndarray = system.force(state) * system.inverse_mass[:, None]
    return a


def set_held(system: System, state: State, end: State) -> State:
    """Set the held directions in the state's own arrays exactly to `end`; return the state."""
    system.constraints.set_held(state.x, end.x)
    system.constraints.set_held(state.v, end.v)
    return state


def move(begin: State, a: np.ndarray, dt: float, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions x + dt (v + share dt a) and velocities v + dt a after a step from `begin`."""
    dv = dt * a
    return begin.x + dt * (begin.v + share * dv), begin.v + dv
