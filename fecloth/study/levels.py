"""The runs of a study of convergence: its levels, and one run for each error that they hide."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from fecloth import validation
from fecloth.errors import InputError, did_you_mean
from fecloth.simulation.quantity import Quantity
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Run

# What is refined, and the name of its part of the error.
REFINED = {"h": "mesh", "dt": "time step", "both": "mesh and time step"}
RATIO = 2.0  # of two levels: smaller ones do not separate levels of unstructured meshes
# rtol over rtol of the run that shows the error of chosen steps: the error falls to a fifth, so
# that the change is most of it.
RTOL_RATIO = 10.0
RTOL_ORDER = 2 / 3  # global errors of adaptive steps are about proportional to rtol^(2/3)


def check_levels(refine: str, levels: int, ratio: float | None) -> None:
    """Raise `InputError` for a refinement that no problem has.

    That is an unknown `refine`, less than 3 or more than 10 levels, or a ratio outside of 1.1 to
    10.
    """
    if refine not in REFINED:
        what = f"refine = {refine!r}"
        remedy = did_you_mean(refine, REFINED)
        raise InputError(what, 'must be "h", "dt" or "both"', "converge", remedy)
    validation.whole("levels", levels, 3, "converge", most=10)
    if ratio is not None:
        validation.number("ratio", ratio, 0.0, "converge")
        if not 1.1 <= ratio <= 10:
            raise InputError(f"ratio = {ratio:g}", "must lie between 1.1 and 10", "converge")


def levels_to_run(
    problem: StudyProblem,
    quantity: Quantity,
    refine: str,
    levels: int,
    ratio: float | None = None,
) -> list[Run]:
    """Return the runs of the levels, coarse to fine, and after them those for other errors.

    A finer level of an equilibrium starts from the solution of the level before, and so stays on
    its branch. Where the error, the work or the stability limit chooses dt, a finer level repeats
    the steps of the level before, each in halves. With "both", dt ∝ h^(p/q) for the orders p in
    space and q in time: then the errors of both keep their share. Raise `InputError` for what
    `check_levels` or the problem refuses.
    """
    check_levels(refine, levels, ratio)
    problem.check_refining(refine)
    space_order, time_order = problem.orders(quantity)
    if refine == "dt" and not problem.can_refine("dt"):
        return _halving_levels(problem, quantity, levels, ratio)
    ratio = ratio or RATIO
    ratios = {refine: ratio}
    if refine == "both":
        ratios = {"h": ratio, "dt": ratio ** (space_order / time_order)}
    divisors = [{name: ratio**k for name, ratio in ratios.items()} for k in range(levels)]
    first, *finer = (_level(problem, {}, of_level) for of_level in divisors)
    runs = [first, *(replace(run, follows=problem.is_static) for run in finer)]
    return runs + _runs_for_other_errors(problem, quantity, refine, time_order)


def _halving_levels(
    problem: StudyProblem, quantity: Quantity, levels: int, ratio: float | None
) -> list[Run]:
    """Return the runs of levels that each repeat the steps of the level before in halves."""
    if ratio not in (None, 2.0):
        allowed = "must be 2: each chosen step is taken in halves"
        raise InputError(f"ratio = {ratio:g}", allowed, "converge")
    first = _level(problem, {}, {})
    finer = []
    for parts in (2**k for k in range(1, levels)):
        work = replace(first.work, steps=parts * first.work.steps)
        words = f"each step in {parts} parts"
        finer.append(replace(first, words=words, own_work=work, halves=True))
    _, time_order = problem.orders(quantity)
    return [first, *finer, *_runs_for_other_errors(problem, quantity, "dt", time_order)]


def _level(problem: StudyProblem, cells: Mapping, divisors: Mapping[str, float]) -> Run:
    """Return the run of a problem whose sizes and tolerances are divided by these numbers."""
    parts = [f"{name} / {divisor:.3g}" for name, divisor in divisors.items() if divisor != 1]
    finer = problem.finer(**{"sharper": 1.0, **divisors})
    words = " and ".join(parts).replace("sharper / 100", "a sharper tolerance")
    return Run(finer, words or "the first level", cells)


def _runs_for_other_errors(
    problem: StudyProblem, quantity: Quantity, refine: str, time_order: float
) -> list[Run]:
    """Return up to three runs, each of which is the first level with one other refinement.

    They show the errors that the refined levels do not show. One is finer in dt, if h is
    refined, or in h, if dt is refined. If the error chooses the steps, rtol is divided in place
    of dt. One halves the gaps of contact, if there is contact. One divides the tolerance of the
    solver, if steps in time solve equations.

    An error ∝ s^p of the first level changes by the part 1 − r^−p of itself if the size s is
    divided by r. The cells of the run are the name of the error that it `shows` and this `part`;
    the part of the mesh follows from the edges as meshed, see `other_shares`.
    """
    in_time = not (problem.is_static or quantity.how == "mode")
    runs = []

    def show(error: str, part: float | None, **divisors: float) -> None:
        runs.append(_level(problem, {"shows": error, "part": part}, divisors))

    if in_time and refine == "h" and problem.rtol:
        show("time step", 1 - RTOL_RATIO**-RTOL_ORDER, rtol=RTOL_RATIO)
    elif in_time and refine == "h" and problem.can_refine("dt"):
        show("time step", 1 - 2.0**-time_order, dt=2.0)
    elif in_time and refine == "dt" and problem.can_refine("h"):
        show("mesh", None, h=RATIO)
    if problem.has_contact:
        show("gap", 1 - 1 / 2.0, gap=2.0)  # of first order
    if in_time and not problem.is_explicit:
        show("solver", 1.0, sharper=100.0)  # a hundredth of the tolerance leaves nearly no error
    return runs


def other_shares(
    first: Mapping, others: Sequence[Mapping], changes: Sequence[float], space_order: float
) -> dict[str, float]:
    """Return the estimated errors that the refined levels do not show, by their names.

    Parameters
    ----------
    first
        Row of the first level.
    others, changes
        Rows of the runs for other errors, and how far the quantity is in each from the first
        level. The error is the change over the part of it that the run shows.
    space_order
        Theoretical order in h.
    """
    errors = {}
    for row, change in zip(others, changes, strict=True):
        part = row["part"]
        if part is None:
            part = 1 - (first["edge"] / row["edge"]) ** -space_order
        errors[row["shows"]] = change / part
    return errors
