"""Exceptions and warnings of fecloth, checks of plain values, and "Did you mean ...?".

A message states the quantity with its value, the limit, the place, and the remedy.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from numbers import Real
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Any, TypeGuard

    import numpy as np


# Exit statuses of commands and studies, beside 0. The codes are documented, and 2 is also the
# status of argparse for bad options.
MISSED = 1
BAD_INPUT = 2
FAILED = 3
STOPPED = 4


class FeclothError(Exception):
    """Base class of all exceptions of fecloth."""


class FeclothWarning(UserWarning):
    """A warning that a result may be wrong or inaccurate."""


class InputError(FeclothError, ValueError):
    """An argument or an input value that is not allowed.

    Parameters
    ----------
    what
        The quantity and its value, e.g. ``"areal_density = -0.2 kg/m²"``.
    allowed
        The allowed range or the allowed values, e.g. ``"must be > 0"``.
    where
        The file and key, or the function, of the value.
    remedy
        A sentence that says how to correct it.

    Attributes
    ----------
    also
        Other errors of the same input; the message has a line for each.
    """

    also: tuple[InputError, ...] = ()

    def __init__(self, what: str, allowed: str = "", where: str = "", remedy: str = ""):
        self.what = what
        self.allowed = allowed
        self.where = where
        self.remedy = remedy
        super().__init__(what, allowed, where, remedy)

    def __str__(self) -> str:
        """Return "where: what: allowed. remedy", without empty parts, and lines for `also`."""
        text = self.what
        if self.allowed:
            text += f": {self.allowed}"
        if self.where:
            text = f"{self.where}: {text}"
        if self.remedy:
            text = f"{text}. {self.remedy}"
        return "\n".join([text, *map(str, self.also)])


class MeshError(InputError):
    """An invalid mesh. The message names the triangles, nodes or groups."""


class SceneError(InputError):
    """An unknown key, a wrong type or a value out of range in a scene file."""


@contextmanager
def errors_of(where: str, before: str = "", kind: type[InputError] = InputError) -> Iterator[None]:
    """Raise an `InputError` of the block again, with this place and the words `before`."""
    try:
        yield
    except InputError as error:
        raise kind(f"{before}{error.what}", error.allowed, where, error.remedy) from None


class SolveFailed(FeclothError):
    """A linear solve that did not reach the required relative residual.

    Parameters
    ----------
    reason
        The cause, in words.
    residual, rtol
        The relative residual, and the required relative residual; NaN if there is none.
    """

    def __init__(self, reason: str, residual: float = float("nan"), rtol: float = float("nan")):
        self.reason = reason
        self.residual = residual
        self.rtol = rtol
        text = reason
        if not math.isnan(residual):
            text += f" (relative residual {residual:.2e}, required {rtol:.2e})"
        super().__init__(text)


class IndefiniteMatrix(SolveFailed):
    """A matrix that is not positive definite, in a solver for definite matrices.

    Attributes
    ----------
    so_far
        The last iterate (n, 3) of conjugate gradients; None for other solvers.
    """

    so_far: np.ndarray | None = None


class StepFailed(FeclothError):
    """A time step that did not converge, or whose result is not finite.

    Attributes
    ----------
    reason
        The cause, in words.
    step, t, dt
        Number of the step, its start time [s] and its size [s].
    residual
        The smallest relative residual; NaN if there is none.
    stretch, triangle
        The largest principal stretch of the state at the start of the step, and its triangle.
    state
        The state at the start of the step.
    result
        The `Result` of the steps before, with their tables, where `fc.run` failed; else None.
    remedy
        A sentence that says what to try.
    unit
        What follows a value of t: " s", or " of the loads" of a static scene.
    """

    def __init__(
        self,
        reason: str,
        *,
        step: int | None = None,
        t: float | None = None,
        dt: float | None = None,
        residual: float = float("nan"),
        stretch: float = float("nan"),
        triangle: int | None = None,
        state: Any = None,
        remedy: str = "",
        unit: str = " s",
    ):
        """Make the error of a step; the arguments are its attributes. `result` is set later."""
        self.reason = reason
        self.step = step
        self.t = t
        self.dt = dt
        self.unit = unit
        self.residual = residual
        self.stretch = stretch
        self.triangle = triangle
        self.state = state
        self.remedy = remedy
        self.result: Any = None
        super().__init__(reason)

    def __str__(self) -> str:
        """Return the step, the reason, the residual, the worst triangle and the remedy in words.

        Where the step, t or dt is not known, return the reason alone.
        """
        if self.step is None or self.t is None or self.dt is None:
            return self.reason
        if math.isnan(self.residual):
            residual = ""
        else:
            residual = f"relative residual {self.residual:.2e}; "
        place = f"step {self.step} from t = {self.t:.6g} s with dt = {self.dt:.3g} s"
        if self.unit != " s":  # t is the part of the loads of a static scene
            end = self.t + self.dt
            place = f"load step {self.step}, from {self.t:.6g} to {end:.6g}{self.unit},"
        return (
            f"{place} failed: {self.reason} ({residual}most deformed triangle {self.triangle} "
            f"with a principal stretch of {self.stretch:.4g}). {self.remedy}"
        )


def is_number(value: object) -> TypeGuard[float]:
    """Whether the value is a finite real number; text and booleans are not."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def floats(name: str, value: object, where: str) -> np.ndarray:
    """Convert a value to an array of floats; raise `InputError` if this is impossible."""
    import numpy as np  # imported here, so that `fecloth --version` is fast

    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {brief(value)}", "must be numbers", where) from None


