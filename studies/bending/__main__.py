"""Bending: the error of each model against the edge length, on six problems and six patterns.

The problems: a supported square, a clamped square and a clamped disk under a uniform load, the
first frequency of a free square, a square twisted at a corner, and a heavy strip at large rotation.
The models: `HingeBending`, `QuadraticBending`, and `PlateBending` on P1 and P2. They have equal
nodes: h is their distance, on graded meshes the longest, and the triangles of P2 are twice as long.

Hinges have no clamp: two rows of nodes are held, and the cloth begins half-way between them. On
graded meshes their clamped problems are left out. A disk has no "right" and no "cross" pattern.

The second part has two fabrics, 10 : 1, whose seam is a zigzag.

    python -m studies.bending [--quick] [--jobs N] [--out DIR]
"""

from __future__ import annotations

from pathlib import Path

from fecloth import study
from studies import harness
from studies.bending import figure
from studies.bending.cases import MODELS, PROBLEMS, run
from studies.bending.findings import (
    HINGES,
    Rows,
    conclude,
    conclude_seams,
    seam_errors,
    select,
)
from studies.bending.meshes import DISK_PATTERNS, PATTERNS
from studies.bending.seams import CROSS, GMSH, LINE, MORLEY, PLATE, run_seam

TITLE = "Error of bending"
CLAMPED = ("clamped_square", "clamped_disk", "heavy_strip")


def list_cases(quick: bool) -> Rows:
    """List the settings of the six problems."""
    return [
        {"problem": problem, "model": model, "pattern": pattern, "n": n}
        for problem in PROBLEMS
        for model in MODELS
        for pattern in patterns(problem, model, quick)
        for n in ((8, 16) if quick else (8, 16, 32) if pattern == "graded" else (8, 16, 32, 64))
    ]


def patterns(problem: str, model: str, quick: bool) -> tuple[str, ...]:
    """Return the patterns on which the model carries the problem."""
    if quick:
        return ("unstructured",) if problem == "clamped_disk" else ("right", "unstructured")
    every = DISK_PATTERNS if problem == "clamped_disk" else PATTERNS
    return every[:-1] if model in HINGES and problem in CLAMPED else every


def list_seams(quick: bool) -> Rows:
    """List the meshes with a seam."""
    sizes = (8, 16) if quick else (8, 16, 32, 64)
    models = {LINE: [PLATE], CROSS: [PLATE, MORLEY], GMSH: [PLATE]}
    return [
        {"seam": seam, "model": model, "n": n}
        for seam, chosen in models.items()
        for model in chosen
        for n in sizes
    ]


def spread(rows: Rows, n: int) -> Rows:
    """Return the least and the largest error over the patterns, of each problem and model."""
    lines = []
    for problem in PROBLEMS:
        line = {"problem": problem}
        for model in MODELS:
            errors = [row["error"] for row in select(rows, problem=problem, model=model, n=n)]
            line[model] = f"{min(errors):.2g} … {max(errors):.2g}"
        lines.append(line)
    return lines


def main(argv: list[str] | None = None) -> int:
    """Run all cases, write the figure, the tables and the report; return the exit status."""
    options = harness.parse_arguments(__doc__ or "", argv)
    running = harness.run_options(options)
    rows = study.run_cases(list_cases(options.quick), run, **running, time_limit=120)
    seams = study.run_cases(list_seams(options.quick), run_seam, **running, time_limit=120)
    harness.require_results(options, TITLE, rows)
    figure.draw(options.out, rows)
    n, seam_lines = 16 if options.quick else 32, seam_errors(seams)
    finest = max(line["n"] for line in seam_lines)
    tables = {
        f"Relative errors over all patterns, n = {n}": spread(rows, n),
        "Seams, finest mesh": [line for line in seam_lines if line["n"] == finest],
    }
    return harness.write_report(
        options,
        TITLE,
        rows + seams,
        tables=tables,
        figures=("bending",),
        findings=conclude(rows) + conclude_seams(seam_lines),
        page=Path(__file__).with_name("errors"),
    )


if __name__ == "__main__":
    harness.run_main(main)
