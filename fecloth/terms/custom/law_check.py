"""What a user's membrane law gives, looked at before it is compiled: shapes, and derivatives."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np

from fecloth.errors import InputError, brief

VOIGT = ((0, 3, 4), (3, 1, 5), (4, 5, 2))  # ℂ as a matrix on (E11, E22, 2 E12)
NAMES = ("11", "22", "66", "12", "16", "26")  # of ℂ; the first two, and 12, of S
NEAR = (0.011, -0.007, 0.005)  # the strain at which S and ℂ are held against differences
STEP = 1e-5
TOLERANCE = 1e-5  # relative to the largest entry
WEIGHTS = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))  # central, of order 4


def checked(law: Callable, c: np.ndarray, name: str) -> tuple:
    """(W, S, ℂ) at E = 0 of the law called `name`, for the constants c.

    Raises
    ------
    InputError
        For another shape, what is not finite at E = 0, and wrong derivatives near it.
    """
    if not callable(law) or inspect.ismethod(law):
        allowed = "must be a function of E and c, under @staticmethod"
        raise InputError(f"law = {brief(law)}", allowed, name)
    law = getattr(law, "py_func", law)  # what is compiled knows no shapes
    rest = _values(law, (0.0, 0.0, 0.0), c, name)
    if not all(np.isfinite(part).all() for part in rest):
        raise InputError(f"law at E = 0 gives {rest}", "must be finite", name)
    W, S, C = _values(law, NEAR, c, name)
    if np.isfinite(W) and np.isfinite(S).all() and np.isfinite(C).all():
        dW, dS = _differences(law, c, name)
        _compare("S", S, dW, name)
        for row, order in enumerate(VOIGT):
            _compare("C", C, dS[row], name, order, np.abs(C).max())
    return rest


def _values(law: Callable, E: tuple, c: np.ndarray, name: str) -> tuple:
    """W, S (3,), ℂ (6,) of the plain function; not numbers where it overflows."""
    allowed = "must return W, (S11, S22, S12), (C11, C22, C66, C12, C16, C26)"
    try:
        with np.errstate(all="ignore"):
            W, S, C = law(E, c)
        W, S, C = float(W), np.array(S, dtype=float), np.array(C, dtype=float)
    except ArithmeticError:  # in compiled code infinity, or not a number
        return np.nan, np.full(3, np.nan), np.full(6, np.nan)
    except (TypeError, ValueError, IndexError) as error:
        raise InputError(f"law(E, c): {error}", allowed, name) from error
    if S.shape != (3,) or C.shape != (6,):
        raise InputError(f"law(E, c) with S {S.shape} and C {C.shape}", allowed, name)
    return W, S, C


def _differences(law, c, name):
    """∂W/∂E as S (3,), and ∂S/∂E (3, 3) on E11, E22, 2 E12, at `NEAR`."""
    dW, dS = np.zeros(3), np.zeros((3, 3))
    for k, h in enumerate((STEP, STEP, 0.5 * STEP)):  # of E12: a step in 2 E12
        for s, weight in WEIGHTS:
            E = tuple(e + s * h * (i == k) for i, e in enumerate(NEAR))
            W, S, _ = _values(law, E, c, name)
            dW[k] += weight * W / STEP
            dS[:, k] += weight * S / STEP
    return dW, dS


def _compare(symbol, given, expected, name, order=(0, 1, 3), scale=None):
    """Refuse the entry that is farthest off."""
    found = given if symbol == "S" else given[list(order)]
    wrong = np.abs(found - expected)
    at = int(np.argmax(wrong))
    if wrong[at] > TOLERANCE * (np.abs(expected).max() if scale is None else scale):
        of = "W" if symbol == "S" else "S"
        raise InputError(
            f"{symbol}{NAMES[order[at]]} = {found[at]:.9g} at E = {NEAR}",
            f"differences of {of} give {expected[at]:.9g}",
            name,
            "S12 is half of ∂W/∂E12; the C are on E11, E22 and 2 E12.",
        )
