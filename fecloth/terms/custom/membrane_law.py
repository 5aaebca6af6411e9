"""Membrane law of a user: W, S and ℂ in the Green strain become a term.

The templates in `fecloth.terms.loops.membrane` are compiled with the law at its first use and
stored on disk. They are compiled anew when the law, or a function that it calls, changes.
"""

import inspect
import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

from fecloth.compiled.jit import inner, insert
from fecloth.errors import InputError, brief
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.terms.custom.finite_differences import WEIGHTS, WRONG_DERIVATIVE
from fecloth.terms.loops import membrane, membrane_loops
from fecloth.terms.protocol import element_nodes
from fecloth.terms.strain_errors import VOIGT
from fecloth.terms.traits import MEMBRANE


class MembraneLaw:
    """Base class of a membrane with a law of your own.

    Write the static method `law`, and `constants` if the law has any. A subclass is a frozen
    dataclass with the parameters of the law as its fields. It is used as `StVK` is: in a
    `System`, on P1 and P2, with every integrator, as the `law` of `StrainRateDamping`, and with
    stresses in the output. The name of its class is the name of the term.

    ``law(E, c)`` takes the Green strain E = (E11, E22, E12) in warp and weft and the constants c
    of the triangle, and returns

        W                                 energy per reference area [J/m²]
        (S11, S22, S12)                   S = ∂W/∂E [N/m]; S12 is half of ∂W/∂E12
        (C11, C22, C66, C12, C16, C26)    ℂ = ∂S/∂E [N/m], on E11, E22 and 2 E12

    Numba compiles the law: use numbers, tuples and `math`, and call only functions that are
    compiled themselves, by `numba.njit`, such as `fecloth.terms.loops.green_strain.contract` for
    ℂ : E. To compile takes a second or two for each of force, tangent and definite tangent. The
    machine code stays on disk until the law, its constants or a function that it calls changes.
    Write out the entries of c: a slice of c is slow. When the term is bound, S and ℂ are
    compared with differences near rest; `fecloth.verify.check_term` does so far from rest.

    The definite tangent of Newton's method raises negative principal values of S and
    eigenvalues of ℂ to zero: W need not be convex. `System` raises `InputError` for a result
    that is not (W, S, ℂ) or not finite at E = 0, for an entry of S or ℂ that is not the
    derivative, and for a law that Numba cannot compile.

    Attributes
    ----------
    law
        The static method of a subclass.
    strain
        On P2, "interpolated" or "pointwise", as of `StVK`.
    """

    traits = MEMBRANE

    law: ClassVar[Any] = None
    strain: ClassVar[str] = "interpolated"

    def constants(self, fabric: Fabric) -> Sequence[float]:
        """The constants c (p,), from the parameters and the fabric; a subclass may have some."""
        return (0.0,)

    def moduli(self, fabric: Fabric) -> np.ndarray:
        """(6,) ℂ at E = 0 [N/m]."""
        return check_law(self.law, self._row(fabric), type(self).__name__)[2]

    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> membrane.BoundMembrane:
        """Check the law, compile it, and bind the membrane.

        Raises `InputError` for wrong constants, for a wrong law (`check_law`), and for a law
        that Numba cannot compile.
        """
        name = type(self).__name__
        constants = panel.each(self._row)
        panel.each(self.moduli)  # checks the law
        try:
            # The first call compiles the law by itself: an error is then about the law only.
            _compile_law(self.law)(STRAIN_NEAR_REST, constants[0])
        except NumbaError as error:
            what = f"law: {' '.join(str(error).split())}"
            allowed = "must be what Numba compiles"
            raise InputError(what, allowed, name) from error
        return membrane.bind(name, _kernels(self.law), constants, panel, slots, self.strain)

    def _row(self, fabric: Fabric) -> np.ndarray:
        """Return the constants c (p,) of a fabric as an array.

        Raises `InputError` if `constants` does not return a list of finite numbers, or fails.
        """
        name = f"{type(self).__name__}.constants"
        try:
            c = np.array(self.constants(fabric), dtype=float)
        except (TypeError, ValueError, NameError, AttributeError) as error:
            raise InputError(f"constants: {error}", "must be a list of numbers", name) from error
        if c.ndim != 1:
            what = f"constants of shape {c.shape}"
            raise InputError(what, "must be a list of finite numbers", name)
        if not c.size or not np.isfinite(c).all():
            raise InputError(f"constants = {c}", "must be a list of finite numbers", name)
        return c


@inner
def positive(C):
    """Return ℂ with its negative eigenvalues raised to zero.

    ℂ is given and returned as (C11, C22, C66, C12, C16, C26).
    """
    C11, C22, C66, C12, C16, C26 = C
    minor = C11 * C22 - C12 * C12
    det = C66 * minor - C11 * C26 * C26 - C22 * C16 * C16 + 2.0 * C12 * C16 * C26
    # With all three leading minors positive, ℂ is positive definite. If it is not finite, it has
    # no eigenvalues.
    if (C11 > 0.0 and minor > 0.0 and det > 0.0) or not math.isfinite(det):
        return C
    matrix = np.array([[C11, C12, C16], [C12, C22, C26], [C16, C26, C66]])
    values, vectors = np.linalg.eigh(matrix)
    A = np.zeros((3, 3))  # Σ max(λ, 0) v ⊗ v
    for k in range(3):
        for i in range(3):
            for j in range(3):
                A[i, j] += max(values[k], 0.0) * vectors[i, k] * vectors[j, k]
    return A[0, 0], A[1, 1], A[2, 2], A[0, 1], A[0, 2], A[1, 2]


