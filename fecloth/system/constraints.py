"""Constraints: projectors onto the free directions of constrained nodes, and their motion."""

from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations, count
from typing import Self

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.calls import Call
from fecloth.compiled.jit import Array, rounded_kernel
from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.mesh.cloth import Cloth
from fecloth.system.followers import NO_FOLLOWERS, Followers
from fecloth.system.pins import Motion, Pin

# Products of what is not finite give no warnings here: the solvers look for it.
QUIET = np.errstate(over="ignore", invalid="ignore")


class _MovedGroup:
    """A pin with a motion and its nodes; the end of a step is the start of the next one."""

    def __init__(self, pin: Pin, nodes: np.ndarray):
        self.pin = pin
        self.nodes = nodes
        self._last: tuple[float, np.ndarray] | None = None

    def displacement(self, t: float) -> np.ndarray:
        """(3,) or (k, 3) [m], evaluated once for several calls with the same t."""
        if self._last:
            time, displacement = self._last
            if time == t:
                return displacement
        return self.pin.displacement(t)

    def end(self, t: float, since: float) -> tuple[np.ndarray, np.ndarray]:
        """Displacement [m] and speed [m/s] at the end of a step from `since`."""
        displacement = self.pin.displacement(t)
        self._last = t, displacement
        return displacement, self.pin.speed(t, since=since)

    def rows(self, begins: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the displacements over steps [m] and the speeds at their ends [m/s].

        `begins` and `ends` (s,) are the times of the steps [s]. Both results are (s, k, 3), or
        (s, 1, 3) if all nodes move alike.
        """
        rows = self.pin.over_steps(begins, ends)
        if rows is not None:
            return rows
        # a function of Python is called once for each time
        pairs = []
        for t, end in zip(begins.tolist(), ends.tolist(), strict=True):
            before = self.displacement(t)
            after, speed = self.end(end, since=t)
            pairs.append(np.broadcast_arrays(after - before, speed))
        both = np.array(pairs).reshape(len(ends), 2, -1, 3)
        return both[:, 0], both[:, 1]


@dataclass(frozen=True, eq=False)
class Constraints:
    """All pins and slides of a system on its cloth.

    Attributes
    ----------
    groups
        By name: the pin and its nodes.
    nodes
        (c,) the constrained nodes, ascending.
    projectors
        (c, 3, 3) the projector P onto the free directions of each of them. It is 0 for a pinned
        node, and of rank 1 or 2 for one that slides.
    followers
        The nodes that follow others. They are none of the nodes above, and have no free
        direction of their own either.
    """

    groups: dict[str, tuple[Pin, np.ndarray]]
    nodes: np.ndarray
    projectors: np.ndarray
    followers: Followers = NO_FOLLOWERS

    @classmethod
    def bind(cls, pins, cloth: Cloth, check: bool = True) -> Self:
        """Find the nodes of the pins, each a `Pin` or the name of a node set, on a cloth.

        Several pins may hold a node if they agree there, which `check` asks; the first one moves
        it. Raises `InputError` for pins that do not agree, for a pin that names no node, and for
        a user's motion that fails at t = 0 or has another number of rows than the pin has nodes.
        """
        groups: dict[str, tuple[Pin, np.ndarray]] = {}
        for number, pin in enumerate(pins):
            if isinstance(pin, str):
                pin = Pin(pin)
            default = pin.where if isinstance(pin.where, str) else f"pin{number}"
            name = _free_name(pin.name or default, groups)
            nodes = pin.nodes(cloth)
            groups[name] = (pin.at(cloth.X[nodes]), nodes)
            if not isinstance(pin.motion, Motion):  # a user's function: an early error
                for value in (pin.displacement(0.0), pin.speed(0.0, since=0.0)):
                    pin.check_shape(value, len(nodes))
        return cls.of(groups, cloth, check)

    @classmethod
    def of(
        cls, groups: dict[str, tuple[Pin, np.ndarray]], cloth: Cloth, check: bool = True
    ) -> Self:
        """The constraints of pins on their nodes, by name; see `bind`."""
        held = np.concatenate([nodes for _, nodes in groups.values()] or [np.zeros(0, np.int64)])
        nodes, first, node, times = np.unique(
            held, return_index=True, return_inverse=True, return_counts=True
        )
        meet = times > 1
        if check:
            _refuse_conflicts(groups, nodes[meet], cloth)
        each = [np.tile(pin.projector, (len(own), 1, 1)) for pin, own in groups.values()]
        P = np.concatenate([np.zeros((0, 3, 3)), *each])
        projectors = P[first]
        # where pins meet, the null space of Σ (I − P) is free
        H = np.zeros_like(projectors)
        np.add.at(H, node, np.eye(3) - P)
        values, vectors = np.linalg.eigh(H[meet])
        free = vectors * (values < 1e-9)[:, None]
        projectors[meet] = free @ free.swapaxes(1, 2)
        return cls(groups, nodes, projectors)

    @cached_property
    def without_own(self) -> tuple[np.ndarray, np.ndarray]:
        """The constrained and the following nodes, and their projectors: 0 of following nodes."""
        nodes = np.concatenate([self.nodes, self.followers.nodes])
        still = np.zeros((len(self.followers.nodes), 3, 3))
        return nodes, np.concatenate([self.projectors, still])

    def project(self, y: np.ndarray) -> np.ndarray:
        """P y in place, y (n, 3): 0 for nodes that follow."""
        project_rows(*self.without_own, y)
        return y

    def reduce(self, f: np.ndarray) -> np.ndarray:
        """P Tᵀ f in place: the part of forces (n, 3) that moves the free directions."""
        return self.project(self.followers.gather(f))

    def expand(self, y: np.ndarray) -> np.ndarray:
        """T P y in place: the motion of all nodes with that of the free directions."""
        return self.followers.follow(self.project(y))

    def _free_part(self, rows: np.ndarray) -> np.ndarray:
        """P of rows (c, 3) of the constrained nodes, with sums in the order of `fused_loops`."""
        P: np.ndarray = self.projectors
        return P[:, :, 0] * rows[:, :1] + P[:, :, 1] * rows[:, 1:2] + P[:, :, 2] * rows[:, 2:]

    def project_matrix(self, A: sparse.spmatrix) -> sparse.csr_matrix:
        """Return P Tᵀ A T P of a sparse matrix A (3n, 3n), with P for all nodes."""
        A = self.followers.condense(A).tocsr()
        nodes, projectors = self.without_own
        dofs = 3 * nodes[:, None] + np.arange(3)
        if not np.diff(A.indptr)[dofs].any():  # A couples i with j as j with i: rows tell
            return A
        held = np.eye(3) - projectors
        rows = np.repeat(dofs, 3, axis=1).ravel()
        columns = np.tile(dofs, (1, 3)).ravel()
        # P differs from the unit matrix in the blocks of the constrained nodes alone
        I_minus_P = sparse.csr_matrix((held.ravel(), (rows, columns)), shape=A.shape)
        P = sparse.identity(A.shape[0], format="csr") - I_minus_P
        projected: sparse.csr_matrix = P @ A @ P
        return projected

    @QUIET
    def held_part(self, y: np.ndarray) -> np.ndarray:
        """(I − P) y of the constrained nodes, (c, 3)."""
        return y[self.nodes] - self._free_part(y[self.nodes])

    def hold(self, y: np.ndarray, target: np.ndarray) -> np.ndarray:
        """P y + (I − P) target, a copy: exactly the target where P is 0."""
        return self.set_held(y.copy(), target)

    @QUIET
    def set_held(self, y: np.ndarray, target: np.ndarray) -> np.ndarray:
        """P y + (I − P) target, in place; nodes that follow are where their leaders say."""
        held = target[self.nodes]
        y[self.nodes] = held + self._free_part(y[self.nodes] - held)
        self.followers.place(y, target)
        return y

    def correction(self, left: np.ndarray) -> np.ndarray:
        """What to add to y (n, 3), which is `left` from its target: held directions reach it.

        Nodes that follow are then where their leaders say.
        """
        change = np.zeros_like(left)
        change[self.nodes] = self.held_part(left)
        change[self.followers.nodes] = self.followers.gap(left - change)
        return change

    def target(self, t: float, dt: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the prescribed positions and velocities (n, 3) at t + dt.

        x (n, 3) are the positions at the time t. The results are meaningful in the constrained
        directions only. If no pin moves, the position is x itself, not a copy.
        """
        v = np.zeros_like(x)
        old = x
        if self.moved or len(self.followers.nodes):
            x = x.copy()
        for group in self.moved:
            before = group.displacement(t)
            after, speed = group.end(t + dt, since=t)
            if group.pin.rotate is None:
                x[group.nodes] += after - before
                v[group.nodes] = speed
            else:
                here = x[group.nodes]
                x[group.nodes], v[group.nodes] = turn(group.pin, t, t + dt, here, before, after)
                v[group.nodes] += speed
        if x is not old:
            self.followers.close(t, t + dt, old, x, v)
        return x, v

    @cached_property
    def moved(self) -> list[_MovedGroup]:
        """The pins that move, each with the nodes that no pin before it holds."""
        groups = []
        taken = np.zeros(0, np.int64)
        for pin, nodes in self.groups.values():
            if not pin.moves:
                continue
            is_own = ~np.isin(nodes, taken)
            taken = np.union1d(taken, nodes)
            if not is_own.all():
                X = getattr(pin.motion, "X", None)
                pin = pin if X is None else pin.at(X[is_own])
            groups.append(_MovedGroup(pin, nodes[is_own]))
        return groups

    def free(self, n: int) -> np.ndarray:
        """Return the numbers 3 i + c of the free degrees of freedom of a cloth of n nodes.

        c is the component of node i. Raises `InputError` for a node that slides along no axis:
        it has free directions, but no free components.
        """
        diagonal = np.einsum("cii->ci", self.projectors)
        # along an axis an entry is 1 if the component is free, and 0 if it is held
        oblique = np.flatnonzero(((diagonal > 1e-12) & (diagonal < 1 - 1e-12)).any(axis=1))
        if len(oblique):
            what = f"node {self.nodes[oblique[0]]} slides along no axis"
            remedy = "Use System.admissible, a basis of the free directions."
            raise InputError(what, "the free dofs are defined along the axes", "System", remedy)
        held = (3 * self.nodes[:, None] + np.arange(3))[diagonal < 0.5]
        follow = 3 * self.followers.nodes[:, None] + np.arange(3)
        return np.setdiff1d(np.arange(3 * n), np.append(held, follow))

    def count_free(self, n: int) -> int:
        """Number of the directions that the pins leave free: the columns of `admissible`."""
        nodes, projectors = self.without_own
        return 3 * (n - len(nodes)) + int(np.rint(np.einsum("cii->", projectors)))

    def admissible(self, n: int) -> sparse.csc_matrix:
        """Return a basis of the velocities of n nodes that the pins allow: orthonormal but for
        nodes that follow others.

        It is a matrix (3n, f), with a column for each of the f free directions: first three unit
        vectors for each node without a pin, then the free directions of those that slide.
        """
        unpinned = np.setdiff1d(np.arange(n), self.without_own[0])
        # a projector has the eigenvalue 1 in each free direction, and else 0
        values, vectors = np.linalg.eigh(self.projectors)  # columns of vectors
        sliding, number = np.nonzero(values > 0.5)
        nodes = np.concatenate([unpinned, self.nodes[sliding]])
        unit_count = 3 * len(unpinned)
        slide_count = len(sliding)
        unit_columns = np.arange(unit_count)
        slide_columns = unit_count + np.arange(slide_count)
        rows = (3 * nodes[:, None] + np.arange(3)).ravel()
        columns = np.concatenate([unit_columns, np.repeat(slide_columns, 3)])
        data = np.concatenate([np.ones(unit_count), vectors[sliding, :, number].ravel()])
        shape = 3 * n, unit_count + slide_count
        return self.followers.extend(sparse.csc_matrix((data, (rows, columns)), shape=shape))


def _refuse_conflicts(
    groups: dict[str, tuple[Pin, np.ndarray]], shared: np.ndarray, cloth: Cloth
) -> None:
    """Raise `InputError` for pins that do not agree at one of the `shared` nodes (k,)."""
    if not len(shared):
        return
    meeting = {name: np.intersect1d(nodes, shared) for name, (_, nodes) in groups.items()}
    meeting = {name: nodes for name, nodes in meeting.items() if len(nodes)}
    for first, second in combinations(meeting, 2):
        both = np.intersect1d(meeting[first], meeting[second])
        if not len(both) or groups[first][0].agrees_with(groups[second][0]):
            continue
        X, Y = cloth.X[both[0]]
        what = f"pins {first!r} and {second!r} both hold node {both[0]} at ({X:.6g}, {Y:.6g}) m"
        allowed = "pins that meet and move must hold in the same directions and move alike"
        ways = [
            f'without = "{pin.where}" in the pin {other!r}'
            for pin, other in ((groups[first][0], second), (groups[second][0], first))
            if isinstance(pin.where, str)
        ]
        words = f": write {', or '.join(ways)}" if ways else ""
        remedy = f"Leave it out of one of them{words}."
        raise InputError(what, allowed, "System(pins=...)", remedy)


def turn(pin: Pin, t: float, later: float, points: np.ndarray, before, after):
    """Positions and velocities (k, 3) at `later` of points that a pin turns and moves from t on.

    `before` and `after` are the displacements of its motion at the two times. The velocity is
    that of the rotation alone.
    """
    rotation = pin.rotate
    assert rotation is not None
    arm = (points - rotation.point - before) @ rotation.matrix(later, since=t).T
    return rotation.point + after + arm, np.cross(rotation.rate(later), arm)


def _free_name(name: str, taken) -> str:
    """The name, with a number where it is taken."""
    numbered = (f"{name}.{number}" for number in count(2))
    return next(free for free in chain([name], numbered) if free not in taken)


@dataclass(frozen=True, eq=False)
class MatrixProjection:
    """P Tᵀ A T P + (I − P) s on a fixed pattern, in place; s is the mean of the node's diagonal.

    Attributes
    ----------
    blocks
        (k,) the blocks that touch a constrained node.
    left
        (k,) the row of `projectors` to apply to each of them from the left.
    right
        (k,) the row of `projectors` to apply from the right.
    projectors
        (c + 1, 3, 3) P of the constrained nodes, and I for all others.
    diagonal
        (c,) the diagonal blocks of the constrained nodes.
    source, sink, weights
        (e,) each block `source` of a node that follows is added with its weight to a `sink`.
    """

    blocks: np.ndarray
    left: np.ndarray
    right: np.ndarray
    projectors: np.ndarray
    diagonal: np.ndarray
    source: np.ndarray
    sink: np.ndarray
    weights: np.ndarray

    @classmethod
    def bind(cls, constraints: Constraints, pattern: BlockPattern) -> Self:
        """Find the blocks in the rows and the columns of the constrained nodes, in a pattern."""
        nodes, projectors = constraints.without_own
        c = len(nodes)
        row_of_node = np.full(len(pattern), c)  # of `projectors`; the last row is for all others
        row_of_node[nodes] = np.arange(c)
        left = row_of_node[pattern.rows]
        right = row_of_node[pattern.indices]
        blocks = np.flatnonzero((left < c) | (right < c))
        projectors = np.concatenate([projectors, np.eye(3)[None]])
        diagonal = pattern.diagonal[nodes].astype(np.int64)
        source, rows, columns, weights = constraints.followers.spread(pattern)
        sink = pattern.slots(np.column_stack([rows, columns]).astype(np.int32))[:, 0, 1]
        sides = left[blocks], right[blocks]
        return cls(blocks, *sides, projectors, diagonal, source, sink, weights)

    def apply(self, A: BlockMatrix) -> None:
        """Project A in place."""
        function, arguments = self.call(A)
        function(*arguments)

    def call(self, A: BlockMatrix) -> Call:
        """The call that projects A."""
        scale = np.empty(len(self.diagonal))
        arrays = self.blocks, self.left, self.right, self.projectors, self.diagonal, scale
        moved = self.source, self.sink, self.weights
        return project_blocks, (*arrays, *moved, A.values)


@rounded_kernel
def project_rows(nodes: Array, P: Array, y: Array) -> None:
    """y_i = P y_i of the constrained nodes i (c,), whose projectors are P (c, 3, 3)."""
    for n in range(len(nodes)):
        i = nodes[n]
        y1, y2, y3 = y[i, 0], y[i, 1], y[i, 2]
        for k in range(3):
            y[i, k] = P[n, k, 0] * y1 + P[n, k, 1] * y2 + P[n, k, 2] * y3


@rounded_kernel
def project_blocks(
    blocks: Array,
    left: Array,
    right: Array,
    P: Array,
    diagonal: Array,
    scale: Array,
    source: Array,
    sink: Array,
    weights: Array,
    values: Array,
) -> None:
    """P Tᵀ A T P + (I − P) s with the blocks `values` of A; see `MatrixProjection`.

    `scale` (c,) is work space, for s of each constrained node.
    """
    for e in range(len(source)):
        values[sink[e]] += weights[e] * values[source[e]]
    for n in range(len(diagonal)):
        own = values[diagonal[n]]
        scale[n] = (own[0, 0] + own[1, 1] + own[2, 2]) / 3
        if scale[n] == 0.0:  # a node that follows has no mass
            scale[n] = 1.0
    PA = np.empty((3, 3))
    for k in range(len(blocks)):
        A = values[blocks[k]]
        L = P[left[k]]
        R = P[right[k]]
        for i in range(3):
            for j in range(3):
                PA[i, j] = L[i, 0] * A[0, j] + L[i, 1] * A[1, j] + L[i, 2] * A[2, j]
        for i in range(3):
            for j in range(3):
                A[i, j] = PA[i, 0] * R[0, j] + PA[i, 1] * R[1, j] + PA[i, 2] * R[2, j]
    for n in range(len(diagonal)):
        own = values[diagonal[n]]
        for i in range(3):
            for j in range(3):
                identity = 1.0 if i == j else 0.0
                own[i, j] += scale[n] * (identity - P[n, i, j])
