"""Implicit methods with a memory: their base class, Newmark's family and generalised α."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fecloth.errors import InputError, flag, is_number
from fecloth.integrators.numerical_dissipation import memory_dissipation
from fecloth.integrators.protocol import ALL_STUDIES, MethodTraits
from fecloth.integrators.step import UNCOUNTED, Begin, Opening, OpensSteps, Step, arrive, blend
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.linear_solver import make_linear_solver
from fecloth.nonlinear.options import Newton
from fecloth.nonlinear.stage import Stage, hold_stage
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered


class WithMemory(OpensSteps):
    """Base class of methods with a memory; it supplies `step` and their numerical dissipation.

    The memory is a frozen record, `Step.memory`, that `march` hands to the next step; without
    it a method starts anew. A subclass supplies `traits`, and `open` and `close` or a `step`
    of its own. The traits have θ = ½, because M Δv · v̄ with v̄ = (v₀ + v₁)/2 is the change of
    the kinetic energy.
    """

    traits: MethodTraits

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Numerical dissipation [J] of a step from `old`, see `memory_dissipation`."""
        return memory_dissipation(system, old, step)


@remembered
@dataclass(frozen=True, eq=False)
class Acceleration:
    """The memory of Newmark's family: a (n, 3) [m/s²] at the end of the last step."""

    a: np.ndarray


class AccelerationMethod(WithMemory):
    """Base of methods that solve for the acceleration q = a₁ at the end of a step.

    With index 0 for the old and 1 for the new state, y_f = α_f y₀ + (1 − α_f) y₁ and
    a_m = α_m a₀ + (1 − α_m) a₁:

        M a_m = f(x_f, v_f, t_f)
        x₁ = x₀ + dt v₀ + dt² ((½ − β) a₀ + β a₁)
        v₁ = v₀ + dt ((1 − γ) a₀ + γ a₁)
    """

    @property
    def share(self) -> float | None:
        """The field `share` of the method's `Step`."""
        return None

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        """The parameters (α_m, α_f, β, γ)."""
        raise NotImplementedError

    def stage(self, state: State, dt: float, a: np.ndarray) -> Stage:
        """Return the stage of a step from `state`, where the acceleration is a (n, 3).

        It is at (x_f, v_f, t_f), with a_m, for the unknown q = a₁.
        """
        alpha_m, alpha_f, beta, gamma = self.parameters
        # x₁ and v₁ with q = 0
        x = state.x + dt * state.v + (0.5 - beta) * dt**2 * a
        v = state.v + (1 - gamma) * dt * a
        at = blend(state, State(state.t + dt, x, v), 1 - alpha_f)
        return Stage(
            t=at.t,
            x=at.x,
            v=at.v,
            a=alpha_m * a,
            wx=(1 - alpha_f) * beta * dt**2,
            wv=(1 - alpha_f) * gamma * dt,
            wa=1 - alpha_m,
            x_end=x,
            w_end=beta * dt**2,
        )

    def _open(
        self, begin: Begin, solver: SolverContext | None, over: System | None = None
    ) -> Opening:
        """Open a step after the step that left the memory of `begin`; q = a₁.

        Without a memory the first acceleration is solved for, by the `solver` or a direct one.
        `over` is the system over the step if another method opens its first step by this one,
        as BDF2 does: then the rates of the terms are the rates of that method.
        """
        system, state, dt, memory, history = begin
        alpha_m, alpha_f = self.parameters[:2]
        end = begin.end
        before = system.with_history(history)
        memory = memory or Acceleration(starting_acceleration(before, state, end, dt, solver))
        stage = self.stage(state, dt, memory.a)
        if over is None:
            over = system.over_step(stage.difference(state, dt), history, rates=False)
        a_held = self._acceleration_of_held(state, end, dt, memory.a)
        at = blend(state, end, 1 - alpha_f)
        a_m = alpha_m * memory.a + (1 - alpha_m) * a_held
        stage = hold_stage(system, stage, at, a_m)
        return Opening(
            method=self,
            system=before,
            over=over,
            stage=stage,
            begin=state,
            end=end,
            dt=dt,
            memory=memory,
            guess=memory.a,
            history=history,
        )

    def close(self, opening: Opening, q: np.ndarray, counts: Counts = UNCOUNTED) -> Step:
        """Close the step with the acceleration q (n, 3) at its end.

        `Step.a` is a_m where the forces are balanced at the stage. With a `share` the ledger
        compares M a with the weighted forces of both ends, and `Step.a` is Δv/dt.
        """
        stage = opening.stage
        begin = opening.begin
        end = opening.end
        dt = opening.dt
        gamma = self.parameters[3]
        a = opening.memory.a
        v = begin.v + dt * ((1 - gamma) * a) + dt * gamma * q
        new, ending = arrive(opening, end.t, stage.x_end + stage.w_end * q, v)
        a_held = self._acceleration_of_held(begin, end, dt, a)
        a_new = opening.system.constraints.hold(q, a_held)
        x, v, a_mean = stage.at(q)
        if self.share is not None:
            a_mean = (new.v - begin.v) / dt
        return Step(
            state=new,
            balanced_at=State(stage.t, x, v),
            memory=Acceleration(a_new),
            counts=counts,
            ends=(opening.system, begin),
            a=a_mean,
            share=self.share,
            **ending,
        )

    def _acceleration_of_held(
        self, begin: State, end: State, dt: float, a: np.ndarray
    ) -> np.ndarray:
        """a₁ (n, 3) [m/s²] of the held directions: v₁ = v₀ + dt ((1 − γ) a₀ + γ a₁) for a₁."""
        gamma = self.parameters[3]
        a_held: np.ndarray = ((end.v - begin.v) / dt - (1 - gamma) * a) / gamma
        return a_held


