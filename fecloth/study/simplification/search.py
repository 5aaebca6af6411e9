"""Search for the simplest scene: each variant alone, then the useful ones combined."""

from __future__ import annotations

import math

from fecloth import study
from fecloth.output.atomic_files import replace_file
from fecloth.scene.scene import load_scene
from fecloth.scene.toml_text import to_toml
from fecloth.study.simplification.cases import answer, data_of
from fecloth.study.simplification.dimensionless import Numbers
from fecloth.study.simplification.predictions import predict_change
from fecloth.study.simplification.task import Task
from fecloth.study.simplification.variants import Variant, variants

LOST = 0.05  # fraction of the seconds; smaller differences are noise


def run_each_variant(task: Task) -> list[tuple[Variant, dict]]:
    """Run each variant alone; return it with its row and prediction."""
    tried = variants(task.data, task.interest)
    cases = [
        task.limited_case(one.name, one.apply(task.data), one.static, one.patience) for one in tried
    ]
    numbers = Numbers.of(task.scene)
    found = []
    for variant, row in zip(tried, task.run(cases), strict=True):
        line = task.compare(row)
        found.append((variant, {"predicted": predict_change(variant, numbers)} | line))
    return found


def saving_per_change(line: dict) -> float:
    """Return the saving per change, by which variants are sorted; without saving it is ≤ 0."""
    return line["saved"] / max(line["change"], 1e-12) if line["saved"] > 0 else line["saved"]


def sort_candidates(task: Task, found: list[tuple[Variant, dict]]) -> list[Variant]:
    """Return the variants within the tolerance, the greatest saving per change first.

    A replacement must save time; a dropped term need not. A variant must be a scene: equilibria
    are not. Larger triangles and steps are candidates only if the scene itself is resolved.
    """
    able = [
        (variant, line)
        for variant, line in found
        if line["status"] == "ok"
        and not (variant.static or variant.is_check)
        and reliable_change(variant, found) <= task.tolerance
        and line["saved"] > (-LOST if variant.kind == "without" else LOST)
    ]
    return [variant for variant, _ in sorted(able, key=lambda pair: -saving_per_change(pair[1]))]


def reliable_change(variant: Variant, found: list[tuple[Variant, dict]]) -> float:
    """Return the largest change by a variant and by the smaller changes of the same size.

    A mesh of 2 h that changes less than one of 1.5 h, or than one of h / 2, does so by chance.
    """
    same = [
        line
        for other, line in found
        if other is variant
        or (other.is_size and other.kind == variant.kind and other.by <= variant.by)
    ]
    return max(line["change"] if line["status"] == "ok" else math.inf for line in same)


def unresolved_sizes(task: Task, found: list[tuple[Variant, dict]]) -> list[dict]:
    """Return the rows of the refinements that change more than the tolerance, or that failed."""
    checks = [line for variant, line in found if variant.is_check]
    return [line for line in checks if line["status"] != "ok" or line["change"] > task.tolerance]


def combine_variants(task: Task, found: list[tuple[Variant, dict]]) -> tuple[dict, list[dict]]:
    """Combine variants greedily; return the tables of the final scene and the rows of all attempts.

    Of two changes to the same part the later one wins if it saves more or drops a term.
    """
    chosen: dict[str, Variant] = {}
    data, seconds, rows = task.data, task.full.row["cpu_seconds"], []
    for variant in sort_candidates(task, found):
        before = chosen.get(variant.slot)
        if before and before.kind == "without":
            continue
        trial = {**chosen, variant.slot: variant}
        simpler = task.data
        for one in trial.values():
            simpler = one.apply(simpler)
        names = " + ".join(one.name for one in trial.values())
        line = task.compare(task.run([task.limited_case(names, simpler)])[0])
        fits = line["status"] == "ok" and line["change"] <= task.tolerance
        out = 1 + LOST if variant.kind == "without" or not before else 1 - LOST
        fits = fits and line["cpu_seconds"] <= out * seconds
        rows.append({**line, "taken": "yes" if fits else "no"})
        if fits:
            chosen, data, seconds = trial, simpler, line["cpu_seconds"]
    return data, rows


def run_reduced_scene(task: Task, data: dict) -> dict:
    """Write reduced.toml, run that file, and compare it with the full scene."""
    path = task.options.out / "reduced.toml"
    replace_file(path, to_toml(data).encode())
    case = task.case("reduced.toml", data_of(load_scene(path)))
    (row,) = study.run_cases([case], answer, **task.run_options | {"fresh": True})
    return task.compare(row)
