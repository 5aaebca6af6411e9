"""Trust: which runs of a catalogue are wrong, and which of them warn.

Each set-up of `setups.py` runs once, and again with halved steps until two successive refinements
agree within 2 %; runs that never agree, such as chaotic folding, do not count. The error in time
is the rms error of x weighted by mass, the largest over the frames, over the largest rms
displacement. A run is good below 2 % and wrong above 10 %. No wrong run may
be without a warning, and at most one good run in twenty may have one.

    python -m studies.evidence.trust [--quick] [--jobs N] [--out DIR]
"""

from __future__ import annotations

from pathlib import Path

from fecloth import study
from studies import harness
from studies.evidence.trust.cases import judge
from studies.evidence.trust.setups import SETUPS, Setup

GOOD, WRONG = 0.02, 0.1
FALSE_ALARMS = 0.05  # of the good runs
ENOUGH = 60  # set-ups that count
MOST, QUICK_MOST = 1200, 800  # steps of the finest refinement
QUICK = (
    Setup("breathing", "midpoint", 4e-3, "spinning"),
    Setup("breathing", "midpoint", 2.5e-4, "20 m/s"),
    Setup("drum", "bdf2", 0.02),
    Setup("jump", "bdf2", 0.005),
    Setup("magnet", "midpoint", 0.001),
)


def verdict(row: dict) -> str:
    """Return in words what a run was."""
    if row["status"] != "ok":
        return row["status"]
    if not row["counts"]:
        return "does not count"
    if row["failed"]:
        return "failed"
    kind = "good" if row["error"] < GOOD else "wrong" if row["error"] > WRONG else "between"
    return f"{kind}, {'warned' if row['warned'] else 'silent'}"


def findings_of(rows: list[dict], enough: int) -> list[harness.Finding]:
    """Return the numbers that the catalogue promises."""
    words = [verdict(row) for row in rows]
    good = sum(word.startswith("good") for word in words)
    alarms = words.count("good, warned")
    return [
        harness.Finding(
            "set-ups that count", sum("silent" in w or "warned" in w for w in words), enough
        ),
        harness.Finding("wrong runs", sum(word.startswith("wrong") for word in words), 1),
        harness.Finding("wrong runs without a warning", words.count("wrong, silent"), high=0),
        harness.Finding("good runs", good, 1),
        harness.Finding(
            "share of good runs with a warning", alarms / max(good, 1), high=FALSE_ALARMS
        ),
    ]


def main(argv: list[str] | None = None) -> int:
    """Run the catalogue, write its table and report, and return the exit status."""
    options = harness.parse_arguments(__doc__ or "", argv)
    setups = QUICK if options.quick else SETUPS
    most = QUICK_MOST if options.quick else MOST
    cases = [one.settings | {"most": most} for one in setups]
    rows = study.run_cases(cases, judge, **harness.run_options(options), time_limit=120.0)
    title, what = harness.about(__doc__)
    lines = [row | {"verdict": verdict(row)} for row in rows]
    return harness.write_report(
        options,
        title,
        lines,
        conclusion=what,
        tables={"Runs": harness.count_by(lines, "method", "verdict")},
        findings=findings_of(rows, 1 if options.quick else ENOUGH),
        results=("time limit",),
        page=Path(__file__).with_name("catalogue"),
    )


if __name__ == "__main__":
    harness.run_main(main)
