"""Simplify a scene: find the parts that change its result by less than a tolerance; drop them.

Dimensionless numbers predict the effect of each part. Then the study drops each term or replaces
it by a cheaper one, coarsens the mesh and the steps, runs each of these scenes, and compares it
with the full one in the quantities of its table [interest]; without that table, in the paths of
its probes, or else in the displacements at the end. Changes below the tolerance are combined, the
greatest saving per change first, as long as the combination stays below the tolerance.
OUT/reduced.toml is the resulting scene; it is run once more. Half of h and half of dt show whether
the scene itself is resolved within the tolerance.

    python -m studies.simplify --scene my.toml --tolerance 1% [--jobs N] [--out DIR]
    python -m studies.simplify [--quick]      three scenes with known answers
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from fecloth import study
from fecloth.scene.scene import load_scene
from fecloth.study.simplification.cases import data_of, interest_of
from fecloth.study.simplification.dimensionless import Numbers
from fecloth.study.simplification.dimensionless import table as table_of_numbers
from fecloth.study.simplification.report import (
    KNOWN,
    collect_findings,
    describe_result,
    draw_chart,
    format_row,
    rank_variants,
)
from fecloth.study.simplification.search import (
    combine_variants,
    run_each_variant,
    run_reduced_scene,
)
from fecloth.study.simplification.task import Task
from fecloth.study.simplification.variants import variants

SCENES = Path(__file__).parents[1] / "scenes" / "needs"
RESULTS = ("failed", "refused", "time limit")  # of a variant: a scene that needs the part


@dataclass(frozen=True)
class Simplified:
    """What the study found out about one scene, and its exit status."""

    findings: list
    conclusion: str
    rows: list
    status: int


def simplify_scene(task: Task) -> Simplified:
    """Simplify one scene and write its report."""
    found = run_each_variant(task)
    data, attempts = combine_variants(task, found)
    final = run_reduced_scene(task, data) | {"variant": "reduced.toml"}
    table = rank_variants(task, found)
    names = [line["variant"] for line in attempts if line["taken"] == "yes"]
    conclusion = describe_result(task, found, names[-1] if names else "", final)
    print("\n".join(map(format_row, table)))
    findings, rows = collect_findings(task, found, final), [line for _, line in found]
    status = study.write_report(
        task.options,
        f"Simplification of {task.name}",
        rows,
        tables={
            "Numbers": table_of_numbers(Numbers.of(task.scene)),
            "One change at a time": table,
            "Changes together": [*attempts, final],
        },
        figures=[draw_chart(task, found, final)],
        findings=() if task.known else findings,  # the report of all three scenes has them
        conclusion=conclusion,
        settings={"interest": task.interest.model_dump()},
        results=RESULTS,
    )
    return Simplified(findings, conclusion, rows, status)


def parse_tolerance(text: str) -> float:
    """Read a tolerance such as 1% or 0.01."""
    value = float(text.rstrip("% ")) / (100 if "%" in text else 1)
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must lie between 0 and 100 %")
    return value


def main() -> int:
    tolerance = {"type": parse_tolerance, "default": "1%", "help": "largest change (1%%)"}
    options = study.parse_arguments(__doc__, needs=["matplotlib"], tolerance=tolerance)
    if options.scene:
        check_size(options)
        return simplify_scene(Task.of(options.scene, options)).status
    paths = [SCENES / f"{name}.toml" for name in KNOWN]
    done = {path.stem: simplify_scene(Task.of(path, options)) for path in paths}
    return study.write_report(
        options,
        "Simplification of three scenes",
        [row for one in done.values() for row in one.rows],
        figures=[f"{name}/needs" for name in done],
        findings=[finding for one in done.values() for finding in one.findings],
        conclusion="\n\n".join(f"[{n}]({n}/report.md): {d.conclusion}" for n, d in done.items()),
        results=RESULTS,
    )


def check_size(options: argparse.Namespace) -> None:
    """Print the size of the study of a user's scene; refuse it if it is too long."""
    scene = load_scene(options.scene)
    tried = variants(data_of(scene), interest_of(scene))
    finer = [variant.name for variant in tried if variant.is_check]
    combined = len(tried) // 2  # about as many combinations
    sizes = [study.Workload.of(scene)] * (len(tried) - len(finer) + combined)
    if "dt × 0.5" in finer:
        sizes.append(study.Workload.of(scene, dt=scene.time.dt / 2))
    if "h × 0.5" in finer:
        sizes.append(study.Workload.of(scene, refined=2))
    study.check_scene(sizes, options)


if __name__ == "__main__":
    study.run_main(main)
