"""The error in time of a run, estimated from its positions at a few times."""

import math
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import SolveFailed
from fecloth.integrators.protocol import MethodTraits, drift_of
from fecloth.linalg.reductions import rms
from fecloth.simulation.account import NEVER, Account, Accounts, End, Run
from fecloth.simulation.contact import Contact
from fecloth.simulation.deformation import MOTION_AT_REST
from fecloth.simulation.doubts.jumps import NEAR, Jump, find_jumping_motions
from fecloth.simulation.energy_balance import Balance
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.error_transport import Error, Transport
from fecloth.simulation.rigid_motion import derivative, rms_without_rigid
from fecloth.simulation.steps import StepInfo
from fecloth.simulation.time_error_words import LEAST_STATED, describe_time_error
from fecloth.simulation.within_step import acceleration
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.contact.bound_contact import BoundContact
from fecloth.terms.records import remembered
from fecloth.terms.traits import has_kind

MEAN = math.pi / 2  # peak of |sin| over its mean
# Of a gap: so much a barrier gives way under the weight, and no place is sharper.
GAP_GIVEN_WAY = 0.1
LARGEST_GAIN = 4.0  # what is carried over the sum of errors; above, small errors have grown
LARGEST_LOSS = 6.0  # the sum over what is carried; above, the field has missed what happened
GROWS = (
    "small errors have grown, as where a cloth buckles, flutters or is hit, and nothing tells "
    "how far: see whether a run with half the dt ends the same"
)
JUMPS = "a pin or an obstacle jumps, and what follows depends on dt"
BOUNCES = "the cloth bounces in less than a few steps, and what follows depends on dt"
HITS = "the cloth hits something, where the method is of first order only"
LEAST_IMPACT = 0.05  # over the largest kinetic energy: what impacts have taken where they count
LOOK_AGAIN = 0.15  # of the time so far between two looks at the displacement


