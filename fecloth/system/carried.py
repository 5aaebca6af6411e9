"""Where the nodes of a cloth go if they go along with the pins: a first guess of statics."""

import numpy as np

from fecloth.linalg.reductions import longest
from fecloth.quantities.rotation import rotation_matrix
from fecloth.system.pieces import Piece, fit_motion, turns
from fecloth.system.system import System

# Rotations in a row that fit the rigid motion, and the angle [rad] of the last one: round-off.
MOST_ROTATIONS = 20
SMALLEST_ROTATION = 1e-12
# Singular values of a fit that are smaller, over the largest, count as zero: the held nodes do
# not determine this motion, as nodes on a line do not determine the rotation about it.
LEAST_SINGULAR_VALUE = 1e-6
# Times the longest way of a held node: the longest way of any other node. A longer one was not
# meant, as where a short edge turns.
LONGEST_CARRIED = 4.0


def carry(system: System, x: np.ndarray, target: np.ndarray, stretches: bool = True) -> np.ndarray:
    """Positions (n, 3) [m] with held nodes at the `target` (n, 3), and the others carried along.

    In each piece the others follow the rigid motion that fits the held nodes best, so pins that
    move alike take it along. If the cloth also `stretches`, they then follow the affine motion
    that fits what is left, so pins that are drawn apart stretch it evenly. Where that leads
    far, as with a short edge that turns, the others move by the mean way of the held nodes.
    """
    y = x.copy()
    for piece in system.movable_pieces:
        if len(piece.held):
            y[piece.nodes] = carry_piece(piece, x, target, stretches)
    return system.constraints.hold(y, target)


def carry_piece(
    piece: Piece, x: np.ndarray, target: np.ndarray, stretches: bool = True
) -> np.ndarray:
    """Return the positions (k, 3) [m] of the nodes of a piece that its pins carry along.

    x and `target` (n, 3) are the positions before, and where the pins hold the nodes after. The
    piece must have held nodes. `carry` says how the others follow.
    """
    projectors = piece.held_projectors
    start = x[piece.nodes]
    held = x[piece.held]
    # only the directions in which the pins hold count
    goal = held + np.einsum("hij,hj->hi", projectors, target[piece.held] - held)
    way = goal - held
    if not way.any():
        return start
    nodes = start
    # Each rotation is the least that fits best. The fit is linear in the rotation. So after a
    # large one it is repeated from where that led.
    for _ in range(MOST_ROTATIONS):
        centre = held.mean(axis=0)
        u, omega = fit_motion(projectors, turns(held - centre), goal - held, LEAST_SINGULAR_VALUE)
        R = rotation_matrix(omega)
        held = centre + u + (held - centre) @ R.T
        nodes = centre + u + (nodes - centre) @ R.T
        if np.linalg.norm(omega) < SMALLEST_ROTATION:
            break
    if stretches:
        nodes = nodes + _affine_part(projectors, held, goal, nodes)
    # a node that goes much farther than the pins was not meant to: all move by their mean way
    if longest(nodes - start) > LONGEST_CARRIED * longest(way):
        return start + way.mean(axis=0)
    return nodes


def _affine_part(
    projectors: np.ndarray, held: np.ndarray, goal: np.ndarray, nodes: np.ndarray
) -> np.ndarray:
    """Return the ways (k, 3) [m] of `nodes` (k, 3) in the affine motion that fits held nodes.

    It is u + G (y − centre), with G (3, 3), for held nodes (h, 3) that go to the `goal` (h, 3).
    """
    centre = held.mean(axis=0)
    gradients = np.einsum("ij,hk->hijk", np.eye(3), held - centre).reshape(len(held), 3, 9)
    u, G = fit_motion(projectors, gradients, goal - held, LEAST_SINGULAR_VALUE)
    ways: np.ndarray = u + (nodes - centre) @ G.reshape(3, 3).T
    return ways
