"""An obstacle whose distance is a formula."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from fecloth.errors import InputError
from fecloth.quantities.formula import Derivative, Formula
from fecloth.quantities.unit_fields import reads_units
from fecloth.quantities.units import LENGTH
from fecloth.terms.contact.shape import Shape, positive

VARIABLES = ("x", "y", "z", "t")


@reads_units
@dataclass(frozen=True)
class Sdf(Shape):
    """All points at which a formula φ(x, y, z, t) is negative.

    φ should be about the distance [m] outside, |∇φ| ≈ 1: elsewhere the gap is gap/|∇φ|. Its
    derivatives are exact, by the chain rule. It need not be convex.

    Parameters
    ----------
    formula
        Formula of x, y, z [m] and t [s]; a shape that deforms in time pushes along its normal.
    radius
        The least radius with which it curves outwards [m], which says how many points inside
        triangles are needed; None for a shape with edges.
    motion
        Displacement [m], three formulas of t; only its changes count.
    rotate
        `Rotation` about an axis that moves along; only the changes of its angle count.

    Examples
    --------
    >>> Sdf("z - 0.02*sin(20*x)").distance(np.array([[0.0, 0.0, 0.1]]), 0.0)
    array([0.1])
    """

    formula: str
    radius: Annotated[float | None, LENGTH] = None

    convex = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.radius is not None:
            positive("radius", self.radius, "Sdf")
        try:
            _ = self._formula
        except InputError as error:
            raise InputError(error.what, error.allowed, "Sdf", error.remedy) from None

    @cached_property
    def deforms(self) -> bool:  # type: ignore[override]  # constant in the base, here computed
        """Whether t occurs in the formula."""
        return re.search(r"\bt\b", self.formula) is not None

    @property
    def radius_of_curvature(self) -> float:
        return self.radius or 0.0

    @cached_property
    def _formula(self) -> Formula:
        if not isinstance(self.formula, str):
            allowed = f"must be a formula of {', '.join(VARIABLES)}"
            raise InputError(f"formula = {self.formula!r}", allowed, "Sdf")
        return Formula(self.formula, VARIABLES)

    @cached_property
    def _derivatives(self) -> tuple[list[Derivative], list[list[Derivative]]]:
        first = [self._formula.derivative(variable) for variable in VARIABLES[:3]]
        return first, [[one.derivative(by) for by in VARIABLES[:3]] for one in first]

    def distance(self, y: np.ndarray, t: float) -> np.ndarray:
        return _at(self._formula, y, t)

    def slopes(self, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        first, second = self._derivatives
        gradient = np.stack([_at(part, y, t) for part in first], axis=-1)
        rows = [np.stack([_at(part, y, t) for part in row], axis=-1) for row in second]
        return gradient, np.stack(rows, axis=1)

    def time_rate(self, y: np.ndarray, t: float) -> np.ndarray:
        """(m,) ∂φ/∂t [m/s]."""
        return _at(self._formula.derivative("t"), y, t)


def _at(formula: Formula | Derivative, y: np.ndarray, t: float) -> np.ndarray:
    named = dict(zip(VARIABLES, (*y.T, np.full(len(y), t)), strict=True))
    return np.asarray(formula(**named))
