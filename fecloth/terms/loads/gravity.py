"""Loads that do not depend on where the cloth is: gravity, and forces on points."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from fecloth.compiled.calls import Calls, ValuedCall
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.linalg.reductions import dot
from fecloth.quantities.time_function import TimeFunction, VectorOfTime, vector
from fecloth.quantities.units import ACCELERATION, FORCE, LENGTH
from fecloth.terms.loops.array_updates import add, add_shares, scale
from fecloth.terms.protocol import BoundTerm, uncoupled
from fecloth.terms.traits import LOAD


@dataclass(frozen=True)
class Gravity:
    """Weight f_a = Σ_b M_ab g = ρ g ∫ N_a dA with the potential −Σ f_a · x_a [J].

    The potential is zero at the origin.

    Source: virtual work of the weight ρ g of the reference area, exact on P1 and P2. On P2
    with a lumped mass the force is m_a g with the lumped masses m_a, so that a cloth in free
    fall stays flat. Then a P2 strip at rest converges as P1 does, with h² in L2 instead of h³.

    Valid at any deformation, in a uniform gravity field.

    Cost: a fiftieth of the force of `StVK`; there is no tangent.

    Parameters
    ----------
    acceleration
        g, three components [m/s²].
    """

    acceleration: Annotated[tuple[float, float, float], ACCELERATION] = (0.0, 0.0, -9.81)

    def __post_init__(self):
        g = np.asarray(self.acceleration)
        if g.shape != (3,) or g.dtype.kind not in "iuf" or not np.isfinite(g).all():
            allowed = "must be three finite numbers [m/s²]"
            raise InputError(f"acceleration = {self.acceleration!r}", allowed, "Gravity")

    traits = replace(LOAD, several_places=False)
    stencil = uncoupled

    def bind(self, panel: Panel, slots) -> BoundTerm:
        return BoundGravity(np.outer(panel.nodal_mass, self.acceleration))


@dataclass(frozen=True, eq=False)
class BoundGravity(BoundTerm):
    """`Gravity` on a cloth: `weight` (n, 3) are the forces on the nodes [N]."""

    weight: np.ndarray

    name = "Gravity"
    load = True
    symmetric = True
    has_energy = True
    conserves = True

    def energy(self, x, t) -> float:
        """−Σ f_a · x_a [J]."""
        return -dot(self.weight, x)

    def add_force(self, x, v, t, f) -> None:
        """f += the weight [N]."""
        f += self.weight

    def force_calls(self, x, v, t, f) -> Calls:
        return [(add, (self.weight, f))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Do nothing: the force is constant."""

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls:
        return []

    def energy_calls(self, x, t, sums) -> Calls:
        energy = sums[:1]
        return [ValuedCall(dot, (self.weight, x), energy), (scale, (-1.0, energy))]


@dataclass(frozen=True)
class PointForce:
    """f_a = N_a F(t) at a point of the cloth, or f_a = F(t)/k at each of k nodes.

    The resultant is F(t) on any mesh, in a direction that does not rotate with the cloth. Its
    work is ``work:PointForce`` in the energy ledger. There is no tangent.

    Source: virtual work F · δx of a force at a material point; N_a are the shape functions
    there.

    Valid at any deformation, at some distance from the point. At the point itself the
    displacement of a membrane does not converge under refinement: in the plane it grows as the
    logarithm of 1/h. Evaluate results elsewhere, or load a set of nodes whose size does not
    depend on h. For a load along an edge take `EdgeForce`: equal forces on its nodes give its
    ends, which have half an edge, too much.

    Cost: proportional to the number of loaded nodes.

    Parameters
    ----------
    where
        The name of a node set, a material point (X, Y) [m], node indices as a list or array,
        or a predicate on X.
    force
        F: three numbers [N], formulas of t as text, or a function of t.

    Examples
    --------
    >>> import fecloth as fc
    >>> pull = fc.PointForce("corners", ("0.1 * sin(t)", 0, 0.5))
    >>> middle = fc.PointForce((0.5, 0.5), lambda t: [0.0, 0.0, t**2])
    """

    where: Annotated[
        str | tuple[float, float] | list[int] | Callable[[np.ndarray], np.ndarray], LENGTH
    ]
    force: Annotated[VectorOfTime, FORCE]

    def __post_init__(self):
        vector(self.force, "force", "PointForce")

    traits = LOAD
    stencil = uncoupled

    def bind(self, panel: Panel, slots) -> BoundTerm:
        """Return the force on the nodes of a point's triangle, or on the named nodes.

        Raises `InputError` for a point that is not two finite numbers or not on the cloth, and
        for nodes that the cloth does not have.
        """
        cloth = panel.cloth
        force = vector(self.force, "force", "PointForce")
        if isinstance(self.where, tuple):  # a material point
            if len(self.where) != 2 or not np.isfinite(self.where).all():
                allowed = "must be two finite numbers (write node indices as a list)"
                raise InputError(f"point {self.where!r}", allowed, "PointForce")
            # One sparse row: the nodes of the triangle, and their shape functions N_a there.
            shapes = cloth.interpolator(np.array([self.where], dtype=float))
            return BoundPointForce(nodes=shapes.indices, share=shapes.data[:, None], force=force)
        nodes = cloth.nodes(self.where)
        equal_share = np.full((len(nodes), 1), 1 / len(nodes))
        return BoundPointForce(nodes=nodes, share=equal_share, force=force)


@dataclass(frozen=True, eq=False)
class BoundPointForce(BoundTerm):
    """`PointForce` on a cloth: nodes (k,) and their shares (k, 1), whose sum is 1."""

    nodes: np.ndarray
    share: np.ndarray
    force: TimeFunction

    name = "PointForce"
    load = True
    symmetric = True
    has_energy = False

    def supply(self, x, v, t) -> float:
        """Power F · v of the force [W]."""
        return float(self.force(t) @ np.sum(self.share * v[self.nodes], axis=0))

    def add_force(self, x, v, t, f) -> None:
        """f_a += N_a F [N]."""
        f[self.nodes] += self.share * self.force(t)

    def force_calls(self, x, v, t, f) -> Calls | None:
        force = np.empty(3)
        calls = self.force.calls(t, force)
        if calls is None:
            return None
        return [*calls, (add_shares, (self.nodes, self.share, force, f))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Do nothing: the force does not depend on x and v."""

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls:
        return []
