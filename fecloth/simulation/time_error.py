"""The error in time of a run, carried along with its motion as a field."""

import math
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import SolveFailed
from fecloth.integrators.protocol import MethodTraits, drift_of
from fecloth.linalg.reductions import rms
from fecloth.simulation.account import NEVER, Account, Accounts, End, Run
from fecloth.simulation.contact import Contact
from fecloth.simulation.deformation import MOTION_AT_REST
from fecloth.simulation.doubts.jumps import NEAR
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.error_transport import Error, carry_error
from fecloth.simulation.rigid_motion import derivative, rms_of_deformation, rms_without_rigid
from fecloth.simulation.steps import StepInfo
from fecloth.simulation.time_error_words import describe_time_error
from fecloth.simulation.within_step import acceleration
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.contact.bound_contact import BoundContact
from fecloth.terms.records import remembered
from fecloth.terms.traits import has_kind

SAFETY = 2.5  # what is stated over the estimate: at least the true error in 9 of 10 runs
FEWEST_SAMPLES = 50  # of a run
# Steps between two samples of a long run, at least: a sample costs about a twentieth of them.
IMPLICIT_STEPS, EXPLICIT_STEPS = 6, 1000
GROWN = 10.0  # over the largest displacement: an error that is no longer moved on
# Of a gap: so much a barrier gives way under the weight, and no place is sharper.
GAP_GIVEN_WAY = 0.1
GROWS = (
    "small errors have grown, as where a cloth buckles, flutters or is hit: "
    'error_in_time = "companion" tells how far apart two runs are'
)
BOUNCES = "the cloth bounces in less than a few steps, and what follows depends on dt"
HITS = "the cloth hits something, where the method is of first order only"
LEAST_IMPACT = 0.05  # over the largest kinetic energy: what impacts have taken where they count


@remembered
@dataclass(frozen=True, eq=False)
class Sample:
    """A state of the run: its time t [s], the number of its step, x and v (n, 3)."""

    t: float
    step: int
    x: np.ndarray
    v: np.ndarray


