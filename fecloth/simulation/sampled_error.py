"""The error in time of a run, carried along with its motion as a field."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from fecloth.errors import SolveFailed
from fecloth.integrators.protocol import MethodTraits, drift_of
from fecloth.linalg.reductions import rms
from fecloth.simulation.account import NEVER, Run
from fecloth.simulation.doubts.jumps import NEAR
from fecloth.simulation.error_transport import Error, carry_error
from fecloth.simulation.rigid_motion import derivative, rms_without_rigid
from fecloth.simulation.steps import StepInfo
from fecloth.simulation.within_step import acceleration
from fecloth.system.state import State
from fecloth.terms.records import remembered

FEWEST_SAMPLES = 50  # of a run
# Steps between two samples of a long run, at least: a sample costs about a twentieth of them.
IMPLICIT_STEPS, EXPLICIT_STEPS = 6, 1000
GROWN = 10.0  # over the largest displacement: an error that is no longer moved on
GROWS = (
    "small errors have grown, as where a cloth buckles, flutters or is hit; "
    'error_in_time = "companion" tells how far apart two runs are'
)


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
class SampledError:
    """The error in time of a run so far, without a second run.

    A method with the drift (q, κ) moves a mode of amplitude A and frequency ω away from the
    solution by κ dt^q ω^(q + 1) A in each second. Over all modes, with p = q + 1, it solves

        dx/dt = v + κ dt^q d^p x/dt^p,    M dv/dt = f + κ dt^q M d^p v/dt^p

    in place of the equations of motion: the first term of its modified equation (Hairer, Lubich
    and Wanner 2006, Geometric Numerical Integration, chapter IX). The difference of both motions
    is the error. It moves on by the equations that are linear about the motion, see
    `carry_error`: about each sample, from halfway after the sample before to halfway before the
    next. The derivatives are divided differences of p + 1 samples. A load that jumps
    inside a step adds an error of v, see `_kicked`.

    Where waves are too fast for the steps, the run has lost them, and their error is as large as
    they are. A wave of amplitude A has at most the divided difference (2/τ)^p A over times τ
    apart, and so an error of at most 2 A if

        (2/τ)^p κ dt^q T = 2

    for the time T since the start. The samples of a difference are τ/2 apart or more. Samples
    are taken every τ, but no closer than IMPLICIT_STEPS or EXPLICIT_STEPS, and at
    FEWEST_SAMPLES times of a run at least.

    Attributes
    ----------
    opening
        The sample before the first step.
    recent
        The last samples.
    error
        The error of x [m] and v [m/s].
    carried
        Time up to which it has been moved on [s].
    lag
        κ ∫ dt^q dt since then [s^p].
    whole, deforming
        Its largest rms so far, and without its rigid part [m].
    kicked
        Time of the first jump of a load, infinite without any [s].
    due
        Number of the step of the next sample.
    unknown
        Why there is no estimate, or "".
    """

    # The bound over the estimate. It is chosen so that the bound is at least the true error in 9
    # of 10 small set-ups, and at most 5 times the true error in 9 of 10: see the study
    # `studies.evidence.trust.estimators`.
    safety: ClassVar[float] = 2.6

    opening: Sample
    recent: tuple[Sample, ...]
    error: Error
    carried: float
    lag: float = 0.0
    whole: float = 0.0
    deforming: float = 0.0
    kicked: float = math.inf
    due: int = 0
    unknown: str = ""

    @classmethod
    def begin(cls, run: Run) -> "SampledError":
        """Return the record before the first step."""
        opening = Sample(run.start.t, run.step, run.start.x, run.start.v)
        is_known = drift_of(run.method.traits) is not None and run.system.is_whole
        due = 0 if is_known else NEVER
        return cls(opening, (opening,), Error.none(run.start.x), run.start.t, due=due)

    def after(self, run: Run, info: StepInfo, moved: float) -> "SampledError":
        """Return the record after a step, when the cloth has moved by at most `moved` [m, rms]."""
        return self.sampled(run, info.result.state, info.step, moved)

    def sampled(self, run: Run, state: State, step: int, moved: float) -> "SampledError":
        """Return the record with one more sample, and the step of the next one."""
        drift = drift_of(run.method.traits)
        assert drift
        q, constant = drift
        last = self.recent[-1]
        new = Sample(state.t, step, state.x, state.v)
        dt = (new.t - last.t) / (new.step - last.step)
        fewest = EXPLICIT_STEPS if run.method.traits.explicit else IMPLICIT_STEPS
        tau = _time_apart(q, constant, dt, new.t - self.opening.t)
        apart = min(max(fewest * dt, tau), (run.t_end - self.opening.t) / FEWEST_SAMPLES)
        after = replace(
            self._kicked(run, state, dt),
            recent=_since((*self.recent, new), new.t - (q + 2) * max(tau, apart)),
            lag=self.lag + constant * dt**q * (new.t - last.t),
            due=step + math.ceil(apart / dt - 1e-6),
        )
        spread = _spread(after.recent, q + 2, 0.5 * tau)
        if len(spread) < q + 2 or self.unknown or self.whole > GROWN * moved:
            return after
        return after._moved_on(run, spread, dt)

    def _moved_on(self, run: Run, spread: list[Sample], dt: float) -> "SampledError":
        """Return the record with the error moved on to halfway before the last sample.

        On this way the method adds the error of a `lag` κ ∫ dt^q dt, evenly. The derivatives are
        of the samples `spread`.
        """
        system = run.system
        middle = self.recent[-2]
        state = State(middle.t, middle.x, middle.v)
        end = 0.5 * (middle.t + self.recent[-1].t)
        seconds = end - self.carried
        times = [sample.t for sample in spread]
        rate = self.lag / seconds
        s = rate * derivative(times, [sample.x for sample in spread])
        r = rate * derivative(times, [sample.v for sample in spread])
        try:
            error = carry_error(system, state, seconds, self.error, s, r)
        except SolveFailed:
            return replace(self, unknown=GROWS)
        seen = error.x + _offset(run.method.traits, dt) * state.v
        mass = system.diagonal_mass
        return replace(
            self,
            error=error,
            carried=end,
            lag=0.0,
            whole=max(self.whole, rms(mass, seen)),
            deforming=max(self.deforming, rms_without_rigid(mass, state.x, seen)),
        )

    def _kicked(self, run: Run, state: State, dt: float) -> "SampledError":
        """Return the record with the jumps of loads since the last sample.

        A step ends up to dt beside a jump Δa of the acceleration and errs by up to dt Δa/2 in
        the velocity, by dt Δa/4 on average. Errors of several jumps add up as random ones.
        """
        since = self.recent[-1].t if len(self.recent) > 1 else -math.inf  # also at the start
        jumps = run.load_jumps
        times = jumps[(jumps > since) & (jumps <= state.t)].tolist()
        error = self.error
        for t in times:
            more = _as_random(error.v, 0.25 * dt * _change_at(run, state, t))
            error = Error(error.x - (t - self.carried) * more, error.v + more)
        return replace(self, error=error, kicked=min([self.kicked, *times]))


def _offset(traits: MethodTraits, dt: float) -> float:
    """Return c dt [s]: x is off by c dt v where steps have a lower order than their drift.

    Symplectic Euler is such a method. Its error of this kind does not grow with time.
    """
    drift = drift_of(traits)
    if drift and traits.order < drift[0] and traits.error_constant is not None:
        return traits.error_constant * dt
    return 0.0


def _time_apart(q: int, constant: float, dt: float, seconds: float) -> float:
    """Return the time τ [s] between samples, `seconds` after the start: see `SampledError`."""
    return (2**q * constant * dt**q * seconds) ** (1 / (q + 1))


def _since(samples: tuple[Sample, ...], t: float) -> tuple[Sample, ...]:
    """Return the samples since the time t [s], and the one before."""
    first = sum(sample.t <= t for sample in samples) - 1
    return samples[max(0, first) :]


def _spread(samples: tuple[Sample, ...], count: int, apart: float) -> list[Sample]:
    """Return up to `count` of the last samples that are at least `apart` [s], oldest first."""
    chosen = [samples[-1]]
    for sample in reversed(samples):
        if len(chosen) < count and sample.t <= chosen[-1].t - (1 - 1e-6) * apart:
            chosen.append(sample)
    return chosen[::-1]


def _change_at(run: Run, state: State, t: float) -> np.ndarray:
    """Return the jump of the acceleration (n, 3) [m/s²] at the time t [s] of a jump of loads."""
    near = NEAR * (run.t_end - run.start.t)
    before = acceleration(run.system, replace(state, t=max(run.start.t, t - near)))
    return acceleration(run.system, replace(state, t=t + near)) - before


def _as_random(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return α b, with the α > 0 for which the square of a + α b is the sum of both squares."""
    share = (a * b).sum() / max((b * b).sum(), 1e-300)
    return (math.hypot(1.0, share) - share) * b