@dataclass(frozen=True)
class Newmark(AccelerationMethod):
    """M a₁ = f(x₁, v₁), x₁ and v₁ by β and γ from a₀ and a₁.

    Second order for γ = ½, else first. A-stable for 2β ≥ γ ≥ ½. With a smaller β it is stable
    for ω dt < 1/√(γ/2 − β) without damping (`critical_dt`).

    β = ¼, γ = ½ is the trapezoidal rule: it does not damp linear modes of any frequency, and
    keeps the energy of a linear problem. On nonlinear problems the energy can grow at steps that
    do not resolve the fast modes. With γ > ½ a slow mode loses the part (γ − ½)(ω dt)²/2 of its
    amplitude in each step; with β = (γ + ½)²/4 the fastest modes keep |γ − 3/2|/(γ + ½).

    Keeps linear momentum, not angular momentum.

    Source: Newmark (1959), A Method of Computation for Structural Dynamics, J. Eng. Mech. Div.
    85.

    Parameters
    ----------
    beta
        > 0: at 0 the method is explicit.
    gamma
        At least ½: below, every mode grows.
    beyond_limit
        Whether `march` may take steps beyond the stability limit, which it refuses otherwise.
    """

    beta: float = 0.25
    gamma: float = 0.5
    beyond_limit: bool = False

    def __post_init__(self) -> None:
        if not (is_number(self.beta) and self.beta > 0):
            remedy = "beta = 0 is CentralDifference."
            raise InputError(f"beta = {self.beta!r}", "must be > 0", "Newmark", remedy)
        if not (is_number(self.gamma) and self.gamma >= 0.5):
            raise InputError(f"gamma = {self.gamma!r}", "must be >= 0.5", "Newmark")
        flag("beyond_limit", self.beyond_limit, "Newmark")

    @cached_property
    def traits(self) -> MethodTraits:  # type: ignore[override]  # a constant of the base class
        """The constants of the method, of second order for γ = ½.

        The error constant is |β − 1/6|, but no less than 1/12, the error of the trapezoidal rule
        in v. For γ > ½ the error in v is of first order, and there is no estimate of it. Damping
        widens the limit of stability for γ > ½ only.
        """
        order = 1
        error_constant = None
        drift = (1, 0.5 * (self.gamma - 0.5))  # the loss of amplitude
        if self.gamma == 0.5:
            order = 2
            error_constant = max(abs(self.beta - 1 / 6), 1 / 12)
            drift = (2, 0.5 * abs(self.beta - 1 / 12))  # the error of the phase
        of_stiffness = max(0.5 * self.gamma - self.beta, 0.0)  # 0 where it is A-stable
        of_damping = 0.5 - self.gamma
        return MethodTraits(
            order=order,
            error_constant=error_constant,
            drift=drift,
            stability=(of_stiffness, of_damping),
            beyond_limit=self.beyond_limit,
            at_infinity=self._at_infinity(),
            gains=True,
        )

    def _at_infinity(self) -> float:
        """The largest root of β λ² + (½ − 2β + γ) λ + ½ + β − γ = 0, which ω dt → ∞ leaves."""
        half = 0.5 * (0.5 - 2 * self.beta + self.gamma) / self.beta
        product = (0.5 + self.beta - self.gamma) / self.beta
        root = half**2 - product
        if root > 0:
            return half + math.sqrt(root)
        return math.sqrt(product)

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        return 0.0, 0.0, self.beta, self.gamma

    @property
    def share(self) -> float:
        """γ: M Δv/dt = (1 − γ) f₀ + γ f₁."""
        return self.gamma


