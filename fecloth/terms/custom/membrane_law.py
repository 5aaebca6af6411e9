"""A user's own membrane law: W, S and ℂ in the Green strain become a term.

What the laws of the package spell out by hand, so that their machine code is kept on disk, is
written out here with the law when it is first bound, and compiled anew in each process. The loops
are the same, and so is their speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.jit import inner
from fecloth.mesh.cloth import Cloth
from fecloth.terms.custom.law_check import NEAR, VOIGT, checked
from fecloth.terms.loops import gonzalez, membrane
from fecloth.terms.loops import membrane_discrete_gradient as averaged


class MembraneLaw:
    """Base of a membrane with a law of one's own: write `law`, and `constants` if it has any.

    A subclass is a frozen dataclass with the parameters of the law as its fields, and is used as
    `StVK` is: in a `System`, on P1 and P2, with every integrator (`EnergyMomentum` by the quotient
    of Gonzalez, see `terms.quotient`), as the `law` of `StrainRateDamping`, with stresses in the
    output. Its class's name is the term's.

    ``law(E, c)`` is a static method of the Green strain E = (E11, E22, E12) and the constants c of
    the triangle, in warp and weft, and returns

        W                                 energy per reference area [J/m²]
        (S11, S22, S12)                   S = ∂W/∂E [N/m]; S12 is half of ∂W/∂E12
        (C11, C22, C66, C12, C16, C26)    ℂ = ∂S/∂E [N/m], on E11, E22 and 2 E12

    It is compiled by Numba: numbers, tuples and `math`, and what it calls is compiled itself
    (`numba.njit`; `fecloth.terms.loops.membrane.contract` gives ℂ : E). That takes a second or two
    for each of force, tangent and definite tangent, in each process. Entries of c are best written
    out: a law with a slice of c took three times as long. S and ℂ are held against differences
    near rest when the term is bound, and far from it by `fecloth.verify.check_term`.

    Newton's definite tangent clamps the principal values of S, as for all laws, and the
    eigenvalues of ℂ where they are negative: W need not be convex.

    Raises
    ------
    InputError
        From `System`: for what is not (W, S, ℂ) or not finite at E = 0, for an entry of S or ℂ
        that is not the derivative, and for what Numba cannot compile.

    Examples
    --------
    A fabric that stiffens with its strain, W = ½ E:ℂ₀:E (1 + (E:E)/ε²):

    >>> import fecloth as fc
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Stiffening(fc.MembraneLaw):
    ...     strain: float
    ...
    ...     def constants(self, fabric):
    ...         return [fabric.moduli()[0], self.strain**-2]
    ...
    ...     @staticmethod
    ...     def law(E, c):
    ...         I = E[0] ** 2 + E[1] ** 2 + 2 * E[2] ** 2
    ...         W = c[0] * (I / 2 + c[1] * I**2 / 4)
    ...         s, d = c[0] * (1 + c[1] * I), 2 * c[0] * c[1]
    ...         C = (s + d * E[0] ** 2, s + d * E[1] ** 2, s / 2 + d * E[2] ** 2,
    ...              d * E[0] * E[1], d * E[0] * E[2], d * E[1] * E[2])
    ...         return W, (s * E[0], s * E[1], s * E[2]), C
    >>> sweeps = fc.verify.check_term(Stiffening(0.1), scales=[1.0])
    """

    elements = ("P1", "P2")

    law = None

    def constants(self, fabric: Fabric) -> Sequence[float]:
        """(p,) c, from the parameters and the fabric; none if not overridden."""
        return (0.0,)

    def moduli(self, fabric: Fabric) -> np.ndarray:
        """(6,) ℂ at E = 0 [N/m]."""
        return checked(self.law, self._row(fabric), type(self).__name__)[2]

    def stencil(self, cloth: Cloth) -> np.ndarray:
        return cloth.stencil

    def bind(self, panel: Panel, slots) -> averaged.SteppedMembrane:
        name, constants = type(self).__name__, panel.each(self._row)
        moduli = panel.each(lambda fabric: _raised(self.moduli(fabric)))
        try:
            jitted(self.law)(NEAR, constants[0])
        except NumbaError as error:
            what, allowed = f"law: {' '.join(str(error).split())}", "must be what Numba compiles"
            raise InputError(what, allowed, name) from error
        return averaged.bind(name, *compiled(self.law), constants, moduli, panel, slots)

    def _row(self, fabric: Fabric) -> np.ndarray:
        """`constants`, checked."""
        name = f"{type(self).__name__}.constants"
        try:
            c = np.array(self.constants(fabric), dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"constants: {error}", "must be a list of numbers", name) from error
        if c.ndim != 1 or not c.size or not np.isfinite(c).all():
            what = f"constants of shape {c.shape}" if c.ndim != 1 else f"constants = {c}"
            raise InputError(what, "must be a list of finite numbers", name)
        return c


def _raised(C: np.ndarray) -> np.ndarray:
    """ℂ with its eigenvalues made positive, which can only raise the bound on the frequency."""
    values, vectors = np.linalg.eigh(C[np.array(VOIGT)])
    least = max(1e-9 * np.abs(values).max(), 1e-100)
    A = (vectors * np.maximum(values, least)) @ vectors.T
    return np.array([A[0, 0], A[1, 1], A[2, 2], A[0, 1], A[0, 2], A[1, 2]])


# --- compiled ---------------------------------------------------------------------------------


@inner
def positive(C):
    """ℂ with its negative eigenvalues at zero."""
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


@cache
def jitted(law: Callable) -> Callable:
    """The law by itself."""
    return law if isinstance(law, Dispatcher) else inner(law)


class Entries(NamedTuple):
    """A law's entry points, at a state and over a step."""

    kernels: membrane.Kernels
    averaged: averaged.Averaged


