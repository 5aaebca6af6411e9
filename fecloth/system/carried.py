"""Where the nodes of a cloth go if they go along with the pins: a first guess of statics."""

import numpy as np
from scipy.spatial.transform import Rotation

from fecloth.linalg.reductions import longest
from fecloth.system.pieces import Piece, fit_motion, turns
from fecloth.system.system import System

PASSES, SMALL = 20, 1e-12  # of the rigid motion, and the angle [rad] at which they end
RANK = 1e-6  # relative size of a singular value below which a direction is not known
FARTHEST = 4.0  # times the longest way of a held node: the longest of any other one


def carry(system: System, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Positions (n, 3) [m] with held nodes at the `target` (n, 3), and the others carried along.

    In each piece they follow the rigid motion that fits the held nodes best, and then the
    affine motion that fits what is left: pins that are drawn apart stretch a cloth alike, pins
    that move alike take it along. Where that leads far, as with a short edge that turns, the
    mean counts.
    """
    y = x.copy()
    for piece in system.movable_pieces:
        if len(piece.held):
            y[piece.nodes] = _along(piece, x, target)
    return system.constraints.hold(y, target)


def _along(piece: Piece, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    outside = piece.outside
    start = x[piece.nodes]
    there = x[piece.held]
    goal = there + np.einsum("hij,hj->hi", outside, target[piece.held] - there)
    way = goal - there
    if not way.any():
        return start
    here = start
    for _ in range(PASSES):  # finite rotations, by the least one that fits
        centre = there.mean(axis=0)
        u, omega = fit_motion(outside, turns(there - centre), goal - there, RANK)
        R = Rotation.from_rotvec(omega).as_matrix()
        there, here = (centre + u + (points - centre) @ R.T for points in (there, here))
        if np.linalg.norm(omega) < SMALL:
            break
    centre = there.mean(axis=0)
    stretched = np.einsum("ij,hk->hijk", np.eye(3), there - centre).reshape(len(there), 3, 9)
    u, G = fit_motion(outside, stretched, goal - there, RANK)
    here = here + u + (here - centre) @ G.reshape(3, 3).T
    if longest(here - start) > FARTHEST * longest(way):
        here = start + way.mean(axis=0)
    return here
