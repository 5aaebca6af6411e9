"""Which homogeneous material a spring network or a hinge model on a periodic pattern is."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.hinges import Hinges
from fecloth.suggest import did_you_mean
from fecloth.system.system import System

_H = np.sqrt(0.75)
_SQUARE, _SKEW = np.eye(2), np.array([[1.0, 0.5], [0.0, _H]])
_A, _B, _C, _D, _O = (0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 0)

# the periods as columns, the nodes of a cell, and its triangles: each corner is a node of the
# cell that lies (i, j) cells further, written (node, i, j)
CELLS = {
    "right": (_SQUARE, [[0.0, 0.0]], [(_A, _B, _C), (_A, _C, _D)]),
    "cross": (
        _SQUARE,
        [[0.0, 0.0], [0.5, 0.5]],
        [(_A, _B, _O), (_B, _C, _O), (_C, _D, _O), (_D, _A, _O)],
    ),
    "equilateral": (_SKEW, [[0.0, 0.0]], [(_A, _B, _D), (_B, _C, _D)]),
}


def plane_moduli(term, fabric: Fabric, pattern: str, h: float = 0.1) -> np.ndarray:
    """Homogenised moduli of a term at rest on an endless mesh of one pattern.

    For a strain ε = (ε11, ε22, γ12) imposed on one period of area A, with the nodes of the period
    free to move relative to it, the least energy is A/2 ε·ℂ ε. The energy of one period is that
    of a patch of nx × ny periods at rest, ½ u·K u for the affine displacement εX plus one that is
    the same in each period, differenced once in nx and once in ny: what the borders add depends
    on the length of a border alone and drops out.

    Parameters
    ----------
    term
        A description such as ``Springs(kind="van_gelder")``.
    fabric
        What the term is bound to.
    pattern
        "right", "cross" or "equilateral".
    h
        Edge length [m].

    Returns
    -------
    (3, 3) array
        ℂ [N/m] with C11, C22, C12 and C33 = ``[2, 2]`` (shear), in the order 11, 22, 12; C13 and
        C23 couple stretch and shear. Isotropic if C11 = C22 = C12 + 2 C33 and C13 = C23 = 0; then
        ν = C12/C11 and Y = C11 (1 − ν²).

    Examples
    --------
    An equilateral lattice of springs k has ν = 1/3 and Y = 2 k/√3:

    >>> import fecloth as fc
    >>> fabric = Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> C = plane_moduli(fc.Springs(stiffness=100.0), fabric, "equilateral")
    >>> bool(np.isclose(C[0, 1] / C[0, 0], 1 / 3)), round(float(C[0, 0]) * 8 / 9, 6)
    (True, 115.470054)
    """
    if pattern not in ("right", "cross", "equilateral"):
        allowed = "must be right, cross or equilateral"
        raise InputError(f"pattern = {pattern!r}", allowed, "plane_moduli")
    period = np.array([h, h if pattern != "equilateral" else 2 * h * np.sqrt(0.75)])
    sizes = (((4, 4), 1), ((4, 3), -1), ((3, 4), -1), ((3, 3), 1))
    H = sum(sign * _energy(term, fabric, pattern, h, size * period) for size, sign in sizes)
    relaxed = H[:3, 3:] @ np.linalg.pinv(H[3:, 3:], rcond=1e-10, hermitian=True) @ H[3:, :3]
    return (H[:3, :3] - relaxed) / np.prod(period)


def _energy(term, fabric, pattern, h, sides):
    """The quadratic form of a patch in ε and the displacements of the period's nodes."""
    cloth = Cloth.rectangle(*sides, h, pattern)
    system = System(cloth, fabric, [term])
    K = system.stiffness(system.rest())
    D = _displacements(cloth.X, _kinds(cloth.X, pattern, h))
    return D.T @ (K @ D)


def _kinds(X, pattern, h):
    """(n,) which node of the period each is; the two ends of a cut row count with it."""
    row = np.round(X[:, 1] / (0.5 * h if pattern == "cross" else h * np.sqrt(0.75)))
    return np.zeros(len(X), int) if pattern == "right" else row.astype(int) % 2


def _displacements(X, kinds):
    """(3 n, 3 + 2 q): ε11, ε22, γ12, then X and Y of each kind of node."""
    n, q = len(X), kinds.max() + 1
    D = np.zeros((n, 3, 3 + 2 * q))
    D[:, 0, 0], D[:, 0, 2] = X[:, 0], 0.5 * X[:, 1]
    D[:, 1, 1], D[:, 1, 2] = X[:, 1], 0.5 * X[:, 0]
    for axis in (0, 1):
        D[np.arange(n), axis, 3 + 2 * kinds + axis] = 1.0
    return D.reshape(3 * n, -1)


