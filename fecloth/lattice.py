"""Which plane material a spring network, or any other membrane term, is on a periodic pattern."""

from __future__ import annotations

import numpy as np

from .cloth import Cloth
from .errors import InputError
from .fabric import Fabric
from .system import System


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
