"""`tune`: an accepted error in, the cheapest proven setting out."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file
from fecloth.quantities.units import TIME
from fecloth.quantities.units import quantity as read_quantity
from fecloth.scene.scene import Scene
from fecloth.simulation.probes import Probe
from fecloth.simulation.quantity import Quantity
from fecloth.study.problems import SceneProblem, open_problem
from fecloth.study.run_problems import Runs
from fecloth.study.tolerance import in_percent, read_tolerance
from fecloth.study.tuning.choices import Choice, methods_to_try, span_of, text_with
from fecloth.study.tuning.fewer_terms import drop_terms
from fecloth.study.tuning.growth import measure_growth
from fecloth.study.tuning.proof import Proof, best_run, prove
from fecloth.study.tuning.reasons import obstacle_of
from fecloth.study.tuning.result import Tuned
from fecloth.study.tuning.run_table import table_of_runs
from fecloth.study.tuning.search import Goal, coarse_meshes, measure_meshes, shared_run
from fecloth.study.tuning.time_errors import measure_methods
from fecloth.study.tuning.timing import time_candidates
from fecloth.study.tuning.trials import Bench, Trial, spent
from fecloth.study.workload import LONGEST

SEARCH = 40.0  # s, CPU time for the runs of all methods
STEPS = 128  # of the runs that compare terms
SHARPER = 100.0  # divides the solver's tolerance in the run that shows its error


def tune(
    problem: Scene | str | Path | Callable,
    tolerance: float | str = 0.01,
    quantity: str | Quantity | Sequence[str | Quantity] | None = None,
    *,
    budget: float | str | None = None,
    model: bool = False,
    methods: Sequence[str] | None = None,
    elements: Sequence[str] | None = None,
    folder: str | Path | None = None,
    h: float | None = None,
    dt: float | None = None,
    t_end: float | None = None,
    probes: Sequence[Probe] = (),
    cache: str | Path | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    time_limit: float | None = None,
    most_seconds: float | None = LONGEST,
    fresh: bool = False,
    **settings: object,
) -> Tuned:
    """Find the cheapest setting of a problem that meets a tolerance, and prove its error.

    Runs on a coarse mesh show the error in time of each method and the seconds that it takes; runs
    on a few meshes with the same steps show the error in space of each element and pattern. From
    these the errors and the seconds of all settings are predicted: element, pattern, h, method and
    dt or rtol. In scenes, meshes that are graded at corners and pins (see `Grading`) are tried
    where they should save 40 % of the triangles. The cheapest setting that should meet the
    tolerance is run. Its error is that by which it differs from a finer run, the best one so far or
    one that is finer in what contributes most, plus the error of that, by its order (grid
    convergence index). Cheaper settings are then tried beside it.

    Parameters
    ----------
    problem
        A scene, its path, or a function as for `converge`. What the function takes as `method` and
        `element` varies as `methods` and `elements` say; h and dt vary always.
    tolerance
        Largest relative error of each quantity, as 0.01 or "1%".
    quantity
        One or more; by default all of [interest], the paths of the probes (in a static scene their
        ends), or the displacement.
    budget
        Longest CPU time of the tuned run, as 60.0 [s] or "60 s". The most accurate setting within
        it is sought in place of the cheapest one; the tolerance is not used.
    model
        Whether terms may be left out or replaced by cheaper ones, if that changes the quantities
        by less than a quarter of the tolerance.
    methods, elements
        Names as in a scene, by default the usual methods with the scene's own, and P1 and P2.
    folder
        Where tuned.toml is written; None for nowhere.
    h, dt, t_end, probes, cache, jobs, scheduler, time_limit, fresh
        As for `converge`.
    most_seconds
        Longest predicted time of a run [s]; longer ones are skipped. None for no limit.

    Raises
    ------
    InputError
        For a tolerance outside 0 to 100 %, an unknown quantity or one of size zero, or an unknown
        name.
    StudyFailed
        If no run on a coarse mesh reaches its end.

    Examples
    --------
    >>> import fecloth as fc
    >>> def strip(h, element="P1"):
    ...     cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="cross", element=element)
    ...     terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
    ...     mass = "lumped" if element == "P1" else "consistent"
    ...     system = fc.System(cloth, fc.Fabric(0.2, 20.0), terms, pins=["left"], mass=mass)
    ...     return cloth, system, None, system.rest()
    >>> tip = [fc.Probe("tip", "right")]
    >>> tuned = fc.tune(strip, "1%", "tip.x", h=0.1, probes=tip, elements=["P1", "P2"])
    >>> print(tuned.proved, tuned.error < 0.01)
    True True
    """
    opened = open_problem(problem, h, dt, t_end, probes, settings)
    goal = _goal(tolerance, budget)
    quantities = opened.choose_quantities(quantity)
    runs = Runs(cache, jobs, scheduler, time_limit, most_seconds, fresh)
    bench = Bench(opened, quantities, runs)
    names = methods_to_try(opened, methods)
    meshes = coarse_meshes(opened, elements)
    other: dict = {}
    dropped: list[str] = []
    before: list[Trial] = []
    if model:
        _say("terms: what they change on a coarse mesh")
        bench, other["model"], dropped, before = _reduce(bench, meshes[0], goal)
    _say("errors in time: all methods on a coarse mesh")
    times = measure_methods(bench, meshes[0], names, goal.scale, SEARCH)
    coarse = shared_run(bench, times, goal.scale)
    bench.check_sizes(coarse)
    _say("errors in space: all meshes with the same steps")
    space, prediction = measure_meshes(bench, meshes, times, coarse, goal)
    search = [*before, *times.trials, *space.trials]
    sharper = _sharper_run(bench, coarse)
    if sharper is not None:
        search.append(sharper)
        other["solver"] = bench.distance(sharper, coarse)
    added = sum((float(one.max()) for one in other.values()), 0.0)
    prediction = replace(prediction, other=added)
    why = obstacle_of(bench, space, prediction, goal, most_seconds)
    found = None
    if not why:
        _say("seconds of the best settings: short runs")
        prediction = measure_growth(bench, prediction, goal, search)
        prediction = time_candidates(bench, prediction, goal, search)
        why = obstacle_of(bench, space, prediction, goal, most_seconds)
    if not why:
        _say("proof: the best setting beside a finer one")
        found = prove(bench, prediction, goal, search, other, space)
        why = found.why if found else "no setting that should meet it ran to its end"
    if found is None:
        found = best_run(bench, space, times, search, other)
    return _summarise(bench, goal, replace(found, why=why), dropped, folder)


def _say(phase: str) -> None:
    print(f"tune: {phase}", file=sys.stderr, flush=True)


def _goal(tolerance: float | str, budget: float | str | None) -> Goal:
    if budget is None:
        return Goal(tolerance=read_tolerance(tolerance))
    seconds = read_quantity("budget", str(budget), TIME) if isinstance(budget, str) else budget
    if not 0 < seconds < math.inf:
        raise InputError(
            f"budget = {budget!r}", 'must be a time > 0, as 60.0 [s] or "60 s"', "tune"
        )
    return Goal(budget=float(seconds))


def _reduce(bench: Bench, mesh: Choice, goal: Goal) -> tuple:
    """Return the problem with fewer terms, its change, the changes in words and all runs."""
    if not isinstance(bench.opened, SceneProblem):
        remedy = "Write a scene file, or compare the models with compare."
        raise InputError("model = True", "needs a scene: it changes its terms", "tune", remedy)
    span = span_of(bench.opened)
    choice = mesh if span is None else replace(mesh, method="bdf2", steps=STEPS)
    return drop_terms(bench, choice, goal.scale)


def _sharper_run(bench: Bench, coarse: Trial) -> Trial | None:
    """Return the coarse run with a sharper tolerance of the solver; None if it has no solver."""
    if coarse.choice.is_explicit:
        return None
    (trial,) = bench.run([replace(coarse.choice, sharper=SHARPER)])
    return trial if trial.is_ok else None


def _summarise(
    bench: Bench, goal: Goal, found: Proof, dropped: Sequence[str], folder: str | Path | None
) -> Tuned:
    """Return the result; write tuned.toml."""
    trial, opened = found.trial, bench.opened
    met = found.error <= goal.tolerance and trial.seconds <= goal.budget
    proved = met and not found.why
    text = text_with(opened, trial.choice) if isinstance(opened, SceneProblem) else ""
    scene = None
    if folder is not None and text:
        scene = Path(folder) / "tuned.toml"
        scene.parent.mkdir(parents=True, exist_ok=True)
        replace_file(scene, text.encode())
    verifying = [found.finer] if found.finer else []
    return Tuned(
        title=opened.name,
        verdict=_verdict(found, goal, proved),
        table=table_of_runs(bench, found),
        error=found.error,
        seconds=trial.seconds,
        predicted=found.candidate.seconds if found.candidate else math.nan,
        proved=proved,
        tolerance=goal.tolerance if math.isfinite(goal.tolerance) else math.nan,
        budget=goal.budget if math.isfinite(goal.budget) else math.nan,
        quantities=tuple(one.text for one in bench.quantities),
        parts={name: float(part.max()) for name, part in found.parts.items()},
        settings=_settings(trial),
        text=text,
        scene=scene,
        search_seconds=spent([one for one in found.search if one not in verifying]),
        remarks=(f"Changed terms: {', '.join(dropped)}.",) if dropped else (),
    )


def _verdict(found: Proof, goal: Goal, proved: bool) -> str:
    """Return the answer in words: proved, or not proved and why, and what can be had."""
    size = "unknown" if math.isnan(found.error) else in_percent(found.error)
    has = f"{found.trial.choice}: estimated error {size}, CPU time {found.trial.seconds:.2g} s"
    timed = math.isfinite(goal.budget)
    allowed = f"{goal.budget:g} s" if timed else in_percent(goal.tolerance)
    if proved:
        return f"proved: {has} (allowed: {allowed})"
    why = found.why or (
        f"it takes longer than {allowed}"
        if timed
        else f"no verified setting has an error below {allowed}"
    )
    return f"not proved: {why}. What can be had: {has}"


def _settings(trial: Trial) -> dict[str, Any]:
    choice, row = trial.choice, trial.row
    values: dict[str, Any] = {"element": row["element"], "pattern": choice.pattern, "h": choice.h}
    values |= {"method": choice.method, "rtol": choice.rtol}
    if math.isfinite(row["step"]):
        values["dt"] = row["step"]
    return {name: value for name, value in values.items() if value}
