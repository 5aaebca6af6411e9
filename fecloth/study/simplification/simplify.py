"""`simplify`: find what a scene does not need, and write the reduced scene."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file
from fecloth.scene.probe_tables import Interest
from fecloth.scene.scene import Scene
from fecloth.scene.toml_text import to_toml
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.quantity import Quantity
from fecloth.study.problems import SceneProblem, open_problem
from fecloth.study.refinement import RTOL_ORDER
from fecloth.study.run_problems import Runs, refuse_huge
from fecloth.study.simplification.numbers import Numbers
from fecloth.study.simplification.numbers import table as table_of_numbers
from fecloth.study.simplification.outcome import Trial
from fecloth.study.simplification.predictions import find_limits, predict_change
from fecloth.study.simplification.resolution import Resolution, find_resolutions
from fecloth.study.simplification.result import Simplification
from fecloth.study.simplification.runs import Original, data_of
from fecloth.study.simplification.search import combine_variants, sort_candidates
from fecloth.study.simplification.variants import Variant, list_variants
from fecloth.study.simplification.words import (
    describe_predictions,
    describe_resolved,
    make_table,
    make_verdict,
)
from fecloth.study.tables import Table
from fecloth.study.tolerance import read_tolerance
from fecloth.study.workload import LONGEST, Workload, check_size


def simplify(
    problem: Scene | str | Path,
    tolerance: float | str = 0.01,
    quantity: str | Quantity | Sequence[str | Quantity] | None = None,
    *,
    folder: str | Path | None = None,
    repeats: int = 3,
    cache: str | Path | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    time_limit: float | None = None,
    most_seconds: float | None = LONGEST,
    fresh: bool = False,
) -> Simplification:
    """Find the parts of a scene that change its quantities by less than a tolerance; drop them.

    First half of h and half of dt (or a quarter of rtol) show whether the scene itself is resolved.
    Then each term is left out or replaced by a cheaper one, triangles and steps become larger, and
    each of these scenes is run. Changes below the tolerance are combined, the greatest saving per
    change first, as long as the combination stays below the tolerance. The reduced scene is run
    once more. Sizes that are not resolved stay as they are.

    Parameters
    ----------
    problem
        A scene, or its path.
    tolerance
        Largest relative change of each quantity, as 0.01 or "1%".
    quantity
        One or more; by default all of [interest], the paths of the probes (in a static scene their
        ends), or the displacement.
    folder
        Where reduced.toml is written; None for nowhere.
    repeats
        Runs of each scene of less than about a second, of which the fastest counts.
    cache, jobs, scheduler, time_limit, most_seconds, fresh
        As for `converge`. Seconds of cases that run side by side are less certain.

    Raises
    ------
    InputError
        For a problem that is no scene, a tolerance outside 0 to 100 %, an unknown quantity, or too
        long a time.
    StudyFailed
        If the scene itself fails.

    Examples
    --------
    >>> import fecloth as fc
    >>> found = fc.study.simplify("flag.toml", "1%", folder="out")  # doctest: +SKIP
    >>> print(found.verdict)  # doctest: +SKIP
    """
    chosen = read_tolerance(tolerance)
    runs = Runs(cache, jobs, scheduler, time_limit, most_seconds, fresh)
    opened, interest = open_scene(problem, quantity, runs)
    original = Original(opened, interest.all, chosen, runs, repeats)
    tried = list_variants(original.data, interest)
    check_size(_sizes(opened.scene, tried), 1 if scheduler else jobs, most_seconds, opened.name)
    numbers = Numbers.of(opened.scene)
    checks = run_variants(original, [one for one in tried if one.is_check], numbers)
    resolutions = find_resolutions(checks, _sizes_now(original.data), _orders(original), chosen)
    for one in resolutions:
        print(one, file=sys.stderr, flush=True)
    found = checks + run_variants(original, [one for one in tried if not one.is_check], numbers)
    return summarise(original, found, resolutions, numbers, folder)


def open_scene(problem: object, quantity, runs: Runs) -> tuple[SceneProblem, Interest]:
    """Return the problem of a scene, and its [interest]: the quantities that count.

    Raises
    ------
    InputError
        For a function, and for quantities that cannot be compared between scenes.
    """
    if not isinstance(problem, Scene | str | Path):
        remedy = "Write a scene file; simplify drops its tables."
        raise InputError(f"problem = {problem!r}", "must be a scene or its path", "", remedy)
    opened = open_problem(problem)
    assert isinstance(opened, SceneProblem)
    refuse_huge(opened, runs)
    chosen = opened.choose_quantities(quantity)
    if any(one.function for one in chosen):
        raise InputError("a function as quantity", "must be a text, as 'max tip.z'")
    interest = Interest(quantities=tuple(one.text for one in chosen))
    scene = opened.scene.model_copy(update={"interest": interest})
    return replace(opened, scene=scene), interest


def _sizes(scene: Scene, tried: Sequence[Variant]) -> list[Workload]:
    """Return the predicted sizes of all runs: about half of the variants are combined."""
    checks = {one.kind for one in tried if one.is_check}
    sizes = [Workload.of(scene)] * (1 + len(tried) - len(checks) + len(tried) // 2)
    if "dt" in checks:
        sizes.append(Workload.of(scene, dt=float(scene.time.dt) / 2))
    if "rtol" in checks:
        sizes.append(Workload.of(scene))
    if "mesh" in checks:
        sizes.append(Workload.of(scene, refined=2))
    return sizes


def _sizes_now(data: dict) -> dict[str, float]:
    time = data.get("time", {})
    return {
        "mesh": data["cloth"].get("h", 0.0),
        "dt": time.get("dt", 0.0),
        "rtol": time.get("rtol", Adaptive.rtol),
    }


def _orders(original: Original) -> dict[str, dict[str, float]]:
    """Return the theoretical orders of each quantity in h, dt and rtol."""
    both = {one.text: original.problem.orders(one) for one in original.quantities}
    return {
        "mesh": {text: orders[0] for text, orders in both.items()},
        "dt": {text: orders[1] for text, orders in both.items()},
        "rtol": dict.fromkeys(both, RTOL_ORDER),
    }


def run_variants(original: Original, tried: Sequence[Variant], numbers: Numbers) -> list[Trial]:
    """Run each variant alone; return it with what its run gave and its prediction."""
    scenes = [(one.name, one.apply(original.data), one.patience) for one in tried]
    return [
        (variant, replace(outcome, predicted=predict_change(variant, numbers)))
        for variant, outcome in zip(tried, original.run(scenes), strict=True)
    ]


def summarise(
    original: Original,
    found: list[Trial],
    resolutions: list[Resolution],
    numbers: Numbers,
    folder: str | Path | None,
) -> Simplification:
    """Combine the variants, run the reduced scene, and return the result."""
    chosen = original.tolerance
    unresolved = {one.kind for one in resolutions if not one.is_resolved}
    data, attempts = combine_variants(original, sort_candidates(found, chosen, unresolved))
    taken = [outcome.name for outcome, fits in attempts if fits]
    text = to_toml(data)
    final = None
    if taken:  # read from its text, as the user will
        final = original.run_one("reduced.toml", data_of(original.read(text)), fresh=True)
    if folder is not None:
        Path(folder).mkdir(parents=True, exist_ok=True)
        replace_file(Path(folder) / "reduced.toml", text.encode())
    has_h = "h" in original.data["cloth"]
    return Simplification(
        title=original.name,
        verdict=make_verdict(found, chosen, resolutions, taken[-1] if taken else "", final),
        table=make_table(found, chosen, unresolved, attempts, final),
        tolerance=chosen,
        quantities=tuple(one.text for one in original.quantities),
        resolved=not unresolved,
        scene=None if folder is None else Path(folder) / "reduced.toml",
        reduced=text,
        change=final.change if final else 0.0,
        saved=final.saved if final else 0.0,
        numbers=Table(tuple(table_of_numbers(numbers))),
        remarks=(
            *describe_resolved(resolutions, has_h),
            describe_predictions(found, chosen, find_limits(numbers)),
        ),
    )
