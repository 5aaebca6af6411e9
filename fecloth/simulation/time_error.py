"""The error in time of a run, estimated from its positions at a few times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.integrators.protocol import MethodTraits
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.march import StepInfo
from fecloth.simulation.rigid_motion import deformation, rms_without_rigid
from fecloth.system.records import remembered
from fecloth.system.state import State
from fecloth.system.system import System

MEAN = 1.5  # peak of |sin| over its mean, π/2; √2 where many modes swing
STILL = 1e-6  # of the cloth's extent: a cloth that has moved by less is at rest
OFTEN = 0.03  # of the time so far between two looks at the displacement


@remembered
@dataclass(frozen=True, eq=False)
class Sample:
    """Time [s], number of the step, x (n, 3) [m], and two energies [J].

    `kinetic` is relative to the mean velocity of the start, `dissipated` the sum since then.
    """

    t: float
    step: int
    x: np.ndarray
    kinetic: float
    dissipated: float


@remembered
@dataclass(frozen=True, eq=False)
class TimeError:
    """The error in time of a run so far.

    A method with the drift (q, κ) moves a mode of amplitude A and frequency ω away from the
    solution by κ dt^q ω^(q + 1) A in each second, in phase or in size. Over all modes, that is
    κ dt^q times the derivative of x of order p = q + 1, as a mass-weighted root mean square over
    the nodes without its rigid part. Damping of rate γ forgets earlier errors:

        de/dt = MEAN κ dt^q |d^p x / dt^p| − γ e,    γ = power dissipated / (4 kinetic energy)

    A mode cannot be off by more than 2 A. The derivative is therefore a divided difference over
    times τ apart, at most (2/τ)^p A for a mode of any frequency, with

        (2/τ)^p κ ∫ dt^q dt = 2

    so that positions are needed every τ only, which grows with time. The largest e so far over the
    largest displacement is the relative error.

    Attributes
    ----------
    start
        The state before the first step.
    recent
        The last p + 1 samples.
    lag
        κ ∫ dt^q dt up to the last of them [s^p].
    length, largest
        e there, and the largest e [m].
    speed
        Largest rms speed of the samples [m/s], where it is needed: see `relative_error`.
    moved, looked
        Largest rms displacement [m], and the time of the last look at it [s].
    due
        Time of the next sample [s].
    """

    start: State
    recent: tuple[Sample, ...]
    lag: float = 0.0
    length: float = 0.0
    largest: float = 0.0
    speed: float = 0.0
    moved: float = 0.0
    looked: float = 0.0
    due: float = 0.0

    @classmethod
    def open(cls, system: System, state: State) -> TimeError:
        """Return the estimate before the first step."""
        ledger = Ledger.open(system, state)
        start = _sample(system, state, state, 0, ledger)
        return cls(state, (start,), looked=state.t, due=state.t)

    def after(self, system: System, method, info: StepInfo, ledger: Ledger) -> TimeError:
        """Return the estimate after a step: nearly always the same object."""
        if info.t < self.due:
            return self
        return self.sampled(system, method.traits, info.result.state, info.step, ledger)

    def sampled(
        self, system: System, traits: MethodTraits, state: State, step: int, ledger: Ledger
    ) -> TimeError:
        """Return the estimate with one more sample, after that many steps."""
        if (drift := drift_of(traits)) is None:
            return replace(self, due=math.inf)
        q, constant = drift
        mass, is_first = system.diagonal_mass, len(self.recent) < q + 2
        recent = (*self.recent, _sample(system, self.start, state, step, ledger))[-(q + 2) :]
        old, new = recent[-2:]
        lag = constant * _mean_step(old, new) ** q * (new.t - old.t)
        length, total = self.length, self.lag + lag
        if len(recent) == q + 2:  # the first derivative stands for all time before
            rate = MEAN * rms_without_rigid(mass, state.x, derivative(recent))
            length = _add_forgetting(length, rate * (total if is_first else lag), old, new)
        slow = traits.order < q
        speed = max(self.speed, rms_without_rigid(mass, state.x, state.v)) if slow else 0.0
        after = replace(
            self,
            recent=recent,
            lag=total,
            length=length,
            largest=max(self.largest, length),
            speed=speed,
            due=new.t + (2**q * total) ** (1 / (q + 1)),
        )
        return after if new.t < self._next_look else after._looked(mass)

    @property
    def _next_look(self) -> float:
        return self.looked + OFTEN * (self.looked - self.start.t)

    def _looked(self, mass: np.ndarray) -> TimeError:
        """Return the estimate with another look at the displacement."""
        last = self.recent[-1]
        return replace(
            self, moved=max(self.moved, deformation(mass, self.start.x, last.x)), looked=last.t
        )


def relative_error(
    error: TimeError, system: System, method, state: State, step: int, ledger: Ledger
) -> float:
    """Return the error up to `state`, over the largest displacement, or NaN without an estimate.

    Where the error of a step is of a lower order than its drift, as that of the symplectic Euler
    method, c dt |v| is added: such an error does not grow with time. There is no estimate for a
    method without these constants, before p steps, and for a cloth at rest.
    """
    traits = method.traits
    if (drift := drift_of(traits)) is None:
        return math.nan
    if step > error.recent[-1].step:
        error = error.sampled(system, traits, state, step, ledger)
    error = error._looked(system.diagonal_mass)
    extent = float(np.ptp(system.cloth.X, axis=0).max())
    if len(error.recent) < drift[0] + 2 or error.moved <= STILL * extent:
        return math.nan
    length = error.largest
    if traits.order < drift[0] and traits.error_constant is not None:
        dt = (state.t - error.start.t) / step
        length += traits.error_constant * dt * error.speed
    return length / error.moved


def drift_of(traits: MethodTraits) -> tuple[int, float] | None:
    """Return (q, κ) of a method; without a `drift` that of the error of its steps, if known."""
    if traits.drift is not None:
        return traits.drift
    return None if traits.error_constant is None else (traits.order, traits.error_constant)


def derivative(samples: Sequence[Sample]) -> np.ndarray:
    """Return d^p x / dt^p (n, 3) from p + 1 samples: p! times Newton's divided difference."""
    order = len(samples) - 1
    x, y = samples[0].x, np.zeros_like(samples[0].x)
    for one in samples[1:]:  # the weights add up to 0: differences keep the digits far away
        weight = math.factorial(order) / math.prod(one.t - b.t for b in samples if b is not one)
        y += weight * (one.x - x)
    return y


def _sample(system, start, state, step, ledger):
    """Return a sample of a state."""
    velocity = system.sums.mean(system.diagonal_mass, start.v)
    mean = system.sums.mean(system.diagonal_mass, state.v)
    mass = float(system.nodal_mass.sum())
    kinetic = ledger.kinetic + mass * float(0.5 * velocity @ velocity - mean @ velocity)
    return Sample(state.t, step, state.x, kinetic, sum(ledger.dissipated.values()))


def _mean_step(a, b):
    """Return the mean size of the steps between two samples [s]."""
    return (b.t - a.t) / (b.step - a.step)


def _add_forgetting(length, added, a, b):
    """Return e at b: e at a decays, and what is added between them decays as it comes."""
    lost, moving = max(b.dissipated - a.dissipated, 0.0), max(a.kinetic + b.kinetic, 0.0)
    decay = lost / max(2 * moving, 1e-3 * lost) if lost else 0.0  # γ (t_b − t_a)
    share = -math.expm1(-decay) / decay if decay > 1e-9 else 1.0
    return length * math.exp(-decay) + added * share
