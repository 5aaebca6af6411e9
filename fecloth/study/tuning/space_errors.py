"""The error in space of each element and pattern, with the same steps on all meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.study.tuning.choices import Choice
from fecloth.study.tuning.curves import (
    STALLED,
    Curve,
    cost_curve,
    error_curve,
    error_of_finest,
    grouped,
)
from fecloth.study.tuning.sampled_extremes import unsampled
from fecloth.study.tuning.trials import Bench, Trial

POWERS = 1.0, 3.2  # of the seconds of a step over √triangles
DISTRUST = 1.0  # times the estimated errors: two elements further apart are not yet converged


@dataclass(frozen=True, eq=False)
class Mesh:
    """An element with a pattern: errors in space and seconds of a step over √triangles."""

    # The element, the pattern and h of its coarsest run, with the steps of all its runs.
    choice: Choice
    # Curves over √triangles.
    errors: Curve
    seconds: Curve
    trials: tuple[Trial, ...]  # the runs, coarse to fine

    def choose(self, edges: float) -> Choice:
        """Return the choice whose mesh has about `edges`² triangles."""
        if self.choice.h is None:
            return self.choice
        measured = [one.edges for one in self.trials]
        sizes = [one.choice.h * one.edges for one in self.trials if one.choice.h is not None]
        size = np.exp(np.interp(np.log(edges), np.log(measured), np.log(sizes)))
        return replace(self.choice, h=float(f"{size / edges:.4g}"))


@dataclass(frozen=True, eq=False)
class SpaceErrors:
    """The meshes that serve, and the best known run.

    Attributes
    ----------
    meshes, trials
        The meshes, and all runs.
    reference, error
        The best known run, and its own error, (q,).
    rival
        The other mesh if the error is mostly what the two best meshes differ by; else None.
    """

    meshes: tuple[Mesh, ...]
    reference: Trial
    error: np.ndarray
    trials: tuple[Trial, ...]
    rival: Mesh | None = None

    def stalls(self, bench: Bench, tolerance: float) -> bool:
        """Whether there is a kind of mesh of which finer ones do not come closer to each other.

        The last change counts if it is above twice the tolerance. It is compared with the change
        before, of this or of another kind, because one of them may be small by accident.
        """
        pairs = [one.trials[-3:-1] for one in self.meshes if len(one.trials) > 2]
        pairs += [one.trials for one in self.meshes if len(one.trials) == 2]
        before = max((float(bench.distance(b, a).max()) for a, b in pairs), default=0.0)
        for runs in (one.trials for one in self.meshes if len(one.trials) > 2):
            apart = bench.distance(runs[-1], runs[-2]) - unsampled(bench, runs[-2])
            change = float(apart.max())
            ratio = runs[-1].edges / runs[-2].edges
            if change > 2 * tolerance and change > before * ratio**-STALLED:
                return True
        return False


def summarise_meshes(bench: Bench, trials: Sequence[Trial], orders: np.ndarray) -> SpaceErrors:
    """Return the curves of all meshes: distances to the best run, plus the error of that.

    `orders` are the theoretical orders in h of the quantities on P1 and on P2, (2, q).
    """
    good = [one for one in trials if one.is_ok]
    kinds = grouped(good, lambda one: one.choice.mesh, lambda one: one.edges)
    finest = [(runs[-1], _own_error(bench, runs, _theory(runs, orders))) for runs in kinds]
    reference, own = min(finest, key=lambda pair: pair[1].max())
    others = [pair for pair in finest if pair[0] is not reference]
    other = min(others, key=lambda pair: pair[1].max(), default=None)
    error = np.maximum(own, _disagreement(bench, reference, own, other))
    meshes = []
    for runs in kinds:
        x = [one.edges for one in runs]
        apart = [
            bench.distance(reference, one) if one is not reference else 0 * error for one in runs
        ]
        errors = error_curve(x, apart, _theory(runs, orders), error)
        seconds = cost_curve(x, [one.seconds / one.steps for one in runs], *POWERS)
        meshes.append(Mesh(runs[0].choice, errors, seconds, tuple(runs)))
    rival = None
    if other is not None and error.max() > own.max():
        rival = next(one for one in meshes if one.trials[-1] is other[0])
    return SpaceErrors(tuple(meshes), reference, error, tuple(trials), rival)


def _theory(runs: Sequence[Trial], orders: np.ndarray) -> np.ndarray:
    return orders[int(runs[0].choice.element == "P2")]


def _own_error(bench: Bench, runs: Sequence[Trial], theory: np.ndarray) -> np.ndarray:
    """Return the error of the finest run of a mesh; 1 of a single run."""
    if len(runs) < 2:
        return np.ones(len(theory))
    sizes = [one.edges for one in runs]
    return error_of_finest(bench.distance, runs, sizes, theory) + unsampled(bench, runs[-1])


def _disagreement(
    bench: Bench, reference: Trial, error: np.ndarray, other: tuple[Trial, np.ndarray] | None
) -> np.ndarray:
    """Return what the best run and the next best differ by beyond their estimated errors."""
    if other is None:
        return np.zeros(len(error))
    trial, its_error = other
    apart = bench.distance(reference, trial)
    expected = DISTRUST * (error + its_error)
    return np.where(apart > expected, apart - expected, 0.0)