@remembered
@dataclass(frozen=True, eq=False)
class TimeError(Account):
    """The error in time of a run so far.

    A method with the drift (q, κ) moves a mode of amplitude A and frequency ω away from the
    solution by κ dt^q ω^(q + 1) A in each second. Over all modes, with p = q + 1, it solves

        dx/dt = v + κ dt^q d^p x/dt^p,    M dv/dt = f + κ dt^q M d^p v/dt^p

    in place of the equations of motion: the first term of its modified equation (Hairer, Lubich
    and Wanner 2006, Geometric Numerical Integration, chapter IX). The difference of both motions
    is the error. It moves on by the equations that are linear about the motion, see `Transport`,
    from sample to sample. The derivatives are divided differences of the last p + 1 samples; x
    is seen from pins that move, whose motion has no error. A load that jumps inside a step adds
    an error of v, see `_kicked`.

    Samples are taken so often that the fastest waves that they show have an error as large as
    their amplitude: waves that are faster are lost anyway. Such a wave has at most the
    divided difference (2/τ)^p A over times τ apart, so that

        (2/τ)^p κ dt^q T = 2

    for the time T since the start. There are at least FEWEST_SAMPLES of a run.

    Stated is the largest rms of the error of x, weighted by mass, times SAFETY over the largest
    rms displacement; of the deformation the same without rigid motions. It is at most 1: then
    the steps do not resolve the motion, or small errors grow. There is no estimate for a method
    without these constants, before p steps, for a cloth at rest, on several processes, and
    after impacts where they count: see `find_hits`.

    Attributes
    ----------
    opening
        The sample before the first step.
    recent
        The last p + 1 samples.
    error
        The error of x [m] and v [m/s] at the last sample.
    lag
        κ ∫ dt^q dt since the error was last moved on [s^p].
    carried
        Time up to which it has been moved on [s].
    whole, deforming
        Its largest rms, and without its rigid part [m].
    moved, deformed
        The largest rms displacement, and the largest without rigid motion [m].
    fastest
        The largest kinetic energy of the samples [J].
    kicked
        Time of the first jump of a load, infinite without any [s].
    due
        Number of the step of the next sample.
    relative, relative_of_deformation
        At the end: what is stated, NaN without an estimate.
    sentence
        The same in words.
    unknown
        Why there is no estimate, or "".
    """

    name = "time_error"
    opening: Sample
    recent: tuple[Sample, ...]
    error: Error
    carried: float
    lag: float = 0.0
    whole: float = 0.0
    deforming: float = 0.0
    moved: float = 0.0
    deformed: float = 0.0
    fastest: float = 0.0
    kicked: float = math.inf
    due: int = 0
    relative: float = math.nan
    relative_of_deformation: float = math.nan
    sentence: str = ""
    unknown: str = ""

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> "TimeError":
        opening = Sample(run.start.t, run.step, run.start.x, run.start.v)
        never = drift_of(run.method.traits) is None or not run.system.is_whole
        due = NEVER if never else 0
        return cls(opening, (opening,), Error.none(run.start.x), run.start.t, due=due)

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "TimeError":
        """Return the estimate after a step: nearly always the same object."""
        if info.step < self.due:
            return self
        return self.sampled(run, info.result.state, info.step, others[Ledger].kinetic)

    def finish(self, run: Run, end: End, others: Accounts) -> "TimeError":
        """Return the record with the relative errors, or with why there are none."""
        after = self
        if end.state.t > self.recent[-1].t and self.due != NEVER:
            after = self.sampled(run, end.state, end.step, others[Ledger].kinetic)
        after = after.changed(unknown=after.unknown or after.find_hits(run, others))
        is_known = after.has_estimate(run.system, run.method.traits)
        relative, of_deformation = (
            after.relative_errors(run.system) if is_known else (math.nan,) * 2
        )
        dt = math.nan
        if after.recent[-1].step > self.opening.step:
            dt = _mean_step(self.opening, after.recent[-1])
        sentence = describe_time_error(relative, SAFETY, run.method, dt, self.kicked, after.unknown)
        return after.changed(
            relative=relative, relative_of_deformation=of_deformation, sentence=sentence
        )

    def summary(self) -> dict[str, object]:
        errors = {"time_error": self.relative, "deformation_error": self.relative_of_deformation}
        known = {key: None if math.isnan(error) else error for key, error in errors.items()}
        return {**known, "time_error_in_words": self.sentence}

    def sampled(self, run: Run, state: State, step: int, kinetic: float) -> "TimeError":
        """Return the estimate with one more sample, and the step of the next one."""
        system = run.system
        drift = drift_of(run.method.traits)
        assert drift
        q, constant = drift
        new = Sample(state.t, step, state.x, state.v)
        recent = (*self.recent, new)[-(q + 2) :]
        dt = _mean_step(*recent[-2:])
        lag = self.lag + constant * dt**q * (new.t - recent[-2].t)
        cheap = dt * (EXPLICIT_STEPS if run.method.traits.explicit else IMPLICIT_STEPS)
        apart = max(cheap, _time_apart(q, constant, dt, new.t - self.opening.t))
        apart = min(apart, (run.t_end - self.opening.t) / FEWEST_SAMPLES)
        after = self._kicked(run, state, new).changed(
            recent=recent,
            lag=lag,
            moved=max(self.moved, rms(system.diagonal_mass, state.x - self.opening.x)),
            deformed=max(
                self.deformed, rms_of_deformation(system.diagonal_mass, self.opening.x, state.x)
            ),
            fastest=max(self.fastest, kinetic),
            due=step + math.ceil(apart / dt - 1e-6),
        )
        if len(recent) < q + 2 or self.unknown or self.whole > GROWN * after.moved:
            return after
        return after._moved_on(run, dt)

    def _moved_on(self, run: Run, dt: float) -> "TimeError":
        """Return the estimate with the error moved on to the last sample.

        On this way the method adds the error of a `lag` κ ∫ dt^q dt, evenly: s [m/s] to the
        error of x, and r [m/s²] to the error of v, in each second.
        """
        system = run.system
        middle = self.recent[-2]
        state = State(middle.t, middle.x, middle.v)
        end = 0.5 * (middle.t + self.recent[-1].t)
        seconds = end - self.carried
        times = [sample.t for sample in self.recent]
        s = derivative(times, [sample.x for sample in self.recent])
        r = derivative(times, [sample.v for sample in self.recent])
        rate = self.lag / seconds
        try:
            error = carry_error(system, state, seconds, self.error, rate * s, rate * r)
        except SolveFailed:
            return self.changed(unknown=GROWS)
        seen = error.x + _offset(run.method.traits, dt) * state.v
        mass = system.diagonal_mass
        return self.changed(
            error=error,
            carried=end,
            lag=0.0,
            whole=max(self.whole, rms(mass, seen)),
            deforming=max(self.deforming, rms_without_rigid(mass, state.x, seen)),
        )

    def has_estimate(self, system: System, traits: MethodTraits) -> bool:
        """Return whether the run has moved, and long enough for an estimate."""
        if self.unknown or not self.whole or self.due == NEVER:
            return False
        gaps = (term.gap for term in system.bound if isinstance(term, BoundContact))
        still = max(MOTION_AT_REST * system.cloth.extent, GAP_GIVEN_WAY * min(gaps, default=0.0))
        return self.moved > still

    def relative_errors(self, system: System) -> tuple[float, float]:
        """Return what is stated of the whole motion and of the deformation, at most 1."""
        whole = min(1.0, SAFETY * self.whole / self.moved)
        deforms = self.deformed > MOTION_AT_REST * system.cloth.extent
        return whole, min(1.0, SAFETY * self.deforming / self.deformed) if deforms else math.nan

    def find_hits(self, run: Run, others: Accounts) -> str:
        """Return why impacts leave no estimate, or "".

        Bounces that steps do not resolve have none. An impact without a bounce errs by an order
        of dt less than a smooth motion of a method of second order, for which the estimate is.
        """
        if not has_kind(run.system.terms, "contact"):
            return ""
        if others[Contact].ratio > 1.0:
            return BOUNCES
        ledger = others[Ledger]
        drift = drift_of(run.method.traits)
        contacts = [name for name, term in run.system.named if term.limits_direction]
        lost = ledger.numerical + sum(ledger.dissipated.get(name, 0.0) for name in contacts)
        if drift and drift[0] > 1 and lost > LEAST_IMPACT * self.fastest:
            return HITS
        return ""

    def _kicked(self, run: Run, state: State, new: Sample) -> "TimeError":
        """Return the estimate with the jumps of loads since the last sample.

        A step ends up to dt beside a jump Δa of the acceleration and errs by up to dt Δa/2 in
        the velocity, by dt Δa/4 on average. Errors of several jumps add up as random ones.
        """
        last = self.recent[-1]
        since = last.t if len(self.recent) > 1 else -math.inf  # also what jumps at the start
        times = run.load_jumps[(run.load_jumps > since) & (run.load_jumps <= new.t)].tolist()
        error = self.error
        for t in times:
            kick = 0.25 * _mean_step(last, new) * _change_at(run, state, t)
            more = _as_random(error.v, kick)
            error = Error(error.x - (t - self.carried) * more, error.v + more)
        return self.changed(error=error, kicked=min([self.kicked, *times]))


