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

        The last change counts if it is above twice the tolerance. It is compared with the change
        before, of this or of another kind, because one of them may be small by accident.
        """
        refined = [mesh.trials for mesh in self.meshes if len(mesh.trials) > 1]
        twice_refined = [runs for runs in refined if len(runs) > 2]
        before = 0.0
        for runs in refined:
            coarser, finer = runs[-3:-1] if len(runs) > 2 else runs
            before = max(before, float(bench.distance(finer, coarser).max()))
        for *_, coarser, finest in twice_refined:
            change = bench.distance(finest, coarser) - unsampled(bench, coarser)
            allowed = before * (finest.edges / coarser.edges) ** -curves.STALLED_ORDER
            if change.max() > max(IRREGULAR_CHANGE * tolerance, allowed):
                return True
        return False


def summarise_meshes(bench: Bench, trials: Sequence[Trial], orders: np.ndarray) -> SpaceErrors:
    """Return the curves of all meshes: distances to the best run, plus the error of that run.

    `orders` are the theoretical orders in h of the quantities on P1 and on P2, (2, q).
    """
    able = [trial for trial in trials if trial.is_ok]
    kinds = curves.grouped(able, lambda trial: trial.choice.mesh, lambda trial: trial.edges)

    def theory(runs: Sequence[Trial]) -> np.ndarray:
        return orders[int(runs[0].choice.element == "P2")]

    finest = [(runs[-1], _own_error(bench, runs, theory(runs))) for runs in kinds]
    (reference, own), *others = sorted(finest, key=lambda pair: pair[1].max())
    error = own
    second = None
    if others:  # the two best runs may differ by more than both errors
        second, error_of_second = others[0]
        error = np.fmax(own, bench.distance(reference, second) - (own + error_of_second))
    meshes = []
    for runs in kinds:
        edges = [run.edges for run in runs]
        apart = [bench.distance(reference, run) for run in runs]
        seconds = [run.seconds / run.steps for run in runs]
        mesh = Mesh(
            choice=runs[0].choice,
            errors=curves.error_curve(edges, apart, theory(runs), error),
            seconds=curves.cost_curve(edges, seconds, LEAST_POWER_OF_STEP, LARGEST_POWER_OF_STEP),
            trials=tuple(runs),
        )
        meshes.append(mesh)
    rival = None
    if error.max() > own.max():
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
    """Return how far the cloth may reach below its lowest node, by the (n,) depths of nodes."""
    lowest = int(np.argmax(depth))
    around = np.unique(cloth.parts[(cloth.parts == lowest).any(axis=1)])
    part = DROP_INSIDE
    border = cloth.nodes("boundary")
    if lowest in border:
        around = np.intersect1d(around, border)
        part = DROP_ON_BORDER
    neighbours = around[around != lowest]
    return part * float(depth[lowest] - depth[neighbours].mean())


def graded_choices(opened: Problem, trials: Sequence[Trial]) -> list[Choice]:
    """Return the choices of the first trial of each element, with gradings that save triangles.

    There are none for explicit steps, which the smallest edge limits, for functions, for scenes
    with their own gradings, and where the error in space has no estimate or is too even.
    """
    if isinstance(opened, FunctionProblem) or opened.scene.cloth.grading:
        return []
    first: dict[str, Trial] = {}
    for trial in trials:
        if trial.is_ok and not trial.choice.is_explicit and trial.choice.h:
            first.setdefault(trial.choice.element, trial)
    choices = []
    for trial in first.values():
        choice = trial.choice
        setup = trial.row["point"].problem.first
        try:
            gradings = choose_gradings(setup, end_of(trial.row)[1], choice.h or 0.0, LEAST_SAVED)
        except InputError:  # no estimate of the error, or a shape that takes no grading
            continue
        if gradings:
            pattern = "unstructured" if choice.pattern else ""
            choices.append(replace(choice, pattern=pattern, grading=gradings))
    return choices
