"""The connected pieces of a cloth that can move as a whole, and their rigid motion."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from fecloth.mesh.cloth import Cloth
from fecloth.system.constraints import Constraints

# Relative size of a singular value, or of an eigenvalue of a projector, that counts as zero.
ZERO_SINGULAR_VALUE = 1e-9


@dataclass(frozen=True, eq=False)
class Piece:
    """Nodes that terms connect, and the constrained ones among them.

    Attributes
    ----------
    nodes
        (k,) its nodes, ascending; a slice if they are all of the cloth.
    held
        (h,) those that pins or slides hold.
    outside
        (h, 3, 3) the projector I − P onto the held directions of each of these.
    """

    nodes: np.ndarray | slice
    held: np.ndarray
    outside: np.ndarray

    def rigid_velocity(self, x, p, mass, mass_x, held_v) -> np.ndarray:
        """(k, 3) velocity of the piece as a rigid body, at its nodes [m/s].

        A free piece has the linear and angular momentum of its nodes. A held one follows its
        pins: Σ |(I − P)(v − u − ω × r)|² over the held nodes is least, and along the directions
        in which no pin holds it, u has its linear momentum. x and p (n, 3) are positions [m] and
        momenta M v [kg m/s], `mass` (n,) and `mass_x` (n, 3) row sums of M [kg] and M x [kg m],
        `held_v` (n, 3) velocities of the pins, of which only the held directions count.
        """
        m = mass[self.nodes]
        r = x[self.nodes]
        if len(self.held):
            centre = x[self.held].mean(axis=0)
            basis = turns(x[self.held] - centre)
            v = held_v[self.held]
            u, omega = fit_motion(self.outside, basis, v, ZERO_SINGULAR_VALUE)
            velocity = _turn(u, omega, r - centre)
            if not self.free_directions.any():
                return velocity
            momentum = p[self.nodes].sum(axis=0) - np.einsum("a,ai->i", m, velocity)
            return velocity + self.free_directions @ momentum / m.sum()
        centre = mass_x[self.nodes].sum(axis=0) / m.sum()
        r = r - centre
        G = np.einsum("ai,aj->ij", r, p[self.nodes])
        moment = np.array([G[1, 2] - G[2, 1], G[2, 0] - G[0, 2], G[0, 1] - G[1, 0]])  # Σ r × p
        spread = np.einsum("ai,aj->ij", r, mass_x[self.nodes] - np.outer(m, centre))
        inertia = np.trace(spread) * np.eye(3) - 0.5 * (spread + spread.T)
        omega = np.linalg.pinv(inertia, rcond=ZERO_SINGULAR_VALUE, hermitian=True) @ moment
        return _turn(p[self.nodes].sum(axis=0) / m.sum(), omega, r)

    @cached_property
    def free_directions(self) -> np.ndarray:
        """(3, 3) projector onto the directions in which no pin holds the piece."""
        values, vectors = np.linalg.eigh(self.outside.sum(axis=0))
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
    """The pieces that are free, held by pins that move, or free to slide as a whole.

    Triangles connect their nodes, and so do the stencils (m, k) of terms, such as springs
    between two triangles.
    """
    count, label = _connect(len(cloth.X), [cloth.stencil, *stencils])
    moved = np.zeros(len(label), bool)
    for pin, nodes in constraints.groups.values():
        moved[nodes] = pin.moves
    held_label = label[constraints.nodes]
    movable = []
    for number in range(count):
        is_ours = held_label == number
        held = constraints.nodes[is_ours]
        outside = np.eye(3) - constraints.projectors[is_ours]
        own = slice(None) if count == 1 else np.flatnonzero(label == number)
        piece = Piece(own, held, outside)
        if moved[held].any() or piece.free_directions.any():
            movable.append(piece)
    return tuple(movable)


def _connect(n: int, stencils: Iterable[np.ndarray]) -> tuple[int, np.ndarray]:
    """Number of the pieces of n nodes, and the piece of each node, by their lowest nodes."""
    count = n
    label = np.arange(n)
    for stencil in stencils:
        if count == 1:
            break
        pieces = label[stencil]
        ends = np.repeat(pieces[:, 0], stencil.shape[1] - 1), pieces[:, 1:].ravel()
        graph = sparse.coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(count, count))
        count, merged = connected_components(graph, directed=False)
        label = merged[label]
    return count, label


def turns(y: np.ndarray) -> np.ndarray:
    """(h, 3, 3) the matrix of ω ↦ ω × y of each y (h, 3)."""
    return np.cross(np.eye(3), y[:, None]).transpose(0, 2, 1)


def fit_motion(
    outside: np.ndarray, basis: np.ndarray, way: np.ndarray, rank: float
) -> tuple[np.ndarray, np.ndarray]:
    """u (3,) and a (k,) with the least Σ |(I − P)(u + basis a − way)|², the shortest of all.

    `outside` (h, 3, 3) are I − P, `basis` (h, 3, k); a singular value that is less than `rank`
    times the largest counts as zero.
    """
    size = np.abs(basis).max() or 1.0
    A = np.concatenate([outside, outside @ basis / size], axis=2)
    b = np.einsum("hij,hj->hi", outside, way)
    q = np.linalg.lstsq(A.reshape(-1, A.shape[2]), b.ravel(), rcond=rank)[0]
    return q[:3], q[3:] / size


def _turn(u: np.ndarray, omega: np.ndarray, r: np.ndarray) -> np.ndarray:
    """u + ω × r, (k, 3)."""
    velocity: np.ndarray = u + np.einsum("ji,aj->ai", np.cross(omega, np.eye(3)), r)
    return velocity
