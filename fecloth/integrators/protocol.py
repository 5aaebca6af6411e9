"""What a time integrator offers: its traits, its step, and the abilities that some have.

A method of your own is a frozen dataclass with `traits` and the functions of `Integrator`, or
of `ExplicitIntegrator`. `StageMethod` and `WithMemory` are bases that supply all but a few
lines; the file studies/examples/integrator.py has one of each. `fecloth.integrators` exports
them, and the `Step`, `prescribed_end`, `set_prescribed` and `remembered` named below.
`Counts()` of `fecloth.nonlinear.statistics` are the counts of a step without Newton's
iteration.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from inspect import signature
from typing import Any, Protocol

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, brief, is_number
from fecloth.integrators.step import Step
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.quantities.arguments import checks_arguments
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.step_difference import StepDifference

ALL_STUDIES = ("chart", "stability", "tune")


@checks_arguments
@dataclass(frozen=True)
class MethodTraits:
    """The constants of a method, which the rest of fecloth reads before and during a run.

    Parameters
    ----------
    order
        p: the error at a given time is proportional to dt^p.
    theta
        Place between the old (0) and the new (1) state where the forces balance: the work of
        the pins over a step is the power at the velocity v₀ + θ Δv. Take ½ if M Δv · (v₀ +
        v₁)/2 is the change of the kinetic energy that your method accounts for.
    explicit
        Whether a step needs forces only. An explicit method gets no linear solver, offers
        `check`, and may be stepped near its stability limit.
    symmetric
        Whether the system matrix is symmetric if the terms' tangents are.
    error_constant
        c > 0: a step's error in x is c dt^(p + 1) times the (p + 1)-th time derivative of x.
        None if it is not known: then `Adaptive` refuses the method.
    drift
        (q, κ): the error of a slow undamped mode of frequency ω after the time t, relative to
        its amplitude, is κ (ω dt)^q ω t. It may be an error of the phase or of the amplitude:
        the eigenvalue of a step is about e^(iω dt) (1 + c (ω dt)^(q + 1)) with a complex c,
        |c| = κ. Without it, the error in time of a run is estimated from (order,
        error_constant). That estimate is too large if errors of single steps cancel.
    stability
        (a, b): a mode with k = ω² and d = 2 ζ ω is stable if a dt² k + b dt d < 1. (0, 0) is an
        A-stable method. None if the limit has another form or is not known.
    beyond_limit
        Whether `march` may take steps beyond that limit; otherwise it refuses them.
    chooses_dt
        Whether the method chooses its steps; then `march` takes no dt.
    has_difference
        Whether the method gives terms its difference for rates over a step; see
        `fecloth.terms.step_difference`. Methods without it refuse a term that needs one.
    at_infinity
        ρ∞: the factor by which a step multiplies the amplitude of waves that it does not resolve
        at all; 1 keeps them, 0 takes them away at once. Explicit methods have none.
    gains
        Whether such waves may gain energy in large motions.
    solves
        Whether a step solves its equation. The error of a linearisation is in no estimate.
    studied
        The studies that run the method if they are not told which: "chart", "stability", "tune".

    Raises
    ------
    InputError
        For a trait of another name, an order that is no integer >= 0, a theta outside [0, 1],
        and for an explicit method that claims to be A-stable.

    Examples
    --------
    >>> MethodTraits(order=1, theta=1.0, error_constant=1 / 2).stability
    (0.0, 0.0)
    """

    order: int
    theta: float = 0.5
    explicit: bool = False
    symmetric: bool = True
    error_constant: float | None = None
    drift: tuple[int, float] | None = None
    stability: tuple[float, float] | None = (0.0, 0.0)
    beyond_limit: bool = True
    chooses_dt: bool = False
    has_difference: bool = False
    at_infinity: float = 1.0
    gains: bool = False
    solves: bool = True
    studied: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        validation.whole("order", self.order, 0, "MethodTraits")
        if not is_number(self.theta) or not 0.0 <= self.theta <= 1.0:
            raise InputError(f"theta = {self.theta!r}", "must be from 0 to 1", "MethodTraits")
        if self.explicit and self.stability == (0.0, 0.0):
            allowed = "must be (a, b) with a limit, or None: no explicit method is A-stable"
            raise InputError(f"stability = {self.stability}", allowed, "MethodTraits")


def drift_of(traits: MethodTraits) -> tuple[int, float] | None:
    """The `drift` (q, κ) of a method, else (order, error constant) of its steps, if known."""
    if traits.drift is not None:
        return traits.drift
    if traits.error_constant is None:
        return None
    return (traits.order, traits.error_constant)


class Integrator(Protocol):
    """What every method offers: traits, a step, and an account of its energy."""

    @property
    def traits(self) -> MethodTraits:
        """The constants of the method: a class attribute, or a property if they vary."""

    def step(
        self,
        system: System,
        state: State,
        dt: float,
        solver: Any,
        memory: Any = None,
        history: History | None = None,
    ) -> Step:
        """Take one step from `state` over `dt` [s].

        Parameters
        ----------
        system
            Supplies ``force(state)`` (n, 3) [N], ``scalar_mass`` (n, n) [kg], its row
            sums ``nodal_mass`` (n,) [kg], and the constraints.
        state
            Time [s], x (n, 3) [m] and v (n, 3) [m/s]; do not change its arrays.
        dt
            Size of the step [s]; of a method with `chooses_dt` the longest size allowed.
        solver
            For ``newton.solve(system, stage, solver, guess)``; None for explicit methods.
        memory
            What the step before returned as memory; None in the first step. It may be a first
            guess or a record of past values. Mark the class of a record with `remembered`, so
            that restart files can hold it.
        history
            The records that terms keep, None without any: ``over = system.over_step(difference,
            history, rates=False)`` is the system with them, and the `Step` has
            ``history=over.commit(new, history)`` and ``earlier=history``. It may be left out of
            the arguments: then a system whose terms keep a history is refused.

        Returns
        -------
        Step
            ``Step(state, balanced_at, memory, counts)``: the new state, the state at which the
            forces were balanced, the memory for the next step, and the `Counts`. A method whose
            step is by the mean of several forces, as explicit ones are, adds `accelerations`.
            The new state must have the pinned nodes at their prescribed places:
            ``new = set_prescribed(system, new, prescribed_end(system, state, dt))`` returns a
            state with them there, and leaves its argument unchanged.

        Raises
        ------
        NewtonFailed, SolveFailed
            If the step cannot be solved. `march` reports it; `Adaptive` tries a shorter step.
        """

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Energy [J] that the method itself dissipated in a step from `old`; < 0 for a gain."""