@remembered
@dataclass(frozen=True, eq=False)
class Sample:
    """A state, and its energies [J]: see `Balance` and `Ledger`.

    Attributes
    ----------
    t, x, v
        Time [s], positions and velocities (n, 3).
    step
        Number of the step after which it was taken.
    deforming
        Kinetic energy of the deformation.
    inside
        Energy dissipated by damping that a rigid motion does not feel.
    kinetic
        The whole kinetic energy.
    outside
        Energy taken by the other damping, less what it supplies: a wind that drives the cloth
        forgets no errors.
    """

    t: float
    step: int
    x: np.ndarray
    v: np.ndarray
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

    This sum is too large where errors cancel each other, and too small where they grow. Where
    the method solves systems, `Transport` moves the same error on with the cloth, as a field.
    It is too small where lost energy changes the mean motion. The geometric mean of both is
    stated. Below the sum over LARGEST_LOSS the field has missed waves between its samples: the
    sum is stated. Above LARGEST_GAIN times the sum the errors grow, as in a cloth that buckles:
    there is no estimate. There is none where a pin jumps, and after impacts where they count:
    see `find_hits`.

    A mode cannot be off by more than 2 A. The derivative is therefore a divided difference over
    times τ apart, at most (2/τ)^p A for a mode of any frequency, with

        (2/τ)^p κ ∫ dt^q dt = 2

    so that positions are needed every τ only, which grows with time. (For τ, dt is the dt of the
    present, so that a short motion after a long rest is not passed over.) The largest e so far
    over the largest displacement, rigid motion included, is the relative error; the largest e of
    the deformation [m] is the same for every observer.

    Attributes
    ----------
    opening
        (n, 3) positions before the first step.
    start
        The sample before the first step.
    recent
        The last p + 1 samples.
    lag
        κ ∫ dt^q dt up to the last of them [s^p].
    inner, rigid
        e of the deformation and of the rigid motion there [m].
    deforming, largest
        The largest e of the deformation so far, and of both together [m].
    kick, kicked
        What jumps of loads have given too much or too little: rms velocity [m/s], and since
        when [s].
    error, carried
        By `Transport`: the error of the drift and of the jumps, and its largest rms of x [m].
    fastest
        Largest kinetic energy of the samples [J].
    moved, looked
        Largest rms displacement [m], and the time of the last look at it [s].
    due
        Number of the step of the next sample.
    relative
        At the end: the error over the largest displacement, NaN without an estimate.
    sentence
        The same in words.
    unknown
        Why there is no estimate, or "".
    jumps
        Jumps of motions.
    """

    name = "time_error"
    opening: np.ndarray
    start: Sample
    recent: tuple[Sample, ...]
    lag: float = 0.0
    inner: float = 0.0
    rigid: float = 0.0
    deforming: float = 0.0
    largest: float = 0.0
    kick: float = 0.0
    kicked: float = math.inf
    error: Error | None = None
    carried: float = 0.0
    fastest: float = 0.0
    moved: float = 0.0
    looked: float = 0.0
    due: int = 0
    relative: float = math.nan
    sentence: str = ""
    unknown: str = ""
    jumps: tuple[Jump, ...] = ()

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> "TimeError":
        start = _sample(run.system, run.start, run.step, others)
        return cls(run.start.x, start, (start,), looked=start.t)

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "TimeError":
        """Return the estimate after a step: nearly always the same object."""
        if info.step < self.due:
            return self
        return self._after(run, info.result.state, info.step, others)

    def finish(self, run: Run, end: End, others: Accounts) -> "TimeError":
        """Return the record with the relative error, or with why there is none."""
        after = self
        system = run.system
        t = end.state.t
        if t > self.recent[-1].t:
            after = self._after(run, end.state, end.step, others)
        after = after._looked(system.diagonal_mass, end.state)
        after = after.changed(
            jumps=find_jumping_motions(system, replace(run.start, t=self.start.t), t)
        )
        unknown = after.unknown or after._find_unknown(system, t) or after.find_hits(run, others)
        after = after.changed(unknown=unknown)
        error = after.relative_error(system, run.method.traits, t)
        latest = after.recent[-1]
        dt = math.nan
        if latest.step > self.start.step:
            dt = _mean_step(self.start, latest)
        is_cause = after.kick_length(system, t) > after.largest
        sentence = describe_time_error(error, run.method, dt, after.kicked, is_cause, unknown)
        return after.changed(relative=error, sentence=sentence)

    def _after(self, run: Run, state: State, step: int, others: Accounts) -> "TimeError":
        """Return the estimate with a sample of the state after a step."""
        sample = _sample(run.system, state, step, others)
        kicked = self._kicked(run, state, sample)
        return kicked.sampled(run.system, run.method.traits, state, sample)

    def summary(self) -> dict[str, object]:
        is_known = not math.isnan(self.relative)
        return {
            "time_error": self.relative if is_known else None,
            "deformation_error": self.deforming if is_known else None,
            "time_error_in_words": self.sentence,
        }

    def sampled(
        self, system: System, traits: MethodTraits, state: State, sample: Sample
    ) -> "TimeError":
        """Return the estimate with one more sample, and the step of the next one."""
        drift = drift_of(traits)
        if drift is None:
            return self.changed(due=NEVER)
        q, constant = drift
        recent = (*self.recent, sample)[-(q + 2) :]
        old, new = recent[-2:]
        dt = _mean_step(old, new)
        lag = constant * dt**q * (new.t - old.t)
        total = self.lag + lag
        after = self
        if len(recent) == q + 2:
            begin = old
            added = lag
            if len(self.recent) < q + 2:  # the first derivative stands for all time before
                begin = self.start
                added = total
            after = after._summed(system, state, recent, added)
            if not traits.explicit and system.is_whole and not system.dense(state):
                after = after._moved_on(system, state, recent, begin, added)
        steps_to_next = math.ceil(self._apart(q, constant, dt, new.t) / dt - 1e-6)
        after = after.changed(
            recent=recent,
            lag=total,
            fastest=max(self.fastest, sample.kinetic),
            due=sample.step + steps_to_next,
        )
        next_look = self.looked + LOOK_AGAIN * (self.looked - self.start.t)
        if new.t < next_look:
            return after
        return after._looked(system.diagonal_mass, state)

    def _summed(self, system: System, state: State, recent, lag: float) -> "TimeError":
        """Return the estimate with what a `lag` κ ∫ dt^q dt adds to e, and what e forgets."""
        old, new = recent[-2:]
        mass = system.diagonal_mass
        times = [sample.t for sample in recent]
        places = [sample.x for sample in recent]
        y = _seen_from_pins(system, derivative(times, places))
        rate = rms_without_rigid(mass, state.x, y)
        rate_of_rigid = math.sqrt(max(0.0, rms(mass, y) ** 2 - rate**2))
        outer = _decay(new.outside - old.outside, old.kinetic + new.kinetic)
        decay = outer + _decay(new.inside - old.inside, old.deforming + new.deforming)
        inner = _add_forgetting(self.inner, rate * (MEAN * lag), decay)
        rigid = _add_forgetting(self.rigid, rate_of_rigid * (MEAN * lag), outer)
        deforming = max(self.deforming, inner)
        largest = max(self.largest, math.hypot(inner, rigid))
        return self.changed(inner=inner, rigid=rigid, deforming=deforming, largest=largest)

    def _moved_on(self, system: System, state: State, recent, begin, lag: float) -> "TimeError":
        """Return the estimate with the error moved on by `Transport` since the sample `begin`.

        On this way the method adds the error of a `lag` κ ∫ dt^q dt, evenly: s [m/s] to the
        error of x, and r [m/s²] to the error of v, in each second.
        """
        if self.unknown:
            return self
        seconds = state.t - begin.t
        parts = len(recent) - 1
        if begin is recent[-2]:
            parts = 1
        times = [sample.t for sample in recent]
        s = lag / seconds * derivative(times, [sample.x for sample in recent])
        r = lag / seconds * derivative(times, [sample.v for sample in recent])
        error = self.error or Error.none(s)
        try:
            transport = Transport.at(system, state, seconds / parts)
            for _ in range(parts):
                error = transport.carry(error, s, r)
        except SolveFailed:
            return self.changed(unknown=GROWS)
        carried = max(self.carried, rms(system.diagonal_mass, error.x))
        return self.changed(error=error, carried=carried)

    def relative_error(self, system: System, traits: MethodTraits, t: float) -> float:
        """Return the error up to t, over the largest displacement; NaN for no estimate.

        Where the error of a step is of a lower order than its drift, as with symplectic Euler,
        c dt |v| is added: such an error does not grow with time. There is no estimate for a
        method without these constants, before p steps, and for a cloth at rest.

        The sum of errors is too large where errors cancel, and the error that `Transport` has
        carried is too small where lost energy changes the mean motion: their geometric mean is
        taken. A carried error far below the sum has missed waves, and does not count.
        """
        if (drift := drift_of(traits)) is None or self.unknown:
            return math.nan
        gaps = (term.gap for term in system.bound if isinstance(term, BoundContact))
        still = max(MOTION_AT_REST * system.cloth.extent, GAP_GIVEN_WAY * min(gaps, default=0.0))
        if len(self.recent) < drift[0] + 2 or self.moved <= still:
            return math.nan
        length = self._sum(system, t)
        if traits.order < drift[0] and traits.error_constant is not None:
            dt = _mean_step(self.start, self.recent[-1])
            length += traits.error_constant * dt * self._speed(system)
        if self.carried > length / LARGEST_LOSS:
            length = math.sqrt(length * self.carried)
        return length / self.moved

    def _sum(self, system: System, t: float) -> float:
        """Return the largest e up to t, with what jumps of loads have added [m]."""
        return math.hypot(self.largest, self.kick_length(system, t))

    def _speed(self, system: System) -> float:
        """Return the largest rms speed of the samples [m/s]."""
        return math.sqrt(2 * self.fastest / system.total_mass)

    def _find_unknown(self, system: System, t: float) -> str:
        """Return why there is no estimate at the end of the run, or ""."""
        if self.carried > max(LARGEST_GAIN * self._sum(system, t), LEAST_STATED * self.moved):
            return GROWS
        return JUMPS if self.jumps else ""

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

    def kick_length(self, system: System, t: float) -> float:
        """Return how far jumps of loads have moved the cloth away from the solution at t [m].

        A wrong velocity δ moves it by δ times the time since, or by δ/ω at most in a motion of
        frequency ω, the largest speed over the largest displacement.
        """
        if not self.kick:
            return 0.0
        return self.kick * min(t - self.kicked, self.moved / max(self._speed(system), 1e-300))

    def _kicked(self, run: Run, state: State, sample: Sample) -> "TimeError":
        """Return the estimate with the jumps of loads since the last sample.

        A step ends up to dt beside a jump Δa of the acceleration and errs by up to dt Δa/2 in
        the velocity, by dt Δa/4 on average. Errors of several jumps add up as random ones.
        """
        last = self.recent[-1]
        drift = drift_of(run.method.traits)
        if not sample.t > last.t or drift is None:
            return self
        since = last.t if len(self.recent) > 1 else -math.inf  # also what jumps at the start
        times = run.load_jumps[(run.load_jumps > since) & (run.load_jumps <= sample.t)]
        if not len(times):
            return self
        dt = _mean_step(last, sample)
        jumps = [(t, _change_at(run, state, t)) for t in times.tolist()]
        error = self.error or Error.none(state.x)
        kick = self.kick
        begin = last.t  # from where `_moved_on` moves the error
        if len(self.recent) < drift[0] + 2:
            begin = self.start.t
        for t, change in jumps:
            kick = math.hypot(kick, 0.25 * dt * rms(run.system.diagonal_mass, change))
            more = _as_random(error.v, 0.25 * dt * change)
            error = Error(error.x - (t - begin) * more, error.v + more)
        return self.changed(error=error, kick=kick, kicked=min(self.kicked, jumps[0][0]))

    def _apart(self, q: int, constant: float, dt: float, t: float) -> float:
        """Return τ [s] for steps of the present size from the start on."""
        return (2**q * constant * dt**q * (t - self.start.t)) ** (1 / (q + 1))

    def _looked(self, mass: np.ndarray, state: State) -> "TimeError":
        moved = rms(mass, state.x - self.opening)
        return self.changed(moved=max(self.moved, moved), looked=state.t)


def _change_at(run: Run, state: State, t: float) -> np.ndarray:
    """Return the jump of the acceleration (n, 3) [m/s²] at the time t [s] of a jump of loads."""
    near = NEAR * (run.t_end - run.start.t)
    before = acceleration(run.system, replace(state, t=max(run.start.t, t - near)))
    return acceleration(run.system, replace(state, t=t + near)) - before


def _as_random(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return α b, with the α > 0 for which the square of a + α b is the sum of both squares."""
    share = (a * b).sum() / max((b * b).sum(), 1e-300)
    return (math.hypot(1.0, share) - share) * b


