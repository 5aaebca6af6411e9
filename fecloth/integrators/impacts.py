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

from fecloth.integrators.step import Opening
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.contact.bound_contact import Touched
from fecloth.terms.contact.touches import Touches

# Speeds are exact to this part of the fastest one; e is then so, too.
SPEED_TOLERANCE = 1e-10
ROUND_OFF_OF_WORK = 1e-5  # above that of the speeds
MOST_ITERATIONS = 2_000
# Of connected places, over their own A: there are more of them than ways of the nodes, and
# without it the conjugate gradients take ten times the iterations. It is an error of e, too.
COMPLIANCE = 1e-3
# The most impulse of an impact over the impulse that it needs alone: no pile has as many layers.
MOST_IMPULSE = 100.0
LESS_SPEED = 0.95  # of what connected places are asked for, where they would gain energy
# Steps whose forces explain the speed of an approach: then it is no impact.
STEPS_EXPLAINED = 2.0


class Struck(NamedTuple):
    """The end of a step after its impacts.

    Attributes
    ----------
    state
        The new state, with v after the impulses.
    stroke
        (n, 3) the change of v by the impulses of impacts, M⁻¹ GᵀΛ of their places alone [m/s].
    beyond
        (n, 3) the part of it that the force of the barrier has not given, M⁻¹ Gᵀ(Λ − Λ₀).
    works
        Work [J] of what each term touches and of Λ − Λ₀, w·(Λ − Λ₀): 0 where it stands still.
    forces
        The mean normal forces (p,) [N] at the places of each term, for friction.
    """

    state: State
    stroke: np.ndarray
    beyond: np.ndarray
    works: tuple[float, ...] = ()
    forces: tuple[np.ndarray, ...] = ()


def after_impacts(opening: Opening, new: State) -> Struck:
    """Return the end of the step to `new` after the impulses of its contacts.

    Its state is `new` itself if no impulse changes v. Raises `NewtonFailed` if no impulses are
    found.
    """
    parts = [term.touches(opening.begin, new) for term in opening.over.bound]
    touching = [part for part in parts if part is not None]
    if not touching:
        return Struck(new, np.zeros_like(new.v), np.zeros_like(new.v))
    touches = Touches.join(touching)
    G = touches.rows
    changes = unit_changes(opening.system, G)
    A = (G @ changes).tocsr()
    u = G @ new.v.ravel() - touches.surface
    free = u - A @ touches.pushed
    strikes = is_impact(touches.before, free)
    approach = np.maximum(np.minimum(-touches.before, -free), 0.0)
    c = np.where(strikes, touches.restitution * approach, 0.0)
    impulses = touches.pushed
    if ((u > c) | (strikes & (u < c))).any():
        most = limits(A.diagonal(), free, c, impulses, strikes)
        impulses = find_impulses(A, free, c, impulses, most)
    beyond = impulses - touches.pushed

    def change(of_places: np.ndarray) -> np.ndarray:
        return np.reshape(changes @ of_places, new.v.shape)

    state = new
    if beyond.any():
        state = replace(new, v=new.v + change(beyond))
    work = touches.surface * beyond
    ends = np.cumsum([0 if part is None else len(part.surface) for part in parts])[:-1]
    works = tuple(float(each.sum()) for each in np.split(work, ends))
    # Friction acts in the next step: a force that lasts adds h times itself to v in each step,
    # and a force of one step dt times itself, with what the method remembers of it.
    lasting = opening.stage.wv / opening.stage.wa
    times = np.where(strikes, opening.dt, lasting)
    forces = tuple(np.split(impulses / times, ends))
    return Struck(state, change(strikes * impulses), change(strikes * beyond), works, forces)


def with_forces(history: History | None, struck: Struck) -> History | None:
    """Return the records of the terms with the normal forces at the end, for friction."""
    if history is None or not struck.forces:
        return history
    return tuple(
        replace(record, forces=forces) if isinstance(record, Touched) else record
        for record, forces in zip(history, struck.forces, strict=True)
    )


def unit_changes(system: System, G: sparse.csr_matrix) -> sparse.csc_matrix:
    """Return the changes (3n, m) of v by unit impulses along the rows G (m, 3n) [1/kg].

    They are Z (ZᵀMZ)⁻¹ Zᵀ Gᵀ, with a basis Z of the motions that pins allow.
    """
    Z = system.admissible
    along = (Z.T @ G.T).tocsc()
    if system.mass_kind == "lumped":
        mass = Z.power(2).T @ system.mass_rows.ravel()
        return (Z @ (sparse.diags(1 / mass) @ along)).tocsc()
    return (Z @ sparse.csc_matrix(system.free_mass.solve(along.toarray()))).tocsc()