class ExplicitIntegrator(Integrator, Protocol):
    """A method that needs forces only: `Integrator`, and a check of the mass."""

    def check(self, system: System) -> None:
        """Raise `InputError` for a system that the method cannot step, as without lumped mass.

        It is called before the first step.
        """


class ChoosesMethod(Protocol):
    """A choice of the method itself, such as `Auto`, before it is made."""

    @property
    def traits(self) -> MethodTraits:
        """The constants that every method it may choose has."""


class StepChoice(Integrator, Protocol):
    """A method together with the choice of its steps: `traits.chooses_dt` is True.

    Its ``step(system, state, horizon, solver, memory, history)`` takes one step of any size up
    to `horizon` [s]; the time of the state that it returns says how long it was. Its traits
    are ``replace(method.traits, chooses_dt=True)``, and its memory contains the memory of the
    method.

    `FixedStep`, `GivenSteps`, `StabilityLimited` and `Adaptive` of `fecloth.simulation` are
    such values, and `simulation.resolve.choose_steps` decides between them. The base
    `ChosenSteps` has all but `method` and `step` of a value whose steps are not fixed.
    """

    @property
    def method(self) -> Integrator:
        """The method that takes the steps."""

    @property
    def dt(self) -> float | None:
        """The step [s] if it is fixed, else None."""

    def end_times(self, t: float, t_end: float | None, stops: Sequence[float] = ()) -> np.ndarray:
        """Times after t at which a step must end [s], in order; the last one is `t_end`."""

    def check(self, system: System) -> None:
        """Raise `InputError` for a system that the method cannot step, as by its mass."""

    def check_start(self, system: System, state: State, insist: str = "") -> None:
        """Raise `InputError` for steps that the method cannot take from `state`.

        `insist` is the sentence that says how to take them anyway.
        """


def check_method(method: object, where: str = "march") -> None:
    """Raise `InputError` for an object that is no method with a `step` and `MethodTraits`.

    `where` is the function that the error names. A choice of steps, or of the method, passes.
    """
    if not takes_steps(method):
        allowed = "must be a method such as BackwardEuler() or Auto()"
        if isinstance(method, State):
            remedy = "The method comes before the state."
        else:
            remedy = ""
        raise InputError(f"method {brief(method)}", allowed, where, remedy)
    check_offers(method, ("traits",), where)
    traits = getattr(method, "traits", None)
    if not isinstance(traits, MethodTraits):
        what = f"{type(method).__name__}.traits = {brief(traits)}"
        raise InputError(what, "must be a MethodTraits(order=...)", where)


def method_of(steps: Any) -> Any:
    """The method whose steps are chosen; the object itself if it is a method, or `Auto`."""
    return getattr(steps, "method", steps)


def chooses_method(steps: object) -> bool:
    """Whether an object chooses the method itself before the first step, as `Auto` does."""
    return hasattr(steps, "choose")


def takes_steps(value: object) -> bool:
    """Whether a value may be a method at all."""
    return not isinstance(value, type) and hasattr(value, "step")


def is_method(value: object) -> bool:
    """Whether a value is a method with traits that does not choose its steps."""
    if isinstance(value, type):
        return False
    traits = getattr(value, "traits", None)
    return isinstance(traits, MethodTraits) and not traits.chooses_dt


