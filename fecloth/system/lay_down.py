"""Lay a cloth on what carries it, so that a run starts at rest there."""

from dataclasses import dataclass

import numpy as np
import scipy

from fecloth.errors import InputError
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System

MOST_PASSES = 60  # of the way down: each leaves at most a fifth of the distance to the contact
MOST_TURNS = 4  # how often the direction of the push is taken anew; on a plane it stays


def lay_down(system: System, state: State) -> State:
    """The state at rest, each free piece moved as a whole to where its contact carries its load.

    A piece goes along its load f, as `Gravity`, until it comes nearer than the gap of an
    obstacle, a mesh or another piece. Then it moves along the direction n of the push p of all
    contact until

        n · (Σ p + Σ f) = 0

    over its nodes: on a plane of the slope φ, of a cloth of areal density ρ, at the distance s
    of the gap with the pressure κ p(s) = ρ g cos φ. On a plane that is parallel to the piece,
    a run from there neither hops nor falls. Moments are not balanced here: a piece that tilts,
    hangs over or bends as it is laid down, and a held piece, find their rest by `equilibrium`.
    Raises `InputError` if no piece is free, if no load acts on one, or if nothing lies in the
    direction of a load.

    Parameters
    ----------
    system, state
        The cloth and where it is, so that its load pulls it to what is to carry it.

    Returns
    -------
    State
        Positions x (n, 3) [m] at the same t, with v = 0: velocities of `state` do not count.
    """
    check_system(system, state, "lay_down")
    free = [piece.nodes for piece in system.movable_pieces if not len(piece.held)]
    if not free:
        remedy = "Find the rest of a held cloth by fc.equilibrium."
        raise InputError("a cloth that pins hold", "must have a free piece", "lay_down", remedy)
    x = state.x.copy()
    for nodes in free:
        x = _lay_piece(system, x, state.t, nodes)
    return State(state.t, x, np.zeros_like(x))


def _lay_piece(system: System, x: np.ndarray, t: float, nodes) -> np.ndarray:
    """Return x (n, 3) with the free piece of the `nodes` laid down, see `lay_down`.

    Raises `InputError` if no load acts on the piece, or if nothing is there to carry it.
    """
    load = np.zeros_like(x)
    for term in system.bound:
        if term.load:
            term.add_force(x, np.zeros_like(x), t, load)
    f = load[nodes].sum(axis=0)
    if not f.any():
        raise InputError("a free piece without a load", "needs one, as Gravity", "lay_down")
    contacts = [term for term in system.bound if term.limits_direction]
    contact = _Contact(contacts, nodes, t)
    extent = system.cloth.extent
    way = np.zeros_like(x)
    way[nodes] = 10 * extent * f / np.linalg.norm(f)
    in_contact = _go_down(contact, x, way)
    return _balance(contact, in_contact, f, extent)


@dataclass(frozen=True, eq=False)
class _Contact:
    """What a piece touches: the terms of contact, the nodes of the piece, and the time [s]."""

    terms: list
    nodes: np.ndarray | slice
    t: float

    def push(self, x: np.ndarray) -> np.ndarray:
        """Σ p (3,) over the piece; friction is none at rest."""
        p = np.zeros_like(x)
        for term in self.terms:
            term.add_force(x, np.zeros_like(x), self.t, p)
        total: np.ndarray = p[self.nodes].sum(axis=0)
        return total

    def part(self, x: np.ndarray, way: np.ndarray) -> float:
        """The part of a way that the contacts allow; 1 for all of it."""
        return min((term.limit(x, way, self.t) for term in self.terms), default=1.0)


def _go_down(contact: _Contact, x: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return x (n, 3) moved along a way (n, 3) of ten extents, to where contact begins to push.

    Raises `InputError` if the whole way is free.
    """
    for _ in range(MOST_PASSES):
        if contact.push(x).any():
            break
        alpha = contact.part(x, way)
        if alpha == 1.0:
            remedy = "Start above an obstacle, or move it below the cloth."
            what = "nothing within ten extents of the cloth in the direction of its load"
            raise InputError(what, "must be there to carry it", "lay_down", remedy)
        x = x + alpha * way
    return x


def _balance(contact: _Contact, x: np.ndarray, f: np.ndarray, extent: float) -> np.ndarray:
    """Return x (n, 3) moved to where the push of the contact carries the load f (3,) [N].

    The piece moves along the direction n of the push. On a curved obstacle n changes with the
    place, so this is repeated. `extent` is the largest extent of the cloth [m].
    """
    for _ in range(MOST_TURNS):
        p = contact.push(x)
        n = p / np.linalg.norm(p)
        along = np.zeros_like(x)
        along[contact.nodes] = n

        def surplus(distance: float, x=x, n=n, along=along) -> float:
            """n · (Σ p + Σ f) [N] after a way [m] along n."""
            return float(n @ (contact.push(x + distance * along) + f))

        # nearer to the contact the push is larger than the load, farther away it is smaller
        nearest = -extent
        nearest *= contact.part(x, nearest * along)
        farthest = 1e-6 * extent
        while surplus(farthest) > 0:
            farthest *= 2
        distance = scipy.optimize.brentq(surplus, nearest, farthest, xtol=1e-15)
        x = x + distance * along
        has_left_contact = not contact.push(x).any()
        if has_left_contact or abs(distance) < 1e-12 * extent:
            break
    return x