def _sample(system: System, state: State, step: int, others: Accounts) -> Sample:
    """Return the sample of a state after the step of this number."""
    ledger = others[Ledger]
    deforming = others[Balance].deforming
    supplied = sum(ledger.work.get(name, 0.0) for name in ledger.resisting)
    return Sample(
        t=state.t,
        step=step,
        x=state.x,
        v=state.v,
        deforming=deforming,
        inside=ledger.lost_inside,
        kinetic=ledger.kinetic,
        outside=ledger.lost_outside - supplied,
    )


def _seen_from_pins(system: System, x: np.ndarray) -> np.ndarray:
    """Return x (n, 3) as seen from pins that move: a method makes no error in their motion."""
    moved = [nodes for pin, nodes in system.constraints.groups.values() if pin.moves]
    if moved:
        return x - x[np.concatenate(moved)].mean(axis=0)
    return x


def _mean_step(a: Sample, b: Sample) -> float:
    """Return the mean size of the steps between two samples [s]."""
    return (b.t - a.t) / (b.step - a.step)


def _add_forgetting(length: float, added: float, decay: float) -> float:
    """Return e [m] after a time in which it decays by e^(−decay), with errors added evenly."""
    share_that_stays = 1.0
    if decay > 1e-9:
        share_that_stays = -math.expm1(-decay) / decay
    return length * math.exp(-decay) + added * share_that_stays


def _decay(lost: float, moving: float) -> float:
    """Return γ times the time between two samples, from the energy lost between them [J].

    It is that energy over 4 times the mean kinetic energy. `moving` is the sum of the kinetic
    energies of both samples [J].
    """
    if lost > 0:
        return lost / max(2 * moving, 1e-3 * lost)
    return 0.0
