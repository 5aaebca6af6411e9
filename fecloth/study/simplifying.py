"""`simplify`: find what a problem does not need, and write the reduced scene."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

from fecloth.errors import FeclothError, InputError
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import relative_difference, size_of
from fecloth.study.command import StudyFailed
from fecloth.study.opened import Opened, open_study
from fecloth.study.problem import StudyProblem
from fecloth.study.refinement import RTOL_ORDER
from fecloth.study.result import Table, read_tolerance
from fecloth.study.runs import (
    Row,
    Run,
    Runs,
    announce,
    print_doubts,
    record_at,
    refuse_huge,
    run_quantities,
)
from fecloth.study.sensitivities import describe_weak_terms
from fecloth.study.simplification_result import (
    Resolution,
    Simplification,
    Trial,
    describe_reduced,
    describe_trials,
    describe_weak_friction,
    judge,
    resolution_of,
)
from fecloth.study.status import NO_VALUE, OK, REFUSED, failure
from fecloth.study.term_variants import Variant, simpler_terms

LARGER = {"h": (1.5, 2.0), "dt": (2.0, 4.0), "rtol": (2.0, 4.0)}  # factors of sizes
SMALLER = {"h": 0.5, "dt": 0.5, "rtol": 0.25}  # factors that show the error of the problem itself
PATIENCE = 3.0  # CPU seconds that a variant may take, over those of the problem itself
# Values of a scene that is the equilibrium to which its motion comes.
AT_REST = {
    "time": None,
    "solver": None,
    "equilibrium": {"load_steps": 1},
    "start.velocity": None,
    "output": {"frames": 1},
    "expect": None,  # which may name times
}


def simplify(
    problem: Scene | str | Path | Callable | Opened,
    tolerance: float | str = 0.01,
    quantity: str | Quantity | Sequence[str | Quantity] | None = None,
    *,
    folder: str | Path | None = None,
    repeats: int = 3,
    **shared: Any,
) -> Simplification:
    """Find the parts of a scene that change its quantities by less than a tolerance; drop them.

    First half of h and half of dt (or a quarter of rtol) show whether the scene itself is
    resolved. Then each term is left out or replaced by a cheaper one, and resolved triangles
    and steps become larger. Changes below the tolerance are combined, the greatest saving per
    change first, as long as the combination stays below the tolerance. The reduced scene is
    run once more.

    Parameters
    ----------
    problem
        As for `of`. The terms of a function's system, its h and its dt are varied, not its
        method.
    tolerance
        Largest relative change of each quantity, as 0.01 or "1%".
    quantity
        One or more; by default all of [interest], the paths of the probes (in a static scene
        their ends), or the displacement.
    folder
        Where reduced.toml is written, for a function a text; None for nowhere.
    repeats
        Runs of each scene of less than about a second; the fastest counts.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache. Seconds of cases that run
        side by side are less certain.

    Raises
    ------
    InputError
        For a tolerance outside 0 to 100 %, an unknown quantity, a function as quantity, or too
        long a time.
    StudyFailed
        If the scene itself fails.
    """
    largest_change = read_tolerance(tolerance)
    study = open_study(problem, shared)
    how = replace(study.runs(), timed=True, repeats=repeats)
    refuse_huge(study.problem, how)
    quantities = study.problem.choose_quantities(quantity)
    if any(quantity.function for quantity in quantities):
        raise InputError("a function as quantity", "must be a text, as 'max tip.z'")
    opened = study.problem.interested_in(quantities)
    doubts = print_doubts(opened)
    weak_terms = describe_weak_terms(opened, quantities, largest_change, replace(how, timed=False))
    if weak_terms:
        print(weak_terms, file=sys.stderr, flush=True)
    variants = [*simpler_terms(opened), *other_sizes(opened), *simpler_steps(opened, quantities)]
    announce([Run(opened, ""), *(_run_of(opened, variant) for variant in variants)], how, stages=2)
    original = run_original(opened, quantities, largest_change, how)
    checks = original.run([variant for variant in variants if variant.is_check])
    resolutions = original.find_resolutions(checks)
    others = original.run([variant for variant in variants if not variant.is_check])
    trials = judge([*checks, *others], resolutions, largest_change)
    found = _summarise(original, trials, resolutions, folder, weak_terms)
    return replace(found, doubts=doubts, scene=found.write_scene(folder))


def sizes_of(problem: StudyProblem) -> dict[str, float]:
    """Return h [m], dt [s] and rtol [1/s], without those that the problem does not have."""
    sizes = {"h": problem.h, "dt": problem.dt, "rtol": problem.rtol}
    return {kind: size for kind, size in sizes.items() if size}


def other_sizes(problem: StudyProblem) -> Iterator[Variant]:
    """Yield the problem with other triangles and steps: a finer size as a check, and larger ones.

    A size that the problem does not have is left out, and so are steps longer than the run.
    """
    for kind, size in sizes_of(problem).items():
        for factor in (SMALLER[kind], *LARGER[kind]):
            # 1e-9 is round-off
            if kind == "dt" and problem.span and size * factor > problem.span * (1 + 1e-9):
                continue
            slot = "mesh" if kind == "h" else "time"
            values = problem.finer_values(**{kind: 1 / factor})
            yield Variant(f"{kind} × {factor:g}", slot, values, kind, factor)


def simpler_steps(problem: StudyProblem, quantities: Sequence[Quantity]) -> Iterator[Variant]:
    """Yield the problem with a simpler element or method.

    These are linear triangles, explicit steps, and a single load step, unless the equilibrium
    depends on how the loads grow. A motion of which only the end counts also becomes an
    equilibrium, unless its pins move or its contact has friction: then its end depends on the
    motion. The element and the method of a function are its own.
    """
    source = problem.source
    tables = problem.tables
    if "element" in source.keys and tables["cloth"].get("element") == "P2":
        yield Variant("P1 for P2", "element", source.values_of({"element": "P1"}), "element")
    if problem.is_static:
        follows_loads = any(bound.load_steps > 1 for bound in problem.first.system.bound)
        if tables["equilibrium"].get("load_steps", 1) > 1 and not follows_loads:
            yield Variant("one load step", "time", {"equilibrium.load_steps": 1}, "load steps")
        return
    if "method" not in tables["time"]:
        return
    if not problem.is_explicit and source.method != "auto":
        values = source.values_of({"method": "central_difference"})
        yield Variant("explicit", "time", values, "method")
    has_moving_pins = any(pin.get("motion") or pin.get("rotate") for pin in tables.get("pins", ()))
    has_friction = any(term.get("friction") for term in tables.get("terms", ()))
    counts_end_only = all(q.how == "value" and q.at is None for q in quantities)
    if counts_end_only and not (has_moving_pins or has_friction):
        yield Variant("equilibrium", "time", AT_REST, "equilibrium")


@dataclass(frozen=True, eq=False)
class Original:
    """The run of the problem itself, with which variants are compared.

    Attributes
    ----------
    quantities
        The quantities that count.
    tolerance
        The largest relative change of each of them.
    how
        How cases are run.
    row
        The row of its run.
    """

    quantities: tuple[Quantity, ...]
    tolerance: float
    how: Runs
    row: Row

    @property
    def problem(self) -> StudyProblem:
        """The problem."""
        return self.row["problem"]

    @property
    def seconds(self) -> float:
        """CPU time of its run [s]."""
        return self.row["cpu_seconds"]

    def run(self, variants: Sequence[Variant], fresh: bool = False) -> list[Trial]:
        """Run variants, and compare each with the problem; `fresh` for runs that are not stored.

        A variant that takes much longer than the problem is cut off, unless it is a check.
        """
        most = round(PATIENCE * self.seconds + 1, 1)  # 1 s against noise
        runs = [_run_of(self.problem, v, None if v.is_check else most) for v in variants]
        how = replace(self.how, fresh=fresh or self.how.fresh)
        rows = run_quantities(runs, self.quantities, how)
        return [self._compare(variant, row) for variant, row in zip(variants, rows, strict=True)]

    def _compare(self, variant: Variant, row: Row) -> Trial:
        """Return a variant with the changes that it makes; with the cause if its run failed."""
        if row["status"] != OK:
            return Trial(variant, {}, failure(row["status"], row["cause"]))
        changes = {}
        try:
            for quantity in self.quantities:
                records = record_at(self.row, quantity), record_at(row, quantity)
                changes[quantity.text] = relative_difference(quantity, *records)
        except FeclothError as error:  # for example, a signal has no period
            return Trial(variant, {}, failure(NO_VALUE, error))
        cells = {
            "change [%]": 100 * max(changes.values()),
            **{f"{text} [%]": 100 * change for text, change in changes.items()},
            "seconds saved": self.seconds - row["cpu_seconds"],
            "saved [%]": 100 * (1 - row["cpu_seconds"] / self.seconds),
            **{name: row[name] for name in ("cpu_seconds", "triangles", "steps", "status")},
        }
        return Trial(variant, changes, cells)

    def find_resolutions(self, checks: Sequence[Trial]) -> list[Resolution]:
        """Return and print whether the problem is resolved in its sizes, by finer runs."""
        resolutions = []
        for check in checks:
            kind = check.variant.kind
            orders = {}
            for quantity in self.quantities:
                order_in_h, order_in_dt = self.problem.orders(quantity)
                orders[quantity.text] = {"h": order_in_h, "dt": order_in_dt}.get(kind, RTOL_ORDER)
            size = sizes_of(self.problem)[kind]
            resolutions.append(resolution_of(check, size, orders, self.tolerance))
            print(resolutions[-1].words, file=sys.stderr, flush=True)
        return resolutions


def run_original(
    problem: StudyProblem, quantities: tuple[Quantity, ...], tolerance: float, how: Runs
) -> Original:
    """Run the problem itself.

    Raise `StudyFailed` if the run fails, and `InputError` if all quantities are zero: then no
    relative change is known.
    """
    (row,) = run_quantities([Run(problem, "the scene")], quantities, how)
    if row["status"] != OK:
        raise StudyFailed(f"{problem.where}: the scene itself fails: {row['cause']}")
    if not any(size_of(quantity, record_at(row, quantity)) for quantity in quantities):
        names = ", ".join(quantity.text for quantity in quantities)
        remedy = "Name another with --quantity or in [interest]."
        raise InputError(f"{names} = 0", "cannot show what changes it", problem.where, remedy)
    return Original(quantities, tolerance, how, row)


def _run_of(problem: StudyProblem, variant: Variant, most: float | None = None) -> Run | Row:
    """Return the run of a variant, of at most so many CPU seconds; a row if it is refused."""
    try:
        changed = problem.at(variant.values, variant.name)
    except InputError as error:
        return failure(REFUSED, error)
    return Run(changed, variant.name, arguments={"most": most} if most else {})


def join(variants: Iterable[Variant], name: str = "") -> Variant:
    """Return the variant that has the values of several, one for each slot."""
    values = dict[str, Any]()
    for variant in variants:
        values |= variant.values
    return Variant(name or " + ".join(v.name for v in variants), "", values, kind="joined")


def combine(original: Original, trials: Sequence[Trial]) -> tuple[dict[str, Variant], list[Trial]]:
    """Take one needless variant after the other, as long as all together change little.

    Those that save most per change come first. Each is run together with all that are taken so
    far, and is taken if that run is worth it, see `Trial.is_worth`. It takes the place of an
    earlier variant of its slot, unless that left out a term.

    Return the variants that are taken, by their slots, and the runs of several variants.
    """
    taken = dict[str, Variant]()
    seconds = original.seconds
    combinations = list[Trial]()
    needless = [trial for trial in trials if trial.verdict == "not needed"]
    for trial in sorted(needless, key=attrgetter("saving_per_change"), reverse=True):
        variant = trial.variant
        if variant.slot in taken and taken[variant.slot].kind == "without":
            continue
        together = {**taken, variant.slot: variant}
        if len(together) > 1:  # alone it has run already
            (trial,) = original.run([join(together.values())])
        is_taken = trial.is_worth(variant, original.tolerance, seconds)
        if len(together) > 1:
            verdict = "combined" if is_taken else "combined, not taken"
            combinations.append(replace(trial, verdict=verdict))
        if is_taken:
            taken = together
            seconds = trial.row["cpu_seconds"]
    return taken, combinations


def _summarise(
    original: Original,
    trials: Sequence[Trial],
    resolutions: Sequence[Resolution],
    folder: str | Path | None,
    weak_terms: str,
) -> Simplification:
    """Combine the needless variants, run the reduced problem once more, and return the result.

    `weak_terms` is a sentence on terms that change little, or "".
    """
    problem = original.problem
    taken, shown = combine(original, trials)
    file = f"reduced.{problem.source.suffix}"
    reduced = join(taken.values(), name=file)
    final = None
    if taken:
        final = replace(original.run([reduced], fresh=True)[0], verdict="reduced scene")
        shown = [*shown, final]
    words = [r.words for r in resolutions if not r.is_resolved] + describe_trials(trials)
    names = " + ".join(variant.name for variant in taken.values())
    words.append(describe_reduced(final, names, file if folder else "the reduced scene"))
    remarks = [weak_terms, describe_weak_friction(problem.first.system, original.row["ends"])]
    remarks += [f"resolved: {r.words}" for r in resolutions if r.is_resolved]
    if problem.h is None:
        remarks.append("whether the mesh is resolved is not known: the scene has no cloth.h")
    return Simplification(
        title=problem.name,
        verdict="\n".join(words),
        table=Table(tuple(trial.cells() for trial in [*trials, *shown])),
        tolerance=original.tolerance,
        quantities=tuple(quantity.text for quantity in original.quantities),
        resolved=all(resolution.is_resolved for resolution in resolutions),
        reduced=problem.at(reduced.values).source.text(),
        file=file,
        change=final.change if final else 0.0,
        saved=final.saved if final else 0.0,
        remarks=tuple(f"{words[0].upper()}{words[1:]}." for words in remarks if words),
    )