def starting_acceleration(
    system: System, state: State, end: State, dt: float, solver: SolverContext | None
) -> np.ndarray:
    """Return the acceleration (n, 3) [m/s²] at the begin of the first step from `state`.

    Along the free directions M a = f, by one linear solve with M. Along the held directions it
    is the mean acceleration of the first step, (v₁ − v₀)/dt. Without a `solver` a direct one is
    made. Raises `SolveFailed` if M has no factor.
    """
    project = system.constraints.project
    hold = system.constraints.hold
    held = hold(np.zeros_like(state.v), (end.v - state.v) / dt)
    b = project(system.force(state) - system.scalar_mass @ held)
    if solver is None:
        solver = SolverContext(*make_linear_solver(system, "direct", True)[:2], Newton())
    linear_solver, matrix = solver.matrix_solver()
    linear_solver.prepare(system.project(system.assemble(matrix, state, wa=1.0)))
    free, _ = linear_solver.solve(b, rtol=solver.options.residual)
    total: np.ndarray = held + free
    return total


@dataclass(frozen=True)
class GeneralizedAlpha(AccelerationMethod):
    """M a_m = f(x_f, v_f): α_m = (2ρ − 1)/(ρ + 1), α_f = ρ/(ρ + 1), with ρ = ρ∞.

    Second order by γ = ½ − α_m + α_f, and A-stable with β = (1 − α_m + α_f)²/4. As ω dt → ∞ a
    mode keeps the part ρ∞ of its amplitude in each step. With ρ∞ = ½ it loses 1e-2 at ω dt = 1
    and 1.4e-4 at 0.3; with ρ∞ = 1 it loses nothing at any ω dt. Keeps linear momentum, but
    neither angular momentum nor energy: on nonlinear problems the energy can grow at steps that
    do not resolve the fast modes, the more the larger ρ∞ is.

    Source: Chung and Hulbert (1993), A Time Integration Algorithm for Structural Dynamics With
    Improved Numerical Dissipation: The Generalized-α Method, J. Appl. Mech. 60.

    Parameters
    ----------
    rho_inf
        In [0, 1].
    """

    rho_inf: float = 0.5

    def __post_init__(self) -> None:
        if not (is_number(self.rho_inf) and 0 <= self.rho_inf <= 1):
            what = f"rho_inf = {self.rho_inf!r}"
            raise InputError(what, "must lie in [0, 1]", "GeneralizedAlpha")

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        alpha_m = (2 * self.rho_inf - 1) / (self.rho_inf + 1)
        alpha_f = self.rho_inf / (self.rho_inf + 1)
        lag = alpha_f - alpha_m
        return alpha_m, alpha_f, 0.25 * (1 + lag) ** 2, 0.5 + lag

    @cached_property
    def traits(self) -> MethodTraits:  # type: ignore[override]  # a constant of the base class
        """The constants of the method.

        The error constant is β − ½ (α_f − α_m) − 1/6: the acceleration belongs to a time
        (α_f − α_m) dt before the end of the step, here the `lag`.
        """
        alpha_m, alpha_f, beta, _ = self.parameters
        lag = alpha_f - alpha_m
        return MethodTraits(
            order=2,
            error_constant=beta - 0.5 * lag - 1 / 6,
            drift=(2, 1 / 12 + 3 / 8 * lag**2),
            at_infinity=self.rho_inf,
            gains=self.rho_inf > 0,
            studied=ALL_STUDIES,
        )