def share_mass(system: System) -> None:
    """Make what `unit_changes` needs, before a step copies the system: the copies share it."""
    if system.mass_kind == "lumped":
        _ = system.admissible
    else:
        _ = system.free_mass


def limits(
    own: np.ndarray, free: np.ndarray, c: np.ndarray, pushed: np.ndarray, strikes: np.ndarray
) -> np.ndarray:
    """Return Λ_most (m,) [N s]: a limit for impacts, too, as there is no Λ for walls that close.

    `own` (m,) is the diagonal of G M⁻¹ Gᵀ, and `strikes` (m,) are the impacts.
    """
    can_move = own > 0.0  # else pins hold all of its nodes
    needed = np.divide(np.abs(free) + c, own, out=np.zeros_like(c), where=can_move)
    most: np.ndarray = pushed + MOST_IMPULSE * strikes * needed
    return most


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

    They minimise ½ Λ·A Λ + Λ·(u_free − c) between 0 and Λ_most, where the gradient is u − c. It
    is done by conjugate gradients along the impulses between their limits, with A scaled to a
    diagonal of 1; a step is cut where it meets a limit, and the limits are left where the
    gradient there is the larger part (Dostál and Schöberl 2005, Minimizing Quadratic Functions
    Subject to Bound Constraints with the Rate of Convergence and Finite Termination, Comput.
    Optim. Appl. 30). The arguments are those of `find_impulses`. Raises `NewtonFailed` if it
    does not end.
    """
    own = A.diagonal()
    if A.nnz > len(own):
        A = A + sparse.diags(COMPLIANCE * own)
    scale = np.divide(1.0, np.sqrt(own), out=np.zeros_like(own), where=own > 0.0)
    scaled = (sparse.diags(scale) @ A @ sparse.diags(scale)).tocsr()
    short_step = 1.0 / max(float(abs(scaled).sum(axis=1).max()), 1.0)  # below 2/‖A‖
    most = most / np.where(scale > 0.0, scale, 1.0)
    y = np.minimum(pushed / np.where(scale > 0.0, scale, 1.0), most)
    g = scaled @ y + scale * (free - c)
    largest = SPEED_TOLERANCE * float((scale * (np.abs(free) + c)).max())
    inner, chopped = _parts(g, y, most)
    p = inner
    for _ in range(MOST_ITERATIONS):
        if max(np.abs(inner).max(), np.abs(chopped).max()) <= largest:
            impulses = scale * y
            return impulses, free + A @ impulses  # of the places as they give way
        leaves_limits = chopped @ chopped > inner @ inner
        if leaves_limits:
            p = chopped
        Ap = scaled @ p
        curvature = float(p @ Ap)
        wanted = float(g @ p) / curvature if curvature > 0.0 else np.inf
        allowed = _longest_step(y, p, most)
        step = min(wanted, allowed)
        y = np.clip(y - step * p, 0.0, most)
        g = g - step * Ap
        inner, chopped = _parts(g, y, most)
        if leaves_limits:
            p = inner
        elif wanted <= allowed:
            p = inner - float(inner @ Ap) / curvature * p
        else:
            y = np.clip(y - short_step * inner, 0.0, most)
            g = scaled @ y + scale * (free - c)
            inner, chopped = _parts(g, y, most)
            p = inner
    reason = "the impulses of contacts at the end of the step are not found"
    raise NewtonFailed(reason, np.nan, "Take a smaller dt.")


def _parts(g: np.ndarray, y: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The gradient g (m,) between the limits of y (m,), and where it leads away from a limit."""
    is_inner = (y > 0.0) & (y < most)
    inner = np.where(is_inner, g, 0.0)
    leaves = ((y <= 0.0) & (g < 0.0) & (most > 0.0)) | ((y >= most) & (g > 0.0) & (most > 0.0))
    return inner, np.where(leaves & ~is_inner, g, 0.0)


def _longest_step(y: np.ndarray, p: np.ndarray, most: np.ndarray) -> float:
    """The largest α for which y − α p (m,) stays between 0 and `most`."""
    room = np.where(p > 0.0, y, y - most)
    steps = np.divide(room, p, out=np.full_like(y, np.inf), where=p != 0.0)
    return float(steps.min())
