"""Does `fc.tune` find a setting that meets the tolerance, is cheap, and is found quickly?

    python -m studies.tune [--quick] [--names NAME …]
    python -m studies.tune --unseen SEED            on scenes that the seed draws
    python -m studies.tune --contact SEED           on ten scenes with contact that it draws

On each of twelve scenes `tune` chooses a setting. The study runs it, compares it with a reference
whose error is below a tenth of the tolerance, and with the cheapest setting of an exhaustive grid.
Expected: the true error is at most 1.2 times the tolerance in 11 of 12 scenes; the run costs at
most twice the best of the grid (four times with `--quick`, whose runs take some 30 ms); the search,
without its one verifying run, at most 3 times the tuned run or 60 s. Where finer meshes give other
folds, `tune` must say that nothing is proved.

The references and the best settings of the grids are stored; `studies.tune.references` and
`studies.tune.grid` make them. Seconds are CPU seconds, measured in this study. The table is written
to out/tune/tune.md and tune.csv; the files in studies/tune are a copy of the full study.
"""

from __future__ import annotations

import math
import sys
import time
import tomllib
from collections.abc import Mapping
from pathlib import Path

import fecloth as fc
from fecloth import study
from fecloth.output.atomic_files import replace_file
from fecloth.scene.scene import scene_of
from fecloth.study.problem import StudyProblem
from fecloth.study.result import markdown_table, write_csv
from fecloth.study.runs import Runs
from fecloth.study.status import OK
from studies import harness
from studies.tune import contact, grid, references, unseen
from studies.tune.scenes import TWELVE, Tried

QUICK = ("strip",)
ALLOWED, SHARE = 1.2, 11 / 12  # of the tolerance, and the part of the scenes that must meet it
COST, MOST_COST = 2.0, 4.0  # times the best of the grid: in most scenes, and in each
SEARCH, LEAST_SEARCH = 3.0, 60.0  # times the tuned run, s
QUICK_COST = 4.0  # times the best: the seconds of runs of 30 ms vary by half
UNSETTLED = 0.3  # of the tolerance: a reference that is less certain is none
LONGEST = 2.0  # s, of a run of the grid of a scene that a seed draws
TITLE = "Tuning of twelve scenes to a tolerance"


def judge(name: str, kind: str, seed: int | None, out: str, fresh: bool) -> dict:
    """Tune a scene and return its row."""
    tried = next(each for each in tried_scenes(kind, seed) if each.name == name)
    runs = Runs(out, most_seconds=None, fresh=fresh)
    folder = Path(out) / "tuned" / name
    begin = time.process_time()
    tuned = fc.tune(tried.scene(), tried.tolerance, folder=folder, most_seconds=None)
    tuned.table.to_csv(folder / "runs.csv")
    row: dict = {
        "quantities": ", ".join(q.text for q in references.quantities_of(tried)),
        "tolerance %": 100 * tried.tolerance,
        "setting": describe(tuned.settings),
        "tune's error %": 100 * tuned.error,
        "proved": tuned.proved,
        "search s": tuned.search_seconds,
        "all s": time.process_time() - begin,
        "verdict": tuned.verdict.splitlines()[0],
    }
    if not tried.has_limit:
        return row | {"tuned s": tuned.seconds}
    return row | compare(tried, tuned, runs, kind)


def tried_scenes(kind: str, seed: int | None) -> list[Tried]:
    """Return the scenes of a kind: "twelve", or "unseen" or "contact" of a seed."""
    drawn = {"unseen": unseen.draw, "contact": contact.draw}
    return drawn[kind](seed) if seed is not None else list(TWELVE)


