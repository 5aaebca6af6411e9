"""Estimate of the largest stable explicit step from a few force evaluations."""

import math

import numpy as np
from scipy.linalg import eigh_tridiagonal

from fecloth import validation
from fecloth.errors import InputError, SolveFailed
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System

# Largest displacement of a node in a difference of forces, relative to a mean edge: small, as
# the force is not linear in x, but far above round-off, about 1e-16 of the forces.
RELATIVE_PUSH = 1e-6
# [m/s] the same for velocities. It may be larger, as the damping force is linear in v.
VELOCITY_PUSH = 1e-3
# Relative error of `largest_rates`: its users need the order of magnitude.
RATE_TOLERANCE = 0.1
# Lanczos steps in a round. If the residual is still large then, it is added to the result, which
# stays safe; the basis of a cloth of 10,000 nodes takes 14 MB at the most.
MOST_LANCZOS_STEPS = 60
# Rounds at the most: in each one dt follows from the mode of the round before.
MOST_ROUNDS = 6
# [s] the dt of the first round: a long one, in which stiffness counts more than damping.
FIRST_DT = 1.0


def estimate(system: System, state: State, method, tol: float = 0.02) -> float:
    """Estimate the dt of `critical_dt` from a few force evaluations alone [s].

    A mode is stable if a dt² k + b dt d < 1, where (a, b) is the limit of the method. So the
    largest eigenvalue of M^-½ (a dt² K + b dt D) M^-½ must be below 1. Lanczos' method finds
    it, with all vectors kept orthogonal (Golub and Van Loan 2013, Matrix Computations, section
    10.3). The products with K and D are differences of forces,
    f(x, v) − f(x + a dt² z, v + b dt z) for a small z. So no matrix is assembled, and terms that
    couple all nodes are included. A Ritz value is at most the eigenvalue. Therefore its
    residual is added to it. The result is an estimate and no bound: use a fraction of it.

    Every call starts from the same random vector. A start from the last eigenvector would miss
    that another end of the cloth has become the stiffest.

    Parameters
    ----------
    system, state
        What moves, and where it is linearised.
    method
        An explicit method with a limit: ``traits.stability`` = (a, b) with a > 0.
    tol
        Relative error of dt, about.

    Returns
    -------
    float
        dt [s]; infinite where nothing is stiff.

    Raises
    ------
    InputError
        For another method, or a consistent mass.
    SolveFailed
        If a force is not finite at the state, with the name of its term, or close to the state.
    """
    check_system(system, state, "estimate")
    validation.number("tol", tol, 0.0, "estimate")
    a, b = method.traits.stability or (0.0, 0.0)
    if system.mass_kind != "lumped" or not a > 0 or b < 0:
        allowed = "must be an explicit one with a limit, on a lumped mass"
        raise InputError(f"method = {method!r}", allowed, "estimate", "See critical_dt.")
    products = _Products(system, state, a, b)
    dt = FIRST_DT
    z = products.noise()
    for _ in range(MOST_ROUNDS):
        # dt is about 1/√value, so the value may have twice the relative error of dt.
        value, residual, z = _lanczos(products.at(dt), z, 2 * tol)
        if value <= 0:  # nothing is stiff
            return math.inf
        dt_before = dt
        dt = products.root(z, dt, value, residual)
        # without damping value/dt² does not depend on dt: one round is enough
        if not products.damped or abs(dt - dt_before) <= tol * dt:
            break
    return dt


def largest_rates(system: System, state: State) -> tuple[float, float]:
    """Return the largest eigenvalues of M⁻¹K [1/s²] and M⁻¹D [1/s], within about a tenth.

    K and D are those at the state; the result is 0 where nothing is stiff, or nothing damped.
    Only forces are evaluated. A consistent mass is at least a part of its scaled diagonal, a
    quarter for P1, and that part counts in its place. Raises `SolveFailed` as `estimate` does.
    """
    products = _Products(system, state, 1.0, 1.0)
    noise = products.noise()

    def largest(of_stiffness: float, of_damping: float) -> float:
        value, residual, _ = _lanczos(
            lambda y: products.product(y, of_stiffness, of_damping), noise, RATE_TOLERANCE
        )
        return max(0.0, value + residual)

    stiffness = largest(1.0, 0.0)
    damping = largest(0.0, 1.0) if products.damped else 0.0
    return stiffness, damping


def step_of_rates(k: float, d: float) -> float:
    """The positive root dt [s] of dt² k + dt d = 1; infinite if there is none."""
    total = d + math.hypot(d, 2 * math.sqrt(k))
    if total > 0:
        return 2 / total
    return math.inf


