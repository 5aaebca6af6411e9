"""Coulomb friction with true stick: a spring ties each place that touches to an anchor.

    e = (1 − n nᵀ)(x − a),   F = −k e  where k |e| ≤ μ λ,   else  F = −μ λ e/|e|

with the place x, its anchor a on what it touches, the normal n, the normal force λ and the
stiffness k. The anchor stays while the place sticks. Where k |e| has exceeded μ λ, it follows
at the end of the step until k |e| = μ λ, and keeps the direction of e (a return mapping). So a
place that sticks does not creep: it stays within e = F/k, however long it is pulled.

F is the derivative of the potential φ(e) of `Sliders`. λ and n are taken at one place and time.
Over a step that is its begin, so that friction has a potential. Over an increment of the loads
it is the end, for which the increment is solved again and again.

In the ledger k |e|²/2 is stored, and μ λ (|e| − μ λ/k) is the heat of a step. Where a place
stops touching, what its spring has stored is heat, too.

Sources: Cundall and Strack (1979), A Discrete Numerical Model for Granular Assemblies,
Géotechnique 29(1), for the spring of a contact, its sum of ways and its limit; Simo and Laursen
(1992), An Augmented Lagrangian Treatment of Contact Problems Involving Friction, Computers &
Structures 42(1), for the trial state and the return mapping.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy.sparse as sparse

from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.sliders import Sliders

# k over κ A/gap, the stiffness of the barrier at its begin. Chosen: a place that sticks gives way
# along the surface by about μ/100 times as much as it gives way across it.
STICK_OVER_BARRIER = 100.0
# An impact has so large a normal force that its whole slip would only stretch such a spring. So a
# spring is stiffer for one step where it would slide only beyond this stretch, over the gap.
MOST_STRETCH_OVER_GAP = 1e-3


def along(n: np.ndarray, w: np.ndarray) -> np.ndarray:
    """w − n (n · w): the parts of vectors (m, 3) along a surface with the normals n (m, 3)."""
    return w - n * np.einsum("mi,mi->m", n, w)[:, None]


class Places(Protocol):
    """m places of the cloth that touch something; positions relative to it are linear in x."""

    def values(self, of_nodes: np.ndarray) -> np.ndarray:
        """(m, 3) values at the places, from values at the nodes (n, 3)."""

    def add_force(self, F: np.ndarray, f: np.ndarray) -> None:
        """f (n, 3) += the forces F (m, 3) at the places [N]."""

    def add_tangent(self, K: np.ndarray, J: BlockMatrix) -> None:
        """J += the stiffness K (m, 3, 3) at the places, where it is in the fixed pattern."""

    def coupling(self, K: np.ndarray) -> sparse.spmatrix | None:
        """(3n, 3n) the stiffness K (m, 3, 3) outside the fixed pattern; None without any."""

    def hand_on(self, before: Any, e: np.ndarray) -> np.ndarray:
        """(m, 3) e of these places, from e at the places `before`; 0 where they are new."""


@dataclass(frozen=True, eq=False)
class Grips:
    """What friction needs of places that touch at one state.

    Attributes
    ----------
    places
        The m places.
    n
        Normals (m, 3) in the frame of the body, of unit length.
    push
        Normal forces λ (m,) [N].
    stiffness
        k (m,) of their springs [N/m].
    """

    places: Places
    n: np.ndarray
    push: np.ndarray
    stiffness: np.ndarray

    def hand_on(self, before: Iterable["Grips"], stretches: Sequence[np.ndarray]) -> np.ndarray:
        """(m, 3) e along the surface, in the frame of the body, from the grips `before`."""
        e = np.zeros_like(self.n)
        for grips, stretch in zip(before, stretches, strict=True):
            e += self.places.hand_on(grips.places, stretch)
        return along(self.n, e)

    def stored(self, e: np.ndarray) -> float:
        """Σ k |e|²/2 [J]."""
        return 0.5 * float(self.stiffness @ np.einsum("mi,mi->m", e, e))


@dataclass(frozen=True, eq=False)
class Springs:
    """The springs of m places, at one pose of the body.

    Attributes
    ----------
    grips
        What touches.
    n
        Normals (m, 3) in space.
    anchors
        a (m, 3) in space, relative to what is touched [m].
    sliders
        The law of the springs.
    """

    grips: Grips
    n: np.ndarray
    anchors: np.ndarray
    sliders: Sliders

    def stretch(self, x: np.ndarray) -> np.ndarray:
        """(m, 3) e of the nodes at x (n, 3) [m]."""
        return along(self.n, self.grips.places.values(x) - self.anchors)

    def tangent(self, x: np.ndarray, exact: bool) -> np.ndarray:
        """(m, 3, 3) ∂²φ/∂x∂x [N/m], or the secant: both are positive semi-definite."""
        across = np.eye(3) - self.n[:, :, None] * self.n[:, None, :]
        of_law = self.sliders.tangent if exact else self.sliders.secant
        K: np.ndarray = across @ of_law(self.stretch(x)) @ across
        return K


class Friction(NamedTuple):
    """The springs of all kinds of places of a contact; their tangent is `exact` or a secant."""

    springs: Sequence[Springs] = ()
    exact: bool = True

    def energy(self, x: np.ndarray) -> float:
        """Σ φ(e) [J]."""
        return sum(float(each.sliders.energy(each.stretch(x)).sum()) for each in self.springs)

    def add_force(self, x: np.ndarray, f: np.ndarray) -> None:
        """f (n, 3) −= ∂φ/∂x [N]."""
        for each in self.springs:
            each.grips.places.add_force(-each.sliders.moment(each.stretch(x)), f)

    def add_tangent(self, x: np.ndarray, wx: float, J: BlockMatrix) -> None:
        """J += wx ∂²φ/∂x∂x or its secant, where it is in the fixed pattern."""
        for each in self.springs:
            each.grips.places.add_tangent(wx * each.tangent(x, self.exact), J)

    def couplings(self, x: np.ndarray, wx: float) -> list[sparse.spmatrix]:
        """The parts (3n, 3n) of wx ∂²φ/∂x∂x outside the fixed pattern."""
        parts = [
            each.grips.places.coupling(wx * each.tangent(x, self.exact)) for each in self.springs
        ]
        return [part for part in parts if part is not None]