def check_offers(method: object, names: tuple[str, ...], where: str) -> None:
    """Raise `InputError` for a method without the attributes `names`, which `where` needs."""
    if missing := [name for name in names if not hasattr(method, name)]:
        remedy = "StageMethod and WithMemory are base classes that have them."
        if "end_times" in missing:  # only a choice of steps must have it
            base = "ChosenSteps, of fecloth.simulation.step_times,"
            remedy = f"{base} is a base class that has them."
        if missing == ["traits"]:
            remedy = "Add traits = MethodTraits(order=...), from fecloth.integrators.protocol."
        what = f"method {type(method).__name__}"
        raise InputError(what, f"must have {', '.join(missing)}", where, remedy)


def check_step(step: object, method: object) -> None:
    """Raise `InputError` for the result of a method's step that is not a `Step`."""
    if not isinstance(step, Step):
        what = f"{type(method).__name__}.step(...) returns {brief(step)}"
        allowed = "must return a Step(state, balanced_at, memory, counts)"
        remedy = "Import it from fecloth.integrators.step."
        raise InputError(what, allowed, "march", remedy)


def take_step(
    method: Integrator,
    system: System,
    state: State,
    dt: float,
    solver: Any,
    memory: Any = None,
    history: History | None = None,
) -> Step:
    """Take one step of a method.

    Raises `NewtonFailed` if the cloth has passed through something in the step.
    """
    records = () if history is None else (history,)  # a method may take no history
    step: Step = method.step(system, state, dt, solver, memory, *records)
    # A choice of steps calls this function itself; `check_step` refuses what is no `Step`.
    if is_method(method) and isinstance(step, Step):
        refuse_crossed(system, step.state, state)
    return step


def refuse_crossed(system: System, state: State, old: State | None = None) -> None:
    """Raise `NewtonFailed` for a state in which the cloth has passed through what it touches.

    With the state `old` at the begin of the step, it is also raised where the cloth has leapt to
    the other side of an obstacle. The error names the contact. It is a `NewtonFailed`, so that
    a choice of steps tries a shorter one.
    """
    for name, term in zip(system.names, system.bound, strict=True):
        reason = ""
        if not term.allows(state.x, state.t):
            reason = f"{name}: the cloth has passed through what it touches"
        elif old is not None and term.leaps(old, state.x, state.t):
            reason = f"{name}: the cloth is on the other side of it after one step"
        if reason:
            raise NewtonFailed(reason, math.nan, "Take a smaller dt.")


def check_history(system: System, method: Any, history: History | None) -> None:
    """Raise `InputError` if terms keep a history, and a function of the method takes none.

    The method may be a choice of steps: then its method is checked too.
    """
    if history is None:
        return
    taken_method = method_of(method)
    functions = (method, "step"), (taken_method, "step"), (taken_method, "over_step")
    for owner, name in functions:
        function = getattr(owner, name, None)
        if function is not None and "history" not in signature(function).parameters:
            pairs = zip(system.names, history, strict=True)
            names = ", ".join(name for name, record in pairs if record is not None)
            what = f"{type(owner).__name__}.{name}(...)"
            allowed = f"must take an argument `history`: {names} remembers earlier steps"
            remedy = "help(fecloth.integrators.protocol.Integrator.step) says what it is."
            raise InputError(what, allowed, "march", remedy)


def check_terms(system: System, method: Integrator | ChoosesMethod, where: str) -> None:
    """Raise `InputError` for a term that needs a difference over the step, if `method` has none.

    Terms of contact need this difference, and also the forces at the end of the step: they are
    named first. `where` is the function that the error names.
    """
    if method.traits.has_difference:
        return
    chosen = method_of(method)
    for term in system.bound:
        if term.needs_end:
            if chooses_method(method):  # `Auto` chooses a method that has it
                return
            what = f"{term.name} in {chosen!r}"
            allowed = "must be in BackwardEuler or BDF2"
            remedy = 'Take BDF2(), in scenes method = "bdf2", or Auto(), which takes it.'
            raise InputError(what, f"{allowed}: {term.needs_end}", where, remedy)
    for term in system.bound:
        if term.needs_difference:
            what = f'{term.name} with rate = "step"'
            allowed = f"needs a method with a difference over the step, which {chosen!r} has not"
            remedy = 'Leave rate out, or take BackwardEuler or BDF2 ("backward_euler", "bdf2").'
            raise InputError(what, allowed, where, remedy)


def has_symmetric_matrix(system: System, method: Integrator | ChoosesMethod) -> bool:
    """Whether the system matrix of the method's steps is symmetric."""
    if method.traits.has_difference:  # over the step a term may have another tangent
        system = system.over_step(StepDifference.between(system.rest().x, 1.0, 0.0))
    return system.symmetric and method.traits.symmetric
