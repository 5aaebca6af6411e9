"""Contact of the cloth with itself, by the IPC Toolkit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from fecloth.errors import InputError, is_number
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.units import LENGTH, PRESSURE
from fecloth.terms.contact import barrier
from fecloth.terms.contact.friction import CREEP
from fecloth.terms.contact.toolkit import ContactSets
from fecloth.terms.contact.triangle_contact import BoundTriangleContact
from fecloth.terms.traits import CONTACT

FARTHEST = 3.0  # gaps: the shortest edge must have as many


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
    stiffness: Annotated[barrier.Stiffness, PRESSURE] = "auto"

    traits = replace(CONTACT, several_places=False)

    def __post_init__(self):
        if not (is_number(self.thickness) and self.thickness >= 0):
            what = f"thickness = {self.thickness!r}"
            raise InputError(what, "must be finite and ≥ 0 [m]", "SelfContact")
        barrier.check_numbers("SelfContact", self.gap, self.friction, self.stiffness)

    def stencil(self, cloth: Cloth) -> None:
        return None

    def bind(self, panel: Panel, slots) -> BoundTriangleContact:
        cloth, stiffness = panel.cloth, barrier.stiffness_of(self.stiffness, panel, self.gap)
        numbers = float(self.gap), float(self.thickness), stiffness
        sets = ContactSets.of("SelfContact", cloth, *numbers)
        edges = cloth.X[sets.triangles] - cloth.X[np.roll(sets.triangles, 1, axis=1)]
        largest = float(np.linalg.norm(edges, axis=2).min()) / FARTHEST
        if self.gap + self.thickness > largest:
            what = f"gap + thickness = {self.gap + self.thickness:.4g} m"
            allowed = f"must be at most {largest:.4g} m, a third of the shortest edge"
            remedy = "Take a smaller gap, or a coarser mesh: neighbours would push each other."
            raise InputError(what, allowed, "SelfContact", remedy)
        return BoundTriangleContact("SelfContact", sets, self.friction, CREEP * cloth.extent)
