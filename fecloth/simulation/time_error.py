"""The error in time of a run, estimated from its positions at a few times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.integrators.protocol import MethodTraits, drift_of
from fecloth.linalg.reductions import rms
from fecloth.simulation.account import NEVER, Account, Accounts, End, Run
from fecloth.simulation.deformation import Deformation
from fecloth.simulation.doubts.jumps import find_jumps
from fecloth.simulation.doubts.planned_run import attempt
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.march import StepInfo
from fecloth.simulation.rigid_motion import rms_without_rigid, weighted_sum
from fecloth.simulation.time_error_words import WARNED, describe_time_error
from fecloth.simulation.within_step import acceleration
from fecloth.system.pieces import mean_of_nodes
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

MEAN = math.pi / 2  # peak of |sin| over its mean
STILL = 1e-6  # of the cloth's extent: a cloth that has moved by less is at rest
LOOKS = 33  # between two samples, at loads that may jump
ROUND_OFF = 1e-9  # of a load
OFTEN = 0.15  # of the time so far between two looks at the displacement


@remembered
@dataclass(frozen=True, eq=False)
class Sample:
    """Time [s], number of the step, x (n, 3) [m], and energies [J].

    `deforming` and `inside` are the kinetic energy of the deformation and what damping has
    dissipated that a rigid motion does not feel; `kinetic` and `outside` the whole kinetic energy
    and what the other damping has dissipated. See `Deformation` and `Ledger`.
    """

    t: float
    step: int
    x: np.ndarray
    deforming: float
    inside: float
    kinetic: float
    outside: float


@remembered
@dataclass(frozen=True, eq=False)
class TimeError(Account):
    """The error in time of a run so far.

    A method with the drift (q, κ) moves a mode of amplitude A and frequency ω away from the
    solution by κ dt^q ω^(q + 1) A in each second, in phase or in size. Over all modes, that is
    κ dt^q times the derivative of x of order p = q + 1, as a mass-weighted root mean square over
    the nodes. Damping of rate γ forgets earlier errors:

        de/dt = MEAN κ dt^q |d^p x / dt^p| − γ e,    γ = power dissipated / (4 kinetic energy)

    for the rigid part of the derivative and for the rest, the deformation, apart. Damping that a
    rigid motion does not feel forgets errors of the deformation only, with the kinetic energy of
    the deformation. x is seen from pins that move. Jumps of loads are added: see `kick_length`.

    A mode cannot be off by more than 2 A. The derivative is therefore a divided difference over
    times τ apart, at most (2/τ)^p A for a mode of any frequency, with

        (2/τ)^p κ ∫ dt^q dt = 2

    so that positions are needed every τ only, which grows with time. (For τ, dt is the dt of the
    present, so that a short motion after a long rest is not passed over.) The largest e so far
    over the largest displacement, rigid motion included, is the relative error; the largest e of
    the deformation [m] is the same for every observer.
    """

    name = "time_error"
    opening: np.ndarray  # (n, 3) positions before the first step
    start: Sample  # that before the first step
    recent: tuple[Sample, ...]  # the last p + 1 samples
    lag: float = 0.0  # κ ∫ dt^q dt up to the last of them [s^p]
    # e of the deformation and of the rigid motion there, the largest of the deformation, and the
    # largest of both together [m].
    inner: float = 0.0
    rigid: float = 0.0
    deforming: float = 0.0
    largest: float = 0.0
    # What jumps of loads have given too much or too little: rms velocity [m/s], and since when [s].
    kick: float = 0.0
    kicked: float = math.inf
    fastest: float = 0.0  # largest kinetic energy of the samples [J]
    # Largest rms speed of the samples [m/s], where it is needed: see `relative_error`.
    speed: float = 0.0
    # Largest rms displacement [m], and the time of the last look at it [s].
    moved: float = 0.0
    looked: float = 0.0
    due: int = 0  # the step of the next sample
    # At the end: the error over the largest displacement, NaN without an estimate; in words.
    relative: float = math.nan
    sentence: str = ""

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> TimeError:
        return cls.open(run.start, _sample(run.system, run.start, run.step, others))

    @classmethod
    def open(cls, state: State, start: Sample) -> TimeError:
        """Return the estimate before the first step."""
        return cls(state.x, start, (start,), looked=start.t)

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> TimeError:
        """Return the estimate after a step: nearly always the same object."""
        if info.step < self.due:
            return self
        state = info.result.state
        sample = _sample(run.system, state, info.step, others)
        kicked = self._kicked(run, state, sample)
        return kicked.sampled(run.system, run.method.traits, state, sample)

    def finish(self, run: Run, end: End, others: Accounts) -> TimeError:
        sample = _sample(run.system, end.state, end.step, others)
        after = self._kicked(run, end.state, sample)
        error = after.relative_error(run.system, run.method.traits, end.state, sample)
        dt = _mean_step(self.start, sample) if end.step > self.start.step else math.nan
        jump = after.kicked if after.kick_length(run.system, end.state.t) > after.largest else None
        sentence = describe_time_error(error, run.method, dt, jump)
        return after.changed(relative=error, sentence=sentence)

    def warnings(self) -> tuple[str, ...]:
        return (self.sentence,) if self.relative > WARNED else ()

    def words(self) -> str:
        return self.sentence

    def summary(self) -> dict[str, object]:
        error = None if math.isnan(self.relative) else self.relative
        deformation = None if math.isnan(self.relative) else self.deforming
        return {
            "time_error": error,
            "deformation_error": deformation,
            "time_error_in_words": self.sentence,
        }

    def sampled(
        self, system: System, traits: MethodTraits, state: State, sample: Sample
    ) -> TimeError:
        """Return the estimate with one more sample, of this state."""
        if (drift := drift_of(traits)) is None:
            return self.changed(due=NEVER)
        q, constant = drift
        mass, is_first = system.diagonal_mass, len(self.recent) < q + 2
        recent = (*self.recent, sample)[-(q + 2) :]
        old, new = recent[-2:]
        dt = _mean_step(old, new)
        lag = constant * dt**q * (new.t - old.t)
        inner, rigid, total = self.inner, self.rigid, self.lag + lag
        if len(recent) == q + 2:  # the first derivative stands for all time before
            y, over = derivative(recent), MEAN * (total if is_first else lag)
            rate = rms_without_rigid(mass, state.x, y)
            turning = math.sqrt(max(0.0, rms(mass, y) ** 2 - rate**2))
            outer = _decay(new.outside - old.outside, old.kinetic + new.kinetic)
            decay = outer + _decay(new.inside - old.inside, old.deforming + new.deforming)
            inner = _add_forgetting(inner, rate * over, decay)
            rigid = _add_forgetting(rigid, turning * over, outer)
        slow = traits.order < q
        speed = max(self.speed, rms(mass, state.v)) if slow else 0.0
        after = self.changed(
            recent=recent,
            lag=total,
            inner=inner,
            rigid=rigid,
            deforming=max(self.deforming, inner),
            largest=max(self.largest, math.hypot(inner, rigid)),
            speed=speed,
            fastest=max(self.fastest, sample.kinetic),
            due=sample.step + math.ceil(self._apart(q, constant, dt, new.t) / dt - 1e-6),
        )
        return after if new.t < self._next_look else after._looked(mass, state)

    def relative_error(
        self, system: System, traits: MethodTraits, state: State, sample: Sample
    ) -> float:
        """Return the error up to `state`, over the largest displacement; NaN for no estimate.

        Where the error of a step is of a lower order than its drift, as the error of the symplectic
        Euler method, c dt |v| is added: such an error does not grow with time. There is no estimate
        for a method without these constants, before p steps, and for a cloth at rest.
        """
        if (drift := drift_of(traits)) is None:
            return math.nan
        error = self
        if state.t > self.recent[-1].t:
            error = self.sampled(system, traits, state, sample)
        error = error._looked(system.diagonal_mass, state)
        extent = float(np.ptp(system.cloth.X, axis=0).max())
        if len(error.recent) < drift[0] + 2 or error.moved <= STILL * extent:
            return math.nan
        length = error.largest
        if traits.order < drift[0] and traits.error_constant is not None:
            dt = _mean_step(error.start, error.recent[-1])
            length += traits.error_constant * dt * error.speed
        return math.hypot(length, error.kick_length(system, state.t)) / error.moved

    def kick_length(self, system: System, t: float) -> float:
        """Return how far jumps of loads have moved the cloth away from the solution at t [m].

        A wrong velocity δ moves it by δ times the time since, or by δ/ω at most in a motion of
        frequency ω, the largest speed over the largest displacement.
        """
        if not self.kick:
            return 0.0
        fastest = math.sqrt(2 * self.fastest / system.total_mass)
        return self.kick * min(t - self.kicked, self.moved / max(fastest, 1e-300))

    def _kicked(self, run: Run, state: State, sample: Sample) -> TimeError:
        """Return the estimate with the jumps of loads since the last sample.

        A step ends up to dt beside a jump Δa of the acceleration and errs by up to dt Δa/2 in the
        velocity, by dt Δa/4 on average. Errors of several jumps add up as random ones.
        """
        last = self.recent[-1]
        if not run.loads or not sample.t > last.t or drift_of(run.method.traits) is None:
            return self
        dt = _mean_step(last, sample)
        jumps = attempt(_jumps_of_loads, run, state, last.t, sample.t, otherwise=())
        if not jumps:
            return self
        kick = math.hypot(self.kick, *(0.25 * dt * size for _, size in jumps))
        return self.changed(kick=kick, kicked=min(self.kicked, jumps[0][0]))

    def _apart(self, q: int, constant: float, dt: float, t: float) -> float:
        """Return τ [s] for steps of the present size from the start on."""
        return (2**q * constant * dt**q * (t - self.start.t)) ** (1 / (q + 1))

    @property
    def _next_look(self) -> float:
        return self.looked + OFTEN * (self.looked - self.start.t)

    def _looked(self, mass: np.ndarray, state: State) -> TimeError:
        """Return the estimate with another look at the displacement."""
        moved = rms(mass, state.x - self.opening)
        return self.changed(moved=max(self.moved, moved), looked=state.t)


def _jumps_of_loads(run: Run, state: State, begin: float, end: float):
    """Return the times of jumps of loads [s], and the rms jumps of the acceleration [m/s²]."""
    times, jumps = np.linspace(begin, end, LOOKS), set()
    for load in run.loads:
        g = np.asarray(load.values(times), float).reshape(LOOKS, -1)
        jumps |= {t for t, _ in find_jumps(times, g, load.values, ROUND_OFF * np.abs(g).max())}
    near = 1e-9 * (end - begin)
    sizes = []
    for t in sorted(jumps):
        a, b = (
            acceleration(run.system, replace(state, t=max(begin, t + side)))
            for side in (-near, near)
        )
        sizes.append((t, rms(run.system.diagonal_mass, b - a)))
    return sizes


def derivative(samples: Sequence[Sample]) -> np.ndarray:
    """Return d^p x / dt^p (n, 3) from p + 1 samples: p! times Newton's divided difference."""
    scale = math.factorial(len(samples) - 1)
    weights = [
        scale / math.prod(one.t - other.t for other in samples if other is not one)
        for one in samples
    ]  # they add up to 0: differences keep the digits of a cloth that is far away
    return weighted_sum([sample.x for sample in samples], weights)


