"""`converge`: the study of convergence of a problem, on uniform or on graded meshes."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.study.convergence import Convergence
from fecloth.study.graded_levels import refine_graded
from fecloth.study.opened import Opened, open_study
from fecloth.study.refinement import refine_problem
from fecloth.study.run_problems import print_warnings, refuse_huge


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
    `ratio`. The uncertainty belongs to the finest level, by the grid convergence index (three
    levels) or least squares (four or more), see `fecloth.study.uncertainty`; to it are added the
    errors that the levels do not show: of the time step, or of the mesh, and of the solver's
    tolerance, each from one more run of the first level, times 3 as for two levels (Roache 1994).
    Steps that their error chooses are run with rtol/10 for it.
    Fields and paths are judged by the differences between levels, whose sum towards the
    finest one takes the place of the values.

    Parameters
    ----------
    problem
        A scene, its path, or a function of h and dt, see `fecloth.study.of`.
    quantity
        A text as in [interest] (see the page of scenes) or a function of the result of `fc.run`,
        by default the first of [interest], the path of the first probe, or the displacement.
    refine
        "h", "dt", or "both" in the ratio that balances their errors, dt ∝ h^(p/q) for the orders p
        and q.
    levels, ratio
        Their number, and h or dt of a level over h or dt of the next level: by default 2, for h of
        unstructured meshes √2.
    grade
        Whether to run the levels again on meshes graded towards corners and pins, as
        `choose_gradings` finds them from the error in space of the first level. Then the result is
        the result on the graded meshes; the table has both, and the verdict says what the grading
        saves. A function takes the gradings as its argument `grading`, for the constructor of
        `Cloth`.
    shared
        Arguments of `fecloth.study.of`: h, dt, t_end, probes, settings; cache, jobs, scheduler,
        time_limit, most_seconds, fresh.

    Raises
    ------
    InputError
        For a problem that cannot be refined so, an unknown quantity, or too long a time; with
        `grade` for meshes that cannot be graded, or without an estimate of the error in space.

    Examples
    --------
    >>> import fecloth as fc
    >>> def strip(h):
    ...     cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
    ...     terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
    ...     system = fc.System(cloth, fc.Fabric(0.2, 20.0), terms, pins=["left"])
    ...     return cloth, system, None, system.rest()
    >>> tip = [fc.Probe("tip", "right")]
    >>> found = fc.study.converge(strip, "tip.x", h=0.25, levels=4, probes=tip)
    >>> print(f"{found.value:.4f}", found.verdict.splitlines()[0][:22])
    1.0450 converges as it should
    """
    study = open_study(problem, shared)
    opened, runs = study.problem, study.runs()
    opened.check(refine)
    refuse_huge(opened, runs)
    warned = print_warnings(opened)
    chosen = opened.choose_quantity(quantity)
    if grade:
        answer = refine_graded(opened, chosen, refine, levels, ratio, runs)
    else:
        answer, _ = refine_problem(opened, chosen, refine, levels, ratio, runs)
    return replace(answer, warnings=warned)