def compare(tried: Tried, tuned, runs: Runs, kind: str) -> dict:
    """Return the true error and the seconds of the tuned run, and the best of the grid.

    The grid has the gaps of the scene, and does not count with contact.
    """
    if kind == "twelve":
        reference, choices = references.read(tried), grid.read_best(tried)
    else:
        reference = references.reference_of(tried, references.make(tried, runs))
        choices = []
    uncertainty = max(reference.uncertainties.values())
    again = Runs(runs.cache, most_seconds=None, timed=True, fresh=True)
    problem = StudyProblem.of(scene_of(tomllib.loads(tuned.text)))
    seconds, error = grid.run_problem(problem, reference, again)
    row = {"uncertainty %": 100 * uncertainty, "tuned s": seconds}
    if uncertainty > UNSETTLED * tried.tolerance:
        return row | {"best": "not settled"}
    row["true error %"] = 100 * error
    if kind == "contact":
        return row
    if kind == "unseen":
        choices = grid.best_of(grid.search(tried, reference, runs, LONGEST))
    best = grid.measure_best(tried, reference, again, choices)
    if best is None:
        return row | {"best": "none"}
    best_seconds, choice = best
    row |= {"best s": best_seconds, "best": describe(choice)}
    if tuned.proved or kind == "twelve":
        row["cost ratio"] = seconds / best_seconds
    return row


def describe(choice: Mapping) -> str:
    """Return a setting in a few words.

    Examples
    --------
    >>> describe({"element": "P1", "pattern": "cross", "h": 0.1, "method": "bdf2", "dt": 0.01})
    'P1 cross, h = 0.1 m, bdf2, dt = 0.01 s'
    """
    words = " ".join(choice[name] for name in ("element", "pattern") if name in choice)
    parts = [words, f"h = {choice['h']:.3g} m" if "h" in choice else "a mesh of one size"]
    if "method" in choice:
        parts.append(choice["method"])
    if "rtol" in choice:
        parts.append(f"rtol = {choice['rtol']:.3g}/s")
    elif "dt" in choice:
        parts.append(f"dt = {choice['dt']:.3g} s")
    return ", ".join(parts)


# --- the verdict ----------------------------------------------------------------------------------


def collect_findings(rows: list[Mapping], most: float = COST) -> list[harness.Finding]:
    """Return the four numbers of the acceptance, and how many tolerances were proved."""
    met = [is_right(row) for row in rows]
    ratios = [row["cost ratio"] for row in rows if "cost ratio" in row]
    largest = [max(ratios)] if ratios else []
    searches = [row["search s"] / search_limit(row) for row in rows]
    endless = [row for row in rows if not limit_of(row)]
    findings = [
        harness.Finding(f"share of {len(rows)} scenes with an error as asked", _mean(met), SHARE),
        *[harness.Finding("largest cost over the best of the grid", r, high=most) for r in largest],
        harness.Finding("largest time of the search over its limit", max(searches), high=1.0),
        harness.Finding("tolerances proved", _proved(rows)),
    ]
    if endless:
        said = _mean([not row["proved"] for row in endless])
        findings.append(harness.Finding("scenes without a limit that are not proved", said, 1.0))
    return findings


def collect_drawn_findings(rows: list[Mapping]) -> list[harness.Finding]:
    """Return the acceptance on scenes that a seed draws."""
    settled = [row for row in rows if limit_of(row)]
    false = [row for row in settled if row["proved"] and row["true error %"] > allowed_error(row)]
    possible = [row for row in settled if "best s" in row]
    open_ = [row for row in rows if not limit_of(row)]
    return [
        harness.Finding(f"falsely proved, of {len(settled)} settled scenes", len(false), high=0.0),
        harness.Finding("scenes that are not settled and proved", _proved(open_), high=0.0),
        harness.Finding("longest search [CPU s]", max(row["search s"] for row in rows), high=60.0),
    ] + _compare_with_grid(possible)


def _compare_with_grid(possible: list[Mapping]) -> list[harness.Finding]:
    """Return what the grid says of the rows that it can meet; nothing where there is no grid."""
    if not possible:
        return []
    ratios = [row["cost ratio"] for row in possible if row["proved"]] or [math.nan]
    cheap = _mean([ratio <= COST for ratio in ratios])
    proved = _mean([bool(row["proved"]) for row in possible])
    return [
        harness.Finding(f"share proved of {len(possible)} that the grid can meet", proved, 0.9),
        harness.Finding(f"share of {len(ratios)} proved that cost at most {COST:g} ×", cheap, 0.9),
        harness.Finding("largest cost over the best of the grid", max(ratios), high=MOST_COST),
    ]


