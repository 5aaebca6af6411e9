"""No node inside an obstacle and no triangles through each other, at any step, in any scene?

Six scenes of about 1,000 triangles fall for 1 s (the sphere: 8,000 triangles, 2 s): on a sphere, a
table, a disk and a ring, a strip in ten layers, and a strip that is twisted to a rope. The drops
have 300 triangles and 0.5 s; a seed draws the shape of the obstacle and its orientation, the cloth,
its fabric, tilt and speed, and the friction. All have `SelfContact`, and steps of 10 ms.

After every step the nodes are tested against other formulas of the shapes than the term uses,
and the triangles by `fecloth.mesh.surface`, which has nothing from ipctk. Points inside the
triangles may cut an edge of a box or of a plate; their depth is in the table.

    python -m studies.contact.catalogue [--quick] [--only NAME ...] [--drops 200] [--out DIR]
"""

from __future__ import annotations

import shutil
from pathlib import Path

from fecloth import study
from studies.contact.catalogue_runs import fall
from studies.contact.catalogue_scenes import NAMED

METHODS = ("BackwardEuler", "BDF2")
DROPS = 200
NOTE = (
    "A point inside a triangle may be in the obstacle where an edge of a box or of a plate cuts "
    "between the points on which it acts: a negative distance."
)


def cases(only: list[str], drops: int, quick: bool) -> list[dict]:
    """The settings of all cases, small ones first."""
    every = []
    for name in NAMED:
        size = (300, 0.08) if quick else (8000, 2.0) if name == "sphere" else (1000, 1.0)
        method = "BackwardEuler" if name in ("sphere", "layers", "ring") else "BDF2"
        every.append((name, 0, *size, method))
    for seed in range(drops):
        size = (100, 0.2) if quick else (300, 0.5)
        every.append(("drop", seed, *size, METHODS[seed % 2]))
    if quick and not only:
        only = ["disk", "layers", "drop"]
    names = ("case", "seed", "triangles", "t_end", "method")
    chosen = [dict(zip(names, values, strict=True)) for values in every]
    return sorted(
        (one for one in chosen if not only or one["case"] in only),
        key=lambda one: one["triangles"] * one["t_end"],
    )


def summary(rows: list[dict]) -> list[dict]:
    """A line for each named case, and one for the drops of each method."""
    groups = {(row["case"], row["method"]): [] for row in rows}
    for row in rows:
        groups[row["case"], row["method"]].append(row)
    return [line(*key, group) for key, group in groups.items()]


def line(case: str, method: str, group: list[dict]) -> dict:
    """Sums and extremes of some cases."""
    done = [row for row in group if row["status"] == "ok"]
    frames = sum(row["frames"] for row in done)
    worst = {name: max((row[name] for row in done), default=None) for name in KEPT}
    return {
        "case": case if len(group) == 1 else f"{len(group)} drops",
        "method": method,
        "finished": len(done),
        "triangles": max((row["cells"] for row in done), default=None),
        "frames": frames,
        "pairs that cross": sum(row["crossings"] for row in done),
        "least distance of a node [mm]": millimetres(worst["node_depth"]),
        "of a point inside a triangle [mm]": millimetres(worst["point_depth"]),
        "most pairs in contact": worst["most_contacts"],
        "Newton a step": sum(row["newton"] for row in done) / max(frames, 1),
        "most": worst["most_newton"],
        "CPU s": sum(row["cpu_seconds"] for row in done),
    }


KEPT = ("node_depth", "point_depth", "most_contacts", "most_newton")


def millimetres(depth: float | None) -> float | None:
    return None if depth is None or depth == -1.0 else -1e3 * depth


def main() -> int:
    """Run the cases, and keep the table of the full form."""
    only = {"nargs": "+", "choices": (*NAMED, "drop"), "default": [], "metavar": "NAME"}
    drops = {"type": int, "default": None, "metavar": "N", "help": "random drops (200)"}
    limit = {"type": float, "default": 900.0, "metavar": "S", "help": "seconds of a case (900)"}
    options = study.parse_arguments(__doc__, needs=["ipctk"], only=only, drops=drops, limit=limit)
    count = options.drops if options.drops is not None else 1 if options.quick else DROPS
    settings = cases(options.only, count, options.quick)
    costs = [case["triangles"] * case["t_end"] for case in settings]
    chosen = study.run_options(options)
    rows = study.run_cases(settings, fall, costs=costs, time_limit=options.limit, **chosen)
    title = "Contact: a catalogue"
    study.require_results(options, title, rows)
    done = [row for row in rows if row["status"] == "ok"]
    findings = [
        study.Finding("pairs of triangles that cross", sum(r["crossings"] for r in done), high=0),
        study.Finding("deepest node [m]", max(row["node_depth"] for row in done), high=0.0),
        study.Finding("CPU minutes", sum(row["cpu_seconds"] for row in done) / 60, high=60.0),
    ]
    text = f"{len(done)} of {len(rows)} scenes ran to their end. {NOTE}"
    tables = {"By case": summary(rows)}
    code = study.write_report(
        options, title, rows, tables=tables, findings=findings, conclusion=text
    )
    if not options.quick and not options.only:
        for name, kept in (("report.md", "catalogue.md"), ("results.csv", "catalogue.csv")):
            shutil.copy(options.out / name, Path(__file__).parent / kept)
    return code


if __name__ == "__main__":
    study.run_main(main)
