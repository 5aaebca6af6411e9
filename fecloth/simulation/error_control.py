"""Steps chosen by their error: a controller around any method that knows its error's constant."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from fecloth.errors import InputError, SolveFailed, is_number
from fecloth.integrators.protocol import (
    ExplicitIntegrator,
    Integrator,
    MethodTraits,
    check_method,
)
from fecloth.integrators.step import Step, arrival, held
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.nonlinear.statistics import Counts
from fecloth.simulation.stability_limited import AtLimit
from fecloth.simulation.within_step import unseen
from fecloth.system.records import remembered
from fecloth.system.state import State
from fecloth.system.system import System

SAFETY = 0.9
SHORTEST, LONGEST = 0.2, 2.0  # of a step to the one before; BDF2 is stable below 1 + √2
STAY = 1.2  # a step that might grow by less keeps its size, and with it what was factorised
RETRIES = 40
QUIET = 0.1  # a step with less than this part of its error is looked into
FAR = 10.0  # times the distance ahead at which the first step's error was looked for


@remembered
@dataclass(frozen=True, eq=False)
class Control:
    """What is handed from step to step.

    Attributes
    ----------
    dt
        The step to try next [s].
    error
        That of the last step relative to what it was allowed, at most 1.
    a, t
        (n, 3) mean acceleration [m/s²] of the last step, and the time of its middle [s].
    of_method
        The memory of the method itself.
    """

    dt: float
    error: float
    a: np.ndarray
    t: float
    of_method: object = None


@dataclass(frozen=True)
class Adaptive:
    """A method whose steps are as long as a tolerance on their error allows.

    A step of the method, of order p, errs in x by c dt^(p + 1) x^(p + 1). The derivative is taken
    from the mean accelerations Δv/dt: the last one itself (p = 1), or the difference of the last
    two over the time between their middles (p = 2). The error is a length, the mass-weighted root
    mean square over the nodes, and may be

        dt (atol + rtol R)

    where R is the same mean of the distance from the cloth's centre: so the error is bounded for
    each second of motion, and that at the end is proportional to the tolerance (bounded for each
    step, it would go with tol^(p/(p + 1))). The next step is, with the error e relative to the
    allowed one and e₋ that of the step before,

        0.9 e^(−0.7/p) e₋^(0.4/p) dt

    and between 0.2 and 2 times the last one: a PI controller (Gustafsson 1991, Control Theoretic
    Techniques for Stepsize Selection in Explicit Runge–Kutta Methods; the exponents are those of
    Hairer and Wanner 1996, Solving Ordinary Differential Equations II, eq. IV.2.43). A step
    beyond its tolerance, or one that Newton cannot solve, is rejected and tried shorter.

    A cloth at rest does not show what is to come: a step with little error is looked into, at
    sixteen times for the pins' motion and five for loads that depend on time, and rejected if
    these stray from what its ends tell. What is shorter than that is missed: make the step end
    there, by `march`'s `stops`.

    Explicit methods stay below their stability limit, see `AtLimit`. The estimate sees all that
    moves, also the fast waves in the plane of the cloth, if they are excited. A method that lets
    them ring creeps after them: on the undamped trampoline, 2,500 nodes, 0.2 s, rtol 1e-2, the
    midpoint rule took 1,631 steps where generalised-α took 93, BDF2 103 and energy–momentum 97.
    Take one of these, or damp the cloth: with damping the midpoint rule takes no more steps than
    they do. The first step is chosen by the acceleration and its change over a short flight.

    Parameters
    ----------
    method
        Of first or second order.
    rtol
        Error for each second of motion, relative to the cloth's size R [1/s].
    atol
        The same as a velocity [m/s], added.

    Raises
    ------
    InputError
        For tolerances below 0 or both 0, and for a method without an estimate.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
    >>> method = fc.Adaptive(fc.ImplicitMidpoint(), rtol=1e-2)
    >>> result = fc.run(system, method, system.rest(), t_end=0.2)
    >>> float(result.times[-1]), bool(np.ptp(np.diff(result.times)) > 0)
    (0.2, True)
    """

    method: Integrator | ExplicitIntegrator
    rtol: float = 1e-3
    atol: float = 0.0

    def __post_init__(self):
        for name in ("rtol", "atol"):
            value = getattr(self, name)
            if not (is_number(value) and value >= 0):
                raise InputError(f"{name} = {value!r}", "must be a number >= 0", "Adaptive")
        if self.rtol == self.atol == 0:
            raise InputError("rtol = atol = 0", "one of them must be > 0", "Adaptive")
        method = self.method
        is_method = not isinstance(method, type) and hasattr(method, "step")
        if is_method:
            check_method(method, "Adaptive")
        if not is_method or method.traits.chooses_dt:
            allowed = "must be a method such as BDF2(), and none that chooses its own steps"
            raise InputError(f"method {method!r}", allowed, "Adaptive")
        _ = self._rule, self._constant  # which refuse methods without a step or an estimate

    @property
    def traits(self) -> MethodTraits:
        """Those of the method; the steps are chosen, of explicit ones below the limit."""
        return replace(self.method.traits, chooses_dt=True, beyond_limit=True)

    def check(self, system: System) -> None:
        """Refuse what the method refuses."""
        cast(ExplicitIntegrator, self.method).check(system)

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Energy [J] that the method itself took in a step, by its own formula."""
        return self.method.numerical(system, old, step)

    def weights(self, dt: float) -> tuple[float, float, float]:
        """Those of the method."""
        return cast(Integrator, self.method).weights(dt)

    def start(self, system: System, state: State, longest: float) -> Control:
        """The first step: that whose error, by differences at the start, is the one allowed.

        The change is that over a short flight with the pins in motion; the step may be FAR times
        that. After Hairer, Nørsett and Wanner (1993), Solving Ordinary Differential Equations I,
        II.4.
        """
        a, rate, c = acceleration(system, state), self.allowed(system, state), self._constant
        size = system.sums.rms(system.diagonal_mass, a)
        dt = min(longest, rate / (c * size)) if size > 0 else longest
        if self.traits.order == 2:
            x = state.x + dt * state.v + 0.5 * dt**2 * a  # as the cloth falls past its pins
            ahead = State(state.t + dt, x, state.v + dt * a)
            ahead = held(system, ahead, arrival(system, state, dt))
            jerk = system.sums.rms(system.diagonal_mass, acceleration(system, ahead) - a) / dt
            dt = min(longest, FAR * dt, math.sqrt(rate / (c * jerk)) if jerk > 0 else longest)
        return Control(SAFETY * dt, 1.0, a, state.t)

    def step(
        self,
        system: System,
        state: State,
        horizon: float,
        solver: SolverContext,
        memory: Control | None = None,
    ) -> Step:
        """One step from `state` over at most `horizon` [s], and to its end if that is near."""
        control, tried = memory or self.start(system, state, horizon), Counts()
        dt = _fitted(control.dt, horizon)
        reason: str | NewtonFailed | SolveFailed = ""
        for rejected in range(RETRIES):
            try:
                step = self._rule.step(system, state, dt, solver, control.of_method)
                a, t, error = self.error(system, state, step, control)
                dt = step.state.t - state.t  # which may be less
            except (NewtonFailed, SolveFailed) as failure:
                reason, error = failure, math.inf
            else:
                tried = tried.plus(step.counts)
                if error < QUIET:
                    error = max(error, self.unseen(system, state, step))
                reason = f"the error is {error:.3g} times the allowed one"
                if error <= 1:
                    proposed = self._next(dt, control, error)
                    after = Control(proposed, error, a, t, step.memory)
                    return replace(step, memory=after, counts=replace(tried, rejected=rejected))
            shorter = SAFETY * error ** (-1 / self.traits.order) if error > 0 else SHORTEST
            dt *= min(SAFETY, max(SHORTEST, shorter)) if math.isfinite(error) else SHORTEST
        raise NewtonFailed(
            f"no step is short enough: at {dt:.2g} s {reason}",
            getattr(reason, "residual", math.nan),
            "Is a load or a motion of the pins discontinuous? Loosen the tolerance there.",
        )

    def unseen(self, system: System, old: State, step: Step) -> float:
        """The error of what pins and loads do within a step, relative to the allowed one."""
        astray, pushed = unseen(system, old, step)
        dt, p = step.state.t - old.t, self.traits.order
        length = astray + self._constant * p * dt**2 * pushed  # a change by p a/dt, dt^(p + 1)
        return length / (dt * self.allowed(system, step.state))

    def _next(self, dt, control, error):
        p, least = self.traits.order, 1e-4
        before = max(control.error, least)
        factor = SAFETY * max(error, least) ** (-0.7 / p) * before ** (0.4 / p)
        return dt * (1.0 if 1 <= factor < STAY else min(LONGEST, max(SHORTEST, factor)))

    @property
    def _rule(self):
        """The method; an explicit one never beyond its limit."""
        return AtLimit(self.method) if self.traits.explicit else self.method

    @property
    def _constant(self) -> float:
        constant = self.method.traits.error_constant
        if constant is None:
            what = f"method {self.method!r}"
            raise InputError(what, "has no estimate of its error (error_constant)", "Adaptive")
        if not (is_number(constant) and constant > 0):
            what = f"{type(self.method).__name__}.traits.error_constant = {constant!r}"
            raise InputError(what, "must be a number > 0", "Adaptive")
        return constant

    def allowed(self, system: System, state: State) -> float:
        """Error for each second [m/s]."""
        mass = system.diagonal_mass
        distances = state.x - system.sums.mean(mass, state.x)
        return self.atol + self.rtol * system.sums.rms(mass, distances)

    def error(self, system: System, old: State, step: Step, control: Control):
        """Mean acceleration, its time, and the error relative to the allowed one; inf if lost."""
        new = step.state
        dt = new.t - old.t
        a, t = system.constraints.project((new.v - old.v) / dt), old.t + 0.5 * dt
        order = self.traits.order
        change = a if order == 1 else (a - control.a) / (t - control.t)
        error = self._constant * dt**order * system.sums.rms(system.diagonal_mass, change)
        error /= self.allowed(system, new)
        return a, t, error if math.isfinite(error) else math.inf


def _fitted(dt, horizon):
    """The step as it fits: the horizon in as many equal parts as it takes if those are few."""
    parts = math.ceil(horizon / dt - 1e-9)
    return horizon / parts if parts <= 2 else dt


def acceleration(system: System, state: State) -> np.ndarray:
    """f / m (n, 3) [m/s²] of the free directions, with the diagonal mass."""
    return system.constraints.project(system.force(state) / system.diagonal_mass[:, None])
