"""The connected pieces of a cloth that can move as a whole, and their rigid motion."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from fecloth.compiled.jit import rounded_kernel
from fecloth.mesh.cloth import Cloth
from fecloth.system.constraints import Constraints

TINY = 1e-9  # relative size of a singular value that counts as zero


@dataclass(frozen=True, eq=False)
class Piece:
    """Nodes that terms connect, and the constrained ones among them."""

    # Nodes of the piece, ascending (a slice if they are all), and the nodes that pins or slides
    # hold.
    nodes: np.ndarray | slice
    held: np.ndarray
    outside: np.ndarray  # (h, 3, 3) projectors I − P onto the held directions of each held node

    def rigid_velocity(self, x, p, mass, mass_x, held_v) -> np.ndarray:
        """(k, 3) velocity of the piece as a rigid body, at its nodes [m/s]."""
        # A free piece has the linear and angular momentum of its nodes. A held one follows its
        # pins: Σ |(I − P)(v − u − ω × r)|² over the held nodes is least, and along the directions
        # in which no pin holds it, u has its linear momentum. x and p (n, 3) are positions [m] and
        # momenta M v [kg m/s], `mass` (n,) and `mass_x` (n, 3) row sums of M [kg] and M x [kg m],
        # `held_v` (n, 3) velocities of the pins, of which only the held directions count.
        m, r = mass[self.nodes], x[self.nodes]
        if len(self.held):
            centre = mean_of_nodes(self.held, x, np.zeros(3))
            velocity = _follow(x[self.held] - centre, held_v[self.held], self.outside, r - centre)
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
        omega = np.linalg.pinv(inertia, rcond=TINY, hermitian=True) @ moment
        return _turn(p[self.nodes].sum(axis=0) / m.sum(), omega, r, np.empty(r.shape))

    @cached_property
    def free_directions(self) -> np.ndarray:
        """(3, 3) projector onto the directions in which no pin holds the piece."""
        values, vectors = np.linalg.eigh(self.outside.sum(axis=0))
        free: np.ndarray = vectors[:, values < TINY * max(values[-1], TINY)]
        return free @ free.T

    def place(self, x, mass) -> np.ndarray:
        """Mean position (3,) of the held nodes, or the centre of mass of a free piece [m]."""
        if len(self.held):
            return mean_of_nodes(self.held, x, np.zeros(3))
        return np.einsum("a,ai->i", mass[self.nodes], x[self.nodes]) / mass[self.nodes].sum()


@rounded_kernel
def mean_of_nodes(nodes, x, total):
    """Return the mean of x (n, 3) at nodes, (3,), in place of zeros."""
    for node in nodes:
        for k in range(3):
            total[k] += x[node, k]
    return total / len(nodes)


def movable_pieces(
    cloth: Cloth, stencils: Sequence[np.ndarray], constraints: Constraints
) -> tuple[Piece, ...]:
    """Return the pieces that are free, held by pins that move, or free to slide as a whole."""
    # Triangles connect their nodes, and so do the stencils (m, k) of terms, such as springs between
    # two triangles.
    count, label = _connect(len(cloth.X), [cloth.stencil, *stencils])
    moved = np.zeros(len(label), bool)
    for pin, nodes in constraints.groups.values():
        moved[nodes] = pin.moves
    held_label = label[constraints.nodes]
    movable = []
    for number in range(count):
        ours = held_label == number
        held = constraints.nodes[ours]
        outside = np.eye(3) - constraints.projectors[ours]
        piece = Piece(slice(None) if count == 1 else np.flatnonzero(label == number), held, outside)
        if moved[held].any() or piece.free_directions.any():
            movable.append(piece)
    return tuple(movable)


def _connect(n: int, stencils: Iterable[np.ndarray]) -> tuple[int, np.ndarray]:
    """Number of the pieces of n nodes, and the piece of each node, by their lowest nodes."""
    count, label = n, np.arange(n)
    for stencil in stencils:
        if count == 1:
            break
        pieces = label[stencil]
        ends = np.repeat(pieces[:, 0], stencil.shape[1] - 1), pieces[:, 1:].ravel()
        graph = sparse.coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(count, count))
        count, merged = connected_components(graph, directed=False)
        label = merged[label]
    return count, label


def _follow(y, v, outside, r) -> np.ndarray:
    """Return u + ω × r with the least Σ |(I − P)(v − u − ω × y)|², and the least |u, ω|."""
    size = np.sqrt((y**2).sum(axis=1).mean()) or 1.0
    A, b = np.empty((len(y), 3, 6)), np.empty((len(y), 3))
    _fill_equations(outside, y / size, v, A, b)
    q = np.linalg.lstsq(A.reshape(-1, 6), b.ravel(), rcond=TINY)[0]
    return _turn(q[:3], q[3:] / size, r, np.empty(r.shape))


@rounded_kernel
def _fill_equations(outside, y, v, A, b):
    """A [u, ω] = b at each held node: (I − P)(u + ω × y) = (I − P) v."""
    for h in range(len(y)):
        y0, y1, y2 = y[h]
        for i in range(3):
            o0, o1, o2 = outside[h, i]
            b[h, i] = o0 * v[h, 0] + o1 * v[h, 1] + o2 * v[h, 2]
            A[h, i, 0], A[h, i, 1], A[h, i, 2] = o0, o1, o2
            A[h, i, 3], A[h, i, 4] = o2 * y1 - o1 * y2, o0 * y2 - o2 * y0
            A[h, i, 5] = o1 * y0 - o0 * y1


@rounded_kernel
def _turn(u, omega, r, velocity):
    """Return u + ω × r, (k, 3)."""
    for a in range(len(r)):
        velocity[a, 0] = u[0] + (omega[1] * r[a, 2] - omega[2] * r[a, 1])
        velocity[a, 1] = u[1] + (omega[2] * r[a, 0] - omega[0] * r[a, 2])
        velocity[a, 2] = u[2] + (omega[0] * r[a, 1] - omega[1] * r[a, 0])
    return velocity
