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
from fecloth.study.tuning.choices import (
    COSTLY_SECONDS,
    ROUND_OFF_OF_DISTANCES,
    Bench,
    Choice,
    Trial,
    problem_with,
    spent,
)
from fecloth.study.tuning.curves import Curve

CONTROLLED = "bdf2"  # the method whose steps are also chosen by rtol
RTOLS = (0.1, 0.01, 0.001)  # 1/s, of its runs with chosen steps
# Seconds of a run over the seconds with ten times its rtol: about √10, as many more steps as an
# error of second order needs.
TENTH_OF_RTOL_COSTS = 3.0
STEPS_OF_STATIC_RUN = 5  # a run of so few long steps is a static solution
FIRST_STEPS = 16  # of the first run, which is then repeated with twice as many, and so on
MOST_IMPLICIT_STEPS = 8192  # of the last run
FEWEST_STEPS = 4  # of the shortest runs
# Most steps of the explicit run on the coarse mesh; with a smaller limit of its steps it is left
# out. On finer meshes, where it would be used, it takes many times as many.
MOST_EXPLICIT_STEPS = 20_000
# Error in time, at least, of an explicit run that is compared with no other run.
LEAST_ERROR_OF_SINGLE_RUN = 1e-4
# The seconds of a run grow with x (see `Rule.kind`) by a power from the first to the second.
# Longer steps take more iterations each.
POWERS_OF_SECONDS = {"steps": (0.5, 1.0), "rtol": (0.3, 1.0), "limit": (1.0, 1.0)}


@dataclass(frozen=True, eq=False)
class Rule:
    """A method with its steps: errors in time and seconds on the coarse mesh.

    Attributes
    ----------
    method
        Name of the method; "" for the problem's own.
    kind
        What x is: "steps", "rtol" (x = 1/rtol), "limit" (x = 1: the steps follow the mesh; 2 for
        half of that step), or "static".
    errors
        Errors in time over x.
    seconds
        Seconds of a run over x.
    trials
        The runs, by x.
    """

    method: str
    kind: str
    errors: Curve
    seconds: Curve
    trials: tuple[Trial, ...]

    @property
    def key(self) -> tuple[str, str]:
        """What tells rules apart."""
        return self.method, self.kind

    def choose(self, choice: Choice, x: float) -> Choice:
        """Return the choice with this method and its steps at x."""
        if self.kind == "rtol":
            return replace(choice, method=self.method, rtol=float(f"{1 / x:.3g}"), steps=None)
        steps = math.ceil(x - 1e-9) if self.kind == "steps" else None  # 1e-9 is round-off of x
        return replace(choice, method=self.method, steps=steps, rtol=None)


@dataclass(frozen=True, eq=False)
class TimeErrors:
    """The rules of all methods that serve, the best known run, its own error, and all runs."""

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
    """Run the methods on a coarse mesh with steps of several lengths, and return their errors.

    The run with the least error, which follows from the change by its last refinement, is the
    reference of all others. First the steps of the first implicit method are doubled, until its
    finest run serves as a reference; then an explicit method and the other methods run. `mesh`
    is the choice of the coarse mesh. About `limit` CPU seconds are spent.

    Raises
    ------
    StudyFailed
        If no run reaches its end.
    """
    if not can_choose_steps(bench.opened):
        trials = bench.run([replace(mesh, method="", steps=None)])
        _require(trials)
        return _errors_of_one_run(trials[0])
    explicit = next((name for name in methods if name in EXPLICIT), None)
    implicit = [name for name in methods if name not in EXPLICIT and name != "auto"]
    trials = []
    if implicit:
        trials = _double_steps(bench, replace(mesh, method=implicit[0]), tolerance, limit / 2)
    if _have_no_value(bench.opened, trials):
        _require(trials)  # raises: other methods would have no value, either
    finished = [trial for trial in trials if trial.is_ok]
    if explicit:
        trials += _explicit_runs(bench, replace(mesh, method=explicit))
    _require(trials)
    if finished:
        seconds_left = limit - spent(trials)
        trials += _other_methods(bench, mesh, implicit, finished, tolerance, seconds_left)
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
    return span is not None and not (dt and span <= STEPS_OF_STATIC_RUN * dt)


