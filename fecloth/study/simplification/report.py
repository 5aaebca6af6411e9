"""Report of a simplified scene: the ranking of its variants, the figure, findings, sentences."""

from __future__ import annotations

import math

import numpy as np

from fecloth import study
from fecloth.study.simplification.cases import COUNTED
from fecloth.study.simplification.search import LOST, reliable_change, unresolved_sizes
from fecloth.study.simplification.task import Task
from fecloth.study.simplification.variants import Variant

KNOWN = {  # scene: a part that it needs, and one that it does not need
    "taut": ("without Gravity", "without HingeBending"),
    "cantilever": ("without HingeBending", "without Drag"),
    "wind": ("without Wind", "without QuadraticBending"),
}


def rank_variants(task: Task, found: list[tuple[Variant, dict]]) -> list[dict]:
    """Return a table of the variants, sorted by their change, each with a verdict."""
    table = []
    for variant, line in found:
        good, verdict = line["status"] == "ok", judge_variant(task, variant, found)
        short = {name: line.get(name) for name in ("variant", "predicted", "change", "of", "saved")}
        counts = {name: line.get(name) for name in ("triangles", "steps", *COUNTED)}
        short |= {"verdict": verdict if good else line["status"], "CPU s": line.get("cpu_seconds")}
        table.append(short | counts)
    return sorted(table, key=lambda line: line["change"] if line["change"] is not None else 1e9)


def judge_variant(task: Task, variant: Variant, found: list[tuple[Variant, dict]]) -> str:
    """Return the verdict on a variant that ran to its end."""
    (line,) = [line for other, line in found if other is variant]
    change = reliable_change(variant, found)
    if variant.is_check:
        return "resolved" if change <= task.tolerance else "NOT RESOLVED"
    if change > task.tolerance:
        return (
            "needed" if line["status"] != "ok" or line["change"] > task.tolerance else "by chance"
        )
    return "can go, saves nothing" if line["saved"] <= -LOST else "can go"


def draw_chart(task: Task, found: list[tuple[Variant, dict]], final: dict) -> str:
    """Draw bars of the change of each variant on a logarithmic axis, and of its saving."""
    lines = [line for _, line in found if line["status"] == "ok"]
    lines = [*sorted(lines, key=lambda line: line["change"]), final]
    at, name = np.arange(len(lines)), "needs"
    colour = [study.COLOURS[0 if line["change"] <= task.tolerance else 1] for line in lines]
    size = (9.0, 1.6 + 0.32 * len(lines))
    with study.figure(task.options.out, name, log=False, panels=(1, 2), size=size, sharey=True) as (
        figure,
        (left, right),
    ):
        figure.suptitle(
            f"{task.scene.title or task.name}: blue can go at {format_percent(task.tolerance)}"
        )
        shown = [min(max(100 * line["change"], 1e-5), 1e4) for line in lines]
        left.barh(at, shown, left=1e-5, color=colour)
        predicted = [
            (i, 100 * line["predicted"]) for i, line in enumerate(lines) if line.get("predicted")
        ]
        if predicted:
            y, x = zip(*predicted, strict=True)
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


def describe_result(task: Task, found: list, gone: str, final: dict) -> str:
    """Return the conclusion in sentences, first those on the resolution of the scene."""
    sentences = [describe_unresolved(task, line) for line in unresolved_sizes(task, found)]
    return "\n\n".join([*sentences, describe_reduced(task, gone, final)])


def describe_unresolved(task: Task, line: dict) -> str:
    """Return a sentence on a refinement that changes more than the tolerance."""
    if line["status"] != "ok":
        return f"Whether {task.name} is resolved is unknown: {line['variant']} failed."
    return (
        f"{task.name} is not resolved: {line['variant']} changes {line['of']} by "
        f"{format_percent(line['change'])}. Refine the scene before you simplify it, or allow a "
        "larger tolerance."
    )


def describe_reduced(task: Task, gone: str, final: dict) -> str:
    """Return a sentence on the reduced scene."""
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
    words = "predicted {:>9}  measured {:>9}  saves {:>7}".format(*numbers)
    return f"  {line['variant']:<28} {words}  {line['verdict']}"
