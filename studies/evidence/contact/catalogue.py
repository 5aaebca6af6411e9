"""Does contact hold in scenes of seven kinds that a seed draws?

Obstacles at rest, moving at up to 20 m/s and turning, thin ones and sharp meshes; several pieces,
cloths that are pierced, thrown and crumpled.
All have `SelfContact`, at a place among the terms that is drawn, as are the fabric, friction,
restitution, element, direction and dt. The methods alternate.

After every step, also the parts of steps that were repeated, the state is tested with formulas
that are not those of the terms, in the frame of each body: nodes inside it, triangles
deeper in it than `Obstacle` announces, triangles that its axis, edges or faces pierce, or that
passed over the middle of a wide body. `fecloth.mesh.surface` finds triangles of the cloth that
cross. Neither has anything from ipctk.

The quick form leaves one scene of each kind soon after their impact.

    python -m studies.evidence.contact.catalogue [--quick] [--only KIND ...] [--seed 5] [--each 20]
"""

from __future__ import annotations

from pathlib import Path

from fecloth import study
from studies import harness
from studies.evidence.contact.catalogue_runs import watch
from studies.evidence.contact.catalogue_scenes import KINDS

SEED, EACH = 5, 20
QUICK, MOST = 7, 45  # scenes of the quick form, and iterations after which it leaves a scene


def cases(only: list[str], seed: int, each: int, quick: bool) -> list[dict]:
    """The settings of all scenes."""
    settings = [
        {"kind": kind, "seed": seed, "number": number}
        for number in range(each)
        for kind in only or KINDS
    ]
    return [scene | {"most": MOST} for scene in settings[:QUICK]] if quick else settings


def line(kind: str, group: list[dict]) -> dict:
    """Sums and extremes of the scenes of a kind."""
    done = [row for row in group if row["status"] == "ok"]
    steps = max(sum(row["steps"] for row in done), 1)
    depths = [row["least"] for row in done if row["least"] < 1.0]
    return {
        "kind": kind,
        "scenes": len(group),
        "finished": sum(row["end"] == "finished" for row in done),
        "lost": sum(is_lost(row) for row in group),
        "crossings": sum(row["crossings"] for row in done),
        "piercings": sum(row["piercings"] for row in done),
        "least distance [mm]": 1e3 * min(depths) if depths else None,
        "steps": steps,
        "repeated, of 100 steps": 100 * sum(row["rejected"] for row in done) / steps,
        "Newton a step": sum(row["newton"] for row in done) / steps,
        "CPU s": sum(row["cpu_seconds"] for row in done),
    }


def is_lost(row: dict) -> bool:
    """Whether a scene ended before its time."""
    return row["status"] != "ok" or row["end"] == "lost"


def findings(rows: list[dict]) -> list[harness.Finding]:
    """What the catalogue promises."""
    done = [row for row in rows if row["status"] == "ok"]
    total = line("all", rows)
    deepest = min(row["least_inside"] for row in done)
    named = [
        ("triangles of the cloth that cross", total["crossings"], 0),
        ("triangles that a body pierces", total["piercings"], 0),
        ("scenes lost", total["lost"], 0),
        ("repeated steps, of 100", total["repeated, of 100 steps"], 20),
        ("CPU minutes", total["CPU s"] / 60, 40),
    ]
    return [
        *(harness.Finding(what, value, high=high) for what, value, high in named),
        harness.Finding("least distance of a node [mm]", total["least distance [mm]"], low=0),
        harness.Finding("least room of a triangle beyond what is announced [mm]", 1e3 * deepest, 0),
    ]


def main() -> int:
    """Run the scenes, and write the report."""
    only = {"nargs": "+", "choices": tuple(KINDS), "default": [], "metavar": "KIND"}
    seed = {"type": int, "default": SEED, "metavar": "N", "help": "of the scenes (5)"}
    each = {"type": int, "default": EACH, "metavar": "N", "help": "scenes of a kind (20)"}
    options = harness.parse_arguments(__doc__, needs=["ipctk"], only=only, seed=seed, each=each)
    settings = cases(options.only, options.seed, options.each, options.quick)
    rows = study.run_cases(settings, watch, time_limit=120.0, **harness.run_options(options))
    title = "Contact: a catalogue"
    harness.require_results(options, title, rows)
    groups = {kind: [row for row in rows if row["kind"] == kind] for kind in KINDS}
    table = [line(kind, group) for kind, group in groups.items() if group]
    tables = {"By kind": [*table, line("all", rows)]}
    page = Path(__file__).with_suffix("")
    return harness.write_report(
        options, title, rows, tables=tables, findings=findings(rows), page=page
    )


if __name__ == "__main__":
    harness.run_main(main)
