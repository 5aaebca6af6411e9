"""Does `fecloth simplify` find what three scenes with known answers need, and what they do not?

Beside each measured change stands the change that the dimensionless numbers of the scene predict.

python -m studies.evidence.simplify [--quick]
fecloth simplify my.toml --tolerance 1%      for a scene of yours
"""

from __future__ import annotations

import math
from itertools import chain
from pathlib import Path

from fecloth import study
from fecloth.scene.scene import Scene, load_scene
from fecloth.study.problem import StudyProblem
from fecloth.study.term_variants import list_variants
from studies import harness
from studies.evidence.simplify.numbers import Numbers, table
from studies.evidence.simplify.predictions import find_limits, predict_change

SCENES = Path(__file__).parents[2] / "scenes" / "needs"
KNOWN = {  # scene: a part that it needs, and one that it does not need
    "taut": ("without Gravity", "without HingeBending"),
    "cantilever": ("without HingeBending", "without Drag"),
    "wind": ("without Wind", "without QuadraticBending"),
}
TOLERANCE = 0.01
RESULTS = ("failed", "refused", "time limit", "no value")  # of a variant that the scene needs


def simplify_scene(name: str, options) -> study.Simplification:
    """Simplify one scene and write its report into a folder of its own."""
    folder = options.out / name
    found = study.simplify(
        SCENES / f"{name}.toml",
        TOLERANCE,
        folder=folder,
        repeats=1 if options.quick else 3,
        cache=options.out,
        jobs=options.jobs,
        scheduler=options.scheduler,
        fresh=options.fresh,
    )
    found.report(folder)
    return found


def predict_changes(scene: Scene) -> dict[str, float]:
    """Return the predicted change [%] by each variant, by its name; without unknown ones."""
    numbers = Numbers.of(scene)
    problem = StudyProblem.of(scene)
    variants = list_variants(problem, problem.quantities)
    sizes = {variant.name: predict_change(variant, numbers) for variant in variants}
    return {name: 100 * size for name, size in sizes.items() if size is not None}


def describe_scene(name: str, found: study.Simplification) -> str:
    """Return the verdict, the dimensionless numbers and the limits of the predictions in words."""
    numbers = Numbers.of(load_scene(SCENES / f"{name}.toml"))
    values = [f"{row['number']} {row['formula']} = {row['value']:.2g}" for row in table(numbers)]
    limits = "".join(f" Beware: {words}." for words in find_limits(numbers))
    return f"{name}: {found.verdict}\n\nNumbers: {'; '.join(values)}.{limits}"


def add_predictions(name: str, found: study.Simplification) -> list[dict]:
    """Return the rows of a scene's table, with the predicted changes."""
    predicted = predict_changes(load_scene(SCENES / f"{name}.toml"))
    return [
        {"scene": name, **row, "predicted [%]": predicted.get(str(row["variant"]))}
        for row in found.table
    ]


def collect_findings(
    name: str, table_rows: list[dict], found: study.Simplification
) -> list[harness.Finding]:
    """Return the change of the reduced scene, and the measured and predicted known parts."""
    rows = {row["variant"]: row for row in table_rows}
    what = f"{name}: change by reduced.toml"
    findings = [harness.Finding(what, found.change, high=found.tolerance)]
    findings.append(harness.Finding(f"{name}: part of the seconds saved", found.saved))
    needed, needless = (rows[variant] for variant in KNOWN[name])
    for key in ("predicted [%]", "change [%]"):
        limit = 100 * found.tolerance
        what = f"{name}, {{}}: {key}".format
        change = math.inf if needed[key] is None else needed[key]  # None: its run failed
        findings.append(harness.Finding(what(needed["variant"]), change, limit))
        findings.append(harness.Finding(what(needless["variant"]), needless[key], high=limit))
    return findings


def main() -> int:
    options = harness.parse_arguments(__doc__)
    names = ("wind",) if options.quick else KNOWN
    done = {name: simplify_scene(name, options) for name in names}
    rows = {name: add_predictions(name, found) for name, found in done.items()}
    return harness.write_report(
        options,
        "Simplification of three scenes",
        list(chain.from_iterable(rows.values())),
        figures=[f"{name}/figure" for name in done],
        findings=[
            finding for name in names for finding in collect_findings(name, rows[name], done[name])
        ],
        conclusion="\n\n".join(describe_scene(name, found) for name, found in done.items()),
        results=RESULTS,
    )


if __name__ == "__main__":
    harness.run_main(main)
