"""What went wrong, its value, its limit, where it stands, and the remedy."""

from __future__ import annotations

import math
from numbers import Real
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


class FeclothError(Exception):
    """Base of every error that fecloth raises on purpose."""


class FeclothWarning(UserWarning):
    """A result that is not to be trusted."""


class InputError(FeclothError, ValueError):
    """A value that the user gave cannot be used.

    Parameters
    ----------
    what
        The quantity and its value, e.g. ``"areal_density = -0.2 kg/m²"``.
    allowed
        The range or the choices, e.g. ``"must be > 0"``.
    where
        File and key, or the call, in which the value stands.
    remedy
        What to do.

    Attributes
    ----------
    also
        The other mistakes that were found with this one; the message has a line for each.
    """

    also: tuple[InputError, ...] = ()

    def __init__(self, what: str, allowed: str = "", where: str = "", remedy: str = ""):
        self.what, self.allowed, self.where, self.remedy = what, allowed, where, remedy
        super().__init__(what, allowed, where, remedy)

    def __str__(self) -> str:
        text = self.what
        if self.allowed:
            text += f": {self.allowed}"
        if self.where:
            text = f"{self.where}: {text}"
        text = f"{text}. {self.remedy}" if self.remedy else text
        return "\n".join([text, *map(str, self.also)])


class MeshError(InputError):
    """A mesh that cannot carry a cloth: the message names the triangles, nodes or groups."""


class SceneError(InputError):
    """A scene file with an unknown key, a wrong type or a value out of range."""


class SolveFailed(FeclothError):
    """A linear solve missed the relative residual it was asked for."""

    def __init__(self, reason: str, residual: float = float("nan"), asked: float = float("nan")):
        self.reason, self.residual, self.asked = reason, residual, asked
        known = (
            ""
            if math.isnan(residual)
            else f" (relative residual {residual:.2e}, asked {asked:.2e})"
        )
        super().__init__(reason + known)


class IndefiniteMatrix(SolveFailed):
    """A symmetric solver met a matrix that is not positive definite."""


class StepFailed(FeclothError):
    """A time step that did not converge, or whose result is not finite.

    Attributes
    ----------
    step, t, dt, residual, stretch
        Number and start time [s] of the step, its size [s], the relative residual that was
        reached and the largest principal stretch of the last good state.
    state
        The last good state.
    """

    def __init__(
        self,
        reason: str,
        *,
        step=None,
        t=None,
        dt=None,
        residual=float("nan"),
        stretch=float("nan"),
        triangle=None,
        state=None,
        remedy="",
    ):
        self.reason, self.step, self.t, self.dt = reason, step, t, dt
        self.residual, self.stretch, self.triangle = residual, stretch, triangle
        self.state, self.remedy = state, remedy
        super().__init__(reason)

    def __str__(self) -> str:
        if self.step is None:
            return self.reason
        residual = "" if math.isnan(self.residual) else f"relative residual {self.residual:.2e}; "
        return (
            f"step {self.step} from t = {self.t:.6g} s with dt = {self.dt:.3g} s failed: "
            f"{self.reason} ({residual}most deformed triangle {self.triangle} with a principal "
            f"stretch of {self.stretch:.4g}). {self.remedy}"
        )


def is_number(value: object) -> bool:
    """Whether it is a finite real number, and no text or boolean."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def floats(name: str, value: object, where: str) -> np.ndarray:
    """The value as an array of floating-point numbers; refused if it holds anything else."""
    import numpy as np  # here, so that `fecloth --version` need not wait for it

    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {brief(value)}", "must be numbers", where) from None


def flag(name: str, value: object, where: str) -> None:
    """Refuse what is neither True nor False."""
    if not isinstance(value, bool):
        raise InputError(f"{name} = {brief(value)}", "must be True or False", where)


def brief(value: object) -> str:
    """The value in at most a line: large ones by their type, functions and classes by name."""
    if callable(value) and hasattr(value, "__qualname__"):
        kind = "the class" if isinstance(value, type) else "the function"
        return f"{kind} {value.__qualname__}, which is not called"
    text = repr(value)
    short = len(text) <= 60 and "\n" not in text and not text.startswith("<")
    return text if short else f"a {type(value).__name__}"
