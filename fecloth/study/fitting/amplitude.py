"""The amplitude of a measured curve over the computed one: a = ln(1 − z·r), see `discrepancy`."""

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fecloth.study.fitting.evaluation import Column
from fecloth.study.fitting.statistics import covariance_of_points
from fecloth.study.problem import StudyProblem

LEAST_PART = -0.99  # of measured/computed − 1, where the signs are opposite
LEAST_SIZE = 1e-6  # of a curve whose amplitude a slack does not hide, over its whole size


@dataclass(frozen=True, eq=False)
class Curve:
    """The amplitude of a measured column.

    Attributes
    ----------
    column
        The column.
    shape
        The same without its amplitudes: what is left of its residuals, and of its repeats.
    direction
        What is the same for columns that measure the same of the same problem.
    x
        (n,) changes of the computed curve in units of σ.
    weights
        (n,) z, so that the amplitude is ln(1 − z·r). They do not see a slack of the specimen.
    amplitudes
        (R,) ln(measured/computed) of each specimen.
    slopes
        (m,) A, the changes of the amplitude by −u.
    """

    column: Column
    shape: Column
    direction: Hashable
    x: np.ndarray
    weights: np.ndarray
    amplitudes: np.ndarray
    slopes: np.ndarray

    @property
    def count(self) -> int:
        """R, the number of specimens."""
        return len(self.amplitudes)

    @property
    def amplitude(self) -> float:
        """The mean amplitude."""
        return float(self.amplitudes.mean())

    @property
    def noise(self) -> float:
        """Variance of the amplitude by the noise of points."""
        return float(covariance_of_points([self.shape], self.weights[None])[0, 0])


def read_curve(column: Column) -> Curve | None:
    """Return the amplitude of a column; None if it has none, as a quantity that does not change."""
    computed = column.computed
    if computed is None:
        return None
    points = column.points
    x = computed.changes / points.sigma
    free_of_slack = x
    slack = computed.along_slope / points.sigma
    if column.specimen.experiment.offset and slack.any():
        free_of_slack = x - slack * (slack @ x) / (slack @ slack)
    size = float(free_of_slack @ free_of_slack)
    if not size > LEAST_SIZE**2 * (x @ x):
        return None
    weights = free_of_slack / size
    larger = -float(weights @ column.residual)  # measured/computed − 1
    shape = column.residual + larger * x
    scatter = None
    if points.scatter is not None:
        own = points.scatter @ (weights / points.sigma)
        parts = larger + own
        scatter = points.scatter - np.outer(own, x * points.sigma)
    else:
        assert points.repeats is not None
        numbers, rows = np.unique(points.repeats, return_inverse=True)
        products = np.bincount(rows, -free_of_slack * column.residual)
        parts = products / np.bincount(rows, free_of_slack**2)
        if len(numbers) > 1:
            shape = column.residual + parts[rows] * x
    rest = replace(column, residual=shape, points=replace(points, scatter=scatter))
    return Curve(
        column=column,
        shape=rest,
        direction=(_identity(column.specimen.problem), points.column),
        x=x,
        weights=weights,
        amplitudes=np.log1p(np.maximum(parts, LEAST_PART)),
        slopes=weights @ column.jacobian,
    )


def _identity(problem: StudyProblem) -> str:
    """Return a text that is the same for the same scene, or for one function and arguments."""
    source: Any = problem.source
    if source.fabrics:
        return repr(source.tables)
    return repr((source.function, source.arguments))
