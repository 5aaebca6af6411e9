"""Derivatives ∂C and ∂²C of a user's condition: the user's functions, or finite differences."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fecloth.errors import InputError

STEP = 1e-3  # of the differences, relative to the size of the stencil
TOLERANCE = 1e-6  # of a user's derivative against differences, relative to the largest entry
WEIGHTS = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))  # central, of order 4

Function = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Derivatives:
    """C, ∂C and ∂²C of the stencils, from the functions of the user."""

    # The user's functions, or None.
    value: Function
    gradient: Function | None
    hessian: Function | None
    size: np.ndarray  # (m,) of each stencil [m]
    r: int  # number of components of C
    name: str  # of the term, for errors

    def C(self, y: np.ndarray) -> np.ndarray:
        """(m, r)."""
        return np.asarray(self.value(y), dtype=float).reshape(len(y), self.r)

    def dC(self, y: np.ndarray) -> np.ndarray:
        """(m, r, k, 3)."""
        if self.gradient is None:
            return self.differentiate(self.C, y)
        return self._check_shape("gradient", self.gradient(y), y, 1)

    def ddC(self, y: np.ndarray) -> np.ndarray:
        """(m, r, k, 3, k, 3)."""
        if self.hessian is not None:
            return self._check_shape("hessian", self.hessian(y), y, 2)
        H = self.differentiate(self.dC, y)
        return 0.5 * (H + H.transpose(0, 1, 4, 5, 2, 3))

    def differentiate(self, function: Function, y: np.ndarray) -> np.ndarray:
        """Differentiate a function (m, k, 3) → (m, …) by y with `WEIGHTS`: (m, …, k, 3)."""
        m, k, _ = y.shape
        h = STEP * self.size[:, None, None]
        columns = []
        for dof in np.eye(3 * k).reshape(3 * k, k, 3):
            column = np.asarray(sum(weight * function(y + s * h * dof) for s, weight in WEIGHTS))
            columns.append(column / h.reshape(m, *[1] * (column.ndim - 1)))
        return np.stack(columns, axis=-1).reshape(*columns[0].shape, k, 3)

    def beside(self, rest: np.ndarray) -> np.ndarray:
        """(m, k, 3) positions in a state near rest, like no other."""
        noise = np.random.default_rng(0).standard_normal(rest.shape)
        return rest + 0.05 * self.size[:, None, None] * noise

    def is_objective(self, rest: np.ndarray) -> bool:
        """Whether ∂C has no resultant and no moment, as no rigid motion changes C."""
        y = self.beside(rest)
        arms = (y - y.mean(axis=1, keepdims=True))[:, None]
        g = self.dC(y)
        moments = np.cross(arms, g)
        return all(
            (np.abs(parts.sum(axis=2)) <= TOLERANCE * np.abs(parts).max()).all()
            for parts in (g, moments)
        )

    def check(self, rest: np.ndarray) -> None:
        """Compare the user's derivatives with differences, in a state near rest."""
        y = self.beside(rest)
        pairs = ("gradient", self.dC, self.C), ("hessian", self.ddC, self.dC)
        for name, function, below in pairs:
            if getattr(self, name) is None:
                continue
            values = function(y)
            expected = self.differentiate(below, y)
            wrong = np.abs(values - expected) - TOLERANCE * np.abs(expected).max()
            at = np.unravel_index(int(np.argmax(np.nan_to_num(wrong, nan=np.inf))), wrong.shape)
            if not wrong[at] <= 0:
                what = f"{name}[{', '.join(str(int(i)) for i in at)}] = {values[at]:.9g}"
                of = "value" if name == "gradient" else "the gradient"
                allowed = f"differences of {of} give {expected[at]:.9g}"
                remedy = "Correct it, or leave it out to have it computed."
                raise InputError(what, allowed, self.name, remedy)

    def _check_shape(self, name, values, y, order):
        """Check the shape, and insert the axis of the components where C has none."""
        m, k, _ = y.shape
        values = np.asarray(values, dtype=float)
        tail = (k, 3) * order
        if values.shape == (m, *tail) and self.r == 1:
            return values[:, None]
        if values.shape != (m, self.r, *tail):
            allowed = f"must be {(m, self.r, *tail)} for y of shape {y.shape}"
            raise InputError(f"{name}(y) of shape {values.shape}", allowed, self.name)
        return values
