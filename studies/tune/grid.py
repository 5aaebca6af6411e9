"""The cheapest setting of a scene that meets a tolerance, by an exhaustive search in order of cost.

    python -m studies.tune.grid [--names NAME …] [--longest SECONDS]

makes all twelve, in some 20 CPU minutes, and writes the best few of each into grid.json.

It is the search of `fecloth.study.front` with two differences: errors are distances to the stored
reference, not to a limit that the search found, and no setting is left out because its line
promises too little. The cheapest of the settings that are left is run next, until all of them
should cost more than the cheapest one that meets the tolerance, or more than `--longest`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file
from fecloth.study.fronts.bench import Bench
from fecloth.study.fronts.front import USUAL_AXES, Plan
from fecloth.study.fronts.search import Search
from fecloth.study.fronts.settings import Setting, Settings
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Row, Run, Runs, run_quantities
from studies import harness
from studies.tune.references import Reference, fingerprint, quantities_of, read
from studies.tune.scenes import TWELVE, Tried

FILE = Path(__file__).with_name("grid.json")
BEST = 3  # lines that also run with the other patterns
LONGEST = 30.0  # CPU seconds of a run
MOST = 1e6  # CPU seconds of a search: no limit
KEPT = 4  # the cheapest that meet the tolerance: their seconds are measured again, with care
Choice = Mapping[str, Any]  # for `StudyProblem.choose`


@dataclass(frozen=True, eq=False)
class KnownLimit:
    """The reference in place of the limit of a search."""

    reference: Reference

    @property
    def uncertainty(self) -> np.ndarray:
        """(q,) zeros: what meets the tolerance may depend on it, but which is cheapest hardly."""
        return np.zeros(len(self.reference.values))

    def error(self, row: Row) -> np.ndarray:
        """Return the (q,) relative distances of a run to the reference."""
        return np.array(list(self.reference.errors(row).values()))


class ExhaustiveSearch(Search):
    """A search by the expected time of each setting alone, not by what its line promises."""

    def _push(self, promise: float, seconds: float, setting: Setting) -> None:
        super()._push(seconds, seconds, setting)


def search(tried: Tried, reference: Reference, runs: Runs, longest: float = LONGEST) -> Search:
    """Return the search after all settings ran that should take at most `longest` [s]."""
    problem = StudyProblem.of(tried.scene())
    quantities = tuple(quantities_of(tried))
    runs = replace(runs, time_limit=LONGEST)
    plan = Plan(problem, quantities, dict.fromkeys(USUAL_AXES), tried.tolerance, MOST, runs)
    bench = Bench(Settings.of(problem), quantities, runs, MOST)
    limit: Any = KnownLimit(reference)
    made = ExhaustiveSearch(bench, limit, tried.tolerance, longest)
    made.add_lines(plan.lines())
    made.run()
    best_lines = list(dict.fromkeys(setting.line for setting in meeting(made)))[:BEST]
    made.add_lines(plan.other_patterns(best_lines))
    made.run()
    return made


def meeting(made: Search) -> list[Setting]:
    """Return the settings that meet the tolerance, the cheapest first."""
    return sorted(filter(made.meets, made.bench.rows), key=made.bench.took)


def best_of(made: Search) -> list[Choice]:
    """Return the cheapest few settings that meet the tolerance."""
    return [made.bench.settings.choice(setting) for setting in meeting(made)[:KEPT]]


def run_problem(problem: StudyProblem, reference: Reference, runs: Runs) -> tuple[float, float]:
    """Run a problem, and return its CPU seconds and its largest error by the reference."""
    quantities = quantities_of(reference.tried)
    (row,) = run_quantities([Run(problem, problem.name)], quantities, replace(runs, quiet=True))
    return row.get("cpu_seconds", 0.0), max(reference.errors(row).values())


def measure_best(
    tried: Tried, reference: Reference, runs: Runs, choices: Sequence[Choice]
) -> tuple[float, Choice] | None:
    """Measure settings again, as for a chart; return seconds and choice of the cheapest one.

    Only settings that meet the tolerance count: return None if no setting does.
    """
    problem = StudyProblem.of(tried.scene())
    measured = [
        (*run_problem(problem.choose(**choice), reference, runs), choice) for choice in choices
    ]
    meeting = [(seconds, choice) for seconds, error, choice in measured if error <= tried.tolerance]
    return min(meeting, key=lambda pair: pair[0], default=None)


# --- storing --------------------------------------------------------------------------------------


def read_best(tried: Tried) -> list[Choice]:
    """Return the stored best settings of a scene.

    Raises
    ------
    InputError
        If there are none, or they belong to an earlier form of the scene.
    """
    stored = _file().get(tried.name)
    if stored is None or stored["scene"] != fingerprint(tried):
        remedy = f"Run python -m studies.tune.grid --names {tried.name}"
        allowed = "is missing or belongs to another scene"
        raise InputError(f"the grid of {tried.name}", allowed, FILE.name, remedy)
    return stored["best"]


def _file() -> dict:
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def _write(stored: Mapping[str, Mapping]) -> None:
    """Write a line for each scene and one for each of its best settings."""
    parts = []
    for name, entry in stored.items():
        rest = {key: value for key, value in entry.items() if key != "best"}
        best = ",\n".join(f"    {json.dumps(choice)}" for choice in entry["best"])
        parts.append(f'"{name}": {json.dumps(rest)[:-1]}, "best": [\n{best}]}}')
    replace_file(FILE, ("{\n" + ",\n".join(parts) + "\n}\n").encode())


def main() -> int:
    names = {"nargs": "*", "default": [], "metavar": "NAME", "help": "scenes; all by default"}
    longest = {"type": float, "default": LONGEST, "metavar": "SECONDS", "help": "of a run"}
    options = harness.parse_arguments(__doc__, names=names, longest=longest)
    runs = Runs(options.out, fresh=options.fresh, most_seconds=None)
    for tried in TWELVE:
        if not tried.has_limit or (options.names and tried.name not in options.names):
            continue
        made = search(tried, read(tried), runs, options.longest)
        ran = {"ran": len(made.bench.rows), "seconds": round(made.bench.spent, 1)}
        entry = {"scene": fingerprint(tried), **ran, "best": best_of(made)}
        _write(_file() | {tried.name: entry})
        print(f"{tried.name}: {entry}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(harness.run_main(main))