# templates, into which `_kernels` inserts the law


def law(E, c):
    """Return W, S and ℂ; the user's law takes the place of this one."""
    raise NotImplementedError


def floating_point(E, c):
    """Return W, S and ℂ of the law as floating-point numbers.

    A law may return integers, such as 0, which would have another type for Numba.
    """
    W, S, C = law(E, c)
    W = 1.0 * W
    S = (1.0 * S[0], 1.0 * S[1], 1.0 * S[2])
    C = (1.0 * C[0], 1.0 * C[1], 1.0 * C[2], 1.0 * C[3], 1.0 * C[4], 1.0 * C[5])
    return W, S, C


def definite(E, c):
    """The law with ℂ positive semi-definite."""
    W, S, C = law(E, c)
    return W, S, positive(C)


@cache
def _compile_law(law: Callable) -> Callable:
    """The law as a compiled function, also if the user has compiled it."""
    if isinstance(law, Dispatcher):
        return law
    return inner(law)


@cache
def _kernels(law: Callable) -> membrane_loops.Kernels:
    """Compile the entry points of a law."""
    exact = inner(insert(floating_point, law=_compile_law(law)))
    return membrane_loops.kernels(exact, inner(insert(definite, law=exact)))


NAMES = ("11", "22", "66", "12", "16", "26")  # of ℂ; the first two, and 12, of S
# The strain E11, E22, E12 at which S and ℂ are compared with differences: small, as cloth is
# strained, and without symmetries, so that every entry of ℂ counts.
STRAIN_NEAR_REST = (0.011, -0.007, 0.005)
# Step of these differences in E11, E22 and 2 E12. They have order 4: their error is the error by
# round-off, about 1e-16/1e-5 of the largest entry.
STEP_OF_STRAIN = 1e-5


def check_law(law: Callable, c: np.ndarray, name: str) -> tuple:
    """Check the law of the term `name` for the constants c; return W, S and ℂ at E = 0.

    Raises `InputError` for a law that is no function or not finite at E = 0, and for an entry
    of S or ℂ near rest that is not the derivative.
    """
    if not callable(law) or inspect.ismethod(law):
        allowed = "must be a function of E and c, under @staticmethod"
        raise InputError(f"law = {brief(law)}", allowed, name)
    law = getattr(law, "py_func", law)  # compiled code does not check shapes
    at_rest = _evaluate(law, (0.0, 0.0, 0.0), c, name)
    if not all(np.isfinite(part).all() for part in at_rest):
        raise InputError(f"law at E = 0 gives {at_rest}", "must be finite", name)
    W, S, C = _evaluate(law, STRAIN_NEAR_REST, c, name)
    # Where the law overflows near rest, there is nothing to compare.
    if np.isfinite(W) and np.isfinite(S).all() and np.isfinite(C).all():
        dW, dS = _differentiate(law, c, name)
        _compare("S", S, dW, np.abs(dW).max(), (0, 1, 3), "W", name)
        for row, order in enumerate(VOIGT):
            _compare("C", C[list(order)], dS[row], np.abs(C).max(), order, "S", name)
    return at_rest


def _evaluate(law: Callable, E: tuple, c: np.ndarray, name: str) -> tuple:
    """Return W, S (3,) and ℂ (6,) of the plain Python function `law` at E, with constants c.

    All of them are NaN where the law overflows. Raises `InputError` for a law that fails
    otherwise, or returns other shapes; `name` is the term.
    """
    allowed = "must return W, (S11, S22, S12), (C11, C22, C66, C12, C16, C26)"
    try:
        with np.errstate(all="ignore"):
            W, S, C = law(E, c)
        W = float(W)
        S = np.array(S, dtype=float)
        C = np.array(C, dtype=float)
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
    """Return dW (3,) and dS (3, 3), by differences at `STRAIN_NEAR_REST`.

    The last index is that of the strain E11, E22 or 2 E12. The differences are central, of
    order 4. Raises `InputError` as `_evaluate` does; `name` is the term.
    """
    dW = np.zeros(3)
    dS = np.zeros((3, 3))
    for k, steps in enumerate(STEP_OF_STRAIN * np.diag([1.0, 1.0, 0.5])):  # half of 2 E12
        for s, weight in WEIGHTS:
            E = tuple(float(e + s * h) for e, h in zip(STRAIN_NEAR_REST, steps, strict=True))
            W, S, _ = _evaluate(law, E, c, name)
            dW[k] += weight * W / STEP_OF_STRAIN
            dS[:, k] += weight * S / STEP_OF_STRAIN
    return dW, dS


def _compare(
    symbol: str,
    values: np.ndarray,
    expected: np.ndarray,
    scale: float,
    order: Sequence[int],
    of: str,
    name: str,
) -> None:
    """Raise `InputError` if entries of S or ℂ differ from the differences `of` W or S.

    The error names the entry that differs most. `symbol` is "S" or "C", with the `values` of
    three entries; `order` are the places of their numbers in `NAMES`. `scale` is the largest
    entry, with which the errors are compared. `name` is the term.
    """
    errors = np.abs(values - expected)
    worst = int(np.argmax(errors))
    if errors[worst] > WRONG_DERIVATIVE * scale:
        what = f"{symbol}{NAMES[order[worst]]} = {values[worst]:.9g} at E = {STRAIN_NEAR_REST}"
        allowed = f"differences of {of} give {expected[worst]:.9g}"
        remedy = "S12 is half of ∂W/∂E12; the C are on E11, E22 and 2 E12."
        raise InputError(what, allowed, name, remedy)
