"""Does `fecloth simplify` find what three scenes with known answers need, and what they do not?

python -m studies.simplify [--quick]
fecloth simplify my.toml --tolerance 1%      for a scene of yours
"""

from __future__ import annotations

import math
from pathlib import Path

from fecloth import study
from studies import harness

SCENES = Path(__file__).parents[1] / "scenes" / "needs"
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


def collect_findings(name: str, found: study.Simplification) -> list[harness.Finding]:
    """Return the change of the reduced scene, and the measured and predicted known parts."""
    rows = {row["variant"]: row for row in found.table}
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
    options = harness.parse_arguments(__doc__, needs=["matplotlib"])
    names = ("wind",) if options.quick else KNOWN
    done = {name: simplify_scene(name, options) for name in names}
    return harness.write_report(
        options,
        "Simplification of three scenes",
        [{"scene": name, **row} for name, found in done.items() for row in found.table],
        figures=[f"{name}/figure" for name in done],
        findings=[one for name, found in done.items() for one in collect_findings(name, found)],
        conclusion="\n\n".join(f"{name}: {found.verdict}" for name, found in done.items()),
        results=RESULTS,
    )


if __name__ == "__main__":
    harness.run_main(main)
