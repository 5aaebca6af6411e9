"""Homogenised stiffness of spring networks and hinge models on periodic mesh patterns."""

from collections.abc import Iterable

import numpy as np

from fecloth.errors import InputError, did_you_mean
from fecloth.fabric.fabric import Fabric
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.hinges import Hinges
from fecloth.system.system import System
from fecloth.terms import TRAITS

_SQUARE, _SKEW = np.eye(2), np.array([[1.0, 0.5], [0.0, np.sqrt(0.75)]])
_A, _B, _C, _D, _O = (0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 0)

# For each pattern: the period vectors as columns, the nodes of a cell, and the triangles of a cell.
# A corner (node, i, j) is a node of the cell at the offset (i, j).
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
    """Homogenised moduli of a term at rest on an infinite mesh of one pattern.

    A strain ε = (ε11, ε22, γ12) is imposed on one period of area A. The nodes of the period may
    move relative to the affine displacement. The minimum of the energy is then A/2 ε·ℂ ε.

    The energy ½ u·K u of patches of nx × ny periods at rest, with εX plus a displacement that is
    equal in all periods, is differenced with respect to nx and ny: the contribution of a border is
    proportional to its length and cancels. Raises `InputError` for an unknown pattern.

    Parameters
    ----------
    term
        A term such as ``Springs(kind="van_gelder")``.
    fabric
        The fabric of the term.
    pattern
        "right", "cross" or "equilateral".
    h
        Edge length [m].

    Returns
    -------
    (3, 3) array
        ℂ [N/m] in the order 11, 22, 12: C11, C22, C12 and the shear modulus C33 = ``[2, 2]``. C13
        and C23 couple stretch and shear. ℂ is isotropic if C11 = C22 = C12 + 2 C33 and
        C13 = C23 = 0. Then ν = C12/C11 and Y = C11 (1 − ν²).
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
    """Matrix of the energy of a patch in ε and the displacements of the nodes of the period."""
    cloth = Cloth.rectangle(*sides, h, pattern)
    system = System(cloth, fabric, [term])
    K = system.stiffness(system.rest())
    D = _displacements(cloth.X, _node_in_period(cloth.X, pattern, h))
    return D.T @ (K @ D)


def _node_in_period(X, pattern, h):
    """(n,) number in the period of each node; the two ends of an odd row belong to that row."""
    row = np.round(X[:, 1] / (0.5 * h if pattern == "cross" else h * np.sqrt(0.75)))
    return np.zeros(len(X), int) if pattern == "right" else row.astype(int) % 2


def _displacements(X, number):
    """(3 n, 3 + 2 q) displacements for unit ε11, ε22, γ12, then for X and Y of each node number."""
    n, q = len(X), number.max() + 1
    D = np.zeros((n, 3, 3 + 2 * q))
    D[:, 0, 0], D[:, 0, 2] = X[:, 0], 0.5 * X[:, 1]
    D[:, 1, 1], D[:, 1, 2] = X[:, 1], 0.5 * X[:, 0]
    for axis in (0, 1):
        D[np.arange(n), axis, 3 + 2 * number + axis] = 1.0
    return D.reshape(3 * n, -1)


def bending_tensor(pattern: str, rigidity: float | tuple[float, float] = 1.0) -> np.ndarray:
    """(3, 3) bending stiffness D [N m] of an infinite pattern: ½ kᵀ D k per area.

    k = (κ11, κ22, 2 κ12). The deflection is ½ X·κX plus a periodic deflection, over which D is the
    minimum of the energy of `HingeBending`, to second order about the flat state, per area of a
    cell. D does not depend on the size of the cell: refinement does not make the model converge to
    the plate energy B (κ11² + κ22² + …). Raises `InputError` for an unknown pattern.

    Parameters
    ----------
    pattern
        "right", "cross" or "equilateral", as `Cloth.rectangle` takes it.
    rigidity
        B [N m], one number or (warp, weft) with the warp along X.

    Examples
    --------
    The rigidity of a free strip along X, and of a strip that cannot curve across X or twist:

    >>> D = bending_tensor("right")
    >>> float(1 / np.linalg.inv(D)[0, 0]), float(D[0, 0])
    (0.8, 1.0)
    """
    X, hinges, period, position = _patch(pattern, 3, 3)
    inside = ((position >= 1 - 1e-9) & (position < 2 - 1e-9)).all(axis=1)
    node = np.arange(len(X)) % len(CELLS[pattern][1])
    x, y = X.T
    curvature = 0.5 * np.stack([x * x, y * y, x * y], axis=1)
    energy = _relaxed_energy(hinges, inside, rigidity, curvature, node)
    return energy / np.linalg.det(period)


def strip_rigidity(pattern: str, across: int, rigidity: float | tuple[float, float] = 1.0) -> float:
    """Effective rigidity B_eff [N m] of a strip along X with two free edges.

    B_eff is the moment per width and curvature in pure bending, as in `bending_tensor`, but the
    minimum over all deflections that are periodic along X, and over the twist. For many cells it
    tends to 1/(D⁻¹)₁₁, with a relative difference of about 1/`across`, because the edges have no
    hinges. Raises `InputError` for an unknown pattern, or `across` less than 1.

    Parameters
    ----------
    pattern
        As for `bending_tensor`.
    across
        Width of the strip in cells, at least 1.
    rigidity
        As for `bending_tensor`.
    """
    if across < 1:
        raise InputError(f"across = {across!r}", "must be at least 1", "strip_rigidity")
    X, hinges, period, position = _patch(pattern, 3, across)
    inside = (position[:, 0] >= 1 - 1e-9) & (position[:, 0] < 2 - 1e-9)
    row = np.arange(len(X)) % ((across + 1) * len(CELLS[pattern][1]))
    x, y = X.T
    curvature = 0.5 * np.stack([x * x, x * y], axis=1)
    energy = _relaxed_energy(hinges, inside, rigidity, curvature, row)
    return float(1 / np.linalg.inv(energy)[0, 0] / (across * np.linalg.det(period)))


def bending_note(pattern: str, terms: Iterable[str]) -> str:
    """A note on the rigidity of hinges on a pattern, for scenes that expect values; else ""."""
    hinge_terms = [name for name in terms if name in TRAITS and TRAITS[name].by_pattern]
    if not hinge_terms or pattern not in CELLS:
        return ""
    D = bending_tensor(pattern)
    span = f"{1 / np.linalg.inv(D)[0, 0]:.2f} B (narrow strip) to {D[0, 0]:.2f} B (wide)"
    return f'{hinge_terms[0]} on "{pattern}" bends along X as {span}, at any h'


def _patch(pattern, nx, ny):
    """Nodes, hinges and periods of nx × ny cells, and the midpoints of the edges in periods."""
    if pattern not in CELLS:
        allowed = f"must be one of {', '.join(CELLS)}"
        remedy = did_you_mean(pattern, CELLS, cutoff=0.0)
        raise InputError(f"pattern = {pattern!r}", allowed, "bending_tensor", remedy)
    period, nodes, triangles = CELLS[pattern]
    i, j = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), indexing="ij")
    corner = np.stack([i.ravel(), j.ravel()], axis=1) @ period.T
    X = (corner[:, None] + np.array(nodes)).reshape(-1, 2)
    cell = np.stack([i[:-1, :-1].ravel(), j[:-1, :-1].ravel()], axis=1)
    node, offset = np.array(triangles)[..., 0], np.array(triangles)[..., 1:]
    cell_of_corner = cell[:, None, None] + offset
    first = (cell_of_corner[..., 0] * (ny + 1) + cell_of_corner[..., 1]) * len(nodes)
    T = (first + node).reshape(-1, 3)
    hinges = Hinges.from_triangles(X, T)
    midpoint = 0.5 * (X[hinges.nodes[:, 0]] + X[hinges.nodes[:, 1]])
    return X, hinges, period, midpoint @ np.linalg.inv(period).T


def _relaxed_energy(hinges, inside, rigidity, fields, node):
    """Matrix (p, p) of the energy of the deflections `fields` (n, p), after relaxation."""
    # The energy is minimised over additional deflections. These have one value for all nodes with
    # the same number in `node` (n,).
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
    relaxable = directions[:, size > 1e-9 * np.linalg.norm(g)]
    remainder = bent - relaxable @ (relaxable.T @ bent)
    return remainder.T @ remainder
