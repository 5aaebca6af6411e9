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
from fecloth.terms.custom.finite_differences import WEIGHTS
from fecloth.terms.kinematics import VOIGT
from fecloth.terms.loops import membrane, membrane_loops
from fecloth.terms.protocol import element_nodes
from fecloth.terms.traits import MEMBRANE


class MembraneLaw:
    """Base class of a membrane with a law of your own: write `law`, and `constants` if it has any.

    A subclass is a frozen dataclass with the parameters of the law as its fields, and is used as
    `StVK` is: in a `System`, on P1 and P2, with every integrator, as the `law` of
    `StrainRateDamping`, with stresses in the output. The name of its class is the term's name.

    ``law(E, c)`` is a static method of the Green strain E = (E11, E22, E12) and the constants
    c of the triangle, in warp and weft, and returns

        W                                 energy per reference area [J/m²]
        (S11, S22, S12)                   S = ∂W/∂E [N/m]; S12 is half of ∂W/∂E12
        (C11, C22, C66, C12, C16, C26)    ℂ = ∂S/∂E [N/m], on E11, E22 and 2 E12

    Numba compiles it: use numbers, tuples and `math`, and call only functions that are
    compiled themselves (`numba.njit`; `fecloth.terms.loops.green_strain.contract` gives ℂ :
    E). That takes a second or two for each of force, tangent and definite tangent. The machine
    code stays on disk until the law, its constants or a function that it calls changes. Write
    out the entries of c: a slice of c is slow. When the term is bound, S and ℂ are compared
    with differences near rest; `fecloth.verify.check_term` does so far from it.

    Newton's definite tangent clamps negative principal values of S and eigenvalues of ℂ: W
    need not be convex. `System` raises `InputError` for what is not (W, S, ℂ) or not finite at
    E = 0, for an entry of S or ℂ that is not the derivative, and for what Numba cannot
    compile.
    """

    traits = MEMBRANE

    law: ClassVar[Any] = None  # a static method of a subclass
    strain: ClassVar[str] = "interpolated"  # on P2; a subclass may say "pointwise"

    def constants(self, fabric: Fabric) -> Sequence[float]:
        """(p,) c, from the parameters and the fabric; none if not overridden."""
        return (0.0,)

    def moduli(self, fabric: Fabric) -> np.ndarray:
        """(6,) ℂ at E = 0 [N/m]."""
        return check_law(self.law, self._row(fabric), type(self).__name__)[2]

    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> membrane.BoundMembrane:
        name = type(self).__name__
        constants = panel.each(self._row)
        panel.each(self.moduli)  # checks the law
        try:
            _compile_law(self.law)(NEAR, constants[0])
        except NumbaError as error:
            what = f"law: {' '.join(str(error).split())}"
            allowed = "must be what Numba compiles"
            raise InputError(what, allowed, name) from error
        return membrane.bind(name, _kernels(self.law), constants, panel, slots, self.strain)

    def _row(self, fabric: Fabric) -> np.ndarray:
        """Check `constants` and return them as an array."""
        name = f"{type(self).__name__}.constants"
        try:
            c = np.array(self.constants(fabric), dtype=float)
        except (TypeError, ValueError, NameError, AttributeError) as error:
            raise InputError(f"constants: {error}", "must be a list of numbers", name) from error
        if c.ndim != 1 or not c.size or not np.isfinite(c).all():
            if c.ndim != 1:
                what = f"constants of shape {c.shape}"
            else:
                what = f"constants = {c}"
            raise InputError(what, "must be a list of finite numbers", name)
        return c


@inner
def positive(C):
    """Raise the negative eigenvalues of ℂ to zero."""
    C11, C22, C66, C12, C16, C26 = C
    minor = C11 * C22 - C12 * C12
    det = C66 * minor - C11 * C26 * C26 - C22 * C16 * C16 + 2.0 * C12 * C16 * C26
    if (C11 > 0.0 and minor > 0.0 and det > 0.0) or not math.isfinite(det):
        return C
    values, vectors = np.linalg.eigh(np.array([[C11, C12, C16], [C12, C22, C26], [C16, C26, C66]]))
    A = np.zeros((3, 3))
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
    """The law with floating-point numbers in place of integers."""
    W, S, C = law(E, c)
    S = 1.0 * S[0], 1.0 * S[1], 1.0 * S[2]
    return 1.0 * W, S, (1.0 * C[0], 1.0 * C[1], 1.0 * C[2], 1.0 * C[3], 1.0 * C[4], 1.0 * C[5])


def definite(E, c):
    """The law with ℂ positive semi-definite."""
    W, S, C = law(E, c)
    return W, S, positive(C)


@cache
def _compile_law(law: Callable) -> Callable:
    if isinstance(law, Dispatcher):
        return law
    return inner(law)


@cache
def _kernels(law: Callable) -> membrane_loops.Kernels:
    """Compile the entry points of a law."""
    exact = inner(insert(floating_point, law=_compile_law(law)))
    return membrane_loops.kernels(exact, inner(insert(definite, law=exact)))


NAMES = ("11", "22", "66", "12", "16", "26")  # of ℂ; the first two, and 12, of S
NEAR = (0.011, -0.007, 0.005)  # the strain at which S and ℂ are compared with differences
STEP = 1e-5
TOLERANCE = 1e-5  # relative to the largest entry


def check_law(law: Callable, c: np.ndarray, name: str) -> tuple:
    """Check the law of the term `name` for the constants c; return W, S and ℂ at E = 0."""
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
    """Differentiate W to S (3,), and S to ∂S/∂E (3, 3) on E11, E22, 2 E12, at `NEAR`."""
    dW = np.zeros(3)
    dS = np.zeros((3, 3))
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
        what = f"{symbol}{NAMES[order[at]]} = {found[at]:.9g} at E = {NEAR}"
        allowed = f"differences of {of} give {expected[at]:.9g}"
        remedy = "S12 is half of ∂W/∂E12; the C are on E11, E22 and 2 E12."
        raise InputError(what, allowed, name, remedy)
