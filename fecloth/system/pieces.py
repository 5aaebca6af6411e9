"""The connected pieces of a cloth that can move as a whole, and their rigid motion."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from fecloth.compiled.jit import Array, kernel
from fecloth.mesh.cloth import Cloth
from fecloth.system.constraints import Constraints

# Relative size of a singular value, or of an eigenvalue of a projector, that counts as zero.
ZERO_SINGULAR_VALUE = 1e-9
# The same of an eigenvalue of normal equations, whose round-off is 1e-16.
ZERO_EIGENVALUE = 1e-14


@dataclass(frozen=True, eq=False)
class Piece:
    """Nodes that terms connect, and the constrained ones among them.

    Attributes
    ----------
    nodes
        (k,) its nodes, ascending; a slice if they are all of the cloth.
    held
        (h,) those that pins or slides hold.
    held_projectors
        (h, 3, 3) the projector I − P onto the held directions of each of these.
    """

    nodes: np.ndarray | slice
    held: np.ndarray
    held_projectors: np.ndarray

    def rigid_velocity(self, x, p, mass, mass_x, held_v) -> np.ndarray:
        """Return the velocity of the piece as a rigid body, at its nodes (k, 3) [m/s].

        A free piece has the linear and angular momentum of its nodes. A held one follows its
        pins: Σ |(I − P)(v − u − ω × r)|² over the held nodes is least, and along the directions
        in which no pin holds it, u has its linear momentum. x and p (n, 3) are positions [m] and
        momenta M v [kg m/s], `mass` (n,) and `mass_x` (n, 3) row sums of M [kg] and M x [kg m],
        `held_v` (n, 3) velocities of the pins, of which only the held directions count.
        """
        m = mass[self.nodes]
        r = x[self.nodes]
        if len(self.held):
            centre, u, omega = self._motion_of_held(x, held_v)
            velocity = _turn(u, omega, r - centre)
            if not self.free_directions.any():
                return velocity
            # the momentum that is missing along the free directions
            momentum = p[self.nodes].sum(axis=0) - np.einsum("a,ai->i", m, velocity)
            return velocity + self.free_directions @ momentum / m.sum()
        centre = mass_x[self.nodes].sum(axis=0) / m.sum()
        r = r - centre  # from here on, from the centre of mass
        G = np.einsum("ai,aj->ij", r, p[self.nodes])
        moment = np.array([G[1, 2] - G[2, 1], G[2, 0] - G[0, 2], G[0, 1] - G[1, 0]])  # Σ r × p
        spread = np.einsum("ai,aj->ij", r, mass_x[self.nodes] - np.outer(m, centre))
        inertia = np.trace(spread) * np.eye(3) - 0.5 * (spread + spread.T)
        # the pseudo-inverse: nodes on a line have no inertia about it
        omega = np.linalg.pinv(inertia, rcond=ZERO_SINGULAR_VALUE, hermitian=True) @ moment
        return _turn(p[self.nodes].sum(axis=0) / m.sum(), omega, r)

    def _motion_of_held(
        self, x: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the mean c (3,) of the held nodes, and the u and ω (3,) that fit v best.

        Σ |(I − P)(v − u − ω × (x − c))|² over these nodes is least. If several u and ω fit
        alike, the result is the shortest.
        """
        centre = np.zeros(3)
        A = np.zeros((6, 6))
        b = np.zeros(6)
        size = fill_normal_equations(self.held, self.held_projectors, x, v, centre, A, b)
        values, vectors = np.linalg.eigh(A)
        counts = values > ZERO_EIGENVALUE * values[-1]
        vectors = vectors[:, counts]
        motion = vectors @ ((b @ vectors) / values[counts])
        return centre, motion[:3], motion[3:] / size

    @cached_property
    def free_directions(self) -> np.ndarray:
        """(3, 3) projector onto the directions in which no pin holds the piece."""
        values, vectors = np.linalg.eigh(self.held_projectors.sum(axis=0))
        zero = ZERO_SINGULAR_VALUE * max(values[-1], ZERO_SINGULAR_VALUE)
        free: np.ndarray = vectors[:, values < zero]
        return free @ free.T

    def place(self, x, mass) -> np.ndarray:
        """Mean position (3,) of the held nodes, or the centre of mass of a free piece [m]."""
        if len(self.held):
            return x[self.held].mean(axis=0)
        return np.einsum("a,ai->i", mass[self.nodes], x[self.nodes]) / mass[self.nodes].sum()