def _require(trials: Sequence[Trial]) -> None:
    """Raise `StudyFailed` if no trial reached its end."""
    if any(trial.is_ok for trial in trials):
        return
    if trials:
        cause = str(trials[0].row["cause"]).splitlines()[0]
    else:
        cause = "nothing was run"
    raise StudyFailed(f"no run on a coarse mesh reached its end; the first: {cause}")


def _errors_of_one_run(trial: Trial) -> TimeErrors:
    """Return the one rule of an equilibrium, or of a function that chooses its steps.

    There are no steps to choose, so that the error in time is 0: the round-off, which has a
    logarithm. The size of the steps is 1, and the seconds are the ones of the run.
    """
    no_error = np.full(len(trial.records), ROUND_OFF_OF_DISTANCES)
    x = np.ones(1)
    rule = Rule(
        method="",
        kind="static",
        errors=Curve(x, no_error[None], slope=0.0, below=0.0),
        seconds=Curve(x, np.full((1, 1), trial.seconds), slope=0.0, below=0.0),
        trials=(trial,),
    )
    return TimeErrors((rule,), trial, no_error, (trial,))


def _explicit_runs(bench: Bench, choice: Choice) -> list[Trial]:
    """Run an explicit method at its stability limit and, if that is quick, with half that step.

    Return the trials: none if it would take too many steps, or if the terms or the pins refuse
    an explicit method.
    """
    try:
        setup = problem_with(bench.opened, choice).first
        steps = (bench.opened.span or 0.0) / critical_dt(setup.system, setup.start)
    except FeclothError:
        return []
    if steps > MOST_EXPLICIT_STEPS:
        return []
    (trial,) = bench.run([choice])
    if not trial.is_ok or 2 * trial.seconds > COSTLY_SECONDS:
        return [trial]
    return [trial, *bench.run([replace(choice, steps=2 * trial.steps)])]


def _double_steps(bench: Bench, choice: Choice, tolerance: float, limit: float) -> list[Trial]:
    """Run a method with twice as many steps again and again; return all trials.

    It ends when three runs have reached their end and the error that is left in the last one is
    below the tolerance, when no run can have a value of the quantity, after
    `MOST_IMPLICIT_STEPS`, or when `limit` CPU seconds are spent.
    """
    trials: list[Trial] = []
    steps = first_steps(bench.opened)
    while steps <= MOST_IMPLICIT_STEPS and spent(trials) < limit:
        trials += bench.run([replace(choice, steps=steps)])
        finished = [trial for trial in trials if trial.is_ok]
        if _have_no_value(bench.opened, trials):
            break
        if len(finished) > 2:
            change = bench.distance(finished[-1], finished[-2]).max()
            # of second order, halving dt leaves a quarter of the error: a third of the change
            if change / 3 < tolerance:
                break
        steps *= 2
    return trials


def first_steps(opened: Problem) -> int:
    """Return the number of steps of the first run: few, and not more than the problem has."""
    return int(min(max(_own_steps(opened, FIRST_STEPS), 2), FIRST_STEPS))


def _own_steps(opened: Problem, otherwise: int) -> float:
    """Return the number of steps of the problem itself; `otherwise` if it chooses them."""
    if opened.span and opened.dt:
        return opened.span / opened.dt
    return otherwise


def _have_no_value(opened: Problem, trials: Sequence[Trial]) -> bool:
    """Whether no run has the quantity, as a period, also with as many steps as the problem."""
    if not trials or any(trial.row["status"] != NO_VALUE for trial in trials):
        return False
    return (trials[-1].choice.steps or 0) >= _own_steps(opened, MOST_IMPLICIT_STEPS)


def _other_methods(
    bench: Bench,
    mesh: Choice,
    implicit: Sequence[str],
    finished: Sequence[Trial],
    tolerance: float,
    limit: float,
) -> list[Trial]:
    """Run all implicit methods with fewer and fewer steps, and one by rtol; return the trials.

    `finished` are the runs of the first method, whose steps were doubled from run to run. The
    other methods begin with as many steps as the last of these, methods of first order with
    twice as many; all with so few that a run is not costly. The first method goes on with fewer
    steps than its first run. No method begins after `limit` CPU seconds.
    """
    finest = finished[-1]
    seconds_per_step = finest.seconds / finest.steps
    trials: list[Trial] = []
    for method in implicit:
        if method == implicit[0]:
            steps = (finished[0].choice.steps or 1) // 2
        elif order_of(method) > 1:
            steps = finest.choice.steps or 1
        else:
            steps = 2 * (finest.choice.steps or 1)
        while steps * seconds_per_step > COSTLY_SECONDS:
            steps //= 2
        choice = replace(mesh, method=method, steps=steps)
        trials += _halve_steps(bench, choice, finest, tolerance, limit - spent(trials))
    if CONTROLLED in implicit and spent(trials) < limit:
        trials += _chosen_steps(bench, mesh)
    return trials


