"""The motion of pinned nodes by formulas, with its exact velocity."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fecloth.errors import InputError, brief, is_number
from fecloth.quantities.formula import Derivative, Formula
from fecloth.quantities.time_function import DIFFERENCE_STEP


@dataclass(frozen=True)
class Motion:
    """Displacement by three formulas of t, or of t and of a node's material point (X, Y) [m].

    Parameters
    ----------
    formulas
        Formulas of t; all three of t, X and Y where one of them has X or Y in it.
    X
        (k, 2) material points of the nodes [m], for formulas of X and Y.

    Examples
    --------
    >>> lift = Motion.read(["0", 0, "0.1*t**2"])
    >>> lift(2.0), lift.velocity(2.0)
    (array([0. , 0. , 0.4]), array([0. , 0. , 0.4]))
    """

    formulas: tuple[Formula, ...]
    X: np.ndarray | None = field(default=None, compare=False)

    @classmethod
    def read(cls, parts: Sequence[str | float], name: str = "motion") -> Motion:
        """The motion of three formulas or numbers; `name` is what errors call it."""
        if isinstance(parts, str) or not isinstance(parts, Sequence) or len(parts) != 3:
            raise _refused(parts, name)
        if not all(is_number(part) or isinstance(part, str) for part in parts):
            raise _refused(parts, name)
        texts = [part if isinstance(part, str) else repr(float(part)) for part in parts]
        by_place = any(re.search(r"\b[XY]\b", text) for text in texts)
        variables = ("t", "X", "Y") if by_place else ("t",)
        return cls(tuple(Formula(text, variables) for text in texts))

    @property
    def by_place(self) -> bool:
        """Whether the motion differs from node to node."""
        return "X" in self.formulas[0].variables

    def __call__(self, t: float | np.ndarray) -> np.ndarray:
        """Displacement (3,) or (k, 3) [m]; of times (m,) or (m, 1) one for each."""
        return self._stack(self.formulas, t)

    def velocity(self, t: float | np.ndarray) -> np.ndarray:
        """The exact derivative of the displacement by t, of the same shape [m/s]."""
        return self._stack(self._derivatives, t)

    def check(self, times: np.ndarray) -> None:
        """Refuse a motion without a finite value, or velocity, at the times (m,) of a run [s]."""
        self(times)
        start, later = times[0], times[1:]
        try:
            self.velocity(later)
        except InputError:  # the velocity is then a difference quotient
            self(np.maximum(later - DIFFERENCE_STEP, start))
            self(later + DIFFERENCE_STEP)

    @cached_property
    def _derivatives(self) -> tuple[Derivative, ...]:
        return tuple(formula.derivative("t") for formula in self.formulas)

    def _stack(self, parts: Sequence[Formula | Derivative], t) -> np.ndarray:
        if not self.by_place:
            if isinstance(t, float):
                t = float(t)  # not NumPy's, which is slower
                return np.array([part.at(t) for part in parts])
            return np.array([part(t=t) for part in parts]).T
        if self.X is None:
            raise InputError("a motion of X and Y", "has values at the nodes of a System only")
        place = {"X": self.X[:, 0], "Y": self.X[:, 1]}
        return np.stack([part(t=t, **place) for part in parts], axis=-1)


def _refused(parts: object, name: str) -> InputError:
    kinds = ["three formulas of t", "a function of t"]
    first, second = kinds if name == "motion" else reversed(kinds)
    allowed = f"must be {first}, or {second}, as in lambda t: [0, 0, 0.1 * t]"
    return InputError(f"{name} = {brief(parts)}", allowed)