def _sample(system: System, state: State, step: int, others: Accounts) -> Sample:
    ledger, deforming = others[Ledger], others[Deformation].kinetic
    energies = deforming, ledger.lost_inside, ledger.kinetic, ledger.lost_outside
    return Sample(state.t, step, _seen_from_pins(system, state.x), *energies)


def _seen_from_pins(system: System, x: np.ndarray) -> np.ndarray:
    """Return x (n, 3) as seen from pins that move: a method makes no error in their motion."""
    moved = [nodes for pin, nodes in system.constraints.groups.values() if pin.moves]
    return x - mean_of_nodes(np.concatenate(moved), x, np.zeros(3)) if moved else x


def _mean_step(a, b):
    """Return the mean size of the steps between two samples [s]."""
    return (b.t - a.t) / (b.step - a.step)


def _add_forgetting(length: float, added: float, decay: float) -> float:
    """Return e after it has decayed by e^(−decay), as what is added does from when it comes."""
    share = -math.expm1(-decay) / decay if decay > 1e-9 else 1.0
    return length * math.exp(-decay) + added * share


def _decay(lost: float, moving: float) -> float:
    """Return γ (t_b − t_a) from the energy lost in between and the sum of the kinetic energies."""
    return lost / max(2 * moving, 1e-3 * lost) if lost > 0 else 0.0