def bending_tensor(pattern: str, rigidity: float | tuple[float, float] = 1.0) -> np.ndarray:
    """(3, 3) D [N m] of the unbounded pattern: ½ kᵀ D k per area, k = (κ11, κ22, 2 κ12).

    The energy of `HingeBending`, to second order about flat, of the deflection ½ X·κX plus a
    periodic one, over the area of a cell, least over the periodic one. It does not depend on the
    size of the cell: refinement does not bring the model nearer to the plate B (κ11² + κ22² + …).

    Parameters
    ----------
    pattern
        "right", "cross" or "equilateral", as `Cloth.rectangle` takes it.
    rigidity
        B [N m], one number or (warp, weft) with the warp along X.

    Examples
    --------
    The free strip along X, and one that can neither curve across nor twist:

    >>> D = bending_tensor("right")
    >>> float(1 / np.linalg.inv(D)[0, 0]), float(D[0, 0])
    (0.8, 1.0)
    """
    X, hinges, period, place = _patch(pattern, 3, 3)
    inside = ((place >= 1 - 1e-9) & (place < 2 - 1e-9)).all(axis=1)
    node = np.arange(len(X)) % len(CELLS[pattern][1])
    x, y = X.T
    curvature = 0.5 * np.stack([x * x, y * y, x * y], axis=1)
    return _relaxed(hinges, inside, rigidity, curvature, node) / np.linalg.det(period)


def strip_rigidity(pattern: str, across: int, rigidity: float | tuple[float, float] = 1.0) -> float:
    """B_eff [N m] of a strip along X that is `across` cells wide, free at its two long edges.

    Its moment per width and curvature in pure bending: as in `bending_tensor`, but least over
    every deflection with the period along X, and over the twist. Towards many cells it tends to
    1/(D⁻¹)₁₁; the edges' missing hinges make it differ by about one part in `across`.
    """
    if across < 1:
        raise InputError(f"across = {across!r}", "must be at least 1", "strip_rigidity")
    X, hinges, period, place = _patch(pattern, 3, across)
    inside = (place[:, 0] >= 1 - 1e-9) & (place[:, 0] < 2 - 1e-9)
    row = np.arange(len(X)) % ((across + 1) * len(CELLS[pattern][1]))
    x, y = X.T
    bent = _relaxed(hinges, inside, rigidity, 0.5 * np.stack([x * x, x * y], axis=1), row)
    return float(1 / np.linalg.inv(bent)[0, 0] / (across * np.linalg.det(period)))


def bending_note(pattern: str, terms: Iterable[str]) -> str:
    """A line for a scene that expects values and bends by hinges on a pattern; else "".

    Examples
    --------
    >>> bending_note("right", ["StVK", "HingeBending"])
    'HingeBending on "right" bends along X as 0.80 B (narrow strip) to 1.00 B (wide), at any h'
    """
    hinged = [name for name in terms if name in ("HingeBending", "QuadraticBending")]
    if not hinged or pattern not in CELLS:
        return ""
    D = bending_tensor(pattern)
    span = f"{1 / np.linalg.inv(D)[0, 0]:.2f} B (narrow strip) to {D[0, 0]:.2f} B (wide)"
    return f'{hinged[0]} on "{pattern}" bends along X as {span}, at any h'


def _patch(pattern, nx, ny):
    """X, hinges, periods of nx × ny cells, and the middles of the edges counted in periods."""
    if pattern not in CELLS:
        allowed = f"must be one of {', '.join(CELLS)}"
        remedy = did_you_mean(pattern, CELLS, cutoff=0.0)
        raise InputError(f"pattern = {pattern!r}", allowed, "bending_tensor", remedy)
    period, nodes, triangles = CELLS[pattern]
    i, j = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), indexing="ij")
    corner = np.stack([i.ravel(), j.ravel()], axis=1) @ period.T
    X = (corner[:, None] + np.array(nodes)).reshape(-1, 2)
    cell = np.stack([i[:-1, :-1].ravel(), j[:-1, :-1].ravel()], axis=1)
    own, shift = np.array(triangles)[..., 0], np.array(triangles)[..., 1:]
    at = cell[:, None, None] + shift
    T = ((at[..., 0] * (ny + 1) + at[..., 1]) * len(nodes) + own).reshape(-1, 3)
    hinges = Hinges.of(X, T)
    middle = 0.5 * (X[hinges.nodes[:, 0]] + X[hinges.nodes[:, 1]])
    return X, hinges, period, middle @ np.linalg.inv(period).T


def _relaxed(hinges, inside, rigidity, fields, node):
    """Energy matrix of the deflections `fields` (n, p), least over those that are the same at all
    nodes of one number in `node` (n,)."""
    warp, weft = np.broadcast_to(np.sqrt(rigidity), 2)
    e = hinges.vector / hinges.length[:, None]
    B = (warp * e[:, 1] ** 2 + weft * e[:, 0] ** 2) ** 2
    root = np.sqrt(B / hinges.area) * hinges.length
    g = (root[:, None] * hinges.flat_gradient)[inside]
    nodes = hinges.nodes[inside]
    bent = np.einsum("ha,hap->hp", g, fields[nodes])
    free = np.zeros((len(g), node.max() + 1))
    np.add.at(free, (np.arange(len(g))[:, None], node[nodes]), g)
    directions, size, _ = np.linalg.svd(free, full_matrices=False)
    reached = directions[:, size > 1e-9 * np.linalg.norm(g)]
    rest = bent - reached @ (reached.T @ bent)
    return rest.T @ rest
