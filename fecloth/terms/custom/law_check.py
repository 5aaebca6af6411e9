"""Check a user's membrane law before it is compiled: shapes and derivatives."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np

from fecloth.errors import InputError, brief
from fecloth.terms.custom.finite_differences import WEIGHTS

VOIGT = ((0, 3, 4), (3, 1, 5), (4, 5, 2))  # ℂ as a matrix on (E11, E22, 2 E12)
NAMES = ("11", "22", "66", "12", "16", "26")  # of ℂ; the first two, and 12, of S
NEAR = (0.011, -0.007, 0.005)  # the strain at which S and ℂ are compared with differences
STEP = 1e-5
TOLERANCE = 1e-5  # relative to the largest entry


def check_law(law: Callable, c: np.ndarray, name: str) -> tuple:
    """Check the law of the term `name` for the constants c; return W, S and ℂ at E = 0.

    Raises
    ------
    InputError
        For a result of another shape, or not finite at E = 0, and for wrong derivatives near it.
    """
    if not callable(law) or inspect.ismethod(law):
        allowed = "must be a function of E and c, under @staticmethod"
        raise InputError(f"law = {brief(law)}", allowed, name)
    law = getattr(law, "py_func", law)  # compiled code does not check shapes
    rest = _evaluate(law, (0.0, 0.0, 0.0), c, name)
    if not all(np.isfinite(part).all() for part in rest):
        raise InputError(f"law at E = 0 gives {rest}", "must be finite", name)
    W, S, C = _evaluate(law, NEAR, c, name)
    if np.isfinite(W) and np.isfinite(S).all() and np.isfinite(C).all():
        dW, dS = _differentiate(law, c, name)
        _raise_if_different("S", S, dW, name)
        for row, order in enumerate(VOIGT):
            _raise_if_different("C", C, dS[row], name, order, np.abs(C).max())
    return rest


def _evaluate(law: Callable, E: tuple, c: np.ndarray, name: str) -> tuple:
    """Evaluate W, S (3,) and ℂ (6,) of the plain function; NaN where it overflows."""
    allowed = "must return W, (S11, S22, S12), (C11, C22, C66, C12, C16, C26)"
    try:
        with np.errstate(all="ignore"):
            W, S, C = law(E, c)
        W, S, C = float(W), np.array(S, dtype=float), np.array(C, dtype=float)
    except ArithmeticError:  # infinity or NaN in compiled code
        return np.nan, np.full(3, np.nan), np.full(6, np.nan)
    except (NameError, AttributeError) as error:
        raise InputError(f"law(E, c): {error}", "must use defined names only", name) from error
    except (TypeError, ValueError, IndexError) as error:
        raise InputError(f"law(E, c): {error}", allowed, name) from error
    if S.shape != (3,) or C.shape != (6,):
        raise InputError(f"law(E, c) with S {S.shape} and C {C.shape}", allowed, name)
    return W, S, C


def _differentiate(law, c, name):
    """Differentiate W to S (3,), and S to ∂S/∂E (3, 3) on E11, E22, 2 E12, at `NEAR`."""
    dW, dS = np.zeros(3), np.zeros((3, 3))
    for k, h in enumerate((STEP, STEP, 0.5 * STEP)):  # of E12: a step in 2 E12
        for s, weight in WEIGHTS:
            E = tuple(e + s * h * (i == k) for i, e in enumerate(NEAR))
            W, S, _ = _evaluate(law, E, c, name)
            dW[k] += weight * W / STEP
            dS[:, k] += weight * S / STEP
    return dW, dS


def _raise_if_different(symbol, given, expected, name, order=(0, 1, 3), scale=None):
    """Raise an `InputError` for the entry with the largest error, if that is above `TOLERANCE`."""
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
