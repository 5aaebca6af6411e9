"""Problems with a known strain or curvature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import fecloth as fc
from studies.bending.meshes import on_sides, rectangle
from studies.convergence.true_error import Field, Solved
from studies.references import closed_forms, manufactured
from studies.references.elastica import heavy_angle, heavy_elastica

SMALL = 1e-4  # load of the plates: their deflection is far below the length √(B/Y)
NU, GAMMA = 0.3, 10.0
PLATE = fc.Fabric(1.0, 1e3, NU, bending_rigidity=1.0, bending_poisson_ratio=NU)


# --- meshes and loads -----------------------------------------------------------------------------


def mesh(width: float, height: float, n: int, pattern: str, element: str) -> fc.Cloth:
    """Return a rectangle with n spacings of nodes along its width; "jittered" moves inner nodes."""
    return rectangle(width, height, width / n * (1 if element == "P1" else 2), pattern, element)


def load(cloth: fc.Cloth, density: Field) -> fc.UserForce:
    """Return consistent nodal forces of a load (p, 3) per reference area."""
    parts = [cloth.load(lambda X, i=i: density(X)[:, i], order=8) for i in range(3)]
    f, none = np.stack(parts, axis=1), np.zeros((len(cloth.X), 3, 3))
    return fc.UserForce(lambda x, v, t: f, per="node", derivatives=lambda x, v, t: (none, none))


def bend(cloth, fabric, pressure: Callable, pins) -> Solved:
    """Return a plate under a small load across it."""
    across = load(cloth, lambda X: SMALL * np.outer(pressure(X), [0.0, 0.0, 1.0]))
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending(), across], pins)
    return Solved(system, fc.equilibrium(system, system.rest(), tolerance=1e-5))


# --- membranes ------------------------------------------------------------------------------------


def taut_sheet(pattern: str, n: int, element: str) -> Solved:
    """Return a taut, wavy sheet under the load that makes it exact; see `manufactured`."""
    cloth = mesh(1.0, 1.0, n, pattern, element)
    fabric = fc.Fabric(manufactured.DENSITY, manufactured.Y, manufactured.NU)
    body = load(cloth, lambda X: -manufactured.divergence(X))
    system = fc.System(cloth, fabric, [fc.StVK(), body], [fc.Pin(on_sides)])
    state = fc.equilibrium(system, system.state(manufactured.position(cloth.X)))
    return Solved(system, state, lambda X: _components(manufactured.strain(X)))


def rubber_sheet(pattern: str, n: int, element: str) -> Solved:
    """Return the same shape of neo-Hookean rubber, S = μ (I − C⁻¹/det C), stretched by a fifth."""
    cloth, step = mesh(1.0, 1.0, n, pattern, element), 1e-4
    fabric = fc.Fabric(manufactured.DENSITY, manufactured.Y, 0.5)

    def stress(X):
        F = manufactured.gradient(X)
        C = np.einsum("piJ,piK->pJK", F, F)
        inverse = np.linalg.inv(C) / np.linalg.det(C)[:, None, None]
        return manufactured.Y / 3 * F @ (np.eye(2) - inverse)

    def body(X):
        sides = [stress(X + e) - stress(X - e) for e in step * np.eye(2)]
        return -(sides[0][:, :, 0] + sides[1][:, :, 1]) / (2 * step)

    terms = [fc.NeoHookean(), load(cloth, body)]
    system = fc.System(cloth, fabric, terms, [fc.Pin(on_sides)])
    state = fc.equilibrium(system, system.state(manufactured.position(cloth.X)))
    return Solved(system, state, lambda X: _components(manufactured.strain(X)))


def _components(E):
    return np.stack([E[:, 0, 0], E[:, 1, 1], E[:, 0, 1]], axis=1)


def hanging_strip(pattern: str, n: int, element: str) -> Solved:
    """Return a soft strip under its own weight, in its plane."""
    cloth = mesh(1.0, 0.2, n, pattern, element)
    terms = [fc.StVK(), fc.Gravity((9.81, 0.0, 0.0))]
    system = fc.System(cloth, fc.Fabric(0.2, 40.0), terms, ["left"])

    def strain(X):
        e = closed_forms.hanging_strip_strain(np.clip(X[:, 0], 0, 1), 1.0, 40.0, 0.2)
        return np.outer(e + e * e / 2, [1, 0, 0])

    return Solved(system, fc.equilibrium(system, system.rest()), strain)


# --- plates ---------------------------------------------------------------------------------------


def supported_square(pattern: str, n: int, element: str) -> Solved:
    """Return a simply supported square under a uniform load: Navier's series."""
    square = mesh(1.0, 1.0, n, pattern, element)
    plate = bend(square, PLATE, lambda X: np.ones(len(X)), [fc.Pin(on_sides)])
    m = np.arange(1, 80, 2)
    i, j = np.meshgrid(m, m, indexing="ij")
    a = 16 * SMALL / (np.pi**4 * i * j * (i * i + j * j) ** 2)

    def curvature(X):
        at = np.pi * X[:, :, None] * m
        (sx, sy), (cx, cy) = np.sin(at).swapaxes(0, 1), np.cos(at).swapaxes(0, 1)
        sum_over = lambda x, A, y: np.einsum("pm,mn,pn->p", x, A, y, optimize=True)  # noqa: E731
        parts = [-sum_over(sx, a * i * i, sy), -sum_over(sx, a * j * j, sy)]
        return np.stack([*parts, 2 * sum_over(cx, a * i * j, cy)], axis=1)

    return replace(plate, curvature=curvature)


