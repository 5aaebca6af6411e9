"""Homogenised stiffness of spring networks and hinge models on periodic mesh patterns."""

from collections.abc import Iterable

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.mesh.cloth import Cloth
from fecloth.system.system import System
from fecloth.terms import TRAITS, HingeBending

CELLS = ("right", "cross", "equilateral")  # the patterns whose cells are all alike
# Factors, and numbers of periods along X and Y, of the patches whose energies are added.
PATCHES = ((1, (4, 4)), (-1, (4, 3)), (-1, (3, 4)), (1, (3, 3)))


def plane_moduli(term, fabric: Fabric, pattern: str, h: float = 0.1) -> np.ndarray:
    """Homogenised moduli of a term at rest on an infinite mesh of one pattern.

    A strain ε = (ε11, ε22, γ12) is imposed on one period of area A. The nodes of the period may
    move relative to the affine displacement. The minimum of the energy is then A/2 ε·ℂ ε.

    The energy ½ u·K u of patches of nx × ny periods at rest, with εX plus a displacement that
    is equal in all periods, is differenced with respect to nx and ny: the contribution of a
    border is proportional to its length and cancels. Raises `InputError` for an unknown
    pattern.

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
        ℂ [N/m] in the order 11, 22, 12: C11, C22, C12 and the shear modulus C33 = ``[2, 2]``.
        C13 and C23 couple stretch and shear. ℂ is isotropic if C11 = C22 = C12 + 2 C33 and C13
        = C23 = 0. Then ν = C12/C11 and Y = C11 (1 − ν²).
    """
    period = _period(pattern, h, "plane_moduli")
    patches = [(sign, size * period) for sign, size in PATCHES]
    return _relaxed(term, fabric, pattern, h, patches, _plane_displacements) / np.prod(period)


def _period(pattern: str, h: float, where: str) -> np.ndarray:
    """(2,) sides of a rectangle after which the pattern repeats itself [m]."""
    validation.known(f"pattern = {pattern!r}", pattern, CELLS, where, always=True)
    if pattern == "equilateral":
        return h * np.array([1.0, 2 * np.sqrt(0.75)])
    return h * np.array([1.0, 1.0])


def _relaxed(term, fabric, pattern, h, patches, displacements, count=3) -> np.ndarray:
    """Return the matrix of the energy in the first `count` displacements, minimised over the rest.

    The energy is the sum over `patches`, pairs of a factor and the sides of a rectangle [m].
    The function ``displacements(X, row)`` returns p displacements (3n, p) of the nodes of a
    rectangle, from their coordinates X (n, 2) [m] and the numbers of their rows (n,).
    """
    H = sum(
        factor * _energy(term, fabric, pattern, h, sides, displacements)
        for factor, sides in patches
    )
    # The Schur complement. The pseudo-inverse, because translations have no energy.
    inner = np.linalg.pinv(H[count:, count:], rcond=1e-10, hermitian=True)
    return H[:count, :count] - H[:count, count:] @ inner @ H[count:, :count]


def _energy(term, fabric, pattern, h, sides, displacements):
    """Return the matrix H (p, p) with the energy ½ qᵀ H q of a rectangle displaced by D q.

    D (3n, p) are the displacements that `displacements` returns, see `_relaxed`, and H = DᵀK D
    with the stiffness K of the term at rest. `sides` are the width and the height [m].
    """
    width, height = sides
    cloth = Cloth.rectangle(width, height, h, pattern)
    system = System(cloth, fabric, [term])
    row_height = 0.5 * h  # of the rows of nodes of "cross"; "right" has only every second one
    if pattern == "equilateral":
        row_height = h * np.sqrt(0.75)
    D = displacements(cloth.X, np.round(cloth.X[:, 1] / row_height).astype(int))
    return D.T @ (system.stiffness(system.rest()) @ D)


def _along(axis: int, *values: np.ndarray) -> np.ndarray:
    """(3n, p) displacements along an axis: (n, p) in one array or several."""
    columns = np.column_stack(values)
    D = np.zeros((len(columns), 3, columns.shape[1]))
    D[:, axis] = columns
    return D.reshape(-1, columns.shape[1])


def _plane_displacements(X, row):
    """Displacements of unit ε11, ε22, γ12, and of every second row of nodes along X and Y."""
    x, y = X.T
    kind = np.eye(2)[row % 2]
    strains = _along(0, x, 0 * x, 0.5 * y) + _along(1, 0 * y, y, 0.5 * x)
    return np.hstack([strains, _along(0, kind), _along(1, kind)])


def bending_tensor(pattern: str, rigidity: float | tuple[float, float] = 1.0) -> np.ndarray:
    """Return the (3, 3) bending stiffness D [N m] of an infinite pattern: ½ kᵀ D k per area.

    k = (κ11, κ22, 2 κ12). The deflection is ½ X·κX plus a periodic deflection, over which D is
    the minimum of the energy of `HingeBending`, to second order about the flat state, per area
    of a cell. D does not depend on the size of the cell: refinement does not make the model
    converge to the plate energy B (κ11² + κ22² + …). Raises `InputError` for an unknown
    pattern.

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
    >>> (1 / np.linalg.inv(D)[0, 0]).round(9).item(), D[0, 0].round(9).item()
    (0.8, 1.0)
    """
    period = _period(pattern, 1.0, "bending_tensor")
    patches = [(sign, size * period) for sign, size in PATCHES]

    def displacements(X, row):
        """Return deflections of unit κ11, κ22 and 2 κ12, and of every second row of nodes."""
        x, y = X.T
        return _along(2, 0.5 * x * x, 0.5 * y * y, 0.5 * x * y, np.eye(2)[row % 2])

    fabric = Fabric(1.0, 1.0, bending_rigidity=rigidity)
    D = _relaxed(HingeBending(), fabric, pattern, 1.0, patches, displacements)
    return D / np.prod(period)


def strip_rigidity(pattern: str, across: int, rigidity: float | tuple[float, float] = 1.0) -> float:
    """Return the effective rigidity B_eff [N m] of a strip along X with two free edges.

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
    width, height = _period(pattern, 1.0, "strip_rigidity")
    height *= across
    if pattern == "equilateral":  # its period has two rows
        height /= 2

    def displacements(X, row):
        """Return deflections of unit κ11 and 2 κ12, and of each row of nodes."""
        x, y = X.T
        return _along(2, 0.5 * x * x, 0.5 * x * y, np.eye(row.max() + 1)[row])

    fabric = Fabric(1.0, 1.0, bending_rigidity=rigidity)
    # The difference of four and three periods is one period, without the ends of the strip.
    patches = [(1, (4 * width, height)), (-1, (3 * width, height))]
    energy = _relaxed(HingeBending(), fabric, pattern, 1.0, patches, displacements, count=2)
    return float(1 / np.linalg.inv(energy)[0, 0] / (width * height))


def bending_note(pattern: str, terms: Iterable[str]) -> str:
    """Return a note on the rigidity of hinges on a pattern; "" without hinges or pattern."""
    hinge_terms = [name for name in terms if name in TRAITS and TRAITS[name].by_pattern]
    if not hinge_terms or pattern not in CELLS:
        return ""
    D = bending_tensor(pattern)
    span = f"{1 / np.linalg.inv(D)[0, 0]:.2f} B (narrow strip) to {D[0, 0]:.2f} B (wide)"
    return f'{hinge_terms[0]} on "{pattern}" bends along X as {span}, at any h'
