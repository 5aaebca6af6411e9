"""Impacts: at the end of a step, impulses decide with what speed a contact opens.

The barrier of a contact keeps the cloth out at any step, but steps are longer than an impact, so
that the speed it leaves depends on dt. Therefore the velocity at the end of a step is decided by
impulses Λ, in place of the impulses Λ₀ of the barrier over the step. With the rows G of the places
that touch, and without any impulse, they open with

    u_free = G (v₁ − M⁻¹ Gᵀ Λ₀) − w

where w is the speed of the surface. All places together satisfy

    u = u_free + G M⁻¹ Gᵀ Λ,   0 ≤ Λ ≤ Λ_most,   and u = c where 0 < Λ < Λ_most,
    u ≥ c where Λ = 0,   u ≤ c where Λ = Λ_most.

In an impact, which closes with v_in, c is e v_in and nothing limits Λ. Elsewhere c = 0 and Λ_most
is Λ₀: the barrier may push less, so that it throws nothing back, but not more. v_in is the smaller
one of the speeds with which a place closes at the begin and, without impulses, at the end of the
step. It is no impact if the forces of the step explain it: if the speed at its begin is at most
twice its change by these forces. So a contact bounces where it enters the gap, in one step, and
nothing must be remembered of it.

Source: Moreau (1988), Unilateral Contact and Dry Friction in Finite Freedom Dynamics, CISM
Courses and Lectures 302, with the velocity at the begin of a step as the one before the impact.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from fecloth.compiled.jit import Array, kernel
from fecloth.integrators.step import Opening
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.system.state import State
from fecloth.terms.contact.touches import Touches

# Speeds are exact to this part of the fastest one; e is then so, too.
SPEED_TOLERANCE = 1e-5
ROUND_OFF_OF_WORK = 1e-4  # above that of the speeds
MOST_SWEEPS = 10_000
# The most impulse of an impact over the impulse that it needs alone: no pile has as many layers.
MOST_IMPULSE = 100.0
TINY = np.finfo(float).tiny
LESS_SPEED = 0.95  # of what connected places are asked for, where they would gain energy
# Steps whose forces explain the speed of an approach: then it is no impact.
STEPS_EXPLAINED = 2.0


class Struck(NamedTuple):
    """The end of a step after its impacts.

    Attributes
    ----------
    state
        The new state, with v after the impulses.
    directions
        Unit vectors (n, 3) along which an impact has struck the nodes; zero for all others.
    """

    state: State
    directions: np.ndarray


def after_impacts(opening: Opening, new: State) -> Struck:
    """Return the end of the step to `new` after the impulses of its contacts.

    Its state is `new` itself if no impulse changes v. Raises `NewtonFailed` if no impulses are
    found.
    """
    parts = [term.touches(opening.begin, new) for term in opening.over.bound]
    parts = [part for part in parts if part is not None]
    if not parts:
        return Struck(new, np.zeros_like(new.v))
    touches = Touches.join(parts)
    G = touches.rows
    changes = opening.system.free_mass.changes(G)
    A = (G @ changes).tocsr()
    u = G @ new.v.ravel() - touches.surface
    free = u - A @ touches.pushed
    strikes = is_impact(touches.before, free)
    directions = np.reshape(G.T @ strikes.astype(float), new.v.shape)
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.divide(directions, length, out=directions, where=length > 0.0)
    approach = np.maximum(np.minimum(-touches.before, -free), 0.0)
    c = np.where(strikes, touches.restitution * approach, 0.0)
    if not ((u > c) | (strikes & (u < c))).any():
        return Struck(new, directions)
    needed = np.abs(free) + c  # times A⁻¹; without a limit, two walls that close have no Λ
    most = touches.pushed + MOST_IMPULSE * strikes * needed / np.maximum(A.diagonal(), TINY)
    impulses = find_impulses(A, free, c, touches.pushed, most)
    jump = np.reshape(changes @ (impulses - touches.pushed), new.v.shape)
    return Struck(replace(new, v=new.v + jump), directions)


def is_impact(before: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Whether places (m,) close faster than the forces of the step explain.

    `before` (m,) are the speeds with which they open at the begin, and `free` (m,) those at the
    end of the step without impulses [m/s].
    """
    by_forces = np.maximum(before - free, 0.0)
    strikes: np.ndarray = (before < 0.0) & (-before > STEPS_EXPLAINED * by_forces)
    return strikes


