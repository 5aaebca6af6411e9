"""The error in space of each element and pattern, with the same steps on all meshes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord, size_of
from fecloth.study.graded_meshes import choose_gradings
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.run_problems import end_of
from fecloth.study.tuning import curves
from fecloth.study.tuning.choices import ZERO_SIZE, Bench, Choice, Trial
from fecloth.study.tuning.curves import Curve

# The seconds of a step grow with this power of √triangles: 2 where all work is linear in the
# number of triangles, less where a step has a fixed cost, more by the solution of its equations.
LEAST_POWER_OF_STEP = 1.0
LARGEST_POWER_OF_STEP = 3.2
# Changes by finer meshes, over the tolerance, that may be irregular: they prove no stall.
IRREGULAR_CHANGE = 2.0
LEAST_SAVED = 0.4  # share of the triangles, for a family of graded meshes to be tried
# How far the lowest point may lie below the lowest node, over the mean drop from the node to its
# neighbours; see `unsampled`.
DROP_INSIDE = 1 / 3
DROP_ON_BORDER = 1 / 4


@dataclass(frozen=True, eq=False)
class Mesh:
    """An element with a pattern: errors in space and seconds of a step.

    Attributes
    ----------
    choice
        The choice of its coarsest run; all runs have these steps.
    errors
        Errors in space over √triangles.
    seconds
        Seconds of a step over √triangles.
    trials
        Its runs, coarse to fine.
    """

    choice: Choice
    errors: Curve
    seconds: Curve
    trials: tuple[Trial, ...]

    def choose(self, edges: float) -> Choice:
        """Return the choice whose mesh has about `edges`² triangles."""
        if self.choice.h is None:
            return self.choice
        measured = [trial.edges for trial in self.trials]
        h_times_edges = [trial.choice.h * trial.edges for trial in self.trials if trial.choice.h]
        product = np.exp(np.interp(np.log(edges), np.log(measured), np.log(h_times_edges)))
        return replace(self.choice, h=float(f"{product / edges:.4g}"))


@dataclass(frozen=True, eq=False)
class SpaceErrors:
    """The meshes that serve, and the best known run.

    Attributes
    ----------
    meshes
        All meshes of which a run reached its end.
    reference
        The best known run.
    error
        Its own error, (q,).
    rival
        The mesh of the second-best run, where its disagreement with the best run is more than
        the error that the best run has by itself; else None.
    """

    meshes: tuple[Mesh, ...]
    reference: Trial
    error: np.ndarray
    rival: Mesh | None = None

    @property
    def most_accurate(self) -> Mesh:
        """The mesh whose finest run has the least error."""
        return min(self.meshes, key=lambda mesh: float(mesh.errors.y[-1].max()))

    def stalls(self, bench: Bench, tolerance: float) -> bool:
        """Whether there is a kind of mesh whose finer meshes do not come closer to each other.

        This is so if the change by the last refinement is above twice the tolerance and has not
        fallen, with an order of `curves.STALLED_ORDER`, from the change before. The largest
        change before of all kinds of meshes counts, because the change of one kind may be small
        by accident.
        """
        refined = [mesh.trials for mesh in self.meshes if len(mesh.trials) > 1]
        twice_refined = [runs for runs in refined if len(runs) > 2]
        change_before = 0.0
        for runs in refined:
            # the refinement before the last one, or the only one
            coarser, finer = runs[-3:-1] if len(runs) > 2 else runs
            change_before = max(change_before, float(bench.distance(finer, coarser).max()))
        for *_, coarser, finest in twice_refined:
            # the sag of both may be off, because it is taken at nodes: this proves no stall
            change = bench.distance(finest, coarser) - unsampled(bench, coarser)
            ratio = finest.edges / coarser.edges
            allowed = change_before * ratio**-curves.STALLED_ORDER
            if change.max() > max(IRREGULAR_CHANGE * tolerance, allowed):
                return True
        return False


def summarise_meshes(bench: Bench, trials: Sequence[Trial], orders: np.ndarray) -> SpaceErrors:
    """Return the errors in space of all kinds of meshes, from their runs.

    `trials` are the runs; failed ones are left out. `orders` (2, q) are the theoretical orders
    in h of the quantities on P1 and on P2.

    The best run is the finest run of a kind whose own error is least. The errors of the others
    are their distances to it, plus its own error. If the best and the second-best run differ by
    more than both errors, the excess counts as the error of the best run, where it is larger.
    """
    finished = [trial for trial in trials if trial.is_ok]
    kinds = curves.grouped(
        finished, group=lambda trial: trial.choice.mesh, size=lambda trial: trial.edges
    )

    def theory(runs: Sequence[Trial]) -> np.ndarray:
        return orders[int(runs[0].choice.element == "P2")]

    finest = [(runs[-1], _own_error(bench, runs, theory(runs))) for runs in kinds]
    (reference, own_error), *others = sorted(finest, key=lambda pair: pair[1].max())
    error = own_error
    second = None
    if others:
        second, error_of_second = others[0]
        unexplained = bench.distance(reference, second) - (own_error + error_of_second)
        error = np.fmax(own_error, unexplained)
    meshes = []
    for runs in kinds:
        edges = [run.edges for run in runs]
        distances = [bench.distance(reference, run) for run in runs]
        seconds = [run.seconds / run.steps for run in runs]
        mesh = Mesh(
            choice=runs[0].choice,
            errors=curves.error_curve(edges, distances, theory(runs), error),
            seconds=curves.cost_curve(edges, seconds, LEAST_POWER_OF_STEP, LARGEST_POWER_OF_STEP),
            trials=tuple(runs),
        )
        meshes.append(mesh)
    rival = None
    if error.max() > own_error.max():
        rival = next((mesh for mesh in meshes if mesh.trials[-1] is second), None)
    return SpaceErrors(tuple(meshes), reference, error, rival)


def _own_error(bench: Bench, runs: Sequence[Trial], theory: np.ndarray) -> np.ndarray:
    """Return the error of the finest run of a mesh; 1 of a single run."""
    if len(runs) < 2:
        return np.ones(len(theory))
    own = curves.error_of_finest(bench.distance, runs, [run.edges for run in runs], theory)
    return own + unsampled(bench, runs[-1])


def unsampled(bench: Bench, trial: Trial) -> np.ndarray:
    """Return (q,) relative errors of `sag` because it is taken at a node; 0 of other quantities.

    Two meshes may have nodes equally near to the lowest point by accident, so that their values
    agree although both are wrong. Where the cloth is round, −½ κ r² about its lowest point, the
    nodes around any node lie ½ κ h² deeper on average than it, and the lowest point is at most
    h/√3 from a node: a third of this drop. On the border it is h/2: a quarter.
    """

    def error(quantity: Quantity, record: RunRecord) -> float:
        if quantity.name != "sag":
            return 0.0
        depth = -np.array(trial.row["displacement"])[:, 2]
        return drop_to_neighbours(trial.cloth, depth) / max(size_of(quantity, record), ZERO_SIZE)

    return np.array(list(map(error, bench.quantities, trial.records)))


def drop_to_neighbours(cloth: Cloth, depth: np.ndarray) -> float:
    """Return how far the cloth may reach below its lowest node [m]; see `unsampled`.

    `depth` (n,) are the depths of the nodes [m]. The result is a part of the mean height of the
    neighbours above the lowest node. For a node on the border, only neighbours on the border
    count.
    """
    lowest = int(np.argmax(depth))
    has_lowest = (cloth.parts == lowest).any(axis=1)
    nodes_around = np.unique(cloth.parts[has_lowest])
    part = DROP_INSIDE
    border = cloth.nodes("boundary")
    if lowest in border:
        nodes_around = np.intersect1d(nodes_around, border)
        part = DROP_ON_BORDER
    neighbours = nodes_around[nodes_around != lowest]
    return part * float(depth[lowest] - depth[neighbours].mean())


def graded_choices(opened: Problem, trials: Sequence[Trial]) -> list[Choice]:
    """Return choices with graded meshes, which have small triangles only where errors are large.

    For each element it is the choice of its first trial that ran, with the gradings that the
    error of this trial asks for. There is none where gradings would save too few triangles or
    the error has no estimate, for explicit steps, which the smallest edge limits, for functions,
    and for scenes with gradings of their own.
    """
    if isinstance(opened, FunctionProblem) or opened.scene.cloth.grading:
        return []
    first_trials: dict[str, Trial] = {}  # by element
    for trial in trials:
        if trial.is_ok and not trial.choice.is_explicit and trial.choice.h:
            first_trials.setdefault(trial.choice.element, trial)
    choices = []
    for trial in first_trials.values():
        choice = trial.choice
        setup = trial.row["point"].problem.first
        end_state = end_of(trial.row)[1]
        try:
            gradings = choose_gradings(setup, end_state, choice.h or 0.0, LEAST_SAVED)
        except InputError:  # no estimate of the error, or a shape that takes no grading
            continue
        if gradings:
            # only an unstructured mesh can be graded; "" is a mesh without a pattern
            pattern = "unstructured" if choice.pattern else ""
            choices.append(replace(choice, pattern=pattern, grading=gradings))
    return choices