class _Products:
    """The products M^-½ P (wx K + wv D) P M^-½ y at a state: one force evaluation for each y.

    P is the projector onto the free directions, and (a, b) the limit of the method.
    """

    def __init__(self, system, state, a, b):
        """Evaluate the force at the state; raise `SolveFailed` if it is not finite."""
        # A term that remembers, as friction, is as stiff as before it yields.
        self.system = system = system.with_history(system.start_history(state))
        self.state = state
        self.a = a
        self.b = b
        if system.mass_kind == "consistent":
            part = system.cloth.least_mass
        else:
            part = 1.0
        self.root_mass = np.sqrt(part * system.diagonal_mass)[:, None]
        self.edge = math.sqrt(system.cloth.area / len(system.cloth.triangles))
        self.damped = any(term.velocity_dependent for term in system.bound)
        self.force = system.force(state)
        if not np.isfinite(self.force).all():
            raise SolveFailed(_not_finite(system, state))

    def noise(self) -> np.ndarray:
        """A random vector of unit size along the free directions, the same in each run."""
        noise = np.random.default_rng(0).standard_normal(self.state.x.shape)
        noise = self.system.constraints.project(noise)
        size = np.linalg.norm(noise)
        if not size:
            raise InputError("no free direction", "needs a node that moves", "estimate")
        return noise.ravel() / size

    def product(self, y, wx, wv) -> np.ndarray:
        """Return M^-½ P (wx K + wv D) P M^-½ y, (3n,), from a difference of forces.

        y is (3n,), along the free directions; wx or wv is > 0. One force is evaluated, where the
        nodes are displaced by at most `RELATIVE_PUSH` of an edge, or without stiffness are
        faster by at most `VELOCITY_PUSH`.
        """
        state = self.state
        z = self.system.constraints.followers.follow(y.reshape(-1, 3) / self.root_mass)
        if wx:
            largest_push = RELATIVE_PUSH * self.edge / wx
        else:
            largest_push = VELOCITY_PUSH / wv
        push = largest_push / np.abs(z).max()
        pushed = State(state.t, state.x + push * wx * z, state.v + push * wv * z)
        change = (self.force - self.system.force(pushed)) / push
        return self.system.constraints.project(change / self.root_mass).ravel()

    def at(self, dt):
        """The operator M^-½ P (a dt² K + b dt D) P M^-½.

        At the largest stable dt its largest eigenvalue is 1.
        """
        wx = self.a * dt**2
        wv = self.b * dt if self.damped else 0.0
        return lambda y: self.product(y, wx, wv)

    def root(self, z, dt, value, residual) -> float:
        """The root dt of dt² k + dt d = 1, where k = a z·Kz and d = b z·Dz of a Ritz vector z.

        The Ritz value at the given dt is `value` = dt² k + dt d. It is at most the eigenvalue.
        Therefore k and d are made larger, by the ratio of value + residual to the value.
        """
        enlarged = 1 + residual / value
        if not self.damped:
            return dt / math.sqrt(enlarged * value)
        k = max(self.a * float(np.vdot(z, self.product(z, 1.0, 0.0))), 0.0)
        d = max((value - dt**2 * k) / dt, 0.0)
        return step_of_rates(enlarged * k, enlarged * d)


def _not_finite(system: System, state: State) -> str:
    """Say which term has no finite force at a state."""
    for name, term in system.named:
        f = np.zeros_like(state.x)
        term.add_force(state.x, state.v, state.t, f)
        if not np.isfinite(f).all():
            return f"{name} has no finite force at this state: no step is known to be stable"
    return "the forces at this state are not finite: no step is known to be stable"


def _lanczos(apply, start, tol):
    """Return the largest Ritz value of a symmetric operator, its residual and its unit vector.

    By Lanczos' method: `apply` is the operator on vectors (3n,), `start` the first vector. It
    ends when the residual is at most `tol` times the value, after `MOST_LANCZOS_STEPS`, or when
    the basis spans an invariant subspace: then the value is an eigenvalue. Raises `SolveFailed`
    if a product is not finite.
    """
    basis = np.empty((MOST_LANCZOS_STEPS, len(start)))  # takes memory only as rows are filled
    basis[0] = start / np.linalg.norm(start)
    diagonal = []
    off_diagonal = []
    while True:
        Q = basis[: len(diagonal) + 1]  # (j, 3n)
        r = apply(Q[-1])
        if not np.isfinite(r).all():
            what = "the forces close to this state are not finite"
            raise SolveFailed(f"{what}: it has no stiffness")
        diagonal.append(float(np.vdot(Q[-1], r)))
        for _ in range(2):  # Gram and Schmidt's method, twice: once leaves round-off
            r -= (Q @ r) @ Q
        values, vectors = eigh_tridiagonal(diagonal, off_diagonal)
        value = values[-1]
        s = vectors[:, -1]  # the Ritz vector is s @ Q
        new_size = float(np.linalg.norm(r))
        residual = new_size * abs(s[-1])
        is_last = len(Q) == MOST_LANCZOS_STEPS
        is_invariant = new_size <= 1e-12 * abs(values).max()
        if residual <= tol * value or is_last or is_invariant:
            z = s @ Q
            return float(value), residual, z / np.linalg.norm(z)
        off_diagonal.append(new_size)
        np.divide(r, new_size, out=basis[len(Q)])
