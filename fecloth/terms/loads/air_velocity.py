"""Velocity of the air around a cloth: uniform, a field of x and t, or gusts."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import Array, kernel
from fecloth.errors import InputError, errors_of
from fecloth.quantities.formula import Formula, FormulaVector
from fecloth.quantities.formula_kernel import write_columns, write_time
from fecloth.quantities.time_function import TimeFunction, vector

GRADIENT_STEP = 1e-5
"""Shift of the positions [m] for central differences of the velocity of the air.

The error of such a difference is about 1e-10 of |u| per metre.
"""
VARIABLES = ("x", "y", "z", "t")


@dataclass(frozen=True)
class Uniform:
    """Uniform velocity u(t) [m/s]; the positions are not used.

    `velocity` and `gradient` have one row, which stands for all triangles.
    """

    value: TimeFunction

    def velocity(self, x: np.ndarray, t: float) -> np.ndarray:
        return self.value(t)[None]

    def gradient(self, x: np.ndarray, t: float) -> np.ndarray:
        return np.zeros((1, 3, 3))

    def compiled(
        self, nodes: np.ndarray, x: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, Calls] | None:
        """The velocity (1, 3) as `Field.compiled` returns it."""
        if self.value.is_constant:
            return self.velocity(x, 0.0), []
        u = np.empty((1, 3))
        calls = self.value.calls(t, u)
        return None if calls is None else (u, calls)


@dataclass(frozen=True)
class Field:
    """Velocity u(x, t) from a function of (m, 3) [m] and t [s]; ∂u/∂x by central differences."""

    function: Callable[[np.ndarray, float], np.ndarray]

    def velocity(self, x: np.ndarray, t: float) -> np.ndarray:
        """Velocity (m, 3) [m/s], or (1, 3) if the function returns (3,)."""
        u = np.atleast_2d(np.asarray(self.function(x, t), dtype=float))
        if u.shape not in ((1, 3), x.shape) or not np.isfinite(u).all():
            allowed = f"must be finite and of shape (3,) or {x.shape}"
            raise InputError(f"velocity of shape {u.shape} at t = {t:g}", allowed, "Wind")
        return np.ascontiguousarray(u)

    def gradient(self, x: np.ndarray, t: float) -> np.ndarray:
        """Gradient ∂u_i/∂x_j (m, 3, 3) [1/s]."""
        columns = []
        for shift in GRADIENT_STEP * np.eye(3):
            change = self.velocity(x + shift, t) - self.velocity(x - shift, t)
            columns.append(np.broadcast_to(change / (2 * GRADIENT_STEP), x.shape))
        return np.stack(columns, axis=2)

    def compiled(
        self, nodes: np.ndarray, x: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, Calls] | None:
        """Return the velocity (m, 3) at the centroids of triangles, and the calls that fill it.

        The calls read the positions x (n, 3) [m] and the time t (1,) [s] when they are made;
        `nodes` (m, 3) are the nodes of the triangles. None for a function of Python.
        """
        if not isinstance(self.function, Formulas):
            return None
        points = np.empty((len(nodes), 3))
        u = np.empty((len(nodes), 3))
        calls = self.function.calls(points, t, u)
        return u, [(fill_centroids, (nodes, x, points)), *calls]


@dataclass(frozen=True)
class Formulas:
    """A function of positions (m, 3) and time from three numbers or formulas of x, y, z, t."""

    parts: tuple

    def __call__(self, x: np.ndarray, t: float) -> np.ndarray:
        variables = np.empty((4, len(x)))
        variables[:3] = x.T
        variables[3] = t
        with errors_of("Wind", "velocity: "):
            return self._components(variables)

    def calls(self, x: np.ndarray, t: np.ndarray, u: np.ndarray) -> list[Call]:
        """The compiled calls that write the values (m, 3) at x (m, 3) and t (1,) to u."""
        variables = np.empty((4, len(x)))
        return [
            (write_columns, (x, variables[:3])),
            (write_time, (t, variables[3])),
            self._components.call(variables, u),
        ]

    @cached_property
    def _components(self) -> FormulaVector:
        return FormulaVector(self.parts)


@dataclass(frozen=True)
class Gusts:
    """Isotropic gusts of given intensity and length that move with the mean wind.

    u(x, t) = U + Σ a_n cos(k_n · (x − U t) + φ_n) is a sum of N random waves.

    - Each component of k_n is Gaussian with the standard deviation 1/ℓ.
    - The a_n have equal lengths and random directions normal to k_n. Therefore the divergence is
      zero. ½ Σ |a_n|² = 3 σ².
    - Each component of the field has the standard deviation σ = intensity · |U|.
    - The correlation decreases as a Gaussian of length ℓ.

    Source: a frozen field in the sense of Taylor (1938), constructed as in Kraichnan (1970),
    Diffusion by a random velocity field, Physics of Fluids 13, 22–31, with a Gaussian spectrum.

    Parameters
    ----------
    mean
        U, three components [m/s].
    intensity
        σ / |U|; 0.1 over open country, 0.3 in a town.
    length
        ℓ [m].
    seed
        Seed of the random numbers. Equal seeds give equal gusts on every machine.
    waves
        Number of waves N.
    """

    mean: tuple[float, float, float]
    intensity: float
    length: float
    seed: int = 0
    waves: int = 64

    def _waves(self):
        """The waves: wave vectors k (N, 3), amplitudes a (N, 3) and phases φ (N,)."""
        random = np.random.RandomState(self.seed)  # the same numbers in all versions of NumPy
        k = random.standard_normal((self.waves, 3)) / self.length
        across = np.cross(k, random.standard_normal((self.waves, 3)))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        a = self.intensity * np.linalg.norm(self.mean) * np.sqrt(6 / self.waves) * across
        return k, a, random.uniform(0, 2 * np.pi, self.waves)

    def velocity(self, x: np.ndarray, t: float) -> np.ndarray:
        k, a, phase = self._waves()
        return self.mean + np.cos((x - t * np.asarray(self.mean)) @ k.T + phase) @ a

    def gradient(self, x: np.ndarray, t: float) -> np.ndarray:
        """Gradient ∂u_i/∂x_j = −Σ a_n k_n sin(…), (m, 3, 3) [1/s]."""
        k, a, phase = self._waves()
        sines = np.sin((x - t * np.asarray(self.mean)) @ k.T + phase)
        return -np.einsum("mn,ni,nj->mij", sines, a, k, optimize=True)

    def compiled(
        self, nodes: np.ndarray, x: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, Calls] | None:
        """None: NumPy computes the sum of the waves faster."""
        return None


AirVelocity = Uniform | Field | Gusts


def velocity_field(velocity, where: str) -> Uniform | Field:
    """Return the velocity field [m/s] of three numbers, three formulas, or a function u(x, t).

    Numbers, and formulas of t alone, give a `Uniform` field, all others a `Field`. Raises
    `InputError`, for the term `where`, for anything else.
    """
    if callable(velocity):
        return Field(velocity)
    # Formulas that have x, y or z are refused here, and read below.
    with contextlib.suppress(InputError):
        return Uniform(vector(velocity, "velocity", where))
    # A list of one from a text or a number, so that it is refused below.
    if isinstance(velocity, str) or np.ndim(np.asarray(velocity, dtype=object)) != 1:
        velocity = (velocity,)
    parts: list[Formula | float] = []
    for part in velocity:
        if isinstance(part, str):
            parts.append(Formula(part, VARIABLES))
        elif not isinstance(part, bool) and np.isscalar(part) and np.isfinite(part):
            parts.append(float(part))  # type: ignore[arg-type]  # isfinite refuses text
    if not len(parts) == len(velocity) == 3:  # a part that is refused above is left out
        allowed = "must be three finite numbers or formulas of x, y, z, t, or a function u(x, t)"
        raise InputError(f"velocity = {velocity!r}", allowed, where)
    return Field(Formulas(tuple(parts)))


@kernel
def fill_centroids(nodes: Array, x: Array, points: Array) -> None:
    """Write the centroids of triangles with these nodes (m, 3) to `points` (m, 3)."""
    for e in range(len(nodes)):
        for k in range(3):
            total = x[nodes[e, 0], k] + x[nodes[e, 1], k] + x[nodes[e, 2], k]
            points[e, k] = total / 3