def find_impulses(
    A: sparse.csr_matrix, free: np.ndarray, c: np.ndarray, pushed: np.ndarray, most: np.ndarray
) -> np.ndarray:
    """Return the impulses Λ (m,) [N s].

    A (m, m) is G M⁻¹ Gᵀ, `free` are u_free (m,), c (m,) the speeds that are asked for, `pushed`
    Λ₀ (m,) and `most` Λ_most (m,). Where connected impulses would do work on the cloth, less is
    asked for. Raises `NewtonFailed` if they are not found.
    """
    impulses, u = solve(A, free, c, pushed, most)
    while (gained := gains_energy(A, impulses, u, free) & (c > 0.0)).any():
        c = np.where(gained, LESS_SPEED * c, c)
        impulses, u = solve(A, free, c, pushed, most)
    return impulses


def gains_energy(
    A: sparse.csr_matrix, impulses: np.ndarray, u: np.ndarray, free: np.ndarray
) -> np.ndarray:
    """Whether each place (m,) is among connected ones whose impulses do work on the cloth.

    The work is Σ Λ (u + u_free)/2 [J]. With one e and one speed it is never positive.
    """
    _, groups = connected_components(A, directed=False)
    work = np.bincount(groups, 0.5 * impulses * (u + free))
    round_off = np.bincount(groups, impulses * (np.abs(u) + np.abs(free)))
    gains = work > ROUND_OFF_OF_WORK * round_off
    gains_here: np.ndarray = gains[groups]
    return gains_here


def solve(
    A: sparse.csr_matrix, free: np.ndarray, c: np.ndarray, pushed: np.ndarray, most: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the impulses Λ (m,) [N s] and the speeds u (m,) [m/s] with them.

    The arguments are those of `find_impulses`. Raises `NewtonFailed` if the sweeps do not end.
    """
    impulses = pushed.copy()
    u = free + A @ impulses
    fastest = max(np.abs(u).max(), np.abs(free).max(), c.max())
    sweeps = sweep_impulses(
        A.indptr, A.indices, A.data, c, most, impulses, u, SPEED_TOLERANCE * fastest, MOST_SWEEPS
    )
    if sweeps == MOST_SWEEPS:
        reason = "the impulses of contacts at the end of the step are not found"
        raise NewtonFailed(reason, np.nan, "Take a smaller dt.")
    return impulses, u


@kernel
def sweep_impulses(
    indptr: Array,
    indices: Array,
    values: Array,
    c: Array,
    most: Array,
    impulses: Array,
    u: Array,
    tolerance: float,
    most_sweeps: int,
) -> int:
    """Change Λ and u in place until u = c or Λ is 0 or `most`; return the sweeps.

    Each sweep solves for one Λ after the other (projected Gauss–Seidel). It ends where none
    changes its own u by more than the tolerance [m/s].
    """
    for sweep in range(most_sweeps):
        largest = 0.0
        for i in range(len(u)):
            own = 0.0
            for k in range(indptr[i], indptr[i + 1]):
                if indices[k] == i:
                    own = values[k]
            if own <= 0.0:  # pins hold all of its nodes
                continue
            new = min(max(impulses[i] - (u[i] - c[i]) / own, 0.0), most[i])
            change = new - impulses[i]
            if change == 0.0:
                continue
            impulses[i] = new
            for k in range(indptr[i], indptr[i + 1]):
                u[indices[k]] += values[k] * change
            largest = max(largest, abs(change) * own)
        if largest <= tolerance:
            return sweep
    return most_sweeps
