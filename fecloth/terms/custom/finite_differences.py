"""Derivatives ∂C and ∂²C of a user's condition: the user's functions, or finite differences."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fecloth.errors import InputError

# Step of the differences over the size of the stencil. They have order 4, so that their error is
# about 1e-12 by truncation (step⁴) and 1e-13 by round-off (1e-16/step).
STEP_OVER_SIZE = 1e-3
# A user's derivative is wrong if it is farther than this from finite differences, over the
# largest entry. Differences are good to 1e-7 where the functions are smooth (see `Condition`).
WRONG_DERIVATIVE = 1e-6
WEIGHTS = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))  # central, of order 4

Function = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Derivatives:
    """C, ∂C and ∂²C of m stencils of k nodes, from the functions of the user.

    Attributes
    ----------
    value
        The user's function C.
    gradient, hessian
        The user's functions ∂C and ∂²C; None where there is none.
    size
        Size (m,) of each stencil [m].
    r
        Number of components of C.
    name
        Of the term, for errors.
    """

    value: Function
    gradient: Function | None
    hessian: Function | None
    size: np.ndarray
    r: int
    name: str

    def C(self, y: np.ndarray) -> np.ndarray:
        """C (m, r) at positions y (m, k, 3)."""
        return np.asarray(self.value(y), dtype=float).reshape(len(y), self.r)

    def dC(self, y: np.ndarray) -> np.ndarray:
        """∂C (m, r, k, 3) at positions y (m, k, 3)."""
        if self.gradient is None:
            return self.differentiate(self.C, y)
        return self._check_shape("gradient", self.gradient(y), y, 1)

    def ddC(self, y: np.ndarray) -> np.ndarray:
        """∂²C (m, r, k, 3, k, 3) at positions y (m, k, 3)."""
        if self.hessian is not None:
            return self._check_shape("hessian", self.hessian(y), y, 2)
        H = self.differentiate(self.dC, y)
        return 0.5 * (H + H.transpose(0, 1, 4, 5, 2, 3))

    def differentiate(self, function: Function, y: np.ndarray) -> np.ndarray:
        """Return the derivative (m, …, k, 3) of a function by y (m, k, 3), from differences.

        The function takes positions (m, k, 3) and returns (m, …). It is called four times for
        each of the 3 k coordinates; a coordinate is moved in all m stencils at once.
        """
        m, k, _ = y.shape
        h = STEP_OVER_SIZE * self.size[:, None, None]
        columns = []
        for unit_vector in np.eye(3 * k).reshape(3 * k, k, 3):
            terms = [weight * function(y + s * h * unit_vector) for s, weight in WEIGHTS]
            difference = np.asarray(sum(terms))
            h_of_rows = h.reshape(m, *[1] * (difference.ndim - 1))  # axes as of `difference`
            columns.append(difference / h_of_rows)
        return np.stack(columns, axis=-1).reshape(*columns[0].shape, k, 3)

    def beside(self, rest: np.ndarray) -> np.ndarray:
        """Return positions (m, k, 3) [m] near rest, without symmetries.

        They are the same in every call. In a symmetric state, a wrong entry of a derivative
        could be right by chance.
        """
        noise = np.random.default_rng(0).standard_normal(rest.shape)
        return rest + 0.05 * self.size[:, None, None] * noise

    def is_objective(self, rest: np.ndarray) -> bool:
        """Whether no rigid motion changes C, tested near `rest` (m, k, 3).

        Then ∂C has no resultant, as no translation changes C, and no moment, as no rotation
        does. A NaN counts as not objective.
        """
        y = self.beside(rest)
        arms = (y - y.mean(axis=1, keepdims=True))[:, None]
        g = self.dC(y)
        moments = np.cross(arms, g)
        for vectors_of_nodes in (g, moments):
            resultant = np.abs(vectors_of_nodes.sum(axis=2)).max()
            if not resultant <= WRONG_DERIVATIVE * np.abs(vectors_of_nodes).max():
                return False
        return True

    def check(self, rest: np.ndarray) -> None:
        """Compare the user's derivatives with finite differences, in a state near rest.

        The user's gradient is compared with differences of the value, and the hessian with
        differences of the gradient. Raises `InputError` for a derivative that differs.
        """
        y = self.beside(rest)
        if self.gradient is not None:
            expected = self.differentiate(self.C, y)
            self._compare("gradient", self.dC(y), expected, "value")
        if self.hessian is not None:
            expected = self.differentiate(self.dC, y)
            self._compare("hessian", self.ddC(y), expected, "the gradient")

    def _compare(self, name: str, values: np.ndarray, expected: np.ndarray, of: str) -> None:
        """Raise `InputError` if a user's derivative differs from finite differences.

        The error names the entry that differs most. `name` is the derivative, with `values`;
        `expected` are the differences of the function that is named `of`.
        """
        # The difference of each entry, above what is allowed.
        excess = np.abs(values - expected) - WRONG_DERIVATIVE * np.abs(expected).max()
        worst_entry = int(np.argmax(np.nan_to_num(excess, nan=np.inf)))  # a NaN is wrong, too
        worst_index = np.unravel_index(worst_entry, excess.shape)
        if excess[worst_index] <= 0:
            return
        index_in_words = ", ".join(str(int(i)) for i in worst_index)
        what = f"{name}[{index_in_words}] = {values[worst_index]:.9g}"
        allowed = f"differences of {of} give {expected[worst_index]:.9g}"
        remedy = "Correct it, or leave it out to have it computed."
        raise InputError(what, allowed, self.name, remedy)

    def _check_shape(self, name: str, values: np.ndarray, y: np.ndarray, order: int) -> np.ndarray:
        """Return a user's derivative of `order` 1 or 2 at y with the axis of its r components.

        With one component, the user may leave this axis out. Raises `InputError` for any other
        shape; `name` is the derivative.
        """
        m, k, _ = y.shape
        values = np.asarray(values, dtype=float)
        axes_of_nodes = (k, 3) * order
        if values.shape == (m, *axes_of_nodes) and self.r == 1:
            return values[:, None]
        if values.shape != (m, self.r, *axes_of_nodes):
            allowed = f"must be {(m, self.r, *axes_of_nodes)} for y of shape {y.shape}"
            raise InputError(f"{name}(y) of shape {values.shape}", allowed, self.name)
        return values
