"""The error in time of each method, on a coarse mesh."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import FeclothError
from fecloth.integrators import EXPLICIT
from fecloth.stability.critical_step import critical_dt
from fecloth.study.chart_grid import ALL_METHODS
from fecloth.study.command import StudyFailed
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.status import NO_VALUE
from fecloth.study.tuning import curves
from fecloth.study.tuning.choices import COSTLY, Bench, Choice, Trial, problem_with, spent
from fecloth.study.tuning.curves import Curve

CONTROLLED = "bdf2"  # the method whose steps are also chosen by rtol
FEW = 5  # steps of a run that is a static solution
FEWEST, MOST = 16, 8192  # steps of the first runs
LEAST_STEPS, FAR = 4, 2.0  # of the shortest runs; times the tolerance: an error of too few steps
NEAR = 4.0  # times the tolerance: errors in time of second order that need no shorter steps
REGULAR = 2.5, 7.0  # ratios of successive changes of a method of second order
PLENTY = 1024  # steps that show a period if there is one
TOLERANCES, DEARER = (0.1, 0.01, 0.001), 3.0  # 1/s, of chosen steps; seconds of one over the last
LONG, MORE = 20_000, 60  # most explicit steps that are tried; times the implicit methods' steps
SHORT = 3.0  # s, of an explicit run that is repeated with half its step
NONE = 1e-12  # error of a rule that makes none
LEAST = 1e-4  # error in time of a run that is compared with no other
POWERS = {"steps": (0.5, 1.0), "rtol": (0.3, 1.0), "limit": (1.0, 1.0)}  # of seconds over x


@dataclass(frozen=True, eq=False)
class Rule:
    """A method with its steps: errors in time and seconds on the coarse mesh."""

    method: str
    # What `x` is: "steps", "rtol" (x = 1/rtol), "limit" (x = 1: the steps follow the mesh; 2 for
    # half of that step), or "static".
    kind: str
    errors: Curve  # over x
    seconds: Curve  # over x
    trials: tuple[Trial, ...]

    @property
    def key(self) -> tuple[str, str]:
        return self.method, self.kind

    def choose(self, choice: Choice, x: float) -> Choice:
        if self.kind == "rtol":
            return replace(choice, method=self.method, rtol=float(f"{1 / x:.3g}"), steps=None)
        steps = math.ceil(x - 1e-9) if self.kind == "steps" else None
        return replace(choice, method=self.method, steps=steps, rtol=None)


@dataclass(frozen=True, eq=False)
class TimeErrors:
    """The rules of all methods that serve, the best known run, and its own error."""

    rules: tuple[Rule, ...]
    reference: Trial
    error: np.ndarray
    trials: tuple[Trial, ...]


def order_of(method: str) -> float:
    """Return the theoretical order of a method in time; 2 where it is not known."""
    cls = ALL_METHODS.get(method)
    return float(cls().traits.order) if cls else 2.0


def measure_methods(
    bench: Bench, mesh: Choice, methods: Sequence[str], tolerance: float, limit: float
) -> TimeErrors:
    """Run the methods on a coarse mesh with steps of several lengths, for `limit` CPU seconds.

    The run with the least error, which follows from the change by its last refinement, is the
    reference of all others. `StudyFailed` if no run reaches its end.
    """
    if not can_choose_steps(bench.opened):
        trials = bench.run([replace(mesh, method="", steps=None)])
        _require(trials)
        return _single(trials[0])
    explicit = next((name for name in methods if name in EXPLICIT), None)
    implicit = [name for name in methods if name not in EXPLICIT and name != "auto"]
    if implicit:
        trials = _ladder(bench, mesh, implicit[0], tolerance, limit / 2)
    else:
        trials = []
    if _have_no_value(bench.opened, trials):
        _require(trials)
    ladder = [trial for trial in trials if trial.is_ok]
    if explicit:
        trials += _explicit_runs(bench, mesh, explicit, MORE * ladder[-1].steps if ladder else LONG)
    _require(trials)
    if ladder:
        trials += _other_methods(bench, mesh, implicit, ladder, tolerance, limit - spent(trials))
    return _summarise(bench, trials)


def can_choose_steps(opened: Problem) -> bool:
    """Whether the problem is a motion whose number of steps may be chosen.

    A run of a few long steps is a static solution: with shorter steps it would become a
    motion.
    """
    span = opened.span
    dt = opened.dt
    if isinstance(opened, FunctionProblem):
        return span is not None and dt is not None
    return span is not None and not (dt and span <= FEW * dt)


def _require(trials: Sequence[Trial]) -> None:
    if not any(trial.is_ok for trial in trials):
        if trials:
            cause = str(trials[0].row["cause"]).splitlines()[0]
        else:
            cause = "nothing was run"
        raise StudyFailed(f"no run on a coarse mesh reached its end; the first: {cause}")


def _single(trial: Trial) -> TimeErrors:
    """Return the one rule of an equilibrium, or of a function that chooses its steps."""
    nothing = np.full(len(trial.records), NONE)
    one = np.ones(1)
    errors, seconds = (Curve(one, y[None], 0.0, 0.0) for y in (nothing, trial.seconds * one))
    rule = Rule("", "static", errors, seconds, (trial,))
    return TimeErrors((rule,), trial, nothing, (trial,))


def _explicit_runs(bench: Bench, mesh: Choice, method: str, most: float) -> list[Trial]:
    """Run an explicit method at its stability limit and, if that is short, with half that step."""
    # It is left out if it takes more than `most` steps.
    choice = replace(mesh, method=method)
    try:
        first = problem_with(bench.opened, choice).first
        steps = (bench.opened.span or 0.0) / critical_dt(first.system, first.start)
    except FeclothError:  # the terms or the pins refuse it
        return []
    if steps > min(most, LONG):
        return []
    (trial,) = bench.run([choice])
    if not trial.is_ok or trial.seconds >= SHORT:
        return [trial]
    return [trial, *bench.run([replace(choice, steps=2 * trial.steps)])]


def _ladder(bench: Bench, mesh: Choice, method: str, tolerance: float, limit: float) -> list[Trial]:
    """Double the steps of a method until its error in time is known and about the tolerance."""
    trials: list[Trial] = []
    steps = first_steps(bench.opened)
    while steps <= MOST and spent(trials) < limit:
        trials += bench.run([replace(mesh, method=method, steps=steps)])
        finished = [trial for trial in trials if trial.is_ok]
        if _have_no_value(bench.opened, trials):
            break
        if len(finished) > 2:
            changes = [bench.distance(finished[-1], trial) for trial in finished[-3:-1]]
            error = changes[1].max() / 3
            ratio = changes[0].max() / changes[1].max()
            is_regular = 1 + REGULAR[0] < ratio < 1 + REGULAR[1]
            if error < tolerance or (is_regular and error < NEAR * tolerance):
                break
        steps *= 2
    return trials


def first_steps(opened: Problem) -> int:
    """Return the number of steps of the first run: few, and not more than the problem has."""
    return int(min(max(_own_steps(opened, FEWEST), 2), FEWEST))


def _own_steps(opened: Problem, otherwise: int) -> float:
    """Return the number of steps of the problem itself; `otherwise` if it chooses them."""
    if opened.span and opened.dt:
        return opened.span / opened.dt
    return otherwise


def _have_no_value(opened: Problem, trials: Sequence[Trial]) -> bool:
    """Whether no run has the quantity, as a period, also with the steps of the problem itself."""
    if not trials or any(trial.row["status"] != NO_VALUE for trial in trials):
        return False
    return (trials[-1].choice.steps or 0) >= _own_steps(opened, PLENTY)


def _other_methods(
    bench: Bench,
    mesh: Choice,
    implicit: Sequence[str],
    ladder: Sequence[Trial],
    tolerance: float,
    limit: float,
) -> list[Trial]:
    """Run all implicit methods with as many steps as the first one and fewer, and by rtol."""
    first = ladder[0].choice.steps or 1
    finest = ladder[-1]
    most = finest.choice.steps or 1
    trials: list[Trial] = []
    per_step = finest.seconds / finest.steps
    for method in implicit:
        if method == implicit[0]:
            steps = first // 2
        else:
            steps = most if order_of(method) > 1 else 2 * most
        while steps * per_step > COSTLY:
            steps //= 2
        choice = replace(mesh, method=method, steps=steps)
        trials += _fewer_steps(bench, choice, finest, tolerance, limit - spent(trials))
    for rtol in TOLERANCES if CONTROLLED in implicit and spent(trials) < limit else ():
        trials += bench.run([replace(mesh, method=CONTROLLED, rtol=rtol)])
        if not trials[-1].is_ok or DEARER * trials[-1].seconds > COSTLY:
            break
    return trials


def _fewer_steps(
    bench: Bench, choice: Choice, finest: Trial, tolerance: float, limit: float
) -> list[Trial]:
    """Halve the steps until the error is far above the tolerance: fewer ones are not predicted."""
    trials: list[Trial] = []
    while (choice.steps or 0) >= LEAST_STEPS and spent(trials) < limit:
        trials += bench.run([choice])
        if not trials[-1].is_ok or bench.distance(finest, trials[-1]).max() > FAR * tolerance:
            break
        choice = replace(choice, steps=(choice.steps or 0) // 2)
    return trials


def _summarise(bench: Bench, trials: Sequence[Trial]) -> TimeErrors:
    """Return the curves of all rules: distances to the best run, plus the error of that run."""
    # The best run is the finest one of its rule whose own error is least.
    able = [trial for trial in trials if trial.is_ok]
    listed = curves.grouped(able, lambda run: key_of(run.choice), lambda run: size_of(run.choice))
    finest = [(runs[-1], _own_error(bench, runs)) for runs in listed]
    reference, error = min(finest, key=lambda pair: pair[1].max())
    rules = []
    for runs in listed:
        x = [size_of(trial.choice) for trial in runs]
        key = key_of(runs[0].choice)
        apart = [bench.distance(reference, trial) for trial in runs]
        errors = curves.error_curve(x, apart, np.full(len(error), _theory(runs)), error)
        seconds = curves.cost_curve(x, [trial.seconds for trial in runs], *POWERS[key[1]])
        rules.append(Rule(*key, errors, seconds, tuple(runs)))
    return TimeErrors(tuple(rules), reference, error, tuple(trials))


def _own_error(bench: Bench, runs: Sequence[Trial]) -> np.ndarray:
    """Return the error of the finest run of a rule."""
    finest = runs[-1]
    if len(runs) == 1:
        known = finest.row["time_error"] if finest.choice.is_explicit else 1.0
        return np.full(len(finest.records), max(np.nan_to_num(known, nan=1.0), LEAST))
    x = [size_of(trial.choice) for trial in runs]
    return curves.error_of_finest(bench.distance, runs, x, _theory(runs))


def _theory(runs: Sequence[Trial]) -> float:
    """Return the theoretical order of a rule in its x."""
    if runs[0].choice.rtol:
        return 1.0
    return order_of(runs[0].choice.method)


def key_of(choice: Choice) -> tuple[str, str]:
    if choice.rtol:
        return choice.method, "rtol"
    return choice.method, "limit" if choice.is_explicit else "steps"


def size_of(choice: Choice) -> float:
    """Return x of a rule: 1/rtol, the number of steps, or 1 for a step at the stability limit."""
    if choice.rtol:
        return 1 / choice.rtol
    if not choice.is_explicit:
        return float(choice.steps or 1)
    return 1.0 + (choice.steps is not None)
