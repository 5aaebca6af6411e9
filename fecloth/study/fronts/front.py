"""`front`: a table of runs with the error and the cost of each, and the cheapest of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fecloth import validation
from fecloth.errors import InputError, did_you_mean
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.study.fronts.bench import Bench
from fecloth.study.fronts.drawing import best_rows, is_known
from fecloth.study.fronts.limit import LEAST_LEVELS, Limit, find_limit
from fecloth.study.fronts.result import Front, describe_front
from fecloth.study.fronts.search import Search
from fecloth.study.fronts.settings import PATTERNS, Line, Setting, Settings, make_lines
from fecloth.study.opened import Opened, open_study
from fecloth.study.problem import Asked, StudyProblem, refuse_methods
from fecloth.study.result import Table, read_tolerance
from fecloth.study.runs import Runs, print_doubts, refuse_huge
from fecloth.study.status import OK
from fecloth.study.term_variants import simpler_terms

AXES = ("h", "dt", "method", "element", "pattern", "model", "terms", "gap")
USUAL_AXES = ("h", "dt", "method", "element", "pattern")
SECONDS = 120.0  # CPU time of a front [s]
BEST_LINES = 3  # lines that also run with the other patterns of the mesh
GAPS = (2.0, 4.0)  # by which gaps are divided if they vary

Axes = Sequence[str] | Mapping[str, Sequence | None]


def front(
    problem: Scene | str | Path | Callable | Opened,
    quantity: Asked | Sequence[Asked] | None = None,
    axes: Axes = USUAL_AXES,
    tolerance: float | str = 0.01,
    seconds: float = SECONDS,
    **shared: Any,
) -> Front:
    """Run a problem with other settings, and say what each accuracy costs.

    First the limit of the quantities is found with its uncertainty U: h and dt of one line of
    settings are halved from level to level, as by `converge`, from meshes that are coarser than
    the problem's own. Then settings run in the order of their cost, coarse ones first, until none
    that is left should be cheaper than the cheapest one with error + U within the tolerance.
    Nothing is predicted from another setting but the time of a finer one.

    Parameters
    ----------
    problem
        As for `fecloth.study.of`.
    quantity
        One or more; by default the first of the problem. Of several, the largest error counts.
    axes
        The names of what varies, or a mapping of names to the values to try: "h", "dt", "method",
        "element", "pattern", "model", "terms", "gap". None in place of values stands for the
        usual ones. h and dt are refined where they vary without values; else they are the
        problem's own. "terms" leaves terms out, or replaces them by cheaper ones; "gap" divides
        the gaps of contact. Of a function only its arguments h and dt vary by default.
    tolerance
        Relative error down to which settings are sought.
    seconds
        Longest CPU time of all runs together [s].
    shared
        Arguments of `fecloth.study.of`, as probes and cache. The settings run one after the
        other, as each tells which is next: `jobs` has no effect.

    Returns
    -------
    Front
        With `table`, `limit`, `cheapest(tolerance)`, `needless(tolerance)` and `figure()`.

    Raises
    ------
    InputError
        For an unknown axis or name, an unknown quantity or one of size zero.
    StudyFailed
        If no run on a coarse mesh reaches its end.
    """
    study = open_study(problem, shared)
    largest_error = read_tolerance(tolerance)
    validation.number("seconds", seconds, 0.0, "front")
    values = read_axes(axes)
    opened, runs = study.problem, study.runs()
    refuse_huge(opened, runs)
    refuse_methods(opened, values.get("method"), "front")
    asked = opened.quantities[:1] if quantity is None else quantity
    plan = Plan(
        problem=opened,
        quantities=opened.choose_quantities(asked),
        axes=values,
        tolerance=largest_error,
        seconds=seconds,
        runs=runs,
    )
    doubts = print_doubts(opened)
    return replace(run_front(plan), doubts=doubts)


def read_axes(axes: Axes) -> dict[str, list | None]:
    """Return the values of each axis, None for the usual ones; refuse unknown names."""
    if isinstance(axes, Mapping):
        values = {name: None if v is None else list(v) for name, v in axes.items()}
    else:
        values = dict.fromkeys(axes)
    for name in values:
        if name not in AXES:
            what = f"axis {name!r}"
            allowed = f"must be one of {', '.join(AXES)}"
            raise InputError(what, allowed, "front", did_you_mean(name, AXES))
    return values


@dataclass(frozen=True, eq=False)
class Plan:
    """What a front runs.

    Attributes
    ----------
    problem
        The problem.
    quantities
        What is computed.
    axes
        The values of what varies.
    tolerance
        Largest relative error.
    seconds
        Longest CPU time [s].
    runs
        How cases run.
    study
        The name of the study, by which usual methods are chosen.
    levels
        Least number of levels of the limit.
    finest
        The least h that settings have [m]; None for any. Levels of the limit may be finer.
    """

    problem: StudyProblem
    quantities: tuple[Quantity, ...]
    axes: Mapping[str, list | None]
    tolerance: float
    seconds: float
    runs: Runs
    study: str = "front"
    levels: int = LEAST_LEVELS
    finest: float | None = None

    def names(self, axis: str) -> list | None:
        """Return the names of an axis to try; None for the usual ones, or its own if it stays."""
        if axis in self.axes:
            return self.axes[axis]
        own = {
            "method": self.problem.source.method,
            "element": self.problem.tables["cloth"].get("element", ""),
            "pattern": self.problem.tables["cloth"].get("pattern", ""),
        }
        if axis not in self.problem.source.usual_variations or not own.get(axis):
            return None
        return [own[axis]]

    @property
    def values(self) -> dict[str, list[float]]:
        """The values of h and of dt to try, the coarsest first.

        An axis whose values the search chooses itself has no entry.
        """
        values = {}
        for name, own in (("h", self.problem.h), ("dt", self.problem.dt)):
            given = self.axes.get(name, [own] if own is not None else None)
            if given is not None:
                values[name] = sorted(given, reverse=True)
        return values

    @property
    def changes(self) -> dict[str, dict[str, Any]]:
        """The changes of terms and gaps that vary, as values by name."""
        changes: dict[str, dict[str, Any]] = {"": {}}
        if "terms" in self.axes:
            changes |= {variant.name: dict(variant.values) for variant in self.variants}
        if "gap" in self.axes:
            for divisor in self.axes["gap"] or GAPS:
                terms = enumerate(self.problem.tables["terms"])
                gaps = {f"terms.{i}.gap": t["gap"] / divisor for i, t in terms if "gap" in t}
                changes[f"gaps / {divisor:g}"] = gaps
        return changes

    @property
    def variants(self) -> list:
        """The simpler terms that are tried: those of the axis, or all."""
        asked = self.axes["terms"]
        return [v for v in simpler_terms(self.problem) if asked is None or v.name in asked]

    def lines(self) -> list[Line]:
        """Return the lines of settings, with the terms of the problem."""
        lines = make_lines(
            self.problem,
            None if self.problem.is_static else self.names("method"),
            self.names("element"),
            self.names("model"),
            self.axes.get("pattern") or None,
            study=self.study,
        )
        return lines

    def other_patterns(self, lines: Sequence[Line]) -> list[Line]:
        """Return lines with the other patterns of a rectangle, if the usual patterns vary."""
        own = self.problem.tables["cloth"].get("pattern")
        if not own or self.axes.get("pattern", ()) is not None:
            return []
        if "pattern" not in self.problem.source.usual_variations:
            return []
        return [replace(line, pattern=name) for line in lines for name in PATTERNS if name != own]


def run_front(plan: Plan) -> Front:
    """Find the limit of a plan, run its settings, and return the front."""
    settings = Settings.of(plan.problem, plan.changes, finest=plan.finest)
    how = replace(plan.runs, jobs=1)  # each setting tells which one is next
    bench = Bench(settings, plan.quantities, how, plan.seconds, study=plan.study)
    lines = plan.lines()
    bench.say("stage 1 of 2: the limit, by levels that are ever finer")
    limit = find_limit(bench, lines, plan.tolerance, plan.levels, bench.say)
    if values := plan.values:  # the levels of the limit have other h and dt
        bench = bench.with_settings(replace(settings, values=values))
    search, why = search_lines(plan, bench, limit, lines)
    run_changes(plan, search)
    return make_front(plan, bench, search, why)


def search_lines(
    plan: Plan, bench: Bench, limit: Limit, lines: Sequence[Line], longest: float = float("inf")
) -> tuple[Search, str]:
    """Run the settings of all lines in the order of their cost; say why it ended before, or "".

    The lines that met the tolerance in the least time run with the other patterns, too.
    """
    search = Search(bench, limit, plan.tolerance, longest, report=bench.say)
    if not limit.is_known:
        return search, limit.why_unknown
    bench.say("stage 2 of 2: settings in the order of their cost")
    search.add_lines(lines)
    why = search.run()
    best = sorted(filter(search.meets, bench.rows), key=bench.took)
    best_lines = list(dict.fromkeys(setting.line for setting in best))[:BEST_LINES]
    others = plan.other_patterns(best_lines)
    if others and not why:
        search.add_lines(others)
        why = search.run()
    return search, why


def run_changes(plan: Plan, search: Search) -> None:
    """Run the changes of the terms that vary, in the cheapest setting."""
    cheapest = search.cheapest
    if cheapest is None:
        return
    for name in plan.changes:
        setting = replace(cheapest, line=replace(cheapest.line, terms=name))
        if search.bench.allows(search.bench.took(cheapest)):
            search.bench.run(setting)


def make_front(plan: Plan, bench: Bench, search: Search, why: str) -> Front:
    """Return the result, from the rows of the bench; `why` says why it ended before, or ""."""
    # without a known limit only its levels have run
    rows = make_rows(bench if bench.rows else bench.with_sharper_solver(), search.limit)
    table = Table(tuple(rows))
    limits = search.limit.convergences()
    remarks = []
    if why:
        next_setting = search.next
        words = f"{why[0].upper()}{why[1:]} ({bench.spent:.0f} of {bench.seconds:.0f} CPU s)"
        if next_setting:
            words += f"; the next setting would be {describe_setting(bench, next_setting)}"
        remarks.append(f"{words}.")
    first = next(iter(limits.values()), None)
    return Front(
        title=plan.problem.name,
        verdict=describe_front(table, first, 100 * plan.tolerance),
        table=table,
        quantity=", ".join(quantity.text for quantity in plan.quantities),
        limit=first,
        limits=limits,
        size=float(search.limit.sizes[0]),
        remarks=tuple(remarks),
    )


def describe_setting(bench: Bench, setting: Setting) -> str:
    """Return a setting in words."""
    sizes = []
    choice = bench.settings.choice(setting)
    if "h" in choice:
        sizes.append(f"h = {1e3 * choice['h']:.3g} mm")
    if "dt" in choice:
        sizes.append(f"dt = {1e3 * choice['dt']:.3g} ms")
    if "rtol" in choice:
        sizes.append(f"rtol = {choice['rtol']:g} 1/s")
    return ", ".join(filter(None, [str(setting.line), *sizes]))


def make_rows(bench: Bench, limit: Limit) -> list[dict[str, Any]]:
    """Return the rows of the table: a row for each setting, the cheapest first."""
    rows = [_make_row(bench, limit, setting) for setting in bench.rows]
    best = {id(row) for row in best_rows([row for row in rows if is_known(row)])}
    rows = [{**row, "on front": id(row) in best} for row in rows]
    return sorted(rows, key=lambda row: row.get("seconds", float("inf")))


def _make_row(bench: Bench, limit: Limit, setting: Setting) -> dict[str, Any]:
    """Return the row of a setting: its status, names and sizes, cost and error."""
    row = bench.rows[setting]
    line = setting.line
    problem = row["problem"]
    method = line.method or problem.source.method or "equilibrium"
    cells: dict[str, Any] = {"status": row["status"], "method": method}
    cells["element"] = row.get("element", line.element)
    for name in ("pattern", "model", "terms"):
        if getattr(line, name):
            cells[name] = getattr(line, name)
    cells |= bench.settings.choice_of_sizes(setting)
    if row["status"] != OK:
        return cells | {"cause": row["cause"]}
    if row["step"] == row["step"]:  # an equilibrium has no step
        cells["dt"] = float(f"{row['step']:.9g}")  # without the round-off of times
    cells |= {"triangles": row["triangles"], "steps": row["steps"]}
    cells["seconds"] = row["cpu_seconds"]
    errors = limit.error(row)
    k = int((errors + limit.uncertainty).argmax())
    size = float(limit.sizes[k])
    error, uncertainty = float(errors[k]), float(limit.uncertainty[k])
    cells |= {"error": error * size, "uncertainty": uncertainty * size}
    cells |= {"error %": 100 * error, "uncertainty %": 100 * uncertainty}
    cells["at most %"] = cells["error %"] + cells["uncertainty %"]
    cells["doubts"] = len(row.get("doubts", ()))
    return cells
