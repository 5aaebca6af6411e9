"""A force on a point or on a set of nodes, as a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth.compiled.calls import Calls
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.time_function import TimeFunction, VectorOfTime, vector
from fecloth.quantities.units import FORCE, LENGTH
from fecloth.terms.loops.array_updates import add_rows
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.traits import LOAD


@dataclass(frozen=True)
class PointForce:
    """f_a = N_a F(t) at a point of the cloth, or f_a = F(t)/k at each of k nodes.

    The resultant is F(t) on any mesh. Its direction does not rotate with the cloth. The work of
    the force is in the column ``work:PointForce`` of the energy ledger. There is no tangent.

    Source: virtual work F · δx of a force at a material point; N_a are the shape functions there.

    Valid at any deformation, at some distance from the point. At the point itself the displacement
    of a membrane does not converge under refinement: in the plane it grows as the logarithm of
    1/h. Evaluate results elsewhere, or load a set of nodes whose size does not depend on h.

    Cost: proportional to the number of loaded nodes.

    Parameters
    ----------
    where
        The name of a node set, a material point (X, Y) [m], node indices as a list or array, or a
        predicate on X.
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

    def stencil(self, cloth: Cloth) -> None:
        return None

    def bind(self, panel: Panel, slots) -> BoundPointForce:
        cloth, force = panel.cloth, vector(self.force, "force", "PointForce")
        if isinstance(self.where, tuple):
            if len(self.where) != 2 or not np.isfinite(self.where).all():
                allowed = "must be two finite numbers (write node indices as a list)"
                raise InputError(f"point {self.where!r}", allowed, "PointForce")
            row = cloth.interpolator(np.array([self.where], dtype=float))
            return BoundPointForce(row.indices, row.data[:, None], force)
        nodes = cloth.nodes(self.where)
        return BoundPointForce(nodes, np.full((len(nodes), 1), 1 / len(nodes)), force)


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
        if not self.force.is_constant:
            return None
        return [(add_rows, (self.nodes, self.share * self.force(t), f))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Do nothing: the force does not depend on x and v."""

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        return 0.0, 0.0
