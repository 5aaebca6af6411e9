"""The IPC Toolkit: which parts of a surface are in contact, and the barrier between them."""

import importlib.util
import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.linalg.reductions import longest
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.sewn_cloth import SewnCloth
from fecloth.mesh.surface import Surface
from fecloth.terms.contact import barrier
from fecloth.terms.contact.pairs import PairPlaces, nodes_of, square_away_from
from fecloth.terms.contact.shape import NO_EDGES, NO_TRIANGLES, Skeleton

# Part of a free way that is taken, where something is met at its end. Chosen: it must be < 1, so
# that the distance there is > 0.
PART_OF_FREE_WAY = 0.9
# Up to this distance over the gap it is asked whether all pairs are farther apart. This number
# and the next one decide on the cost only: beyond it, to ask costs more than it saves.
FARTHEST_ASKED_OVER_GAP = 6.0
# 1 − s from which on a pair pushes. Nearer to the end of the gap, its energy over b(s) is a
# quotient of round-off: b(s) is 1e-18 there.
LEAST_DEPTH_OVER_GAP = 1e-6
MOST_PAIRS_PER_NODE = 8  # to keep more pairs costs more than to search for them again


def is_installed() -> bool:
    """Whether the package ipctk can be imported."""
    return importlib.util.find_spec("ipctk") is not None


def load(where: str) -> Any:
    """Import the module ipctk, set it to one thread and no warnings, and return it.

    Raises `InputError` if it is missing; `where` names what needs it.
    """
    try:
        import ipctk
    except ImportError as error:
        remedy = "In the clone, pip install '.[contact]'."
        raise InputError(where, "needs the package ipctk", remedy=remedy) from error
    # No warnings: whether triangles intersect is tested after each step anyway.
    ipctk.set_logger_level(ipctk.LoggerLevel.error)
    # With more threads, sums have another order in each run, and so other round-off.
    ipctk.set_num_threads(1)
    return ipctk


class KeptPairs(NamedTuple):
    """Pairs that were found for the straight way of all nodes (n, 3) from `start` (n, 3) [m]."""

    start: np.ndarray
    way: np.ndarray
    pairs: Any


class TouchingPairs(NamedTuple):
    """Pairs that touch.

    Attributes
    ----------
    places
        The vectors (m, 3) from one part to the other, without nodes of the fixed mesh.
    n
        Their directions (m, 3).
    push
        The normal forces (m,) [N].
    areas
        The areas (m,) with which they count [m²].
    """

    places: PairPlaces
    n: np.ndarray
    push: np.ndarray
    areas: np.ndarray


def _exponent(fixed: Skeleton) -> float:
    """Return e, so that ratio^e is the `scale` of a mesh whose areas are `ratio` times too large.

    In the toolkit the area of a triangle goes with scale⁻², of a single edge, its length, with
    scale⁻¹, of a single point not at all; those of the cloth go with scale².
    """
    if len(fixed.triangles):
        return 1 / 4
    return 1 / 3 if len(fixed.edges) else 1 / 2


