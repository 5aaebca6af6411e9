"""Tethers: springs from nodes to a point that may move, such as a hand that pulls the cloth."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import inner
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.selection import Where
from fecloth.quantities.time_function import TimeFunction, VectorOfTime, vector
from fecloth.quantities.units import DAMPER, LENGTH, PER_WIDTH
from fecloth.terms.loops import bound_condition
from fecloth.terms.traits import TermTraits


@dataclass(frozen=True)
class Tether:
    """C = x − p(t), energy ½ k |x − p|² for each node: a spring of no length to the point p(t).

    The force is −k (x − p) − k_d (v − ṗ). K = k I and D = k_d I are exact, as C is linear. The
    energy ledger has the work of the hand, ∫ Σ f·dp, as the work of the tether, with jumps of p.

    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eqs. 7, 8, 11, 13, with
    ∂C = I.

    Valid for any distance. Unlike a `Pin` it gives way, by F/k under the force F; many nodes
    drawn to one point crumple the cloth there.

    Parameters
    ----------
    where
        A node set's name, node indices, or a predicate on X; all are drawn to the one point.
    point
        p: three numbers or formulas of t, or a function of t [m].
    stiffness
        k > 0 of each node's spring [N/m].
    damping
        k_d ≥ 0 of each node's spring [N s/m].
    """

    where: Where
    point: Annotated[VectorOfTime, LENGTH]
    stiffness: Annotated[float, PER_WIDTH]
    damping: Annotated[float, DAMPER] = 0.0

    def __post_init__(self):
        validation.positive("stiffness", self.stiffness, "N/m", "Tether")
        validation.positive("damping", self.damping, "N s/m", "Tether", or_zero=True)
        vector(self.point, "point", "Tether")

    traits = TermTraits(elements=("P1", "P2"), shared=True)

    def stencil(self, cloth: Cloth) -> np.ndarray:
        return np.asarray(cloth.nodes(self.where), dtype=np.int32)[:, None]

    def bind(self, panel: Panel, slots) -> bound_condition.BoundCondition:
        """Bind each node as a condition with the three components of x − p.

        Raises `InputError` for a point that is no function of time.
        """
        point = vector(self.point, "point", "Tether")
        point(0.0)  # an error in a function of time is raised here, not in a step
        return BoundTether.bind(
            "Tether",
            KERNELS,
            convex=(1, 1, 1),
            panel=panel,
            slots=slots,
            nodes=self.stencil(panel.cloth),
            constants=np.zeros(3),  # `BoundTether.table` gives p(t) in their place
            stiffness=self.stiffness,
            damping=self.damping,
            point=point,
        )


@dataclass(frozen=True, eq=False)
class BoundTether(bound_condition.BoundCondition):
    """`Tether` on a cloth; Ċ = v − ṗ, so that the loop sees velocities relative to the point."""

    point: TimeFunction = field(kw_only=True)

    conserves = True

    def table(self, x, t, order) -> np.ndarray:
        return np.tile(self.point(t), (len(self.nodes), 1))

    def speed(self, t: float) -> np.ndarray:
        """(3,) ṗ [m/s]."""
        return self.point.rate(t)

    def supply(self, x, v, t) -> float:
        """Return the power of the hand by the damping, −Σ k_d (v − ṗ)·ṗ [W].

        The power by the springs is not in it: the ledger adds ∂U/∂t.
        """
        speed = self.speed(t)
        force = np.zeros_like(x)
        elastic_force = np.zeros_like(x)
        super().add_force(x, v - speed, t, force)
        super().add_force(x, np.zeros_like(x), t, elastic_force)
        return float((force - elastic_force).sum(axis=0) @ speed)

    def power(self, x, v, t) -> float:
        return super().power(x, v - self.speed(t), t)

    def add_force(self, x, v, t, f) -> None:
        """f −= k (x − p) + k_d (v − ṗ) [N]."""
        w = v
        if self.dissipative:
            w = v - self.speed(t)
        super().add_force(x, w, t, f)


@inner
def offset(y, c, order, C, g, H):
    """Fill C = y − c, ∂C = I and ∂²C = 0 of a node at y, with the point c.

    The arguments are those of every family of conditions: see `loops.condition`.
    """
    for r in range(3):
        C[r] = y[0, r] - c[r]
        if order > 0:
            for i in range(3):
                g[r, 0, i] = 0.0
            g[r, 0, r] = 1.0
    if order > 1:
        H[:] = 0.0


KERNELS = bound_condition.ConditionKernels(offset)
