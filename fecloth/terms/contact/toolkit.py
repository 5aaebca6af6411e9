"""The IPC Toolkit: which parts of a surface are in contact, and the barrier between them."""

import importlib.util
import math
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.linalg.reductions import longest
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.surface import Surface
from fecloth.terms.contact.pairs import nodes_of, square_away_from
from fecloth.terms.contact.shape import NO_EDGES, NO_TRIANGLES, Skeleton

RESERVE = 0.9  # of the way that is free, where it is not all of it
AROUND = 1.0  # gaps that a node may move while the pairs found before are all that can touch
FARTHEST = 6.0  # gaps: up to here it pays to ask whether all pairs are farther apart than that
CROWDED = 8  # of these pairs for each node: from here on to keep them costs more


def is_installed() -> bool:
    """Whether the package ipctk can be imported."""
    return importlib.util.find_spec("ipctk") is not None


def load(where: str) -> Any:
    """Import ipctk; raise `InputError` if it is missing."""
    try:
        import ipctk
    except ImportError as error:
        remedy = "In the clone, pip install '.[contact]'."
        raise InputError(where, "needs the package ipctk", remedy=remedy) from error
    ipctk.set_logger_level(ipctk.LoggerLevel.error)  # its doubts are tested after each step
    ipctk.set_num_threads(1)  # on more, sums have another order in each run, and other bits
    return ipctk


