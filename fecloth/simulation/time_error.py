"""The error in time of a run, estimated from its positions at a few times."""

import math
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import SolveFailed
from fecloth.integrators.protocol import MethodTraits, drift_of
from fecloth.linalg.reductions import rms
from fecloth.simulation.account import NEVER, Account, Accounts, End, Run
from fecloth.simulation.contact import Contact
from fecloth.simulation.deformation import Deformation
from fecloth.simulation.doubts.jumps import Jump, find_jumping_motions, find_jumps
from fecloth.simulation.doubts.planned_run import attempt
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.error_transport import Error, Transport
from fecloth.simulation.rigid_motion import derivative, rms_without_rigid
from fecloth.simulation.steps import StepInfo
from fecloth.simulation.time_error_words import LARGEST_ACCEPTED, LEAST_STATED, describe_time_error
from fecloth.simulation.within_step import acceleration
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.contact.bound_contact import BoundContact
from fecloth.terms.records import remembered
from fecloth.terms.traits import has_kind

MEAN = math.pi / 2  # peak of |sin| over its mean
LEAST_MOVED = 1e-6  # over the extent of the cloth: a cloth that has moved by less is at rest
# Of a gap: so much a barrier gives way under the weight, and no place is sharper.
GAP_GIVEN_WAY = 0.1
SAMPLES_OF_LOADS = 33  # between two samples of the motion, at loads that may jump
LEAST_LOAD_JUMP = 1e-9  # over the largest value of a load; less is round-off
LARGEST_GAIN = 4.0  # what is carried over the sum of errors; above, small errors have grown
LARGEST_LOSS = 6.0  # the sum over what is carried; above, the field has missed what happened
GROWS = (
    "small errors have grown, as where a cloth buckles, flutters or is hit, and nothing tells how "
    "far: see whether a run with half the dt ends the same"
)
JUMPS = "a pin or an obstacle jumps, and what follows depends on dt"
BOUNCES = "the cloth bounces in less than a few steps, and what follows depends on dt"
HITS = "the cloth hits something, where the method is of first order only"
LEAST_IMPACT = 0.05  # over the largest kinetic energy: what impacts have taken where they count
LOOK_AGAIN = 0.15  # of the time so far between two looks at the displacement