@dataclass(eq=False)
class ContactSets:
    """The pairs in contact of a cloth with itself, or with a fixed mesh, at positions x (n, 3).

    The contacts at the last positions are kept. So are all pairs that are nearer than three gaps
    at any point of the last way, if they are few: no other pair can touch while each node is
    less than a gap from a point of this way. The pairs are found by boxes around the parts of
    the surface. Where no real distance is as small, no pair is kept.

    Attributes
    ----------
    toolkit
        The module ipctk.
    mesh, potential
        Its collision mesh and its barrier potential.
    stiffness
        κ [Pa] of the potential.
    triangles
        Triangles (s, 3) of the cloth.
    fixed
        Points (k, 3) of the fixed mesh [m].
    gap
        Distance at which the barrier begins [m], beyond the thickness.
    thickness
        Least distance [m].
    """

    toolkit: Any
    mesh: Any
    potential: Any
    stiffness: float
    triangles: np.ndarray
    fixed: np.ndarray
    gap: float
    thickness: float
    _last: tuple[np.ndarray, Any] | None = field(default=None, repr=False)
    _pairs: KeptPairs | None = field(default=None, repr=False)
    _crowded: bool = False

    @classmethod
    def bind(
        cls,
        where: str,
        cloth: Cloth,
        gap: float,
        thickness: float,
        stiffness: float,
        fixed: Skeleton | None = None,
    ) -> Self:
        """Make the sets of a cloth with itself, or with the fixed mesh `fixed`.

        `gap` and `thickness` are in m, `stiffness` is κ [Pa]. Raises `InputError` if the package
        ipctk is missing; `where` names what needs it.
        """
        ipctk = load(where)
        triangles = Surface.from_cloth(cloth).triangles
        rest = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
        fixed_mesh = fixed or Skeleton(np.zeros((0, 3)), NO_EDGES, NO_TRIANGLES)
        # One mesh of the toolkit: first the nodes of the cloth, then those of the fixed mesh.
        faces = np.vstack([triangles, fixed_mesh.triangles + len(rest)]).astype(np.int32)
        edges_of_faces = ipctk.edges(np.asfortranarray(faces))
        edges = np.vstack([edges_of_faces, fixed_mesh.edges + len(rest)])
        edges = edges.astype(np.int32, order="F")

        def mesh_of(rest: np.ndarray, points: np.ndarray) -> Any:
            return ipctk.CollisionMesh(np.asfortranarray(np.vstack([rest, points])), edges, faces)

        mesh = mesh_of(rest, fixed_mesh.points)
        if fixed:
            # A fixed mesh with larger parts than the cloth must not weight contacts with its own
            # areas. The toolkit takes them from the positions at rest, and uses these, beside, only
            # in products of a length of the cloth and one of the fixed mesh: so the lengths of the
            # one are multiplied by `scale` and those of the other divided. All areas of the cloth
            # are scale² as large then, and the stiffness makes up for it.
            is_edge_of_cloth = edges.max(axis=1) < len(rest)
            largest_of_cloth = np.array(mesh.edge_areas)[is_edge_of_cloth].max()
            ratio = max(
                1.0, *mesh.edge_areas / largest_of_cloth, *mesh.vertex_areas / largest_of_cloth
            )
            scale = float(ratio) ** _exponent(fixed)
            mesh = mesh_of(scale * rest, fixed_mesh.points / scale)
            stiffness /= scale**2
        if isinstance(cloth, SewnCloth):
            apart = dict.fromkeys(map(tuple, cloth.neighbours.tolist()), False)
            mesh.can_collide = ipctk.make_sparse_filter(apart, True)
        if fixed:
            # Two nodes with the same number of a patch do not collide: the cloth meets the fixed
            # mesh only, and not itself.
            patches = np.repeat([0, 1], [len(rest), len(fixed_mesh.points)]).astype(np.int32)
            mesh.can_collide = ipctk.make_vertex_patches_filter(patches)
        potential = ipctk.BarrierPotential(gap, stiffness, use_physical_barrier=True)
        return cls(
            toolkit=ipctk,
            mesh=mesh,
            potential=potential,
            stiffness=stiffness,
            triangles=triangles,
            fixed=fixed_mesh.points,
            gap=gap,
            thickness=thickness,
        )

    def nodes(self, x: np.ndarray) -> np.ndarray:
        """(n + k, 3) x and the nodes of the fixed mesh."""
        return np.asfortranarray(np.vstack([x, self.fixed]))

    def at(self, x: np.ndarray) -> Any:
        """The contacts at x (n, 3); energy, force and tangent ask for the same ones in turn."""
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = x.copy(), self._find_contacts(x)
        return self._last[1]

    def _find_contacts(self, x: np.ndarray) -> Any:
        """Find the contacts at x (n, 3), as an object of the toolkit.

        They come from the pairs that are kept, or else from a search by the toolkit.
        """
        contacts = self.toolkit.NormalCollisions()
        contacts.use_area_weighting = True
        pairs = self.candidates(x)
        if pairs is None:
            contacts.build(self.mesh, self.nodes(x), self.gap, self.thickness)
        else:
            contacts.build(pairs, self.mesh, self.nodes(x), self.gap, self.thickness)
        return contacts

    def candidates(self, x: np.ndarray, end: np.ndarray | None = None) -> Any | None:
        """Return the pairs that can touch at x, or on the straight way from x to `end`.

        They are the pairs that are kept, if these cover x and `end`; otherwise they are searched
        for anew, and kept. None if they are too many to be kept: then the toolkit must search by
        itself. If they are too many at x alone, nothing is kept any more until `forget`.
        """
        y = x
        if end is not None:
            y = end
        if not self._crowded and not (self._covers(x) and self._covers(y)):
            pairs = self.toolkit.Candidates()
            # The boxes around the ways of the parts grow by this: by half of the distance of
            # two parts that touch, and by the gap that each node may go from its way.
            growth = 0.5 * (self.gap + self.thickness) + self.gap
            pairs.build(self.mesh, self.nodes(x), self.nodes(y), growth)
            way = self._without_mean(y - x)
            if self._are_far(pairs, x, longest(way)):
                pairs.clear()  # boxes overlap, but no parts are near: keep that none can touch
            if len(pairs) > MOST_PAIRS_PER_NODE * len(x):
                # A long way has many pairs, also where places on it have few.
                self._crowded = end is None
                return None
            self._pairs = KeptPairs(start=x.copy(), way=way, pairs=pairs)
        if self._crowded or self._pairs is None:
            return None
        return self._pairs.pairs

    def _are_far(self, pairs: Any, x: np.ndarray, way: float) -> bool:
        """Whether no pair can touch while each node is less than a gap from its way from x.

        `way` [m] is the length of the longest way. The answer is also False where the test would
        cost more than it saves.
        """
        # Both nodes of a pair may move towards each other, by their way and a gap.
        reach = self.gap + 2 * (way + self.gap)
        if reach > FARTHEST_ASKED_OVER_GAP * self.gap:
            return False
        contacts = self.toolkit.NormalCollisions()
        contacts.build(pairs, self.mesh, self.nodes(x), reach, self.thickness)
        return not len(contacts)

    def _covers(self, x: np.ndarray) -> bool:
        """Whether x is less than a gap from a point of the way of the pairs that are kept."""
        if self._crowded or self._pairs is None:
            return False
        kept = self._pairs
        drifts = not len(self.fixed)
        away = square_away_from(np.ascontiguousarray(x), kept.start, kept.way, drifts)
        return bool(away < self.gap**2)

    def _without_mean(self, way: np.ndarray) -> np.ndarray:
        """The ways (n, 3) of the nodes [m], without their mean where there is no fixed mesh."""
        if len(self.fixed):
            return way
        return way - way.mean(axis=0)

    def forget(self) -> None:
        """Drop what is kept, so that no result depends on earlier calls."""
        self._last = None
        self._pairs = None
        self._crowded = False

    def energy(self, x: np.ndarray) -> float:
        """[J]; +∞ where two parts are nearer than the thickness."""
        energy = float(self.potential(self.at(x), self.mesh, self.nodes(x)))
        if math.isfinite(energy):
            return energy
        return math.inf

    def force(self, x: np.ndarray) -> np.ndarray:
        """(n, 3) −∂energy/∂x [N]."""
        contacts = self.at(x)
        if not len(contacts):
            return np.zeros_like(x)
        gradient = self.potential.gradient(contacts, self.mesh, self.nodes(x))
        return -np.reshape(gradient, (-1, 3))[: len(x)]

    def tangent(self, x: np.ndarray, definite: bool) -> sparse.csr_matrix | None:
        """(3n, 3n) ∂²energy/∂x² [N/m]; None without contacts.

        If `definite`, the negative eigenvalues of each contact are set to 0.
        """
        contacts = self.at(x)
        if not len(contacts):
            return None
        projection = self.toolkit.PSDProjectionMethod.NONE
        if definite:
            projection = self.toolkit.PSDProjectionMethod.CLAMP
        K = self.potential.hessian(contacts, self.mesh, self.nodes(x), projection)
        return K[: x.size, : x.size].tocsr()  # without the nodes of the fixed mesh

    def touching(self, x: np.ndarray) -> "TouchingPairs":
        """Return the m contacts at x (n, 3), in an order by their nodes: the toolkit's changes.

        A contact has up to four nodes. The vector from one part to the other is Σ c_a x_a, with
        the coefficients c_a of the toolkit.
        """
        contacts = self.at(x)
        node_numbers = nodes_of(contacts, self.mesh)
        m = len(node_numbers)
        places = self.nodes(x)[node_numbers].reshape(m, 12)
        vectors = np.zeros((m, 3))
        coefficients = np.zeros((m, 4))
        energies = np.zeros(m)
        areas = np.zeros(m)
        coordinate_counts = 3 * (node_numbers >= 0).sum(axis=1)
        for number, count in enumerate(coordinate_counts):
            pair = contacts[number]
            own_places = places[number, :count]
            vector, own_coefficients = pair.compute_distance_vector_with_coefficients(own_places)
            vectors[number] = vector
            coefficients[number, : len(own_coefficients)] = own_coefficients
            energies[number] = self.potential(pair, own_places)
            areas[number] = pair.weight
        d = np.sqrt(np.einsum("mi,mi->m", vectors, vectors))
        is_of_cloth = (node_numbers >= 0) & (node_numbers < len(x))
        rows, _ = np.nonzero(is_of_cloth)
        entries = (coefficients[is_of_cloth], (rows, node_numbers[is_of_cloth]))
        weights = sparse.csr_matrix(entries, shape=(m, len(x)))
        order = np.lexsort(node_numbers.T)
        return TouchingPairs(
            places=PairPlaces(weights[order]),
            n=(vectors / d[:, None])[order],
            push=self._forces(d, energies)[order],
            areas=areas[order],
        )

    def _forces(self, d: np.ndarray, energies: np.ndarray) -> np.ndarray:
        """−dE/dd (m,) [N] of contacts with the distances d [m] and energies [J]."""
        span = (self.gap + self.thickness) ** 2 - self.thickness**2
        s = (d**2 - self.thickness**2) / span
        acts = s < 1 - LEAST_DEPTH_OVER_GAP
        any_s = np.where(acts, s, 0.5)  # 0.5: any s with b(s) > 0, where a pair does not act
        force_over_energy = barrier.pressure(any_s) / barrier.value(any_s) * 2 * d / span
        return np.where(acts, energies * force_over_energy, 0.0)

    def free_part(self, x: np.ndarray, y: np.ndarray) -> float:
        """Return a part α ≤ 1 for which nothing meets on the straight way to x + α (y − x).

        It is 1 if nothing meets on all of the way. Otherwise it is `PART_OF_FREE_WAY` of the way
        to the first collision that the toolkit detects, which itself leaves some distance. x and
        y are (n, 3) [m].

        Without a contact, `least_distance` is infinite, but it is only known that no parts are
        nearer than the gap.
        """
        room = min(self.least_distance(x) - self.thickness, self.gap)
        # Two parts come nearer by at most twice the longest way; a common motion of the cloth
        # changes no distance in it.
        if 2 * longest(self._without_mean(y - x)) < PART_OF_FREE_WAY * room:
            return 1.0
        # Only the pairs that can touch are tested. Without a list of them (None), the toolkit
        # searches among all pairs.
        detector = self.candidates(x, y)
        if detector is None:
            detector = self.toolkit
        part = detector.compute_collision_free_stepsize(
            self.mesh,
            self.nodes(x),
            self.nodes(y),
            self.thickness,
            narrow_phase_ccd=self.toolkit.AdditiveCCD(),
        )
        if part >= 1.0:
            return 1.0
        return PART_OF_FREE_WAY * float(part)

    def struck(self, x: np.ndarray, y: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the nodes, among those `held` by pins, that must meet something from x to y.

        They are the nodes of edges and triangles that meet on their straight ways. Only pairs
        count whose nodes are all held, or belong to the fixed mesh: other pairs can give way.
        """
        mesh = self.mesh
        pairs = self.toolkit.Candidates()
        begin = self.nodes(x)
        end = self.nodes(y)
        pairs.build(mesh, begin, end, self.thickness)
        prescribed_nodes = {*held, *range(len(x), len(begin))}
        struck_nodes: set[int] = set()
        for pair in [*pairs.ee_candidates, *pairs.fv_candidates]:
            nodes = pair.vertex_ids(mesh.edges, mesh.faces)
            if not prescribed_nodes.issuperset(nodes):
                continue
            rows = list(nodes)
            meets, _ = pair.ccd(begin[rows].ravel(), end[rows].ravel())
            if meets:
                struck_nodes.update(nodes)
        return np.array(sorted(struck_nodes.intersection(held)), int)

    def intersects(self, x: np.ndarray) -> bool:
        """Whether parts that share no node pass through each other."""
        return bool(self.toolkit.has_intersections(self.mesh, self.nodes(x)))

    def least_distance(self, x: np.ndarray) -> float:
        """Least distance [m] of parts nearer than thickness and gap; infinite without any."""
        contacts = self.at(x)
        if not len(contacts):
            return math.inf
        return math.sqrt(contacts.compute_minimum_distance(self.mesh, self.nodes(x)))
