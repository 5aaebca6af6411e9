"""Which scenes of the catalogue move wrongly at their dt, and do their runs say so?

Each scene that has a solution is run at its dt and at dt/4, on the same mesh. The error is the rms
difference of the positions at the end, over the largest rms displacement. A run above 10 % is
wrong, and must say so: by a warning not to trust the motion or of the error in time, or by an error
in time that is not known. Of the runs below 2 % at most one in ten may.

    python -m studies.evidence.contact.catalogue_words [--quick] [--seed 4] [--each 5] [--out DIR]
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import ipctk
import numpy as np

import fecloth as fc
from fecloth import study
from studies import harness
from studies.evidence.contact.catalogue_scenes import KINDS, Scene, draw

SEED, EACH = 4, 5
WRONG, GOOD = 0.10, 0.02
FINER = 4
SIGNS = (fc.DoubtKind.MOTION, fc.DoubtKind.TIME)  # doubts about the motion


def end_of(scene: Scene, parts: int) -> tuple[fc.Result, float]:
    """The run with steps of dt/parts, and its largest rms displacement [m]."""
    moved = [0.0]

    def report(info) -> None:
        study.check_time_limit()
        moved[0] = max(moved[0], rms(info.result.state.x - scene.start.x))

    times = scene.dt / parts, scene.t_end
    given = scene.system, scene.method, scene.start, *times
    return fc.run(*given, newton=scene.newton, report=report), moved[0]


def rms(y: np.ndarray) -> float:
    return float(np.sqrt((y**2).sum(axis=1).mean()))


def compare(kind: str, seed: int, number: int) -> dict:
    """The error of a scene, and what its run says."""
    warnings.simplefilter("ignore", fc.FeclothWarning)
    ipctk.set_num_threads(1)
    scene = draw(kind, seed, number)
    result, moved = end_of(scene, 1)
    fine, _ = end_of(scene, FINER)
    said = [str(doubt) for doubt in result.doubts if doubt.kind in SIGNS]
    return {
        "error": rms(result.state.x - fine.state.x) / moved,
        "claimed": result.time_error,
        "says": bool(said) or math.isnan(result.time_error),
        "warning": " | ".join(said),
        "dt": scene.dt,
        "method": type(scene.method).__name__,
    }


def table(rows: list[dict]) -> list[dict]:
    """Counts of runs by their error, with and without a warning."""
    ranges = [("wrong", WRONG, np.inf), ("between", GOOD, WRONG), ("good", 0.0, GOOD)]
    lines = []
    for name, low, high in ranges:
        group = [row for row in rows if low <= row["error"] < high]
        warned = sum(row["says"] for row in group)
        known = sum(row["claimed"] == row["claimed"] for row in group)
        lines.append(
            {"runs": name, "count": len(group), "say so": warned, "state an error in time": known}
        )
    return lines


def main() -> int:
    """Run the scenes, and write the report."""
    seed = {"type": int, "default": SEED, "metavar": "N", "help": "of the scenes (4)"}
    each = {"type": int, "default": EACH, "metavar": "N", "help": "scenes of a kind (5)"}
    options = harness.parse_arguments(__doc__, needs=["ipctk"], seed=seed, each=each)
    kinds = [kind for kind in KINDS if kind not in ("inside", "through", "closing")]
    settings = [
        {"kind": kind, "seed": options.seed, "number": number}
        for number in range(1 if options.quick else options.each)
        for kind in (kinds[:2] if options.quick else kinds)
    ]
    rows = study.run_cases(settings, compare, time_limit=200.0, **harness.run_options(options))
    title = "Contact: do wrong runs say so?"
    harness.require_results(options, title, rows)
    done = [row for row in rows if row["status"] == "ok"]
    wrong, _, good = table(done)
    unsaid, few = wrong["count"] - wrong["say so"], good["count"] / 10
    findings = [harness.Finding("wrong runs that do not say so", unsaid, high=0)]
    if good["count"]:
        findings.append(harness.Finding("good runs that say so", good["say so"], high=few))
    tables, page = {"By error": table(done)}, Path(__file__).with_suffix("")
    return harness.write_report(options, title, rows, tables=tables, findings=findings, page=page)


if __name__ == "__main__":
    harness.run_main(main)
