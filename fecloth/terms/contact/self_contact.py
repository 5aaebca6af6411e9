"""Contact of the cloth with itself, by the IPC Toolkit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError, is_number
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.intersections import find_intersections
from fecloth.mesh.surface import Surface
from fecloth.quantities.units import LENGTH, PRESSURE
from fecloth.terms.contact.barrier import automatic_stiffness
from fecloth.terms.contact.obstacle import CREEP
from fecloth.terms.contact.self_contact_over_step import RubbedContactOverStep, SelfContactOverStep
from fecloth.terms.contact.toolkit import ContactSets, load
from fecloth.terms.step_difference import StepDifference

FARTHEST = 3.0  # gaps: the shortest edge must have as many
NAMED = 5  # pairs of triangles that an error names


@dataclass(frozen=True)
class SelfContact:
    """Triangles of the cloth at the distance d < thickness + gap push each other apart.

    The potential is Σ κ gap A b(d²) over pairs of a node and a triangle and over pairs of edges,
    with areas A as weights and the barrier of the toolkit, for the thickness 0

        b(d²) = −(s² − 1)² ln s², s = d/gap < 1; 0 from s = 1 on; +∞ for s = 0

    so that no triangle ever passes through another. The pressure between two layers is 1.7 to 2.7
    times −κ b′(s), as nodes and edges of both act: less on unstructured meshes, more on "right"
    ones. Pairs that share a node do not act. The forces are continuous, their slopes almost: they
    jump where edges are exactly parallel. In each
    step of Newton's iteration a continuous collision detection finds how far the cloth may move.

    The pairs change from iteration to iteration. So the tangent stays outside the fixed pattern of
    the matrix (`coupling`); without a contact a step costs as much as before, plus the search for
    pairs. P2 triangles touch as four flat ones each.

    Source: Li et al. (2020), Incremental Potential Contact: Intersection- and Inversion-free,
    Large-Deformation Dynamics, ACM Trans. Graph. 39(4); Li, Kaufman and Jiang (2021), Codimensional
    Incremental Potential Contact, ACM Trans. Graph. 40(4), for the thickness; computed by the IPC
    Toolkit, the package ``ipctk``.

    Friction is that of Coulomb, smoothed and lagged, as of `Obstacle`.

    Valid for any speed and any deformation, with `BackwardEuler`, `BDF2` and, without friction,
    `equilibrium`, from a start free of intersections.

    Cost: as much as the other work of an iteration where each node has a contact.

    Parameters
    ----------
    gap
        Distance at which the barrier begins, beyond the thickness [m]. The gap and the thickness
        together must be at most a third of the shortest edge.
    friction
        Coefficient μ of Coulomb friction between two layers.
    thickness
        Least distance of two layers, between their middle surfaces [m].
    stiffness
        κ [Pa], or "auto": as for `Obstacle`.

    Examples
    --------
    >>> import fecloth as fc
    >>> terms = [fc.StVK(), fc.Gravity(), fc.SelfContact(gap="1 mm")]
    """

    gap: Annotated[float, LENGTH] = 1e-3
    friction: float = 0.0
    thickness: Annotated[float, LENGTH] = 0.0
    stiffness: Annotated[float | Literal["auto"], PRESSURE] = "auto"

    elements = ("P1", "P2")

    def __post_init__(self):
        for name, value, least in (("gap", self.gap, "> 0"), ("thickness", self.thickness, "≥ 0")):
            if not (is_number(value) and (value > 0 or (value == 0 and least == "≥ 0"))):
                allowed = f"must be finite and {least} [m]"
                raise InputError(f"{name} = {value!r}", allowed, "SelfContact")
        if not (is_number(self.friction) and self.friction >= 0):
            what = f"friction = {self.friction!r}"
            raise InputError(what, "must be finite and >= 0", "SelfContact")
        if self.stiffness != "auto" and not (is_number(self.stiffness) and self.stiffness > 0):
            allowed = 'must be finite and > 0 [Pa], or "auto"'
            raise InputError(f"stiffness = {self.stiffness!r}", allowed, "SelfContact")

    def stencil(self, cloth: Cloth) -> None:
        return None

    def bind(self, panel: Panel, slots) -> BoundSelfContact:
        load("SelfContact")
        triangles = Surface.of(panel.cloth).triangles
        edges = panel.cloth.X[triangles] - panel.cloth.X[np.roll(triangles, 1, axis=1)]
        largest = float(np.linalg.norm(edges, axis=2).min()) / FARTHEST
        if self.gap + self.thickness > largest:
            what = f"gap + thickness = {self.gap + self.thickness:.4g} m"
            allowed = f"must be at most {largest:.4g} m, a third of the shortest edge"
            remedy = "Take a smaller gap, or a coarser mesh: neighbours would push each other."
            raise InputError(what, allowed, "SelfContact", remedy)
        stiffness = self.stiffness
        if stiffness == "auto":
            stiffness = automatic_stiffness(panel, self.gap)
        cloth, numbers = panel.cloth, (self.gap, self.friction, self.thickness, float(stiffness))
        return BoundSelfContact(cloth, triangles, *numbers, CREEP * cloth.extent)


@dataclass(frozen=True, eq=False)
class BoundSelfContact:
    """`SelfContact` on a cloth."""

    cloth: Cloth
    triangles: np.ndarray
    gap: float
    friction: float
    thickness: float
    stiffness: float
    creep: float

    name = "SelfContact"
    symmetric = True
    has_energy = True
    stores_strain = False
    needs_end = "the barrier must hold at the end of a step"

    @property
    def dissipative(self) -> bool:
        return self.friction > 0.0

    velocity_dependent = dissipative

    @property
    def no_equilibrium(self) -> str:
        """Why it has no unique equilibrium, or ""."""
        return "with friction the place of rest depends on the way there" if self.friction else ""

    @cached_property
    def sets(self) -> ContactSets:
        """The contacts at positions of the cloth."""
        X = np.column_stack([self.cloth.X, np.zeros(len(self.cloth.X))])
        return ContactSets.of(X, self.triangles, self.gap, self.thickness, self.stiffness)

    def energy(self, x, t) -> float:
        """Σ κ gap A b(s) [J]."""
        return self.sets.energy(x)

    def add_force(self, x, v, t, f) -> None:
        """f −= ∂energy/∂x, and friction [N]."""
        f += self.sets.force(x)
        if self.friction and v.any():
            f += self.sets.rub(self.sets.lag(x, self.friction), v, self.creep)[1]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Add nothing: all of the tangent is in `coupling`."""

    def coupling(self, x, v, t, wx, wv, definite) -> sparse.spmatrix | None:
        """wx K of the barrier, without the negative part of each pair if `definite`, and wv D.

        How friction changes with x is left out: over a step, for which methods ask, it is lagged.
        """
        K = self.sets.tangent(x, definite)
        if K is None:
            return None
        D = None
        if self.friction and wv:
            D = self.sets.rub_slope(self.sets.lag(x, self.friction), v, self.creep)
        return wx * K if D is None else wx * K + wv * D

    def power(self, x, v, t) -> float:
        """Dissipated power Σ μ λ f₁(y) y of friction [W]."""
        force = self.sets.rub(self.sets.lag(x, self.friction), v, self.creep)[1]
        return -float((force * v).sum())

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α ≤ 1 for which no triangle passes through another on the way to x + α s."""
        return self.sets.free_part(x, x + s)

    def over_step(self, step: StepDifference) -> SelfContactOverStep:
        """The contact over a step: it knows where the step began."""
        kind = RubbedContactOverStep if self.friction else SelfContactOverStep
        return kind(self, step)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Return zeros: at rest nothing touches."""
        return 0.0, 0.0

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for layers that start nearer than the thickness, or intersect."""
        if self.sets.intersects(x):
            pairs = find_intersections(self.triangles, x)
            named = ", ".join(f"{a} and {b}" for a, b in pairs[:NAMED]) if pairs is not None else ""
            what = f"triangles intersect at the start: {named or 'some'}"
            remedy = "Place the cloth so that its layers do not meet."
            raise InputError(what, "must start free of intersections", where, remedy)
        nearest = self.sets.least_distance(x)
        if nearest <= self.thickness:
            what = f"two layers start at a distance of {nearest:.3g} m"
            allowed = f"must be farther apart than the thickness, {self.thickness:g} m"
            raise InputError(what, allowed, where, "Move them apart, or take a smaller thickness.")
