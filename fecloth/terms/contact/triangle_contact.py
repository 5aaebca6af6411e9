"""Contact between triangles, by the IPC Toolkit: of the cloth with itself or with a mesh."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import scipy.sparse as sparse

from fecloth import validation
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.mesh.surface import find_intersections
from fecloth.quantities.units import LENGTH, PRESSURE
from fecloth.terms.contact import barrier
from fecloth.terms.contact.bound_contact import NO_FORCES, BoundContact, Touched
from fecloth.terms.contact.friction import STICK_OVER_BARRIER, Grips
from fecloth.terms.contact.inside import MOST_NAMED
from fecloth.terms.contact.pairs import PairPlaces
from fecloth.terms.contact.shape import Shape
from fecloth.terms.contact.toolkit import ContactSets
from fecloth.terms.contact.touches import Touches, gradients
from fecloth.terms.protocol import BoundTerm, uncoupled
from fecloth.terms.step_difference import StepDifference
from fecloth.terms.traits import CONTACT

# The shortest edge over gap + thickness: with shorter edges, pairs of neighbours that share no
# node would push each other at rest.
LEAST_EDGE_OVER_GAP = 3.0


@dataclass(frozen=True, eq=False)
class BoundTriangleContact(BoundContact):
    """`SelfContact` or `MeshObstacle` on a cloth.

    Attributes
    ----------
    name
        Of the term.
    sets
        The contacts at positions of the cloth.
    friction
        Coefficient μ of Coulomb's friction.
    body
        The motion of the fixed mesh of the sets; None where it stands still. All contact is
        computed in the frame of this body.
    restitution
        Part of the speed that an impact leaves.
    last
        Where friction sticks; None before a run.
    """

    name: str
    sets: ContactSets
    friction: float
    body: Shape | None = None
    restitution: float = 0.0
    last: Touched | None = None

    couples_nodes = True

    def place(self, x: np.ndarray, t: float) -> np.ndarray:
        """Positions (n, 3) as the fixed mesh sees them."""
        if self.body is None:
            return x
        return self.body.pose(t).to_body(x)

    def slip(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) velocities as the fixed mesh sees them [m/s]."""
        if self.body is None:
            return v
        return (v - self.body.velocity(x, t)) @ self.body.pose(t).R

    def turned(self, t: float) -> np.ndarray | None:
        """R (3, 3) of the fixed mesh; None if it does not turn."""
        if self.body is None or self.body.rotate is None:
            return None
        return self.rotation(t)

    def barrier(self, x: np.ndarray, t: float) -> float:
        """Σ κ gap A b(s) [J]."""
        return self.sets.energy(self.place(x, t))

    def add_push(self, x: np.ndarray, t: float, f: np.ndarray) -> None:
        f += turn(self.sets.force(self.place(x, t)), self.turned(t))

    def push_coupling(self, x, t, wx, definite) -> sparse.spmatrix | None:
        """wx K of the barrier, without the negative part of each pair if `definite`."""
        K = self.sets.tangent(self.place(x, t), definite)
        return None if K is None else turn_matrix(wx * K, self.turned(t))

    def grips(self, x: np.ndarray, t: float, forces: np.ndarray = NO_FORCES) -> Sequence[Grips]:
        pairs = self.sets.touching(self.place(x, t))
        push = forces if len(forces) else pairs.push
        stiffness = STICK_OVER_BARRIER * self.sets.stiffness / self.gap * pairs.areas
        return [Grips(pairs.places, pairs.n, push, stiffness)]

    @property
    def gap(self) -> float:  # type: ignore[override]  # a field in the base, here of the sets
        return self.sets.gap

    def find_touches(self, old: Any, new: Any, h: float) -> Touches | None:
        y = self.place(new.x, new.t)
        if not len(self.sets.at(y)):
            return None
        pairs = self.sets.touching(y)
        if not pairs.push.any():
            return None
        places = pairs.places
        n = pairs.n @ self.rotation(new.t).T
        n_at_begin = pairs.n @ self.rotation(old.t).T
        opened = np.einsum("mi,mi->m", n_at_begin, places.weights @ old.v)
        return Touches(
            rows=gradients(places.weights, n),
            surface=self._speed_of_surface(places, n, new),
            before=opened - self._speed_of_surface(places, n_at_begin, old),
            pushed=h * pairs.push,
            restitution=np.full(len(n), self.restitution),
        )

    def _speed_of_surface(self, places: PairPlaces, n: np.ndarray, state: Any) -> np.ndarray:
        """Speeds (m,) of the fixed mesh along the normals n (m, 3) at a `State` [m/s]."""
        if self.body is None:
            return np.zeros(len(n))
        v = places.values(self.body.velocity(state.x, state.t))
        speeds: np.ndarray = np.einsum("mi,mi->m", n, v)
        return speeds

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α ≤ 1 for which no triangle passes through another up to x + α s."""
        return self.sets.free_part(self.place(x, t), self.place(x + s, t))

    def over_step(self, step: StepDifference) -> BoundTerm:
        self.sets.forget()  # so that a step depends on its begin only
        return super().over_step(step)

    def begin(self, step: StepDifference, t: float) -> np.ndarray:
        return self.place(step.start, step.t)

    def free_part(self, begin: np.ndarray, end: np.ndarray, t: float) -> float:
        return self.sets.free_part(begin, end)

    def allows(self, x: np.ndarray, t: float) -> bool:
        y = self.place(x, t)
        return not self.sets.intersects(y) and self.sets.least_distance(y) > self.sets.thickness

    def struck(self, x, end, t, dt, held) -> np.ndarray:
        return self.sets.struck(self.place(x, t), self.place(end, t + dt), held)

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for triangles that intersect, or are nearer than the thickness."""
        y = self.place(x, t)
        if self.sets.intersects(y):
            what, allowed = self.crossing(x)
            raise InputError(what, allowed, where, "Move them apart at the start.")
        least_distance = self.sets.least_distance(y)
        thickness = self.sets.thickness
        if least_distance <= thickness:
            what = f"two layers start at a distance of {least_distance:.3g} m"
            allowed = f"must be farther apart than the thickness, {thickness:g} m"
            remedy = "Move them apart, or take a smaller thickness."
            raise InputError(what, allowed, where, remedy)

    def crossing(self, x: np.ndarray) -> tuple[str, str]:
        """Return two texts for an error: which triangles intersect at x, and what is allowed."""
        allowed = "must start free of intersections"
        pairs = find_intersections(self.sets.triangles, x)
        if pairs is None or not len(pairs):
            return "triangles touch, or lie in one plane, at the start", allowed
        named = ", ".join(f"{a} and {b}" for a, b in pairs[:MOST_NAMED])
        return f"triangles intersect at the start: {named}", allowed