def _offset(traits: MethodTraits, dt: float) -> float:
    """Return c dt [s]: x is off by c dt v where steps have a lower order than their drift.

    Symplectic Euler is such a method. Its error of this kind does not grow with time.
    """
    drift = drift_of(traits)
    if drift and traits.order < drift[0] and traits.error_constant is not None:
        return traits.error_constant * dt
    return 0.0


def _time_apart(q: int, constant: float, dt: float, seconds: float) -> float:
    """Return the time τ [s] between samples, `seconds` after the start: see `TimeError`."""
    return (2**q * constant * dt**q * seconds) ** (1 / (q + 1))


def _change_at(run: Run, state: State, t: float) -> np.ndarray:
    """Return the jump of the acceleration (n, 3) [m/s²] at the time t [s] of a jump of loads."""
    near = NEAR * (run.t_end - run.start.t)
    before = acceleration(run.system, replace(state, t=max(run.start.t, t - near)))
    return acceleration(run.system, replace(state, t=t + near)) - before


def _as_random(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return α b, with the α > 0 for which the square of a + α b is the sum of both squares."""
    share = (a * b).sum() / max((b * b).sum(), 1e-300)
    return (math.hypot(1.0, share) - share) * b


def _mean_step(a: Sample, b: Sample) -> float:
    """Return the mean size of the steps between two samples [s]."""
    return (b.t - a.t) / (b.step - a.step)