def clamped_square(pattern: str, n: int, element: str) -> Solved:
    """Return a clamped square that takes the shape sin²πX sin²πY."""
    pi = np.pi

    def pressure(X):
        cx, cy = np.cos(2 * pi * X).T
        return 4 * pi**4 * (4 * cx * cy - cx - cy)

    def curvature(X):
        x, y = pi * X.T
        parts = np.cos(2 * x) * np.sin(y) ** 2, np.cos(2 * y) * np.sin(x) ** 2
        return 2 * pi**2 * SMALL * np.stack([*parts, np.sin(2 * x) * np.sin(2 * y)], axis=1)

    plate = bend(
        mesh(1.0, 1.0, n, pattern, element), PLATE, pressure, [fc.Pin(on_sides, clamp=True)]
    )
    return replace(plate, curvature=curvature)


def clamped_disc(pattern: str, n: int, element: str) -> Solved:
    """Return a clamped disc under a uniform load, of deflection q (1 − r²)²/64; pattern unused."""
    cloth = fc.Cloth.disk(1.0, (1 if element == "P1" else 2) / n, element)
    plate = bend(cloth, PLATE, lambda X: np.ones(len(X)), [fc.Pin("boundary", clamp=True)])

    def curvature(X):
        x, y = X.T
        inner = 1 - x * x - y * y
        return SMALL / 16 * np.stack([2 * x * x - inner, 2 * y * y - inner, 4 * x * y], axis=1)

    return replace(plate, curvature=curvature)


def two_fabrics(pattern: str, n: int, element: str) -> Solved:
    """Return a strip of rigidities 1 and 10, supported at its ends: κ = M/B jumps at the seam.

    Its halves are meshes of their own, the right one a mirror image of the left one.
    """
    cloth = _mirrored(mesh(0.5, 0.5, n // 2, pattern, "P1"), element)
    soft, stiff = (fc.Fabric(1.0, 1e3, bending_rigidity=B) for B in (1.0, 10.0))
    uniform = {"soft": soft, "stiff": stiff}, lambda X: np.ones(len(X))
    plate = bend(cloth, *uniform, [fc.Pin(lambda X: abs(X[:, 0] - 0.5) > 0.5 - 1e-9)])

    def curvature(X):
        x = X[:, 0]
        return np.outer(-SMALL * x * (1 - x) / 2 / np.where(x < 0.5, 1, 10), [1, 0, 0])

    return replace(plate, curvature=curvature)


def _mirrored(half: fc.Cloth, element: str) -> fc.Cloth:
    X, T, n = half.X, half.triangles, len(half.X)
    seam = np.abs(X[:, 0] - 0.5) < 1e-9
    other = np.arange(n)
    other[~seam] = n + np.arange((~seam).sum())
    points = np.vstack([X, np.column_stack([1 - X[:, 0], X[:, 1]])[~seam]])
    m = np.arange(len(T))
    regions = {"soft": m, "stiff": len(T) + m}
    triangles = np.vstack([T, other[T][:, ::-1]])
    return fc.Cloth.from_arrays(points, triangles, regions=regions, element=element)


# --- strips that bend far -------------------------------------------------------------------------


def cantilever(pattern: str, n: int, element: str, ratio: float = 1e6) -> Solved:
    """Return a clamped strip of ρ g L³/B = 10 under its own weight, with Y L²/B = `ratio`."""
    cloth, shape = mesh(1.0, 0.25, n, pattern, element), heavy_angle(GAMMA)
    fabric = fc.Fabric(1.0, ratio, bending_rigidity=1.0)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0.0, 0.0, -GAMMA))]
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    s, along, down = heavy_elastica(GAMMA)
    X, Y = cloth.X.T
    start = np.column_stack([np.interp(X, s, along), Y, -np.interp(X, s, down)])

    def strain(X):  # by the weight of what hangs below
        s = X[:, 0]
        return np.outer(GAMMA * (1 - s) * np.sin(shape(s)[0]) / ratio, [1, 0, 0])

    def curvature(X):
        return np.outer(-shape(X[:, 0])[1], [1, 0, 0])

    state = fc.equilibrium(system, system.state(start), tolerance=1e-7)
    return Solved(system, state, strain, curvature)


def arc(pattern: str, n: int, element: str) -> Solved:
    """Return a strip bent to an arc of one radian by turned clamps: κ = 1 without strain.

    The true strain, of the order of B κ²/Y, is left out: up to 0.3 % in the norm of the energy.
    """
    cloth = mesh(1.0, 0.5, n, pattern, element)
    angle, far, end = 1.0, np.array([1.0, 0.0]), np.array([np.sin(1.0), 1 - np.cos(1.0)])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x, z = np.linalg.solve(np.eye(2) - turn, end - turn @ far)
    moved = fc.Rotation((x, 0.0, z), (0.0, -1.0, 0.0), lambda t: angle * t)
    pins = [fc.Pin("left", clamp=True), fc.Pin("right", clamp=True, rotate=moved)]
    fabric = fc.Fabric(1.0, 1e5, bending_rigidity=1.0)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending()], pins)
    X, Y = cloth.X.T
    start = system.state(np.column_stack([np.sin(X), Y, 1 - np.cos(X)]), t=1.0)
    state = fc.equilibrium(system, start, tolerance=1e-7)
    return Solved(system, state, curvature=lambda X: np.tile([1.0, 0.0, 0.0], (len(X), 1)))


def thin_cantilever(pattern: str, n: int, element: str) -> Solved:
    """Return the cantilever with Y L²/B = 1e7: P1 locks where no edges lie along the bend."""
    return cantilever(pattern, n, element, 1e7)


PROBLEMS = {
    f.__name__: f
    for f in (
        taut_sheet,
        rubber_sheet,
        hanging_strip,
        supported_square,
        clamped_square,
        clamped_disc,
        two_fabrics,
        cantilever,
        thin_cantilever,
        arc,
    )
}