@remembered
@dataclass(frozen=True, eq=False)
class Sample:
    """A state, and its energies [J]: see `Deformation` and `Ledger`."""

    t: float
    step: int
    x: np.ndarray
    v: np.ndarray
    deforming: float  # kinetic energy of the deformation
    inside: float  # dissipated by damping that a rigid motion does not feel
    kinetic: float  # the whole kinetic energy
    # Taken by the other damping, less what it supplies: a wind that drives it forgets no errors.
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
    # What jumps of loads have given too much or too little: rms velocity [m/s], and since when
    # [s].
    kick: float = 0.0
    kicked: float = math.inf
    # By `Transport`: the error of the drift and of the jumps, and its largest rms of x [m].
    error: Error | None = None
    carried: float = 0.0
    fastest: float = 0.0  # largest kinetic energy of the samples [J]
    # Largest rms displacement [m], and the time of the last look at it [s].
    moved: float = 0.0
    looked: float = 0.0
    due: int = 0  # the step of the next sample
    # At the end: the error over the largest displacement, NaN without an estimate; in words.
    relative: float = math.nan
    sentence: str = ""
    unknown: str = ""  # why there is no estimate
    jumps: tuple[Jump, ...] = ()  # of motions

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
        if latest.step > self.start.step:
            dt = _mean_step(self.start, latest)
        else:
            dt = math.nan
        is_cause = after.kick_length(system, t) > after.largest
        sentence = describe_time_error(error, run.method, dt, after.kicked, is_cause, unknown)
        return after.changed(relative=error, sentence=sentence)

    def _after(self, run: Run, state: State, step: int, others: Accounts) -> "TimeError":
        sample = _sample(run.system, state, step, others)
        kicked = self._kicked(run, state, sample)
        return kicked.sampled(run.system, run.method.traits, state, sample)

    @property
    def is_large(self) -> bool:
        """Whether the error, or what is known of one that cannot be stated, is above 10 %."""
        known = max(self.largest, self.carried)
        return self.relative > LARGEST_ACCEPTED or bool(
            self.unknown and known > LARGEST_ACCEPTED * self.moved
        )

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
    ) -> "TimeError":
        if (drift := drift_of(traits)) is None:
            return self.changed(due=NEVER)
        q, constant = drift
        recent = (*self.recent, sample)[-(q + 2) :]
        grown = self
        old, new = recent[-2:]
        dt = _mean_step(old, new)
        lag = constant * dt**q * (new.t - old.t)
        total = self.lag + lag
        if len(recent) == q + 2:  # the first derivative stands for all time before
            is_first = len(self.recent) < q + 2
            begin, over = (self.start, total) if is_first else (old, lag)
            grown = self._summed(system, state, recent, over)
            if not traits.explicit and system.is_whole and not system.dense(state):
                grown = grown._moved_on(system, state, recent, begin, over)
        after = grown.changed(
            recent=recent,
            lag=total,
            fastest=max(self.fastest, sample.kinetic),
            due=sample.step + math.ceil(self._apart(q, constant, dt, new.t) / dt - 1e-6),
        )
        next_look = self.looked + LOOK_AGAIN * (self.looked - self.start.t)
        if new.t < next_look:
            return after
        return after._looked(system.diagonal_mass, state)

    def _summed(self, system: System, state: State, recent, over: float) -> "TimeError":
        """Return the estimate with what κ ∫ dt^q dt = `over` adds to e, and what e forgets."""
        old, new = recent[-2:]
        mass = system.diagonal_mass
        over = MEAN * over
        times, places = zip(*((sample.t, sample.x) for sample in recent), strict=True)
        y = _seen_from_pins(system, derivative(times, places))
        rate = rms_without_rigid(mass, state.x, y)
        turning = math.sqrt(max(0.0, rms(mass, y) ** 2 - rate**2))
        outer = _decay(new.outside - old.outside, old.kinetic + new.kinetic)
        decay = outer + _decay(new.inside - old.inside, old.deforming + new.deforming)
        inner = _add_forgetting(self.inner, rate * over, decay)
        rigid = _add_forgetting(self.rigid, turning * over, outer)
        deforming = max(self.deforming, inner)
        largest = max(self.largest, math.hypot(inner, rigid))
        return self.changed(inner=inner, rigid=rigid, deforming=deforming, largest=largest)

    def _moved_on(self, system: System, state: State, recent, begin, over: float) -> "TimeError":
        """Return the estimate with the error moved on since the sample `begin` by `Transport`."""
        if self.unknown:
            return self
        seconds = state.t - begin.t
        parts = 1 if begin is recent[-2] else len(recent) - 1
        times = [sample.t for sample in recent]
        s = over / seconds * derivative(times, [sample.x for sample in recent])
        r = over / seconds * derivative(times, [sample.v for sample in recent])
        error = self.error or Error.none(s)
        try:
            step = Transport.at(system, state, seconds / parts)
            for _ in range(parts):
                error = step.carry(error, s, r)
        except SolveFailed:
            return self.changed(unknown=GROWS)
        carried = max(self.carried, rms(system.diagonal_mass, error.x))
        return self.changed(error=error, carried=carried)

    def relative_error(self, system: System, traits: MethodTraits, t: float) -> float:
        """Return the error up to t, over the largest displacement; NaN for no estimate.

        Where the error of a step is of a lower order than its drift, as with symplectic Euler,
        c dt |v| is added: such an error does not grow with time. There is no estimate for a
        method without these constants, before p steps, and for a cloth at rest.
        """
        if (drift := drift_of(traits)) is None or self.unknown:
            return math.nan
        gaps = (term.gap for term in system.bound if isinstance(term, BoundContact))
        still = max(LEAST_MOVED * system.cloth.extent, GAP_GIVEN_WAY * min(gaps, default=0.0))
        if len(self.recent) < drift[0] + 2 or self.moved <= still:
            return math.nan
        length = self._sum(system, t)
        if traits.order < drift[0] and traits.error_constant is not None:
            dt = _mean_step(self.start, self.recent[-1])
            length += traits.error_constant * dt * self._speed(system)
        carried = self.carried if self.carried > length / LARGEST_LOSS else length
        return math.sqrt(length * carried) / self.moved

    def _sum(self, system: System, t: float) -> float:
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
        if not run.loads or not sample.t > last.t or drift_of(run.method.traits) is None:
            return self
        dt = _mean_step(last, sample)
        jumps = attempt(_jumps_of_loads, run, state, last.t, sample.t, otherwise=())
        if not jumps:
            return self
        error = self.error or Error.none(state.x)
        kick = self.kick
        is_first = len(self.recent) < drift_of(run.method.traits)[0] + 2
        begin = self.start.t if is_first else last.t  # from where `_moved_on` moves the error
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


def _jumps_of_loads(run: Run, state: State, begin: float, end: float):
    """Return the times of jumps of loads [s], and the jumps of the acceleration (n, 3) [m/s²]."""
    times = np.linspace(begin, end, SAMPLES_OF_LOADS)
    jumps = set()
    for load in run.loads:
        g = np.asarray(load.values(times), float).reshape(SAMPLES_OF_LOADS, -1)
        jumps |= {
            t for t, _ in find_jumps(times, g, load.values, LEAST_LOAD_JUMP * np.abs(g).max())
        }
    near = 1e-9 * (end - begin)
    sizes = []
    for t in sorted(jumps):
        a, b = (
            acceleration(run.system, replace(state, t=max(begin, t + side)))
            for side in (-near, near)
        )
        sizes.append((t, b - a))
    return sizes


def _as_random(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return α b, with the α > 0 for which the square of a + α b is the sum of both squares."""
    share = (a * b).sum() / max((b * b).sum(), 1e-300)
    return (math.hypot(1.0, share) - share) * b


def _sample(system: System, state: State, step: int, others: Accounts) -> Sample:
    ledger = others[Ledger]
    deforming = others[Deformation].kinetic
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


def _mean_step(a, b):
    return (b.t - a.t) / (b.step - a.step)


def _add_forgetting(length: float, added: float, decay: float) -> float:
    """Return e after it has decayed by e^(−decay), as what is added does from when it comes."""
    share = -math.expm1(-decay) / decay if decay > 1e-9 else 1.0
    return length * math.exp(-decay) + added * share


def _decay(lost: float, moving: float) -> float:
    """Return γ (t_b − t_a) from the energy lost in between and the sum of the kinetic energies."""
    if lost > 0:
        return lost / max(2 * moving, 1e-3 * lost)
    return 0.0
