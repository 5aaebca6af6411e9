"""`converge`: the study of convergence of a problem, on uniform or on graded meshes."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.grading import Grading
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import difference_of, value_of
from fecloth.study.convergence import Convergence
from fecloth.study.graded_meshes import alone, choose_gradings
from fecloth.study.opened import Opened, open_study
from fecloth.study.problems import Problem
from fecloth.study.refinement import is_number, refine_problem
from fecloth.study.result import Table
from fecloth.study.run_problems import Runs, end_of, print_warnings, record_at, refuse_huge
from fecloth.study.status import OK
from fecloth.system.space_error import space_error


def converge(
    problem: Scene | str | Path | Callable | Opened,
    quantity: str | Callable[[Any], float] | Quantity | None = None,
    refine: str = "h",
    levels: int = 4,
    *,
    ratio: float | None = None,
    grade: bool = False,
    **shared: Any,
) -> Convergence:
    """Refine a problem level by level; return the quantity with its uncertainty and a verdict.

    The first level has the problem's own h and dt; each further one divides what is refined by
    `ratio`. The uncertainty belongs to the finest level, see `fecloth.study.uncertainty`; to
    it are added the errors that the levels do not show: of the time step, or of the mesh, of
    the solver's tolerance, and of the gaps of contact, each from one more run of the first
    level, times 3 as for two levels (Roache 1994). Fields and paths are judged by the
    differences between levels. Raises `InputError` for a problem that cannot be refined so, an
    unknown quantity, or too long a time; with `grade` for meshes that cannot be graded, or
    without an estimate of the error in space.

    Parameters
    ----------
    problem
        A scene, its path, or a function of h and dt, see `fecloth.study.of`.
    quantity
        A text as in [interest] (see the page of scenes) or a function of the result of `fc.run`,
        by default the first of [interest], the path of the first probe, or the displacement.
    refine
        "h", "dt", or "both" in the ratio that balances their errors, dt ∝ h^(p/q) for the
        orders p and q.
    levels, ratio
        Their number, and h or dt of a level over h or dt of the next level: by default 2, for
        h of unstructured meshes √2.
    grade
        Whether to run the levels again on meshes graded towards corners and pins, as
        `choose_gradings` finds them from the error in space of the first level. Then the
        result is the result on the graded meshes; the table has both, and the verdict says
        what the grading saves. A function takes the gradings as its argument `grading`, for
        the constructor of `Cloth`.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache.
    """
    study = open_study(problem, shared)
    opened = study.problem
    runs = study.runs()
    opened.check(refine)
    refuse_huge(opened, runs)
    warned = print_warnings(opened)
    chosen = opened.choose_quantity(quantity)
    if grade:
        answer = refine_graded(opened, chosen, refine, levels, ratio, runs)
    else:
        answer = refine_problem(opened, chosen, refine, levels, ratio, runs)
    return replace(answer, doubts=warned)


EVEN = "No grading saves 5 % of the triangles: corners and pins have no more error than the rest."
POINT_PINS = (
    "Nodes pinned alone: {}. No mesh is graded towards them, as a membrane has no finite stiffness "
    "at a point."
)


def refine_graded(
    opened: Problem, quantity: Quantity, refine: str, levels: int, ratio: float | None, runs: Runs
) -> Convergence:
    """Run the levels on uniform meshes, find gradings from the first, and run graded levels.

    Both have the same h. All errors are distances to the limit of the graded meshes; of fields,
    paths and vectors to the result of the finest graded mesh, plus its own error.
    """
    _require_gradable(opened, refine)
    runs = replace(runs, timed=True)
    uniform = refine_problem(opened, quantity, refine, levels, ratio, runs)
    if any(row["status"] != OK for row in uniform.levels):
        return uniform
    assert opened.h is not None
    gradings = choose_gradings(opened.first, end_of(uniform.levels[0])[1], opened.h)
    pinned = len(alone(opened.first))
    remarks = (POINT_PINS.format(pinned),) if pinned else ()
    if not gradings:
        return replace(uniform, remarks=(*uniform.remarks, EVEN, *remarks))
    graded = opened.graded(gradings)
    study = refine_problem(graded, quantity, refine, levels, ratio, runs)
    if any(row["status"] != OK for row in study.levels):
        return replace(study, gradings=gradings)
    errors = _errors_of_uniform(quantity, uniform, study)
    compared: list[dict[str, Any]] = [
        {"mesh": "uniform", **row, "error": error}
        for row, error in zip(uniform.table, errors, strict=True)
    ]
    own: list[dict[str, Any]] = [{"mesh": "graded", **row} for row in study.table]
    for row in own:
        if math.isfinite(triangles := _cost_of(row["error"], compared, "triangles")):
            row["uniform_triangles"] = round(triangles)
    others = f"On uniform meshes: {uniform.verdict.splitlines()[0]}"
    return replace(
        study,
        verdict=f"{study.verdict}\n{_saving(own, compared, study.unit)}",
        table=Table((*compared, *own)),
        remarks=(others, *map(_in_words, gradings), *remarks, *study.remarks),
        gradings=gradings,
    )


def _require_gradable(opened: Problem, refine: str) -> None:
    """Raise `InputError` for a problem whose meshes cannot be graded."""
    what = "grade = True"
    where = opened.source
    if refine == "dt":
        raise InputError(what, 'needs refine = "h" or "both"', where)
    if opened.is_explicit:
        remedy = "Take an implicit method."
        allowed = "is not for explicit methods: the smallest edge limits their step"
        raise InputError(what, allowed, where, remedy)
    setup = opened.first
    cloth = opened.first.cloth
    error = space_error(setup.system, setup.start)
    if np.isnan(error.density).all():  # its terms have no estimate, whatever the state
        raise InputError(what, f"needs the error in space: {error.reason}", where)
    point = float(cloth.X[0, 0]), float(cloth.X[0, 1])
    _ = opened.graded([Grading(point=point, distance=cloth.extent)]).first  # refuses by itself


def _errors_of_uniform(quantity: Quantity, uniform: Convergence, study: Convergence) -> list[float]:
    """Return the distance of the uniform levels to the limit, or to the finest graded level."""
    records = [record_at(row, quantity) for row in uniform.levels]
    if is_number(quantity, records[0]):
        return [abs(value_of(quantity, record) - study.limit) for record in records]
    finest = record_at(study.levels[-1], quantity)
    rest = study.table[-1]["error"]
    return [difference_of(quantity, record, finest) + rest for record in records]


def _cost_of(error: float, rows: Sequence[Mapping], key: str) -> float:
    """Return what an error costs by interpolation between levels; NaN beyond them."""
    known = sorted((row["error"], row[key]) for row in rows if row["error"] > 0 and row[key])
    if not (known and known[0][0] <= error <= known[-1][0]):
        return math.nan
    errors, costs = np.log(known).T
    return float(np.exp(np.interp(math.log(error), errors, costs)))


def _saving(graded: Sequence[Mapping], uniform: Sequence[Mapping], unit: str) -> str:
    """Return what the least error that both kinds of meshes reach costs on each."""
    error = max(min(row["error"] for row in rows) for rows in (graded, uniform))
    at_most = "at most " if error > graded[0]["error"] else ""
    own, other = (
        [_cost_of(at, rows, key) for key in ("triangles", "cpu_seconds")]
        for at, rows in ((min(error, graded[0]["error"]), graded), (error, uniform))
    )
    if not np.isfinite([own, other]).all():
        return "What the grading saves is not known: no error is reached by both kinds of meshes."
    times = other[0] / own[0]
    if times > 1:
        saved = f"saves a factor of {times:.2g} in triangles"
    else:
        saved = "saves no triangles"
    return (
        f"The grading {saved}: an error of {f'{error:.2g} {unit}'.strip()} takes {at_most}"
        f"{own[0]:,.0f} triangles and {own[1]:.2g} CPU seconds, on uniform meshes "
        f"{other[0]:,.0f} triangles and {other[1]:.2g} CPU seconds."
    )


def _in_words(grading: Grading) -> str:
    if grading.where:
        place = f'where = "{grading.where}"'
    else:
        place = f"point = {list(grading.point or ())}"
    return f"Graded: {place}, distance = {grading.distance:.4g}, power = {grading.power:g}."