@dataclass(eq=False)
class ContactSets:
    """The pairs in contact of a cloth with itself, or with a fixed mesh, at positions x (n, 3).

    The contacts at the positions asked for last are kept. So are all pairs that are nearer
    than three gaps at any point of the way asked for last, if they are few: no others can
    touch where each node is less than a gap from a point of this way. Boxes around the parts
    find these pairs; where no real distance is as small, none is kept.
    """

    # ipctk, and its collision mesh and barrier potential.
    toolkit: Any
    mesh: Any
    potential: Any
    triangles: np.ndarray  # (s, 3) of the cloth
    fixed: np.ndarray  # (k, 3) points of the fixed mesh [m]
    # [m].
    gap: float
    thickness: float
    # Largest area [m²] with which a pair counts: of two edges of the cloth, where the fixed mesh
    # has larger ones. The toolkit takes the length of a single edge for its area.
    largest: float = math.inf
    _last: tuple[np.ndarray, Any] | None = field(default=None, repr=False)
    _pairs: tuple[np.ndarray, np.ndarray, Any] | None = field(default=None, repr=False)
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
        """Return the pairs of a cloth with itself, or with the points, edges and triangles `fixed`.

        `where` begins the error if ipctk is missing.
        """
        ipctk = load(where)
        triangles = Surface.from_cloth(cloth).triangles
        rest = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
        others = fixed or Skeleton(np.zeros((0, 3)), NO_EDGES, NO_TRIANGLES)
        faces = np.vstack([triangles, others.triangles + len(rest)]).astype(np.int32)
        edges = np.vstack([ipctk.edges(np.asfortranarray(faces)), others.edges + len(rest)])
        nodes = np.asfortranarray(np.vstack([rest, others.points]))
        mesh = ipctk.CollisionMesh(nodes, edges.astype(np.int32, order="F"), faces)
        largest = math.inf
        if fixed:
            patches = np.repeat([0, 1], [len(rest), len(others.points)]).astype(np.int32)
            mesh.can_collide = ipctk.make_vertex_patches_filter(patches)
            of_cloth = np.array(mesh.edge_areas)[edges.max(axis=1) < len(rest)].max()
            if max(max(mesh.edge_areas), max(mesh.vertex_areas)) > of_cloth:
                largest = 0.5 * float(of_cloth)
        potential = ipctk.BarrierPotential(gap, stiffness, use_physical_barrier=True)
        return cls(ipctk, mesh, potential, triangles, others.points, gap, thickness, largest)

    def nodes(self, x: np.ndarray) -> np.ndarray:
        """(n + k, 3) x and the nodes of the fixed mesh."""
        return np.asfortranarray(np.vstack([x, self.fixed]))

    def at(self, x: np.ndarray) -> Any:
        """The contacts at x (n, 3); energy, force and tangent ask for the same ones in turn."""
        if self._last is None or not np.array_equal(self._last[0], x):
            contacts = self.toolkit.NormalCollisions()
            contacts.use_area_weighting = True
            pairs = self.candidates(x)
            where = (self.mesh, self.nodes(x), self.gap, self.thickness)
            contacts.build(*where) if pairs is None else contacts.build(pairs, *where)
            for number in range(len(contacts)) if self.largest < math.inf else ():
                contacts[number].weight = min(contacts[number].weight, self.largest)
            self._last = x.copy(), contacts
        return self._last[1]

    def candidates(self, x: np.ndarray, end: np.ndarray | None = None) -> Any | None:
        """The pairs that can touch at x, or on the straight way to `end`; None if they are many."""
        y = x if end is None else end
        if not self._crowded and not (self._covers(x) and self._covers(y)):
            pairs = self.toolkit.Candidates()
            reach = 0.5 * (self.gap + self.thickness)
            way = self.nodes(x), self.nodes(y)
            pairs.build(self.mesh, *way, reach + AROUND * self.gap)  # each box grows by it
            if self._are_far(pairs, x, longest(self._without_mean(y - x))):
                pairs.clear()
            if len(pairs) > CROWDED * len(x):
                self._crowded = end is None
                return None
            self._pairs = x.copy(), self._without_mean(y - x), pairs
        if self._crowded or self._pairs is None:
            return None
        return self._pairs[2]

    def _are_far(self, pairs: Any, x: np.ndarray, way: float) -> bool:
        """Whether no pair can touch while each node is less than a gap from this way [m] from x."""
        reach = self.gap + 2 * (way + AROUND * self.gap)
        if reach > FARTHEST * self.gap:
            return False
        contacts = self.toolkit.NormalCollisions()
        contacts.build(pairs, self.mesh, self.nodes(x), reach, self.thickness)
        return not len(contacts)

    def _covers(self, x: np.ndarray) -> bool:
        """Whether x is less than a gap from a point of the way of the pairs that are kept."""
        if self._crowded or self._pairs is None:
            return False
        start, way, _ = self._pairs
        away = square_away_from(np.ascontiguousarray(x), start, way, not len(self.fixed))
        return bool(away < (AROUND * self.gap) ** 2)

    def _without_mean(self, way: np.ndarray) -> np.ndarray:
        """The ways (n, 3) of the nodes [m] without what all nodes of the cloth move alike."""
        if len(self.fixed):
            return way
        return way - way.mean(axis=0)

    def forget(self) -> None:
        """Drop all pairs that were found, so that no result depends on earlier calls."""
        self._last = None
        self._pairs = None
        self._crowded = False

    def energy(self, x: np.ndarray) -> float:
        """[J]; +∞ where two parts are nearer than the thickness."""
        energy = float(self.potential(self.at(x), self.mesh, self.nodes(x)))
        return energy if math.isfinite(energy) else math.inf

    def force(self, x: np.ndarray) -> np.ndarray:
        """(n, 3) −∂energy/∂x [N]."""
        contacts = self.at(x)
        if not len(contacts):
            return np.zeros_like(x)
        gradient = self.potential.gradient(contacts, self.mesh, self.nodes(x))
        return -np.reshape(gradient, (-1, 3))[: len(x)]

    def tangent(self, x: np.ndarray, definite: bool) -> sparse.csr_matrix | None:
        """(3n, 3n) ∂²energy/∂x² [N/m]; None without contacts."""
        contacts = self.at(x)
        method = self.toolkit.PSDProjectionMethod
        if not len(contacts):
            return None
        kind = method.CLAMP if definite else method.NONE
        K = self.potential.hessian(contacts, self.mesh, self.nodes(x), kind)
        return K[: x.size, : x.size].tocsr()

    def pairs(self, x: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
        """Of the m contacts at x (n, 3): ∇d (m, 3n), d (m,) [m] and energies (m,) [J]."""
        contacts = self.at(x)
        nodes = self.nodes(x)
        ids = nodes_of(contacts, self.mesh)
        places = nodes[ids].reshape(len(ids), 12)
        lines = []
        for number, size in enumerate(3 * (ids >= 0).sum(axis=1)):
            pair = contacts[number]
            own = places[number, :size]
            way, parts = pair.compute_distance_vector_with_coefficients(own)
            lines.append((*way, *parts, *(4 - len(parts)) * (0.0,), self.potential(pair, own)))
        numbers = np.array(lines).reshape(-1, 8)
        way = numbers[:, :3]
        parts = numbers[:, 3:7]
        energies = numbers[:, 7]
        d = np.sqrt(np.einsum("mi,mi->m", way, way))
        values = parts[:, :, None] * (way / d[:, None])[:, None]
        columns = 3 * ids[:, :, None] + np.arange(3)
        rows = np.broadcast_to(np.arange(len(ids))[:, None, None], columns.shape)
        own = np.broadcast_to((ids[:, :, None] >= 0) & (ids[:, :, None] < len(x)), columns.shape)
        where = (rows[own], columns[own])
        shape = (len(ids), x.size)
        return sparse.csr_matrix((values[own], where), shape=shape), d, energies

    def lag(self, x: np.ndarray, friction: float, parts: np.ndarray | None = None) -> Any:
        """The contacts at x with their normal forces and directions of sliding, for μ."""
        # `parts` (m,) are what the normal forces are multiplied with.
        lagged = self.toolkit.TangentialCollisions()
        contacts = self.at(x)
        for number, part in enumerate(() if parts is None else parts):
            contacts[number].weight *= part
        lagged.build(self.mesh, self.nodes(x), contacts, self.potential, friction)
        self._last = self._last if parts is None else None  # as these have other weights now
        return lagged

    def rub(self, lagged: Any, v: np.ndarray, creep: float) -> tuple[float, np.ndarray]:
        """Σ μ λ f₀(y) [W] at velocities v (n, 3), and minus its derivative by v: the force [N]."""
        if not len(lagged):
            return 0.0, np.zeros_like(v)
        potential = self.toolkit.FrictionPotential(creep)
        all_v = self._velocities(v)
        gradient = potential.gradient(lagged, self.mesh, all_v)
        force = -np.reshape(gradient, (-1, 3))[: len(v)]
        return float(potential(lagged, self.mesh, all_v)), force

    def rub_slope(self, lagged: Any, v: np.ndarray, creep: float) -> sparse.csr_matrix | None:
        """(3n, 3n) −∂force/∂v [N s/m], positive semi-definite; None without contacts."""
        if not len(lagged):
            return None
        potential = self.toolkit.FrictionPotential(creep)
        method = self.toolkit.PSDProjectionMethod
        D = potential.hessian(lagged, self.mesh, self._velocities(v), method.CLAMP)
        return D[: v.size, : v.size].tocsr()

    def _velocities(self, v: np.ndarray) -> np.ndarray:
        return np.asfortranarray(np.vstack([v, np.zeros_like(self.fixed)]))

    def free_part(self, x: np.ndarray, y: np.ndarray) -> float:
        """The largest α ≤ 1 for which nothing meets on the straight way from x to x + α (y − x)."""
        room = min(self.least_distance(x) - self.thickness, self.gap)
        if 2 * longest(self._without_mean(y - x)) < RESERVE * room:
            return 1.0
        pairs = self.candidates(x, y)
        ends = (self.nodes(x), self.nodes(y), self.thickness)
        find = (self.toolkit if pairs is None else pairs).compute_collision_free_stepsize
        part = float(find(self.mesh, *ends, narrow_phase_ccd=self.toolkit.AdditiveCCD()))
        return 1.0 if part >= 1.0 else RESERVE * part

    def struck(self, x: np.ndarray, y: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Those of the nodes `held` of whose edges or triangles one meets another from x to y."""
        # The other one has held nodes only, too, or belongs to the fixed mesh.
        mesh = self.mesh
        pairs = self.toolkit.Candidates()
        begin = self.nodes(x)
        end = self.nodes(y)
        pairs.build(mesh, begin, end, self.thickness)
        moved = {*held, *range(len(x), len(begin))}
        met: set[int] = set()
        for pair in [*pairs.ee_candidates, *pairs.fv_candidates]:
            nodes = pair.vertex_ids(mesh.edges, mesh.faces)
            if moved.issuperset(nodes):
                corners = ([points[i] for i in nodes] for points in (begin, end))
                way = (np.concatenate(each) for each in corners)
                met.update(nodes if pair.ccd(*way)[0] else ())
        return np.array(sorted(met.intersection(held)), int)

    def intersects(self, x: np.ndarray) -> bool:
        """Whether parts that share no node pass through each other."""
        return bool(self.toolkit.has_intersections(self.mesh, self.nodes(x)))

    def least_distance(self, x: np.ndarray) -> float:
        """Least distance [m] of parts nearer than thickness and gap; infinite without any."""
        contacts = self.at(x)
        if not len(contacts):
            return math.inf
        return math.sqrt(contacts.compute_minimum_distance(self.mesh, self.nodes(x)))
