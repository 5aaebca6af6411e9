"""Simplify a scene: find the parts that change its result by less than a tolerance; drop them.

Dimensionless numbers predict the effect of each part. Then the study drops each term or replaces
it by a cheaper one, coarsens the mesh and the steps, runs each of these scenes, and compares it
with the full one in the quantities of its table [interest]; without that table, in the paths of
its probes, or else in the displacements at the end. Changes below the tolerance are combined, the
greatest saving per change first, as long as the combination stays below the tolerance.
OUT/reduced.toml is the resulting scene; it is run once more.

    python -m studies.simplify --scene my.toml --tolerance 1% [--jobs N] [--out DIR]
    python -m studies.simplify [--quick]      three scenes with known answers
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from fecloth import study
from fecloth.errors import FeclothError
from fecloth.output.atomic_files import replace_file
from fecloth.scene.scene import load_scene
from fecloth.scene.toml_text import to_toml
from studies.simplify.cases import COUNTED, Answer, answer, changes, data_of, interest_of, scene_of
from studies.simplify.dimensionless import Numbers
from studies.simplify.dimensionless import table as table_of_numbers
from studies.simplify.predictions import predict_change
from studies.simplify.variants import Variant, variants

SCENES = Path(__file__).parents[1] / "scenes" / "needs"
KNOWN = {  # scene: a part that it needs, and one that it does not need
    "taut": ("without Gravity", "without HingeBending"),
    "cantilever": ("without HingeBending", "without Drag"),
    "wind": ("without Wind", "without QuadraticBending"),
}
PATIENCE = 3  # times the seconds of the full scene; a slower variant saves nothing
LOST = 0.05  # fraction of the seconds; smaller differences are noise


@dataclass(frozen=True, eq=False)
class Task:
    """A scene to simplify, with the result of the full scene and the options of its runs."""

    name: str
    data: dict
    tolerance: float
    run_options: dict
    repeats: int = 3
    known: bool = False

    @classmethod
    def of(cls, path: Path, options: argparse.Namespace) -> Task:
        data = data_of(load_scene(path))
        out = options.out if options.scene else options.out / path.stem
        run_options = study.run_options(options) | {"out": out}
        repeats, known = 1 if options.quick else 3, not options.scene
        return cls(path.stem, data, options.tolerance, run_options, repeats, known)

    @cached_property
    def text(self) -> str:
        return to_toml(self.data)

    @cached_property
    def scene(self):
        return scene_of(self.text)

    @cached_property
    def interest(self):
        return interest_of(self.scene)

    @cached_property
    def full(self) -> Answer:
        (row,) = self.run([self.case("full", self.data)])
        if row["status"] != "ok":
            raise SystemExit(f"the full scene fails: {row['cause']}")
        return Answer.of(row)

    def case(self, name: str, data: dict, static: bool = False) -> dict:
        settings = {"scene": self.name, "variant": name, "text": to_toml(data)}
        return settings | {"static": static, "repeats": self.repeats}

    def run(self, cases: list[dict]) -> list[dict]:
        return study.run_cases(cases, answer, **self.run_options)

    def simpler_case(self, name: str, data: dict, static: bool = False) -> dict:
        """Return the case of a variant, limited to `PATIENCE` times the full scene's seconds."""
        most = math.ceil(1 + PATIENCE * self.full.row["cpu_seconds"])
        return self.case(name, data, static) | {"most": most}

    def compare(self, row: dict) -> dict:
        """Return a row's change and saving against the full scene, or the cause of a failure."""
        line = {key: row.get(key) for key in ("scene", "variant", "status")}
        if row["status"] == "ok":
            try:
                each = changes(self.full, Answer.of(row), self.interest)
            except FeclothError as error:
                return line | {"status": "failed", "cause": str(error)}
            line |= {"change": max(each.values()), "of": max(each, key=each.get)}
            line["saved"] = 1 - row["cpu_seconds"] / self.full.row["cpu_seconds"]
            counts = ("cpu_seconds", "triangles", "steps", *COUNTED)
            line |= {name: row.get(name) for name in counts}
        return line | {"cause": row["cause"]}


