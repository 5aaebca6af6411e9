"""Step size control by a local error estimate, for any method with an error constant."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from fecloth.errors import InputError, SolveFailed, is_number
from fecloth.integrators import protocol
from fecloth.integrators.step import Step, prescribed_end, set_prescribed
from fecloth.nonlinear.equation import has_limits
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.nonlinear.statistics import Counts
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import TIME
from fecloth.simulation.fixed_step import none_short_enough
from fecloth.simulation.stability_limited import LimitMemory, StabilityLimited
from fecloth.simulation.step_times import SAME_TIME, ChosenSteps, fit_step
from fecloth.simulation.within_step import acceleration, deviation_within_step
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.records import remembered

SAFETY = 0.9  # times the step that would just be allowed, as usual in step size control
SHORTEST = 0.2  # step over the step before it: the error of one step is no base for less
LONGEST = 2.0  # step over the step before it; BDF2 is stable below 1 + √2
# Of a step; a step that could grow by less keeps its size, so that its factor can be reused.
LEAST_GROWTH = 1.2
# For a step: each at least a tenth shorter, so that 40 reach 1e-2 to 1e-28 of the first.
MOST_ATTEMPTS = 40
SMALL_ERROR = 0.1  # over the allowed error; a step with less is sampled inside for pulses
LARGEST_FIRST_STEP = 10.0  # over the flight that estimates the error of the first step
# With contact, a step of any size may err by as much as this time of motion [s].
TIME_OF_CONTACT = 1.0
# Of a step that touches: after more the next step is half as long, after fewer it may be longer.
MOST_ITERATIONS = 12
FEW_ITERATIONS = 4


@remembered
@dataclass(frozen=True, eq=False)
class Control:
    """The memory of `Adaptive`.

    Attributes
    ----------
    dt
        The step to try next [s].
    error
        Error of the last step over the allowed one, at most 1.
    a
        (n, 3) mean acceleration of the last step [m/s²].
    t
        Time of the middle of the last step [s].
    method_memory
        The memory of the method itself.
    """

    dt: float
    error: float
    a: np.ndarray
    t: float
    method_memory: object = None

    @property
    def stable_dt(self) -> float:
        """The stable step [s] of an explicit method; infinite for others and at the start."""
        limited = self.method_memory
        return limited.dt if isinstance(limited, LimitMemory) else math.inf

    @property
    def is_at_limit(self) -> bool:
        """Whether the error allows stable steps of an explicit method."""
        return self.dt >= (1 - SAME_TIME) * self.stable_dt


@dataclass(frozen=True, eq=False)
class Attempt:
    """One attempt of `Adaptive` at a step.

    Attributes
    ----------
    dt
        Its size [s], which may be less than was asked for.
    error
        Its error over the allowed one; infinite where the step could not be solved.
    reason
        Why it is rejected, or the failure of the solve.
    step
        The step; None where it could not be solved.
    control
        The memory after the step; None where it is rejected.
    """

    dt: float
    error: float
    reason: str | NewtonFailed | SolveFailed
    step: Step | None = None
    control: Control | None = None


@checks_arguments
@dataclass(frozen=True)
class Adaptive(ChosenSteps):
    """A method whose steps are as long as a tolerance on their error allows.

    A step of the method, of order p, errs in x by c dt^(p + 1) x^(p + 1). The derivative is
    taken from the mean accelerations Δv/dt: the last one itself (p = 1), or the difference of
    the last two over the time between their middles (p = 2). The error is a length, the
    mass-weighted root mean square over the nodes, and may be

        dt (atol + rtol R)

    where R is the same mean of the distance from the cloth's centre: so the error is bounded
    for each second of motion, and the error at the end is proportional to the tolerance
    (bounded for each step, it would go with tol^(p/(p + 1))). The next step is, with the error
    e relative to the allowed one and e₋ the error of the step before,

        0.9 e^(−0.7/p) e₋^(0.4/p) dt

    and between 0.2 and 2 times the last one: a PI controller (Gustafsson 1991, Control Theoretic
    Techniques for Stepsize Selection in Explicit Runge–Kutta Methods; exponents of Hairer and
    Wanner 1996, Solving Ordinary Differential Equations II, eq. IV.2.43). A step beyond its
    tolerance, or one that Newton cannot solve, is rejected and tried shorter.

    At an impact the acceleration jumps, and no step is short enough for a bound for each second.
    With a contact among the terms each step, of any size, may therefore err by atol + rtol R
    times a second. Shorter steps before the first touch would gain nothing that the impacts leave.
    Where a step touches, the acceleration may change within dt, and its work decides, too: after
    more than 12 iterations of Newton's method the next step is half as long, and it is longer
    only after fewer than 4.

    The ends of a step do not show a short motion inside it. A step with little error is
    therefore sampled, at sixteen times for the motion of pins and at five for loads that
    depend on time, and rejected if these deviate from the interpolation between its ends.
    Shorter motions may be missed, and `run` warns of this: bound the steps by `longest`, or
    make one end there with `stops`.

    Explicit methods stay below their stability limit, see `StabilityLimited`. The estimate
    includes fast waves in the plane of the cloth: a method that does not damp them, as the
    midpoint rule on an undamped cloth, then takes many short steps. Take generalised-α, BDF2
    or energy–momentum, or damp the cloth. The first step is chosen by the acceleration and its
    change over a short flight. Raises `InputError` for tolerances below 0 or both 0, for a
    longest step that is not > 0, and for a method without an estimate.

    Parameters
    ----------
    method
        Of first or second order.
    rtol
        Error for each second of motion, relative to the cloth's size R [1/s].
    atol
        The same as a velocity [m/s], added.
    longest
        Longest step [s], for motions and loads shorter than the samples see; None for any.
    """

    method: protocol.Integrator
    rtol: float = 1e-3
    atol: float = 0.0
    longest: Annotated[float | None, TIME] = None

    def __post_init__(self):
        for name in ("rtol", "atol"):
            value = getattr(self, name)
            if not (is_number(value) and value >= 0):
                raise InputError(f"{name} = {value!r}", "must be a number >= 0", "Adaptive")
        if self.rtol == self.atol == 0:
            raise InputError("rtol = atol = 0", "one of them must be > 0", "Adaptive")
        if self.longest is not None and not (is_number(self.longest) and self.longest > 0):
            allowed = "must be a number > 0 [s], or None"
            raise InputError(f"longest = {self.longest!r}", allowed, "Adaptive")
        method = self.method
        if protocol.takes_steps(method):
            protocol.check_method(method, "Adaptive")
        if not protocol.is_method(method):
            allowed = "must be a method such as BDF2(), and none that chooses its own steps"
            raise InputError(f"method {method!r}", allowed, "Adaptive")
        # These raise for a method without a step or without an estimate.
        _ = self._stepper
        _ = self._error_constant

    @cached_property
    def traits(self) -> protocol.MethodTraits:
        """The method's traits, with chosen steps, which stay below its stability limit."""
        return replace(self.method.traits, chooses_dt=True, beyond_limit=True)

    def start(self, system: System, state: State, longest: float) -> Control:
        """Choose the first step so that its error, estimated by differences, is the allowed one.

        They are taken over a short flight with moving pins; the step is at most
        LARGEST_FIRST_STEP times that flight. A flight does not see what the cloth touches: with
        contact the acceleration alone decides, and the error of that step. Source: Hairer,
        Nørsett and Wanner (1993), Solving Ordinary Differential Equations I, II.4.
        """
        a = acceleration(system, state)
        rate = self.allowed(system, state)
        c = self._error_constant
        size = system.sums.rms(system.diagonal_mass, a)
        dt = longest
        touches = has_limits(system)
        if size > 0:
            dt = rate / (c * size)
            dt = min(longest, math.sqrt(TIME_OF_CONTACT * dt) if touches else dt)
        if self.traits.order == 2 and not touches:
            flight = dt
            x = state.x + flight * state.v + 0.5 * flight**2 * a  # the cloth falls past its pins
            ahead = State(state.t + flight, x, state.v + flight * a)
            ahead = set_prescribed(system, ahead, prescribed_end(system, state, flight))
            change = acceleration(system, ahead) - a
            jerk = system.sums.rms(system.diagonal_mass, change) / flight
            dt = min(longest, LARGEST_FIRST_STEP * flight)
            if jerk > 0:
                dt = min(dt, math.sqrt(rate / (c * jerk)))
        return Control(SAFETY * dt, 1.0, a, state.t)

    def step(
        self, system: System, state: State, horizon: float, solver, memory=None, history=None
    ) -> Step:
        """Take one step over at most `horizon` [s].

        Each attempt begins with the `history` that terms keep. Raises `NewtonFailed` if no step
        is short enough.
        """
        control = memory or self.start(system.with_history(history), state, horizon)
        dt = fit_step(min(control.dt, control.stable_dt, self.longest or math.inf), horizon)
        tried = Counts()
        reason: str | NewtonFailed | SolveFailed = ""
        for rejected in range(MOST_ATTEMPTS):
            if not state.t + dt > state.t:  # below the round-off of the time
                break
            attempt = self._attempt(
                system, state, dt, solver, control, history, is_first=memory is None
            )
            if attempt.step is not None:
                tried = tried.plus(attempt.step.counts)
                if attempt.control is not None:
                    return replace(
                        attempt.step,
                        memory=attempt.control,
                        counts=replace(tried, rejected=rejected),
                        size=attempt.step.size or dt,
                    )
            reason = attempt.reason
            dt = attempt.dt * self._shortening(attempt.error)
        raise none_short_enough(
            dt,
            reason,
            "Does a load or a motion of the pins jump here? Let it change in a finite time. "
            "Or take steps of a fixed dt, which need no estimate of their error.",
        )

    def _attempt(
        self,
        system: System,
        state: State,
        dt: float,
        solver,
        control: Control,
        history: History | None,
        is_first: bool,
    ) -> Attempt:
        """Take a step of at most dt [s], and decide by its error whether it is accepted."""
        try:
            step = protocol.take_step(
                self._stepper, system, state, dt, solver, control.method_memory, history
            )
            if is_first:
                protocol.check_step(step, self.method)
            a, t, error = self.error(system, state, step, control)
        except (NewtonFailed, SolveFailed) as failure:
            return Attempt(dt, math.inf, failure)
        dt = step.state.t - state.t
        if error < SMALL_ERROR:
            error = max(error, self.error_within_step(system, state, step))
        if error <= 1:
            return Attempt(dt, error, "", step, self._after(step, dt, control, error, a, t))
        return Attempt(dt, error, f"the error is {error:.3g} times the allowed one", step)

    def control_after(self, system: System, old: State, step: Step, control: Control) -> Control:
        """Return the memory after a step from `old` that is taken, whatever its error is."""
        a, t, error = self.error(system, old, step, control)
        dt = step.state.t - old.t
        return self._after(step, dt, control, error, a, t)

    def _after(
        self, step: Step, dt: float, control: Control, error: float, a: np.ndarray, t: float
    ) -> Control:
        """Return the memory after a step of dt [s]; see `Control`."""
        most = _growth_by_work(step.counts.newton) if step.touches else LONGEST
        following = self._next_dt(dt, control, error, most)
        return Control(following, min(error, 1.0), a, t, step.memory)

    def _shortening(self, error: float) -> float:
        """Return the next attempt over the attempt that failed with this error."""
        if not 0 < error < math.inf:
            return SHORTEST
        wanted = SAFETY * error ** (-1 / self.traits.order)
        return min(SAFETY, max(SHORTEST, wanted))

    def error_within_step(self, system: System, old: State, step: Step) -> float:
        """Return the error from motions and loads inside a step, over the allowed one."""
        deviation, push = deviation_within_step(system, old, step)
        dt = step.state.t - old.t
        p = self.traits.order
        # a change of p a/dt in the derivative, times dt^(p + 1)
        length = deviation + self._error_constant * p * dt**2 * push
        return length / self._allowed_in(system, step.state, dt)

    def _next_dt(self, dt: float, control: Control, error: float, most: float = LONGEST) -> float:
        """Return the next step [s] by the errors e of this step and of the step before it.

        dt SAFETY e^(−0.7/p) e_before^(0.4/p), a proportional and integral control (Hairer and
        Wanner 1996, Solving Ordinary Differential Equations II, IV.2), and at most `most` dt.
        """
        p = self.traits.order
        least = 1e-4  # so that one tiny error does not rule the next step
        before = max(control.error, least)
        factor = SAFETY * max(error, least) ** (-0.7 / p) * before ** (0.4 / p)
        factor = min(factor, most)
        if 1 <= factor < LEAST_GROWTH:
            return dt
        return dt * max(SHORTEST, factor)

    @property
    def _stepper(self):
        """The method, with steps below the stability limit if it is explicit."""
        if self.traits.explicit:
            return StabilityLimited(self.method)
        return self.method

    @property
    def _error_constant(self) -> float:
        """The error constant of the method; `InputError` for a method without one."""
        constant = self.method.traits.error_constant
        if constant is None:
            what = f"method {self.method!r}"
            raise InputError(what, "has no estimate of its error (error_constant)", "Adaptive")
        if not (is_number(constant) and constant > 0):
            what = f"{type(self.method).__name__}.traits.error_constant = {constant!r}"
            raise InputError(what, "must be a number > 0", "Adaptive")
        return constant

    def allowed(self, system: System, state: State) -> float:
        """Return the allowed error of x for each second [m/s]."""
        mass = system.diagonal_mass
        distances = state.x - system.sums.mean(mass, state.x)
        return self.atol + self.rtol * system.sums.rms(mass, distances)

    def _allowed_in(self, system: System, state: State, dt: float) -> float:
        """Return the allowed error of x in a step of dt [m]."""
        seconds = TIME_OF_CONTACT if has_limits(system) else dt
        return seconds * self.allowed(system, state)

    def error(self, system: System, old: State, step: Step, control: Control):
        """Return the mean acceleration (n, 3) of a step, its time, and the step's relative error.

        The time [s] is the middle of the step. The error is over the allowed one, and infinite
        where it is not finite.
        """
        new = step.state
        dt = new.t - old.t
        v = (step.unstruck or new).v  # no step is short enough for the jump of an impact
        a = system.constraints.project((v - old.v) / dt)
        t = old.t + 0.5 * dt
        order = self.traits.order
        derivative = a
        if order > 1:
            seconds = t - control.t
            if step.touches:  # the acceleration may jump within this step
                seconds = min(seconds, dt)
            derivative = (a - control.a) / seconds
        rate = system.sums.rms(system.diagonal_mass, derivative)
        error = self._error_constant * dt ** (order + 1) * rate
        error /= self._allowed_in(system, new, dt)
        if not math.isfinite(error):
            error = math.inf
        return a, t, error


def _growth_by_work(iterations: int) -> float:
    """Return the largest next step over a step with this many iterations, of a contact."""
    if iterations > MOST_ITERATIONS:
        return 0.5
    return LONGEST if iterations < FEW_ITERATIONS else 1.0