def turn(f: np.ndarray, R: np.ndarray | None) -> np.ndarray:
    """Vectors (n, 3) in space, from vectors in the frame of the fixed mesh."""
    if R is None:
        return f
    return f @ R.T


def turn_matrix(K: sparse.csr_matrix, R: np.ndarray | None) -> sparse.csr_matrix:
    """(3n, 3n) R K Rᵀ, in space."""
    if R is None:
        return K
    all_R = sparse.kron(sparse.identity(K.shape[0] // 3), R, format="csr")
    return (all_R @ K @ all_R.T).tocsr()


@dataclass(frozen=True)
class SelfContact:
    """Triangles of the cloth at the distance d < thickness + gap push each other apart.

    The potential is Σ κ gap A b(d²) over pairs of a node and a triangle and over pairs of edges,
    with areas A as weights and the barrier of the toolkit, for the thickness 0

        b(d²) = −(s² − 1)² ln s², s = d/gap < 1; 0 from s = 1 on; +∞ for s = 0

    so that no triangle ever passes through another. The pressure between two layers is 1.7 to
    2.7 times −κ b′(s), as nodes and edges of both layers act: less on unstructured meshes, more
    on "right" ones. Pairs that share a node do not act. The forces are continuous. Their slopes
    are continuous, too, except where edges are exactly parallel. In each step of Newton's
    iteration a continuous collision detection finds how far the cloth may move.

    The pairs change from iteration to iteration. So their tangent is not in the fixed pattern
    of the matrix (`coupling`). Without a contact, a step costs only the search for pairs more.
    A P2 triangle touches as four flat ones.

    Source: Li et al. (2020), Incremental Potential Contact: Intersection- and Inversion-free,
    Large-Deformation Dynamics, ACM Trans. Graph. 39(4); Li, Kaufman and Jiang (2021),
    Codimensional Incremental Potential Contact, ACM Trans. Graph. 40(4), for the thickness;
    computed by the IPC Toolkit, the package ``ipctk``.

    Friction sticks and slides as for `Obstacle`, with k = 100 κ A/gap of each pair. Where a node
    goes over to the next triangle, the new pair takes over the stretch of the old one, so that
    an anchor stays at its material points. Two layers that stick to each other and turn together
    feel no torque about their normal, but one against a turn about an axis in their plane: at most
    μ λ times their distance, an error of the order of the gap.

    An impact leaves the part `restitution` of the speed at which two layers close, as for
    `Obstacle`.

    Valid for any speed and any deformation, with `BackwardEuler`, `BDF2` and `equilibrium`,
    from a start free of intersections.

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
    restitution
        Part of the speed that an impact leaves, 0 (no bounce) … 1.

    Examples
    --------
    >>> import fecloth as fc
    >>> terms = [fc.StVK(), fc.Gravity(), fc.SelfContact(gap="1 mm")]
    """

    gap: Annotated[float, LENGTH] = 1e-3
    friction: float = 0.0
    thickness: Annotated[float, LENGTH] = 0.0
    stiffness: Annotated[barrier.Stiffness, PRESSURE] = "auto"
    restitution: float = 0.0

    traits = replace(CONTACT, several_places=False)

    def __post_init__(self):
        validation.positive("thickness", self.thickness, "m", "SelfContact", or_zero=True)
        barrier.check_numbers("SelfContact", self.gap, self.friction, self.stiffness)
        barrier.check_restitution("SelfContact", self.restitution)

    stencil = uncoupled

    def bind(self, panel: Panel, slots) -> BoundTriangleContact:
        """Bind the contact.

        Raises `InputError` for a gap that is too large for the mesh, and without the package
        ipctk.
        """
        cloth = panel.cloth
        stiffness = barrier.stiffness_of(self.stiffness, panel, self.gap)
        sets = ContactSets.bind(
            "SelfContact",
            cloth,
            gap=float(self.gap),
            thickness=float(self.thickness),
            stiffness=stiffness,
        )
        self._refuse_large_gap(cloth.X[sets.triangles])
        return BoundTriangleContact(
            name="SelfContact",
            sets=sets,
            friction=self.friction,
            restitution=self.restitution,
        )

    def _refuse_large_gap(self, corners: np.ndarray) -> None:
        """Raise `InputError` if neighbours would touch, for triangles with corners (s, 3, 2)."""
        edges = corners - np.roll(corners, 1, axis=1)
        largest = float(np.linalg.norm(edges, axis=2).min()) / LEAST_EDGE_OVER_GAP
        if self.gap + self.thickness > largest:
            what = f"gap + thickness = {self.gap + self.thickness:.4g} m"
            allowed = f"must be at most {largest:.4g} m, a third of the shortest edge"
            remedy = "Take a smaller gap, or a coarser mesh: neighbours would push each other."
            raise InputError(what, allowed, "SelfContact", remedy)
