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
from fecloth.study.tuning.choices import ZERO, Bench, Choice, Trial
from fecloth.study.tuning.curves import Curve

POWERS = 1.0, 3.2  # of the seconds of a step over √triangles
DISTRUST = 1.0  # times the estimated errors: two elements further apart are not yet converged
IRREGULAR = 2.0  # times the tolerance: changes up to this one may be irregular
INSIDE, BORDER = 1 / 3, 1 / 4  # of the mean drop to the neighbours


@dataclass(frozen=True, eq=False)
class Mesh:
    """An element with a pattern: errors in space and seconds of a step over √triangles."""

    choice: Choice  # of its coarsest run; all runs have these steps
    errors: Curve  # over √triangles
    seconds: Curve  # over √triangles
    trials: tuple[Trial, ...]  # coarse to fine

    def choose(self, edges: float) -> Choice:
        """Return the choice whose mesh has about `edges`² triangles."""
        if self.choice.h is None:
            return self.choice
        measured = [trial.edges for trial in self.trials]
        sizes = [trial.choice.h * trial.edges for trial in self.trials if trial.choice.h]
        size = np.exp(np.interp(np.log(edges), np.log(measured), np.log(sizes)))
        return replace(self.choice, h=float(f"{size / edges:.4g}"))


@dataclass(frozen=True, eq=False)
class SpaceErrors:
    """The meshes that serve, and the best known run."""

    meshes: tuple[Mesh, ...]
    reference: Trial  # the best known run
    error: np.ndarray  # its own error, (q,)
    rival: Mesh | None = None  # the other mesh if the two best mostly make the error by differing

    @property
    def most_accurate(self) -> Mesh:
        """The mesh whose finest run has the least error."""
        return min(self.meshes, key=lambda mesh: float(mesh.errors.y[-1].max()))

    def stalls(self, bench: Bench, tolerance: float) -> bool:
        """Whether there is a kind of mesh whose finer meshes do not come closer to each other.

        The last change counts if it is above twice the tolerance. It is compared with the change
        before, of this or of another kind, because one of them may be small by accident.
        """
        runs_of_kinds = [mesh.trials for mesh in self.meshes if len(mesh.trials) > 1]
        pairs = [runs[-3:-1] if len(runs) > 2 else runs for runs in runs_of_kinds]
        before = max((float(bench.distance(b, a).max()) for a, b in pairs), default=0.0)
        for *_, coarser, finest in (runs for runs in runs_of_kinds if len(runs) > 2):
            change = float((bench.distance(finest, coarser) - unsampled(bench, coarser)).max())
            falls = (finest.edges / coarser.edges) ** -curves.STALLED
            if change > IRREGULAR * tolerance and change > before * falls:
                return True
        return False


def summarise_meshes(bench: Bench, trials: Sequence[Trial], orders: np.ndarray) -> SpaceErrors:
    """Return the curves of all meshes: distances to the best run, plus the error of that run."""
    # `orders` are the theoretical orders in h of the quantities on P1 and on P2, (2, q).
    able = [trial for trial in trials if trial.is_ok]
    kinds = curves.grouped(able, lambda trial: trial.choice.mesh, lambda trial: trial.edges)

    def theory(runs: Sequence[Trial]) -> np.ndarray:
        return orders[int(runs[0].choice.element == "P2")]

    finest = [(runs[-1], _own_error(bench, runs, theory(runs))) for runs in kinds]
    (reference, own), *others = sorted(finest, key=lambda pair: pair[1].max())
    error = own
    for trial, its_error in others[:1]:  # they may differ by more than their errors
        apart = bench.distance(reference, trial) - DISTRUST * (own + its_error)
        error = np.fmax(own, apart)
    meshes = []
    for runs in kinds:
        x = [run.edges for run in runs]
        apart = [bench.distance(reference, run) for run in runs]
        errors = curves.error_curve(x, apart, theory(runs), error)
        seconds = curves.cost_curve(x, [run.seconds / run.steps for run in runs], *POWERS)
        meshes.append(Mesh(runs[0].choice, errors, seconds, tuple(runs)))
    is_doubted = error.max() > own.max()
    rivals = [mesh for mesh in meshes if is_doubted and mesh.trials[-1] is others[0][0]]
    return SpaceErrors(tuple(meshes), reference, error, *rivals)


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
        return drop_to_neighbours(trial.cloth, depth) / max(size_of(quantity, record), ZERO)

    return np.array(list(map(error, bench.quantities, trial.records)))


def drop_to_neighbours(cloth: Cloth, depth: np.ndarray) -> float:
    """Return how far the largest of (n,) values at the nodes may lie below the cloth's largest."""
    lowest = int(np.argmax(depth))
    around = np.unique(cloth.parts[(cloth.parts == lowest).any(axis=1)])
    part = INSIDE
    if lowest in (border := cloth.nodes("boundary")):
        around = np.intersect1d(around, border)
        part = BORDER
    return part * float(depth[lowest] - depth[around[around != lowest]].mean())


LEAST_SAVED = 0.4  # share of the triangles, for a family of meshes to be tried


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
        pattern = "unstructured" if choice.pattern else ""
        choices += [replace(choice, pattern=pattern, grading=gradings)] if gradings else []
    return choices