def flag(name: str, value: object, where: str) -> None:
    """Raise `InputError` if a value is neither True nor False."""
    if not isinstance(value, bool):
        raise InputError(f"{name} = {brief(value)}", "must be True or False", where)


def with_article(name: str) -> str:
    """Return a name after "a" or "an"."""
    article = "an" if name[0] in "aeioAEIO" else "a"
    return f"{article} {name}"


def amount(count: int, noun: str) -> str:
    """Return a number with its noun, which has an s unless the number is 1."""
    return f"{count} {noun}{'s' * (count != 1)}"


def brief(value: object) -> str:
    """Describe a value in one line: long values by their type, functions and classes by name."""
    if callable(value) and hasattr(value, "__qualname__"):
        kind = "the class" if isinstance(value, type) else "the function"
        return f"{kind} {value.__qualname__}, which is not called"
    text = repr(value)
    if len(text) <= 60 and "\n" not in text and not text.startswith("<"):
        return text
    return with_article(type(value).__name__)


def closest(name: object, names: Iterable[str], always: bool = False) -> str:
    """Return the name of `names` that is most like `name`; "" if none is alike.

    With `always` a name is returned, however unlike it is. Capitals and underscores do not
    count: ``CentralDifference`` is ``central_difference``.
    """
    names_by_word = {_plain(candidate): candidate for candidate in names}
    words = list(names_by_word)
    word = _plain(name)
    if always:
        close = difflib.get_close_matches(word, words, n=1, cutoff=0.0)
    else:
        close = difflib.get_close_matches(word, words, n=1)
    # The longest candidate with which the word begins is the other one: "cosine" means "cos",
    # but "tipp.z" means "tip.z".
    # A beginning of one or two letters says nothing.
    beginnings = [candidate for candidate in words if word.startswith(candidate)]
    longest = max(beginnings, key=len, default="")
    candidates = [longest, *close] if len(longest) > 2 else close
    if not candidates:
        return ""

    def likeness(candidate: str) -> float:
        return difflib.SequenceMatcher(None, candidate, word).ratio()

    return names_by_word[max(candidates, key=likeness)]


def did_you_mean(name: object, names: Iterable[str], always: bool = False) -> str:
    """Return the remedy "Did you mean ...?" with the closest name; empty if none is alike.

    With `always` a name is suggested, however unlike it is.
    """
    close = closest(name, names, always)
    if close:
        return f"Did you mean {close!r}?"
    return ""


def _plain(name: object) -> str:
    return str(name).lower().replace("_", "")