def allowed_error(row: Mapping) -> float:
    """Return the tolerance and the uncertainty of the reference, in per cent."""
    return row["tolerance %"] + row["uncertainty %"]


def _proved(rows: list[Mapping]) -> int:
    return sum(bool(row["proved"]) for row in rows)


def limit_of(row: Mapping) -> bool:
    """Whether the scene of a row converges."""
    return "true error %" in row


def is_right(row: Mapping) -> bool:
    """Whether the true error is as asked; without a limit, whether `tune` says so."""
    if not limit_of(row):
        return not row["proved"]
    return row["true error %"] <= ALLOWED * row["tolerance %"]


def search_limit(row: Mapping) -> float:
    """Return the longest search allowed [s]."""
    return max(SEARCH * row["tuned s"], LEAST_SEARCH)


def _mean(values: list[bool]) -> float:
    return sum(values) / len(values) if values else math.nan


def verdict_of(findings: list[harness.Finding]) -> str:
    missed = [one.what for one in findings if not one.is_met]
    return f"The acceptance fails: {'; '.join(missed)}." if missed else "The acceptance is met."


def main() -> int:
    names = {"nargs": "*", "default": [], "metavar": "NAME", "help": "scenes; all by default"}
    seed = {"type": int, "default": None, "metavar": "SEED", "help": "scenes that it draws"}
    options = harness.parse_arguments(__doc__, names=names, unseen=seed, contact=seed)
    kind, seed = kind_of(options)
    listed = [each.name for each in tried_scenes(kind, seed)]
    chosen = options.names or (QUICK if options.quick and kind == "twelve" else listed)
    settings = {"kind": kind, "seed": seed, "out": str(options.out), "fresh": options.fresh}
    cases = [{"name": name, **settings} for name in listed if name in chosen]
    rows = study.run_cases(cases, judge, **harness.run_options(options, alone=True))
    harness.require_results(options, title_of(kind, seed), rows)
    good = [row for row in rows if row["status"] == OK]
    table = [{"scene": row["name"], **_shown(row)} for row in good]
    if kind == "twelve":
        findings = collect_findings(good, QUICK_COST if options.quick else COST)
    else:
        findings = collect_drawn_findings(good)
    verdict, title = verdict_of(findings), title_of(kind, seed)
    write_table(options, table, findings, verdict)
    return harness.write_report(
        options, title, rows, tables={"Scenes": table}, findings=findings, conclusion=verdict
    )


def kind_of(options) -> tuple[str, int | None]:
    """Return the kind of the scenes, and the seed that draws them."""
    if options.contact is not None:
        return "contact", options.contact
    return ("twelve", None) if options.unseen is None else ("unseen", options.unseen)


def title_of(kind: str, seed: int | None) -> str:
    if kind == "twelve":
        return TITLE
    return f"Tuning of the scenes{' with contact' * (kind == 'contact')} that the seed {seed} draws"


def _shown(row: Mapping) -> dict:
    order = ("quantities", "tolerance %", "setting", "true error %", "uncertainty %")
    order += ("tune's error %", "proved", "tuned s", "best", "best s", "cost ratio", "search s")
    order += ("all s",)
    return {key: row.get(key) for key in (*order, "verdict")}


def write_table(options, table: list[dict], findings: list[harness.Finding], verdict: str) -> None:
    """Write tune.md and tune.csv into the folder of the results."""
    kind, seed = kind_of(options)
    more = "" if kind == "twelve" else f" --{kind} {seed}"
    words = "\n".join(f"- {finding}" for finding in findings)
    short = [{key: value for key, value in row.items() if key != "verdict"} for row in table]
    said = "\n".join(f"- {row['scene']}: {row['verdict']}" for row in table)
    parts = [f"# {title_of(kind, seed)}", f"`python -m studies.tune{more}`", verdict, words]
    parts += [markdown_table(short), "What `tune` says:", said]
    replace_file(options.out / "tune.md", ("\n\n".join(parts) + "\n").encode())
    write_csv(table, options.out / "tune.csv")


if __name__ == "__main__":
    sys.exit(harness.run_main(main))
