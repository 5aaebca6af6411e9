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

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from fecloth.integrators.step import Opening
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.system.state import State
from fecloth.system.system import History
from fecloth.terms.contact.bound_contact import Touched
from fecloth.terms.contact.touches import Touches

# A place gives way by this part of what its impulse alone would change: there are more places than
# ways of the nodes, and then they share the impulse. It is an error of e, too.
COMPLIANCE = 1e-7
# The iteration ends where no speed changes by more than this part of the fastest speed.
SPEED_TOLERANCE = 1e-12
MOST_ITERATIONS = 1_000
# A whole step along which the slope rises above this part of its start, with the other sign, is
# cut to where the slope is 0.
SLOPE_ALLOWED = 0.5
ROUND_OFF_OF_WORK = 1e-5  # above COMPLIANCE
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
    # A force that lasts adds h times itself to v in each step, and a force of one step dt times
    # itself, with what the method remembers of it.
    h = opening.stage.wv / opening.stage.wa
    system = opening.system
    parts = [term.touches(opening.begin, new, h) for term in opening.over.bound]
    touching = [part for part in parts if part is not None]
    if not touching:
        return Struck(new, np.zeros_like(new.v), np.zeros_like(new.v))
    touches = Touches.join(touching)
    rows = (touches.rows @ system.admissible).tocsr()
    solve_mass: Callable[[np.ndarray], np.ndarray] = system.factor_of_mass.solve
    u = touches.rows @ new.v.ravel() - touches.surface

    def change(of_places: np.ndarray) -> np.ndarray:
        return solve_mass(rows.T @ of_places)

    pushed = change(touches.pushed)
    free = u - rows @ pushed
    strikes = is_impact(touches.before, free)
    approach = np.maximum(np.minimum(-touches.before, -free), 0.0)
    c = np.where(strikes, touches.restitution * approach, 0.0)
    impulses, q = touches.pushed, pushed
    if ((u > c) | strikes).any():
        touched = Places(system.free_mass, solve_mass, rows, free, touches.pushed)
        impulses, q = touched.find_impulses(c, strikes)
    beyond = impulses - touches.pushed

    def velocity(change: np.ndarray) -> np.ndarray:
        return np.reshape(system.admissible @ change, new.v.shape)

    state = new
    if beyond.any():
        state = replace(new, v=new.v + velocity(q - pushed))
    work = touches.surface * beyond
    ends = np.cumsum([0 if part is None else len(part.surface) for part in parts])[:-1]
    works = tuple(float(each.sum()) for each in np.split(work, ends))
    times = np.where(strikes, opening.dt, h)  # friction acts in the next step
    forces = tuple(np.split(impulses / times, ends))
    stroke = of_impacts = np.zeros_like(new.v)
    if strikes.any():
        stroke, of_impacts = (velocity(change(strikes * each)) for each in (impulses, beyond))
    return Struck(state, stroke, of_impacts, works, forces)


def with_forces(history: History | None, struck: Struck) -> History | None:
    """Return the records of the terms with the normal forces at the end, for friction."""
    if history is None or not struck.forces:
        return history
    return tuple(
        replace(record, forces=forces) if isinstance(record, Touched) else record
        for record, forces in zip(history, struck.forces, strict=True)
    )


