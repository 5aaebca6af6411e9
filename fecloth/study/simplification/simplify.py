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
from fecloth.study.change import FIRST_LEVEL, Change, Level
from fecloth.study.opened import Opened, open_study
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.refinement import RTOL_ORDER
from fecloth.study.result import read_tolerance
from fecloth.study.run_problems import Runs, print_warnings, refuse_huge
from fecloth.study.sensitivities import describe_weak_terms
from fecloth.study.simplification import result
from fecloth.study.simplification.outcome import (
    NOISE_PART,
    NOISE_SECONDS,
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
        Arguments of `fecloth.study.of`, as probes, jobs and cache. Seconds of cases that run
        side by side are less certain.

    Raises
    ------
    InputError
        For a tolerance outside 0 to 100 %, an unknown quantity, a function as quantity, or too
        long a time.
    StudyFailed
        If the scene itself fails.
    """
    largest_change = read_tolerance(tolerance)
    study = open_study(problem, shared)
    opened = study.problem
    runs = replace(study.runs(), timed=True, repeats=repeats)
    original = open_original(opened, quantity, largest_change, runs)
    weak_terms = describe_weak_terms(
        original.problem, original.quantities, largest_change, replace(runs, timed=False)
    )
    if weak_terms:
        print(weak_terms, file=sys.stderr, flush=True)
    variants = original.list_variants()
    at_once = 1 if runs.scheduler else runs.jobs
    check_size(_sizes(opened, variants), at_once, runs.most_seconds, opened.source)
    checks = original.try_variants([variant for variant in variants if variant.is_check])
    orders = {}
    for quantity in original.quantities:
        order_in_h, order_in_dt = opened.orders(quantity)
        orders[quantity.text] = {"mesh": order_in_h, "dt": order_in_dt, "rtol": RTOL_ORDER}
    resolutions = find_resolutions(checks, orders, largest_change)
    for resolution in resolutions:
        print(resolution, file=sys.stderr, flush=True)
    others = original.try_variants([variant for variant in variants if not variant.is_check])
    findings = Findings(checks + others, largest_change, resolutions)
    return summarise(original, findings, folder, weak_terms)


def open_original(opened: Problem, quantity: Any, tolerance: float, runs: Runs) -> Original:
    """Return the problem with the quantities that count, and how it is run; print its warnings.

    The reduced scene gets these quantities as its [interest]. Raise `InputError` if the problem
    is predicted to take too long, for an unknown quantity, and for a function as quantity, which
    no scene can hold.
    """
    refuse_huge(opened, runs)
    print_warnings(opened)
    quantities = opened.choose_quantities(quantity)
    if any(quantity.function for quantity in quantities):
        raise InputError("a function as quantity", "must be a text, as 'max tip.z'")
    if isinstance(opened, SceneProblem):
        interest = Interest(quantities=tuple(quantity.text for quantity in quantities))
        scene = opened.scene.model_copy(update={"interest": interest})
        opened = replace(opened, scene=scene)
    return Original(opened, quantities, tolerance, runs)


def _sizes(opened: Problem, variants: Sequence[Variant]) -> list[Workload]:
    """Return the predicted sizes of all runs: about half of the variants are combined."""
    checks = sorted({variant.kind for variant in variants if variant.is_check})
    levels = {"dt": Level(dt=2.0), "rtol": FIRST_LEVEL, "mesh": Level(h=2.0)}
    alone = 1 + len(variants) - len(checks)  # the scene, and all variants that are no checks
    combined = len(variants) // 2
    usual = [opened.workload(FIRST_LEVEL)] * (alone + combined)
    return usual + [opened.workload(levels[kind]) for kind in checks]


def combine_variants(
    original: Original, candidates: Sequence[Variant]
) -> tuple[Change, list[tuple[Outcome, bool]]]:
    """Take one candidate after the other, as long as the combination changes little.

    Each attempt is a run of all variants taken so far with one more. The new one is taken if the
    change is within the tolerance and the run is not too slow, see `_allowed_seconds`. It takes
    the place of an earlier change of the same part, unless that left out a term.

    Return the change by all variants that are taken, and the attempts: pairs of the outcome of a
    run, and whether its last variant was taken.
    """
    taken: dict[str, Variant] = {}  # by slot: at most one change of each part
    seconds = original.full["cpu_seconds"]
    attempts = []
    for variant in candidates:
        before = taken.get(variant.slot)
        if before and before.kind == "without":
            continue
        combination = {**taken, variant.slot: variant}
        name = " + ".join(part.name for part in combination.values())
        outcome = original.run_one(name, changes_of(combination.values()))
        allowed_seconds = _allowed_seconds(variant, before, seconds)
        is_fast_enough = outcome.seconds <= allowed_seconds
        is_taken = outcome.change <= original.tolerance and is_fast_enough
        attempts.append((outcome, is_taken))
        if is_taken:
            taken = combination
            seconds = outcome.seconds
    return changes_of(taken.values()), attempts


def _allowed_seconds(variant: Variant, before: Variant | None, seconds: float) -> float:
    """Return the seconds that a combination may take; without the variant it takes `seconds`.

    A dropped term need not save time, nor need the first change of a part. A change in place of
    another one must save some.
    """
    if variant.kind == "without":
        return (1 + NOISE_PART) * seconds + NOISE_SECONDS
    if before is None:
        return (1 + NOISE_PART) * seconds
    return (1 - NOISE_PART) * seconds


def summarise(
    original: Original, findings: Findings, folder: str | Path | None, weak_terms: str
) -> result.Simplification:
    """Combine the variants, run the reduced scene once more, and return the result.

    The reduced scene is written in `folder`, if that is not None. `weak_terms` is a sentence on
    terms that change little, or "".
    """
    change, attempts = combine_variants(original, findings.candidates())
    taken = [outcome.name for outcome, is_taken in attempts if is_taken]
    tables = original.problem.tables
    file = "reduced.toml" if original.is_scene else "reduced.txt"
    text = original.text(change.apply(tables))
    final = None
    name_of_combination = ""
    if taken:
        final = original.run_one(file, change, fresh=True)
        name_of_combination = taken[-1]  # each attempt has the names of all before it
    name_of_file = "the reduced scene" if folder is None else file
    sentences = [words for words in (weak_terms, original.weak_friction) if words]
    simplification = result.Simplification(
        title=original.problem.name,
        doubts=original.problem.doubts,
        verdict=result.make_verdict(findings, name_of_combination, final, name_of_file),
        table=result.make_table(findings, attempts, final),
        tolerance=original.tolerance,
        quantities=tuple(quantity.text for quantity in original.quantities),
        resolved=not findings.unresolved,
        reduced=text,
        file=file,
        change=final.change if final else 0.0,
        saved=final.saved if final else 0.0,
        remarks=(
            *(f"{words[0].upper()}{words[1:]}." for words in sentences),
            *result.describe_resolved(findings.resolutions, "h" in tables["cloth"]),
        ),
    )
    return replace(simplification, scene=simplification.write_scene(folder))