def _chosen_steps(bench: Bench, mesh: Choice) -> list[Trial]:
    """Run the method whose steps are chosen by rtol, with smaller and smaller rtol."""
    trials: list[Trial] = []
    for rtol in RTOLS:
        trials += bench.run([replace(mesh, method=CONTROLLED, rtol=rtol)])
        is_next_costly = TENTH_OF_RTOL_COSTS * trials[-1].seconds > COSTLY_SECONDS
        if not trials[-1].is_ok or is_next_costly:
            break
    return trials


def _halve_steps(
    bench: Bench, choice: Choice, finest: Trial, tolerance: float, limit: float
) -> list[Trial]:
    """Halve the number of steps until the error is above the tolerance: fewer do not serve."""
    trials: list[Trial] = []
    while (choice.steps or 0) >= FEWEST_STEPS and spent(trials) < limit:
        trials += bench.run([choice])
        if not trials[-1].is_ok or bench.distance(finest, trials[-1]).max() > tolerance:
            break
        choice = replace(choice, steps=(choice.steps or 0) // 2)
    return trials


def _summarise(bench: Bench, trials: Sequence[Trial]) -> TimeErrors:
    """Return the errors in time of all rules, from their runs; failed runs have none.

    The best run is the finest run of a rule whose own error is least. The errors of the others
    are their distances to it, plus its own error.
    """
    able = [trial for trial in trials if trial.is_ok]
    runs_of_rules = curves.grouped(
        able, group=lambda run: key_of(run.choice), size=lambda run: size_of(run.choice)
    )
    finest = [(runs[-1], _own_error(bench, runs)) for runs in runs_of_rules]
    reference, error = min(finest, key=lambda pair: pair[1].max())
    rules = []
    for runs in runs_of_rules:
        method, kind = key_of(runs[0].choice)
        x = [size_of(trial.choice) for trial in runs]
        distances = [bench.distance(reference, trial) for trial in runs]
        theory = np.full(len(error), _theory(runs))
        least_power, largest_power = POWERS_OF_SECONDS[kind]
        seconds = [trial.seconds for trial in runs]
        rule = Rule(
            method=method,
            kind=kind,
            errors=curves.error_curve(x, distances, theory, error),
            seconds=curves.cost_curve(x, seconds, least_power, largest_power),
            trials=tuple(runs),
        )
        rules.append(rule)
    return TimeErrors(tuple(rules), reference, error, tuple(trials))


def _own_error(bench: Bench, runs: Sequence[Trial]) -> np.ndarray:
    """Return the (q,) error of the finest run of a rule.

    Of a single run it is what the run itself estimates, if it is explicit, and else 100 %.
    """
    finest = runs[-1]
    if len(runs) > 1:
        x = [size_of(trial.choice) for trial in runs]
        return curves.error_of_finest(bench.distance, runs, x, _theory(runs))
    estimate = finest.row["time_error"] if finest.choice.is_explicit else 1.0
    error = np.nan_to_num(estimate, nan=1.0)
    return np.full(len(finest.records), max(error, LEAST_ERROR_OF_SINGLE_RUN))


def _theory(runs: Sequence[Trial]) -> float:
    """Return the theoretical order of a rule in its x."""
    if runs[0].choice.rtol:
        return 1.0
    return order_of(runs[0].choice.method)


def key_of(choice: Choice) -> tuple[str, str]:
    """Return method and kind of the rule that a choice belongs to."""
    if choice.rtol:
        return choice.method, "rtol"
    if choice.is_explicit:
        return choice.method, "limit"
    return choice.method, "steps"


def size_of(choice: Choice) -> float:
    """Return x of a rule: 1/rtol, the number of steps, or 1 for steps at the stability limit."""
    if choice.rtol:
        return 1 / choice.rtol
    if not choice.is_explicit:
        return float(choice.steps or 1)
    if choice.steps is None:
        return 1.0
    return 2.0