def movable_pieces(
    cloth: Cloth, stencils: Sequence[np.ndarray], constraints: Constraints
) -> tuple[Piece, ...]:
    """Return the connected pieces that can move as a rigid body, or that moving pins hold.

    A piece can move as a rigid body if it is free, or free to slide as a whole. Pieces that pins
    hold still are left out. Triangles connect their nodes, and so do the stencils (m, k) of
    terms, such as springs between two triangles.
    """
    count, piece_of_node = _connect(len(cloth.X), [cloth.stencil, *stencils])
    has_moving_pin = np.zeros(len(piece_of_node), bool)
    for pin, pinned in constraints.groups.values():
        has_moving_pin[pinned] = pin.moves
    piece_of_held = piece_of_node[constraints.nodes]
    movable = []
    for number in range(count):
        is_ours = piece_of_held == number
        held = constraints.nodes[is_ours]
        # projectors onto the directions in which the pins hold the nodes
        held_projectors = np.eye(3) - constraints.projectors[is_ours]
        # a slice of the whole cloth copies nothing
        nodes = slice(None) if count == 1 else np.flatnonzero(piece_of_node == number)
        piece = Piece(nodes, held, held_projectors)
        if has_moving_pin[held].any() or piece.free_directions.any():
            movable.append(piece)
    return tuple(movable)


def _connect(n: int, stencils: Iterable[np.ndarray]) -> tuple[int, np.ndarray]:
    """Return the number of connected pieces of n nodes, and the piece of each node (n,).

    Each row of a stencil (m, k) connects its k nodes. The pieces are numbered in the order of
    their lowest nodes.
    """
    count = n
    piece_of_node = np.arange(n)  # at first each node is a piece
    for stencil in stencils:
        if count == 1:
            break
        pieces = piece_of_node[stencil]
        # a stencil connects the piece of its first node with the pieces of the others
        ends = np.repeat(pieces[:, 0], stencil.shape[1] - 1), pieces[:, 1:].ravel()
        graph = sparse.coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(count, count))
        count, merged = connected_components(graph, directed=False)
        piece_of_node = merged[piece_of_node]
    return count, piece_of_node


def turns(y: np.ndarray) -> np.ndarray:
    """(h, 3, 3) the matrix of ω ↦ ω × y of each y (h, 3)."""
    matrices = np.zeros((len(y), 3, 3))
    matrices[:, 0, 1] = y[:, 2]
    matrices[:, 1, 2] = y[:, 0]
    matrices[:, 2, 0] = y[:, 1]
    return matrices - matrices.transpose(0, 2, 1)


def fit_motion(
    held_projectors: np.ndarray, basis: np.ndarray, way: np.ndarray, rank: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return u (3,) and a (k,) with the least Σ |(I − P)(u + basis a − way)|².

    The sum is over h points, with the displacements `way` (h, 3). `held_projectors` (h, 3, 3)
    are I − P, `basis` is (h, 3, k). If several u and a fit alike, the result is the shortest. A
    singular value below `rank` times the largest counts as zero.
    """
    size = np.abs(basis).max() or 1.0
    A = np.concatenate([held_projectors, held_projectors @ basis / size], axis=2)
    b = np.einsum("hij,hj->hi", held_projectors, way)
    q = np.linalg.lstsq(A.reshape(-1, A.shape[2]), b.ravel(), rcond=rank)[0]
    return q[:3], q[3:] / size


def _turn(u: np.ndarray, omega: np.ndarray, r: np.ndarray) -> np.ndarray:
    """u + ω × r, (k, 3)."""
    (turn,) = turns(-omega[None])  # the matrix of r ↦ ω × r
    velocity: np.ndarray = u + np.einsum("ij,aj->ai", turn, r)
    return velocity


@kernel
def fill_normal_equations(
    nodes: Array, projectors: Array, x: Array, v: Array, centre: Array, A: Array, b: Array
) -> float:
    """Add the normal equations A q = b of a rigid motion q = (u, ω s) that fits v.

    Σ |H (v − u − ω × (x − c))|² over the nodes (h,) is least, with the projectors H (h, 3, 3),
    the mean c of their positions, which is written to `centre`, and x and v (n, 3). Returns s,
    the largest |x − c| of a component, or 1 if it is 0.
    """
    first = x[nodes[0]]  # nodes at one place have exactly this place as their mean
    for k in range(3):
        total = 0.0
        for i in nodes:
            total += x[i, k] - first[k]
        centre[k] = first[k] + total / len(nodes)
    size = 0.0
    for i in nodes:
        for k in range(3):
            size = max(size, abs(x[i, k] - centre[k]))
    if size == 0.0:
        size = 1.0
    G = np.zeros((3, 6))  # u + ω × r = G q
    for k in range(3):
        G[k, k] = 1.0
    for h in range(len(nodes)):
        i = nodes[h]
        for k in range(3):
            above = (k + 1) % 3
            below = (k + 2) % 3
            G[k, 3 + above] = (x[i, below] - centre[below]) / size
            G[k, 3 + below] = -(x[i, above] - centre[above]) / size
        for p in range(6):
            for k in range(3):
                held = 0.0  # entry k of column p of H G
                for j in range(3):
                    held += projectors[h, k, j] * G[j, p]
                b[p] += held * v[i, k]
                for q in range(6):
                    A[p, q] += held * G[k, q]
    return size
