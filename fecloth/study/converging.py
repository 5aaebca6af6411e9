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
from fecloth.simulation.quantity_values import difference_of, is_number, value_of
from fecloth.study.convergence import Convergence
from fecloth.study.graded_meshes import choose_gradings, find_lone_pins
from fecloth.study.levels import check_levels
from fecloth.study.opened import Opened, open_study
from fecloth.study.problem import StudyProblem
from fecloth.study.refinement import refine_problem
from fecloth.study.result import Table
from fecloth.study.runs import Runs, end_of, record_at
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
        orders p and q. Where the error, the work or the stability limit chooses dt, a level of
        "dt" repeats the steps of the level before, each in halves.
    levels, ratio
        Their number, and h or dt of a level over h or dt of the next level: by default 2.
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
    check_levels(refine, levels, ratio)
    study.problem.check_refining(refine)
    opened, how, doubts = study.begin()
    chosen_quantity = opened.choose_quantity(quantity)
    refined = refine_graded if grade else refine_problem
    convergence = refined(opened, chosen_quantity, refine, levels, ratio, how)
    return replace(convergence, doubts=tuple(dict.fromkeys([*doubts, *convergence.doubts])))


COSTS = ("triangles", "cpu_seconds")
NO_GRADING = (
    "No grading saves 5 % of the triangles: corners and pins have no more error than the rest."
)
LONE_PINS = (
    "Nodes pinned alone: {}. No mesh is graded towards them, as a membrane has no finite "
    "stiffness at a point."
)


def refine_graded(
    problem: StudyProblem,
    quantity: Quantity,
    refine: str,
    levels: int,
    ratio: float | None,
    how: Runs,
) -> Convergence:
    """Run the levels on uniform meshes, find gradings from the first, and run graded levels.

    Both have the same h. All errors are distances to the limit of the graded meshes. Fields,
    paths and vectors have no limit: there the error is the distance to the finest graded mesh,
    plus the error of that mesh.

    Return the result on the graded meshes. Return the result on the uniform meshes if a run on
    them failed, or if no grading saves enough triangles. Raise `InputError` for a problem whose
    meshes cannot be graded.
    """
    _require_gradable(problem, refine)
    how = replace(how, timed=True)  # the verdict compares CPU seconds
    uniform = refine_problem(problem, quantity, refine, levels, ratio, how, stages=2)
    if uniform.estimate is None:
        return uniform
    assert problem.h is not None
    _, end_state = end_of(uniform.levels[0])
    gradings = choose_gradings(problem.first, end_state, problem.h)
    remarks = []
    if lone_pins := len(find_lone_pins(problem.first)):
        remarks.append(LONE_PINS.format(lone_pins))
    if not gradings:
        return replace(uniform, remarks=(*uniform.remarks, NO_GRADING, *remarks))
    graded = refine_problem(problem.graded(gradings), quantity, refine, levels, ratio, how)
    if not graded.has_limit:
        return replace(graded, gradings=gradings)
    errors = _errors_of_uniform(quantity, uniform, graded)
    uniform_rows: list[dict[str, Any]] = [
        {"mesh": "uniform", **row, "error": error}
        for row, error in zip(uniform.table, errors, strict=True)
    ]
    graded_rows: list[dict[str, Any]] = [{"mesh": "graded", **row} for row in graded.table]
    saving = _describe_saving(graded_rows, uniform_rows, graded.unit)
    on_uniform = f"On uniform meshes: {uniform.verdict.splitlines()[0]}"
    return replace(
        graded,
        verdict=f"{graded.verdict}\n{saving}",
        table=Table((*uniform_rows, *graded_rows)),
        remarks=(on_uniform, *map(_describe_grading, gradings), *remarks, *graded.remarks),
        gradings=gradings,
    )


def _require_gradable(problem: StudyProblem, refine: str) -> None:
    """Raise `InputError` for a problem whose meshes cannot be graded.

    That is a refinement of the step alone, an explicit method, terms without an estimate of the
    error in space, and a problem that takes no gradings.
    """
    what = "grade = True"
    where = problem.where
    if refine == "dt":
        raise InputError(what, 'needs refine = "h" or "both"', where)
    if problem.is_explicit:
        remedy = "Take an implicit method."
        allowed = "is not for explicit methods: the smallest edge limits their step"
        raise InputError(what, allowed, where, remedy)
    setup = problem.first
    error = space_error(setup.system, setup.start)
    if np.isnan(error.density).all():  # its terms have no estimate, whatever the state
        raise InputError(what, f"needs the error in space: {error.reason}", where)
    any_node = float(setup.cloth.X[0, 0]), float(setup.cloth.X[0, 1])
    trial = Grading(point=any_node, distance=setup.cloth.extent)
    _ = problem.graded([trial]).first  # a problem that takes no gradings refuses this one


def _errors_of_uniform(
    quantity: Quantity, uniform: Convergence, graded: Convergence
) -> list[float]:
    """Return the distance of the uniform levels to the limit, or to the finest graded level."""
    records = [record_at(row, quantity) for row in uniform.levels]
    if is_number(quantity, records[0]):
        return [abs(value_of(quantity, record) - graded.limit) for record in records]
    finest = record_at(graded.levels[-1], quantity)
    error_of_finest = graded.table[-1]["error"]
    return [difference_of(quantity, record, finest) + error_of_finest for record in records]


def _cost_of(error: float, rows: Sequence[Mapping], key: str) -> float:
    """Return how many triangles or seconds (`key`) a mesh with this error has.

    It is interpolated between the rows of a kind of meshes, linearly in the logarithms. Beyond
    their errors it is the cost of the coarsest or of the finest mesh.
    """
    points = sorted((row["error"], row[key]) for row in rows if row["error"] > 0 and row[key])
    errors, costs = np.log(points).T
    return float(np.exp(np.interp(math.log(error), errors, costs)))


def _describe_saving(graded: Sequence[Mapping], uniform: Sequence[Mapping], unit: str) -> str:
    """Return a sentence on the cost of the same error on graded and on uniform meshes.

    The error is the least one that both kinds of meshes reach, in `unit`. The arguments
    `graded` and `uniform` are the rows of both.
    """
    error = max(min(row["error"] for row in rows) for rows in (graded, uniform))
    if not error > 0:
        return "What the grading saves is not known: the finest meshes have no error."
    costs = [_cost_of(error, rows, key) for rows in (graded, uniform) for key in COSTS]
    triangles, seconds, uniform_triangles, uniform_seconds = costs
    saved = "saves no triangles"
    if uniform_triangles > triangles:
        saved = f"saves a factor of {uniform_triangles / triangles:.2g} in triangles"
    size = f"{error:.2g} {unit}".strip()
    return (
        f"The grading {saved}: an error of at most {size} takes {triangles:,.0f} triangles and "
        f"{seconds:.2g} CPU seconds, on uniform meshes {uniform_triangles:,.0f} triangles and "
        f"{uniform_seconds:.2g} CPU seconds."
    )


def _describe_grading(grading: Grading) -> str:
    """Return a sentence with the place, the distance and the power of a grading."""
    if grading.where:
        place = f'where = "{grading.where}"'
    else:
        place = f"point = {list(grading.point or ())}"
    return f"Graded: {place}, distance = {grading.distance:.4g}, power = {grading.power:g}."
