"""`simplify`: find what a scene does not need, and write the reduced scene."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.scene.probe_tables import Interest
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.study.change import FIRST, Change, Level
from fecloth.study.opened import Opened, open_study
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.refinement import RTOL_ORDER
from fecloth.study.result import read_tolerance
from fecloth.study.run_problems import Runs, print_warnings, refuse_huge
from fecloth.study.sensitivities import describe_weak_terms
from fecloth.study.simplification import result
from fecloth.study.simplification.outcome import (
    LOST,
    NOISE,
    SIZES,
    Findings,
    Outcome,
    find_resolutions,
)
from fecloth.study.simplification.runs import Original
from fecloth.study.simplification.variants import Variant, changes_of
from fecloth.study.workload import Workload, check_size


def simplify(
    problem: Scene | str | Path | Callable | Opened,
    tolerance: float | str = 0.01,
    quantity: str | Quantity | Sequence[str | Quantity] | None = None,
    *,
    folder: str | Path | None = None,
    repeats: int = 3,
    **shared: Any,
) -> result.Simplification:
    """Find the parts of a scene that change its quantities by less than a tolerance; drop them.

    First half of h and half of dt (or a quarter of rtol) show whether the scene itself is
    resolved. Then each term is left out or replaced by a cheaper one, and resolved triangles
    and steps become larger. Changes below the tolerance are combined, the greatest saving per
    change first, as long as the combination stays below the tolerance. The reduced scene is
    run once more.

    Parameters
    ----------
    problem
        As for `of`. The terms of a function's system, its h and its dt are varied, not its
        method.
    tolerance
        Largest relative change of each quantity, as 0.01 or "1%".
    quantity
        One or more; by default all of [interest], the paths of the probes (in a static scene
        their ends), or the displacement.
    folder
        Where reduced.toml is written, for a function a text; None for nowhere.
    repeats
        Runs of each scene of less than about a second; the fastest counts.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache.
        Seconds of cases that run side by side are less certain.

    Raises
    ------
    InputError
        For a tolerance outside 0 to 100 %, an unknown quantity, a function as quantity, or too
        long a time.
    StudyFailed
        If the scene itself fails.
    """
    chosen = read_tolerance(tolerance)
    study = open_study(problem, shared)
    opened = study.problem
    runs = replace(study.runs(), timed=True, repeats=repeats)
    original = open_original(opened, quantity, chosen, runs)
    given = original.problem, original.quantities, chosen, replace(runs, timed=False)
    if weak := describe_weak_terms(*given):
        print(weak, file=sys.stderr, flush=True)
    tried = original.list_variants()
    at_once = 1 if runs.scheduler else runs.jobs
    check_size(_sizes(opened, tried), at_once, runs.most_seconds, opened.source)
    checks = original.try_variants([variant for variant in tried if variant.is_check])
    orders = {
        quantity.text: dict(zip(SIZES, (*opened.orders(quantity), RTOL_ORDER), strict=True))
        for quantity in original.quantities
    }
    resolutions = find_resolutions(checks, orders, chosen)
    for resolution in resolutions:
        print(resolution, file=sys.stderr, flush=True)
    others = original.try_variants([variant for variant in tried if not variant.is_check])
    return summarise(original, Findings(checks + others, chosen, resolutions), folder, weak)


def open_original(opened: Problem, quantity, tolerance: float, runs: Runs) -> Original:
    """Return the problem with the quantities that count, and how it is run."""
    refuse_huge(opened, runs)
    print_warnings(opened)
    chosen = opened.choose_quantities(quantity)
    if any(quantity.function for quantity in chosen):
        raise InputError("a function as quantity", "must be a text, as 'max tip.z'")
    if isinstance(opened, SceneProblem):
        interest = Interest(quantities=tuple(quantity.text for quantity in chosen))
        opened = replace(opened, scene=opened.scene.model_copy(update={"interest": interest}))
    return Original(opened, chosen, tolerance, runs)


def _sizes(opened: Problem, tried: Sequence[Variant]) -> list[Workload]:
    """Return the predicted sizes of all runs: about half of the variants are combined."""
    checks = {variant.kind for variant in tried if variant.is_check}
    finer = {"dt": Level(dt=2.0), "rtol": FIRST, "mesh": Level(h=2.0)}
    usual = [opened.workload(FIRST)] * (1 + len(tried) - len(checks) + len(tried) // 2)
    return [*usual, *(opened.workload(finer[kind]) for kind in sorted(checks))]


def combine_variants(
    original: Original, candidates: Sequence[Variant]
) -> tuple[Change, list[tuple[Outcome, bool]]]:
    """Combine variants greedily; return the change of all that are taken, and all attempts.

    Of two changes to the same part the later one wins if it saves more or drops a term. An
    attempt is a run, and whether it was taken.
    """
    chosen: dict[str, Variant] = {}
    seconds = original.full["cpu_seconds"]
    attempts = []
    for variant in candidates:
        before = chosen.get(variant.slot)
        drops = variant.kind == "without"
        if before and before.kind == "without":
            continue
        trial = {**chosen, variant.slot: variant}
        name = " + ".join(each.name for each in trial.values())
        outcome = original.run_one(name, changes_of(trial.values()))
        most = (1 + LOST if drops or not before else 1 - LOST) * seconds + NOISE * drops
        fits = outcome.change <= original.tolerance and outcome.seconds <= most
        attempts.append((outcome, fits))
        if fits:
            chosen = trial
            seconds = outcome.seconds
    return changes_of(chosen.values()), attempts


def summarise(
    original: Original, findings: Findings, folder: str | Path | None, weak: str
) -> result.Simplification:
    """Combine the variants, run the reduced scene, and return the result."""
    change, attempts = combine_variants(original, findings.candidates())
    taken = [outcome.name for outcome, fits in attempts if fits]
    tables = original.problem.tables
    file = f"reduced.{'toml' if original.is_scene else 'txt'}"
    text = original.text(change.apply(tables))
    final = original.run_one(file, change, fresh=True) if taken else None
    name = "the reduced scene" if folder is None else file
    simplification = result.Simplification(
        title=original.problem.name,
        doubts=original.problem.doubts,
        verdict=result.make_verdict(findings, taken[-1] if taken else "", final, name),
        table=result.make_table(findings, attempts, final),
        tolerance=original.tolerance,
        quantities=tuple(quantity.text for quantity in original.quantities),
        resolved=not findings.unresolved,
        reduced=text,
        file=file,
        change=final.change if final else 0.0,
        saved=final.saved if final else 0.0,
        remarks=(
            *(f"{each[0].upper()}{each[1:]}." for each in (weak, original.weak_friction) if each),
            *result.describe_resolved(findings.resolutions, "h" in tables["cloth"]),
        ),
    )
    return replace(simplification, scene=simplification.write_scene(folder))
