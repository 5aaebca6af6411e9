"""Estimate of the largest stable explicit step from a few force evaluations."""

import math

import numpy as np
from scipy.linalg import eigh_tridiagonal

from fecloth import validation
from fecloth.errors import InputError, SolveFailed
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System

PUSH = 1e-6  # size of the differences, relative to an edge
SLOW = 1e-3  # m/s: the same, of velocities
ROUGH = 0.1  # relative error of `largest_rates`
LONGEST = 60  # Lanczos steps in a round
ROUNDS = 6
FIRST = 1.0  # s, the dt of the first round: a long one, in which stiffness rules


def estimate(system: System, state: State, method, tol: float = 0.02) -> float:
    """The dt of `critical_dt` within about `tol`, from a few force evaluations alone [s].

    A mode is stable if a dt² k + b dt d < 1, where (a, b) is the limit of the method. So the
    largest eigenvalue of M^-½ (a dt² K + b dt D) M^-½ must be below 1. Lanczos' method finds
    it, with all vectors kept orthogonal (Golub and Van Loan 2013, Matrix Computations, section
    10.3), from differences of forces, f(x, v) − f(x + a dt² z, v + b dt z) for a small z. So
    no matrix is assembled, and terms that couple all nodes are included. A Ritz value is at
    most the eigenvalue, so its residual is added to it. The result is an estimate and no
    bound: use a fraction of it.

    Every call starts from a random vector: a start from the last eigenvector does not find
    that another end of the cloth has become the stiffest. dt is infinite where nothing is
    stiff. Raises `InputError` for a method without ``traits.stability`` = (a, b), a > 0, or a
    consistent mass, and `SolveFailed` if a force is not finite at the state or close to it,
    with the term's name.
    """
    check_system(system, state, "estimate")
    validation.number("tol", tol, 0.0, "estimate")
    a, b = method.traits.stability or (0.0, 0.0)
    if system.mass_kind != "lumped" or not a > 0 or b < 0:
        allowed = "must be an explicit one with a limit, on a lumped mass"
        raise InputError(f"method = {method!r}", allowed, "estimate", "See critical_dt.")
    products = _Products(system, state, a, b)
    dt = FIRST
    z = products.noise()
    for _ in range(ROUNDS):
        value, residual, z = _lanczos(products.at(dt), z, 2 * tol)
        if value <= 0:
            return math.inf
        before = dt
        dt = products.root(z, dt, value, residual)
        if not products.damped or abs(dt - before) <= tol * dt:
            break
    return dt


def largest_rates(system: System, state: State) -> tuple[float, float]:
    """The largest eigenvalues of M⁻¹K [1/s²] and M⁻¹D [1/s] at a state, within about a tenth.

    Only forces are evaluated. A consistent mass is at least a part of its scaled diagonal, a
    quarter for P1, and that part counts in its place. Raises as `estimate` does.
    """
    products = _Products(system, state, 1.0, 1.0)
    weights = ((1.0, 0.0), (0.0, 1.0))
    noise = products.noise()
    rates = [0.0, 0.0]
    for i in range(1 + products.damped):
        value, residual, _ = _lanczos(lambda y, i=i: products.product(y, *weights[i]), noise, ROUGH)
        rates[i] = max(0.0, value + residual)
    return rates[0], rates[1]


def step_of_rates(k: float, d: float) -> float:
    """The positive dt [s] of dt² k + dt d = 1; infinite for none."""
    total = d + math.hypot(d, 2 * math.sqrt(k))
    return 2 / total if total > 0 else math.inf


class _Products:
    """y ↦ M^-½ P (wx K + wv D) P M^-½ y at a state, one force evaluation each."""

    def __init__(self, system, state, a, b):
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
        """A start of unit size, the same in each run, along the free directions."""
        noise = np.random.default_rng(0).standard_normal(self.state.x.shape)
        noise = self.system.constraints.project(noise)
        size = np.linalg.norm(noise)
        if not size:
            raise InputError("no free direction", "needs a node that moves", "estimate")
        return noise.ravel() / size

    def product(self, y, wx, wv) -> np.ndarray:
        state = self.state
        z = y.reshape(-1, 3) / self.root_mass
        size = PUSH * self.edge / wx if wx else SLOW / wv  # D changes with x only: v may move far
        push = size / np.abs(z).max()
        pushed = State(state.t, state.x + push * wx * z, state.v + push * wv * z)
        change = (self.force - self.system.force(pushed)) / push
        return self.system.constraints.project(change / self.root_mass).ravel()

    def at(self, dt):
        """The operator whose largest eigenvalue is 1 at the limit."""
        wx = self.a * dt**2
        wv = self.b * dt if self.damped else 0.0
        return lambda y: self.product(y, wx, wv)

    def root(self, z, dt, value, residual) -> float:
        """The dt of a dt² k + b dt d = 1, with k and d of z made larger by the residual."""
        more = 1 + residual / value
        if not self.damped:
            return dt / math.sqrt(more * value)
        k = max(self.a * float(np.vdot(z, self.product(z, 1.0, 0.0))), 0.0)
        d = (value - dt**2 * k) / dt
        k = more * k
        d = more * max(d, 0.0)
        return step_of_rates(k, d)


def _not_finite(system: System, state: State) -> str:
    """Say which term has no finite force at a state."""
    for name, term in system.named:
        f = np.zeros_like(state.x)
        term.add_force(state.x, state.v, state.t, f)
        if not np.isfinite(f).all():
            return f"{name} has no finite force at this state: no step is known to be stable"
    return "the forces at this state are not finite: no step is known to be stable"


def _lanczos(apply, start, tol):
    """Largest Ritz value, its residual and its vector, once the residual is small to `tol`."""
    basis = np.empty((LONGEST, len(start)))  # takes memory only as its rows are filled
    basis[0] = start / np.linalg.norm(start)
    diagonal = []
    beside = []
    while True:
        Q = basis[: len(diagonal) + 1]  # (j, 3n)
        r = apply(Q[-1])
        if not np.isfinite(r).all():
            raise SolveFailed("the forces close to this state are not finite: it has no stiffness")
        diagonal.append(float(np.vdot(Q[-1], r)))
        for _ in range(2):
            r -= (Q @ r) @ Q
        values, vectors = eigh_tridiagonal(diagonal, beside)
        value = values[-1]
        s = vectors[:, -1]
        left = float(np.linalg.norm(r))
        residual = left * abs(s[-1])
        if residual <= tol * value or len(Q) == LONGEST or left <= 1e-12 * abs(values).max():
            z = s @ Q
            return float(value), residual, z / np.linalg.norm(z)
        beside.append(left)
        np.divide(r, left, out=basis[len(Q)])