@cache
def compiled(law: Callable) -> Entries:
    """The loops of `membrane` and `quotient` with the law, each compiled where it is first used."""
    own = jitted(law)

    @inner
    def exact(E, c):
        W, S, C = own(E, c)
        S = 1.0 * S[0], 1.0 * S[1], 1.0 * S[2]
        return 1.0 * W, S, (1.0 * C[0], 1.0 * C[1], 1.0 * C[2], 1.0 * C[3], 1.0 * C[4], 1.0 * C[5])

    @inner
    def definite(E, c):
        W, S, C = exact(E, c)
        return W, S, positive(C)

    return Entries(_at(exact, definite), _over(exact, definite))


def _by_floor(exact: Callable, definite: Callable) -> Callable:
    """A finite floor, the last argument but one, asks for a definite tangent."""
    return lambda *arguments: (definite if arguments[-2] > -math.inf else exact)(*arguments)


def _at(exact, definite) -> membrane.Kernels:
    """The entry points at a state."""

    @inner
    def energy(K, Q, nodes, G, w, c, x):
        return membrane.energy(exact, K, Q, nodes, G, w, c, x)

    @inner
    def add_force(K, Q, nodes, G, w, c, x, f):
        membrane.add_force(exact, K, Q, nodes, G, w, c, x, f)

    def tangent(law):
        @inner
        def add_tangent(K, Q, nodes, slots, G, w, c, x, scale, floor, J):
            membrane.add_tangent(law, K, Q, nodes, slots, G, w, c, x, scale, floor, J)

        return add_tangent

    @inner
    def add_stress(K, Q, nodes, G, w, c, x, out):
        membrane.add_stress(exact, K, Q, nodes, G, w, c, x, out)

    tangents = _by_floor(tangent(exact), tangent(definite))
    return membrane.Kernels(energy, add_force, tangents, add_stress)


def _over(exact, definite) -> averaged.Averaged:
    """The entry points over a step."""

    @inner
    def add_force(K, Q, nodes, G, w, c, start, x, f):
        gonzalez.add_force(exact, K, Q, nodes, G, w, c, start, x, f)

    @inner
    def add_tangent(K, Q, nodes, slots, G, w, c, start, x, scale, J):
        gonzalez.add_tangent(exact, K, Q, nodes, slots, G, w, c, start, x, scale, J)

    def symmetric(law):
        @inner
        def add_symmetric(K, Q, nodes, slots, G, w, c, start, x, scale, floor, J):
            averaged.add_symmetric(law, K, Q, nodes, slots, G, w, c, start, x, scale, floor, J)

        return add_symmetric

    symmetrics = _by_floor(symmetric(exact), symmetric(definite))
    return averaged.Averaged(add_force, add_tangent, symmetrics)