def run_each_variant(task: Task) -> list[tuple[Variant, dict]]:
    """Run each variant alone; return it with its row and prediction."""
    tried = variants(task.data, task.interest)
    cases = [task.simpler_case(one.name, one.apply(task.data), one.static) for one in tried]
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
    are not.
    """
    able = [
        (variant, line)
        for variant, line in found
        if line["status"] == "ok"
        and not variant.static
        and line["change"] <= task.tolerance
        and line["saved"] > (-LOST if variant.kind == "without" else LOST)
    ]
    return [variant for variant, _ in sorted(able, key=lambda pair: -saving_per_change(pair[1]))]


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
        line = task.compare(task.run([task.simpler_case(names, simpler)])[0])
        fits = line["status"] == "ok" and line["change"] <= task.tolerance
        out = 1 + LOST if variant.kind == "without" or not before else 1 - LOST
        fits = fits and line["cpu_seconds"] <= out * seconds
        rows.append({**line, "taken": "yes" if fits else "no"})
        if fits:
            chosen, data, seconds = trial, simpler, line["cpu_seconds"]
    return data, rows


def run_reduced_scene(task: Task, data: dict) -> dict:
    """Write reduced.toml, run that file, and compare it with the full scene."""
    path = task.run_options["out"] / "reduced.toml"
    replace_file(path, to_toml(data).encode())
    case = task.case("reduced.toml", data_of(load_scene(path)))
    (row,) = study.run_cases([case], answer, **task.run_options | {"fresh": True})
    return task.compare(row)


def rank_variants(task: Task, found: list[tuple[Variant, dict]]) -> list[dict]:
    """Return a table of the variants, sorted by their change, each with a verdict."""
    table = []
    for _, line in found:
        good = line["status"] == "ok"
        verdict = "needed" if not good or line["change"] > task.tolerance else "can go"
        if verdict == "can go" and line["saved"] <= -LOST:
            verdict = "can go, saves nothing"
        short = {name: line.get(name) for name in ("variant", "predicted", "change", "of", "saved")}
        counts = {name: line.get(name) for name in ("triangles", "steps", *COUNTED)}
        short |= {"verdict": verdict if good else line["status"], "CPU s": line.get("cpu_seconds")}
        table.append(short | counts)
    return sorted(table, key=lambda line: line["change"] if line["change"] is not None else 1e9)


def draw_chart(task: Task, found: list[tuple[Variant, dict]], final: dict) -> str:
    """Draw bars of the change of each variant on a logarithmic axis, and of its saving."""
    lines = [line for _, line in found if line["status"] == "ok"]
    lines = [*sorted(lines, key=lambda line: line["change"]), final]
    at, name = np.arange(len(lines)), "needs"
    colour = [study.COLOURS[0 if line["change"] <= task.tolerance else 1] for line in lines]
    size = (9.0, 1.6 + 0.32 * len(lines))
    with study.figure(
        task.run_options["out"], name, log=False, panels=(1, 2), size=size, sharey=True
    ) as (figure, (left, right)):
        figure.suptitle(
            f"{task.scene.title or task.name}: blue can go at {format_percent(task.tolerance)}"
        )
        shown = [min(max(100 * line["change"], 1e-5), 1e4) for line in lines]
        left.barh(at, shown, left=1e-5, color=colour)
        told = [
            (i, 100 * line["predicted"]) for i, line in enumerate(lines) if line.get("predicted")
        ]
        if told:
            y, x = zip(*told, strict=True)
            left.plot(np.maximum(x, 1e-5), y, "kD", ms=5, mfc="w", label="predicted")
        left.axvline(100 * task.tolerance, color="k", ls="--", label="tolerance")
        left.set(xscale="log", xlabel="change of the quantities of interest [%]", xlim=(1e-5, 300))
        left.set_yticks(at, [line["variant"] for line in lines])
        left.legend(loc="upper left", bbox_to_anchor=(0.0, -0.14), ncols=2)
        right.barh(at, [100 * line["saved"] for line in lines], color=colour)
        right.set(xlabel="CPU seconds saved [%]", xlim=(-100, 100))
        right.axvline(0, color="k", lw=0.8)
        for i, line in enumerate(lines):
            if line["saved"] < -1:
                right.text(-96, i, f"{1 - line['saved']:.2g} times as many", va="center", color="w")
    return name


def simplify_scene(task: Task, options: argparse.Namespace) -> tuple[list, str, list[dict]]:
    """Simplify one scene and write its report; return the findings, the conclusion and the rows."""
    found = run_each_variant(task)
    data, attempts = combine_variants(task, found)
    final = run_reduced_scene(task, data) | {"variant": "reduced.toml"}
    table = rank_variants(task, found)
    names = [line["variant"] for line in attempts if line["taken"] == "yes"]
    conclusion = describe_result(task, names[-1] if names else "", final)
    print("\n".join([conclusion, *map(format_row, table)]))
    findings, rows = collect_findings(task, found, final), [line for _, line in found]
    study.write_report(
        argparse.Namespace(**vars(options) | {"out": task.run_options["out"]}),
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
    )
    return findings, conclusion, rows


def collect_findings(task: Task, found: list, final: dict) -> list[study.Finding]:
    """Return the findings: the error of the reduced scene, and the parts of known scenes."""
    name, low, high = task.name, task.tolerance, task.tolerance
    lines = {line["variant"]: line for _, line in found}
    change = final.get("change", math.nan)
    findings = [study.Finding(f"{name}: change by reduced.toml", change, high=high)]
    findings.append(study.Finding(f"{name}: seconds saved by it", final.get("saved", math.nan)))
    if not task.known:
        return findings
    needed, needless = (lines[variant] for variant in KNOWN[name])
    for key in ("predicted", "change"):
        findings.append(study.Finding(f"{name}, {needed['variant']}: {key}", needed[key], low))
        what = f"{name}, {needless['variant']}: {key}"
        findings.append(study.Finding(what, needless[key], high=high))
    return findings


def describe_result(task: Task, gone: str, final: dict) -> str:
    """Return the conclusion as a sentence."""
    if not gone:
        return f"At {format_percent(task.tolerance)} {task.name} needs all its parts."
    change, saved = (format_percent(final.get(key, math.nan)) for key in ("change", "saved"))
    return (
        f"At {format_percent(task.tolerance)} {task.name} becomes: {gone}. "
        f"The quantities of interest change by {change}; this saves {saved} of the CPU seconds."
    )


def format_percent(value: float) -> str:
    return f"{100 * value:.2g} %" if abs(value) < 1 else f"{100 * value:.0f} %"


def format_row(line: dict) -> str:
    """Format a row of the ranking for the terminal."""
    numbers = [
        "-" if line[key] is None else format_percent(line[key])
        for key in ("predicted", "change", "saved")
    ]
    said = "predicted {:>9}  measured {:>9}  saves {:>7}".format(*numbers)
    return f"  {line['variant']:<28} {said}  {line['verdict']}"


def parse_tolerance(text: str) -> float:
    """Read a tolerance such as 1% or 0.01."""
    value = float(text.rstrip("% ")) / (100 if "%" in text else 1)
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must lie between 0 and 100 %")
    return value


def main() -> int:
    options = study.parse_arguments(__doc__, tolerance={"type": parse_tolerance, "default": "1%"})
    known = [] if options.scene else [SCENES / f"{name}.toml" for name in KNOWN]
    done = [simplify_scene(Task.of(path, options), options) for path in known or [options.scene]]
    findings = [finding for found, _, _ in done for finding in found]
    if known:
        names = [path.stem for path in known]
        said = [f"[{n}]({n}/report.md): {d[1]}" for n, d in zip(names, done, strict=True)]
        study.write_report(
            options,
            "Simplification of three scenes",
            [row for _, _, rows in done for row in rows],
            figures=[f"{name}/needs" for name in names],
            findings=findings,
            conclusion="\n\n".join(said),
        )
    return 0 if all(finding.is_met for finding in findings) else 1


if __name__ == "__main__":
    sys.exit(main())
