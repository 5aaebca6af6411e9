"""Regions of a scene: a condition on X and Y that chooses nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fecloth.quantities.formula import Formula


@dataclass(frozen=True)
class Region:
    """A condition on X and Y as a predicate on material points (n, 2) [m]."""

    formula: Formula

    def __repr__(self) -> str:
        return repr(self.formula.text)  # as messages name it

    def __call__(self, X: np.ndarray) -> np.ndarray:
        return np.asarray(self.formula(X=X[:, 0], Y=X[:, 1]))