def is_impact(before: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Whether places (m,) close faster than the forces of the step explain.

    `before` (m,) are the speeds with which they open at the begin, and `free` (m,) those at the
    end of the step without impulses [m/s].
    """
    by_forces = np.maximum(before - free, 0.0)
    strikes: np.ndarray = (before < 0.0) & (-before > STEPS_EXPLAINED * by_forces)
    return strikes


class Places(NamedTuple):
    """The m places that touch, in f admissible velocities.

    Attributes
    ----------
    mass
        (f, f) the mass ZᵀMZ, see `System.admissible`.
    solve_mass
        The function b ↦ mass⁻¹ b.
    rows
        (m, f) G Z.
    free
        (m,) u_free [m/s].
    pushed
        (m,) Λ₀ [N s].
    """

    mass: sparse.csc_matrix
    solve_mass: Callable[[np.ndarray], np.ndarray]
    rows: sparse.csr_matrix
    free: np.ndarray
    pushed: np.ndarray

    @property
    def own(self) -> np.ndarray:
        """The change of speed (m,) by each unit impulse alone [1/kg], with the diagonal mass.

        It is 0 where pins hold all of a place.
        """
        changes: np.ndarray = self.rows.power(2) @ (1 / self.mass.diagonal())
        return changes

    @property
    def has_lumped_mass(self) -> bool:
        return bool(self.mass.nnz == self.mass.shape[0])

    @property
    def are_apart(self) -> np.ndarray:
        """Whether each place (m,) alone changes its degrees of freedom, with a lumped mass."""
        m = len(self.free)
        if not self.has_lumped_mass:
            return np.zeros(m, bool)
        is_shared = self.rows.getnnz(axis=0) > 1
        place_of_entry = np.repeat(np.arange(m), np.diff(self.rows.indptr))
        apart: np.ndarray = np.bincount(place_of_entry, is_shared[self.rows.indices], m) == 0
        return apart

    def among(self, which: np.ndarray) -> tuple["Places", np.ndarray]:
        """Return some of the places, and the degrees of freedom (k,) that their motion needs."""
        rows = self.rows[which]
        if not self.has_lumped_mass:
            return self, np.arange(rows.shape[1])
        dofs = np.unique(rows.indices)
        mass = self.mass[dofs][:, dofs].tocsc()
        diagonal = mass.diagonal()
        return Places(
            mass, lambda b: b / diagonal, rows[:, dofs], self.free[which], self.pushed[which]
        ), dofs

    def find_impulses(self, c: np.ndarray, strikes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the impulses Λ (m,) [N s] and the change q (f,) of the velocities by them [m/s].

        `c` (m,) are the speeds that are asked for, and `strikes` (m,) the impacts. Raises
        `NewtonFailed` if they are not found.
        """
        impulses = self.alone(c, self.limits(c, strikes))
        apart = self.are_apart
        q = self.solve_mass(self.rows.T @ (impulses * apart))
        if not apart.all():
            others, dofs = self.among(~apart)
            impulses[~apart], q[dofs] = others.find_together(c[~apart], strikes[~apart])
        return impulses, q

    def find_together(self, c: np.ndarray, strikes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The impulses and the change of velocities of places that are not apart.

        Where connected impulses would do work on the cloth, less is asked for.
        """
        most = self.limits(c, strikes)
        impulses, q = self.solve(c, most)
        while (gained := (c > 0.0) & self.gains_energy(impulses, self.rows @ q)).any():
            c = np.where(gained, LESS_SPEED * c, c)
            impulses, q = self.solve(c, most)
        return impulses, q

    def alone(self, c: np.ndarray, most: np.ndarray) -> np.ndarray:
        """The impulses (m,) [N s] of places that are apart; Λ₀ where pins hold all of a place."""
        can_move = self.own > 0.0
        needed = np.divide(c - self.free, self.own, out=self.pushed.copy(), where=can_move)
        impulses: np.ndarray = np.clip(needed, 0.0, most)
        return impulses

    def limits(self, c: np.ndarray, strikes: np.ndarray) -> np.ndarray:
        """Return Λ_most (m,) [N s]: of impacts, too, as there is no Λ for walls that close."""
        can_move = self.own > 0.0
        needed = np.divide(np.abs(self.free) + c, self.own, out=np.zeros_like(c), where=can_move)
        most: np.ndarray = self.pushed + MOST_IMPULSE * strikes * needed
        return most

    def gains_energy(self, impulses: np.ndarray, faster: np.ndarray) -> np.ndarray:
        """Whether each place (m,) is among connected ones whose impulses do work on the cloth.

        The work is Σ Λ (u + u_free)/2 [J], where `faster` (m,) is u − u_free. With one e and one
        speed it is never positive.
        """
        u = self.free + faster
        _, groups = connected_components(sparse.bmat([[None, self.rows], [self.rows.T, self.mass]]))
        groups = groups[: len(u)]
        work = np.bincount(groups, 0.5 * impulses * (u + self.free))
        round_off = np.bincount(groups, impulses * (np.abs(u) + np.abs(self.free)))
        gains = work > ROUND_OFF_OF_WORK * round_off
        gains_here: np.ndarray = gains[groups]
        return gains_here

    def solve(self, c: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the impulses Λ (m,) [N s] and the change q (f,) of the velocities [m/s].

        A place that gives way has Λ(u) = (c − u)/ε, cut to lie between 0 and Λ_most, with ε of
        `COMPLIANCE`. The change satisfies

            ZᵀMZ q = (GZ)ᵀ Λ(u),   u = u_free + GZ q,

        where the gradient of a convex function is 0, which is quadratic in regions. Newton's method
        with a line search is exact in the last region (Qi and Sun 1993, A Nonsmooth
        Version of Newton's Method, Math. Program. 58). Raises `NewtonFailed` if it does not end.
        """
        can_move = self.own > 0.0
        gives = np.where(can_move, COMPLIANCE * self.own, np.inf)
        least = np.where(can_move, 0.0, most)
        fastest = float((np.abs(self.free) + c).max())
        impulses = self.alone(c, most)
        q = self.solve_mass(self.rows.T @ impulses)
        for _ in range(MOST_ITERATIONS):
            u = self.free + self.rows @ q
            impulses = np.clip((c - u) / gives, least, most)
            residual = self.mass @ q - self.rows.T @ impulses
            gives_way = (impulses > least) & (impulses < most)
            slopes = sparse.diags(gives_way / gives)
            tangent = (self.mass + self.rows.T @ slopes @ self.rows).tocsc()
            direction = splu(tangent).solve(-residual)
            faster = self.rows @ direction
            if np.abs(faster).max() <= SPEED_TOLERANCE * fastest:
                return impulses, q
            inertia = float(direction @ (self.mass @ direction))
            begin = float(direction @ residual)
            q = q + find_step(begin, inertia, faster, c - u, gives, most) * direction
        reason = "the impulses of contacts at the end of the step are not found"
        raise NewtonFailed(reason, np.nan, "Take a smaller dt.")


def find_step(
    begin: float,
    inertia: float,
    faster: np.ndarray,
    closing: np.ndarray,
    gives: np.ndarray,
    most: np.ndarray,
) -> float:
    """The part of a Newton step: the whole, or up to where the slope along it is 0.

    The slope is `begin` at first. It grows with the `inertia` d·M d and, where a place gives way,
    with f²/ε of its own, as the step s changes its speed by s f. It does so where s f is between
    c − u − ε Λ_most and c − u. All but the first two are (m,): f, c − u, ε and Λ_most.
    """
    moves = (faster != 0.0) & np.isfinite(gives)
    f, r, e = faster[moves], closing[moves], gives[moves]
    parts = np.sort(np.clip([(r - e * most[moves]) / f, r / f], 0.0, 1.0), axis=0)
    order = np.argsort(parts, axis=None)
    knots = np.concatenate([[0.0], parts.ravel()[order], [1.0]])
    changes = np.append(f**2 / e, -(f**2) / e)[order]
    growths = inertia + np.cumsum(np.append(0.0, changes))
    slopes = begin + np.cumsum(np.append(0.0, growths * np.diff(knots)))
    if slopes[-1] <= SLOPE_ALLOWED * abs(begin):
        return 1.0
    k = int(np.argmax(slopes > 0.0))
    return float(knots[k] - slopes[k] / growths[k - 1])
