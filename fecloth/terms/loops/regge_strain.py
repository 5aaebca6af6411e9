"""The Regge-interpolated Green strain of quadratic triangles.

Where a P2 membrane bends, its Green strain E is quadratic in a triangle. Most of that strain is
an artefact, which makes thin cloth too stiff by orders of magnitude (membrane locking). E_h is
the linear tensor with the same

    t · E t        at two Gauss points of each edge, with the edge's direction t
    ∫ E dA         over the triangle

It has no such artefact, and equals E where E is linear in X, as it is about flat (Neunteufel and
Schöberl 2021, Avoiding membrane locking with Regge interpolation, Comput. Methods Appl. Mech.
Engrg. 373). It is made on the unit triangle with the coordinates ξ, where the strain is
Ê = Jᵀ E J with J = ∂X/∂ξ, and E_h = J⁻ᵀ Ê_h J⁻¹. For straight edges this is the tensor above. On
triangles with a curved edge E_h of a constant E differs from E by the order h².

P2 keeps its orders with it: h³ in L2, h² in H1, h⁴ of energies and frequencies. In L2 and H1 the
errors of a taut sheet differ from the errors with E by less than 5 % (cases of
`studies.convergence`).

The energy is Σ_p w_p W(E_h(p)) over three points. Each component k of E_h(p), in the order
(11, 22, 12), is a quadratic form of the nodes' positions,

    E_k = ½ Σ_ab A^k_ab x_a · x_b − E⁰_k,      B^k_b = ∂E_k/∂x_b = Σ_a A^k_ab x_a

and with the stress S̃ = (S11, S22, 2 S12) and the moduli ℂ̃ = ∂S̃/∂E

    f_b  = −Σ_p w Σ_k S̃_k B^k_b
    K_ab =  Σ_p w (Σ_kl B^k_a ℂ̃_kl B^l_bᵀ + Σ_k S̃_k A^k_ab I₃)
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import Array, inner
from fecloth.fabric.panel import Panel
from fecloth.mesh.elements import ELEMENTS
from fecloth.mesh.recovery import LINEAR, Samples
from fecloth.terms.loops.green_strain import Six, Three

GAUSS = 0.5 * np.array([1 - 1 / np.sqrt(3), 1 + 1 / np.sqrt(3)])
"""The two Gauss points of an edge from 0 to 1."""
INTERIOR = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6
"""Barycentric coordinates of the points p, whose mean is exact to degree 2."""
EDGES = np.array([[0, 1], [1, 2], [0, 2]])
"""The corners of each edge; the nodes on the edges follow the corners in this order."""
POINTS = len(INTERIOR)
NODES = 3 + len(EDGES)
UNIT_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


STRAINS = "interpolated", "pointwise"


def check_strain(strain: object, where: str) -> None:
    """Raise `InputError` for the term `where` unless `strain` is one of `STRAINS`."""
    validation.one_of("strain", strain, STRAINS, where)


def is_interpolated(strain: object, panel: Panel) -> bool:
    """Whether a term with this `strain` takes E_h on the element of the panel."""
    return panel.cloth.element == "P2" and strain != "pointwise"


@dataclass(frozen=True, eq=False)
class ReggeStrain:
    """E_h of the triangles of a panel, along warp and weft.

    Attributes
    ----------
    nodes
        (m, 6) The nodes of each triangle, as in ``cloth.stencil``.
    forms
        (m, 3 points, 3, 6, 6) The forms A [1/m²].
    weights
        (m, 3) The weights w of the points [m²].
    rest
        (m, 3 points, 3) E⁰, for which the flat cloth has no strain.
    slopes
        (m, 6, 6) ∂N_a/∂t at the six Gauss points of the edges of the unit triangle.
    gradients
        (m, 3, 6, 2) ∂N_a/∂ξ at the three points.
    samples
        (m, 9, 9) The matrix that gives E_h at the three points from the nine data of Ê: the six
        values t · Ê t and the mean of Ê.
    """

    nodes: np.ndarray
    forms: np.ndarray
    weights: np.ndarray
    rest: np.ndarray
    slopes: np.ndarray
    gradients: np.ndarray
    samples: np.ndarray

    @property
    def shape(self) -> tuple[Any, ...]:
        """A zero for each node, and a zero for each point."""
        return (0,) * NODES, (0,) * POINTS

    @property
    def elements(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes, forms and weights."""
        return self.nodes, self.forms, self.weights

    @property
    def definite_arrays(self) -> tuple[np.ndarray, ...]:
        """More arguments of the definite tangent."""
        return self.slopes, self.gradients, self.samples

    def sampled(self, x: np.ndarray) -> tuple[np.ndarray, Samples]:
        """E_h (m, 3 points, 3) at positions x (n, 3), and the samples that these points are."""
        return self.values(x), LINEAR

    def values(self, x: np.ndarray) -> np.ndarray:
        """(m, 3 points, 3) E_h at positions x (n, 3), as E11, E22, E12."""
        u = x[self.nodes] - x[self.nodes[:, :1]]
        rows = np.einsum("epkab,eai->epkbi", self.forms, u, optimize=True)
        E: np.ndarray = 0.5 * np.einsum("epkbi,ebi->epk", rows, u, optimize=True) - self.rest
        return E

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes], about 3.9 kB a triangle."""
        arrays = self.forms, self.weights, self.rest, self.slopes, self.gradients, self.samples
        return sum(array.nbytes for array in arrays)

    @classmethod
    def of_panel(cls, panel: Panel) -> Self:
        """The strain of the triangles of a panel of P2.

        The forms of E on the unit triangle are the same for all triangles. J is ∂X/∂ξ at the
        three points.
        """
        cloth = panel.cloth
        X = _along_grain(panel)
        local = X - X[:, :1]  # from the first node, which avoids round-off
        slopes, gradients, samples, unit_forms = _on_unit_triangle()
        J = np.einsum("eai,paj->epij", local, gradients)
        to_cloth = _covariant(np.linalg.inv(J))
        forms = np.einsum("epkl,plab->epkab", to_cloth, unit_forms, optimize=True)
        forms = np.ascontiguousarray(forms)
        m = len(X)
        samples = np.einsum("epkl,pls->epks", to_cloth, samples).reshape(m, 3 * POINTS, 9)
        rest = 0.5 * np.einsum("epkab,eai,ebi->epk", forms, local, local, optimize=True)
        weights = np.abs(np.linalg.det(J)) / (2 * POINTS)  # corners may be clockwise
        return cls(
            nodes=cloth.stencil,
            forms=forms,
            weights=weights,
            rest=rest,
            slopes=np.tile(slopes, (m, 1, 1)),
            gradients=np.tile(gradients, (m, 1, 1, 1)),
            samples=np.ascontiguousarray(samples),
        )


def _along_grain(panel: Panel) -> np.ndarray:
    """(m, 6, 2) the positions of the triangles' nodes on the flat cloth, along warp and weft."""
    cloth = panel.cloth
    c = np.cos(panel.grain)[:, None]
    s = np.sin(panel.grain)[:, None]
    X, Y = np.moveaxis(cloth.X[cloth.stencil], -1, 0)
    return np.stack([c * X + s * Y, c * Y - s * X], axis=-1)


def _on_unit_triangle() -> tuple[np.ndarray, ...]:
    """Return the slopes, gradients, samples (3, 3, 9) and forms (3, 3, 6, 6) of E there."""
    ends = np.repeat(EDGES, 2, axis=0)
    along = np.tile(GAUSS, len(EDGES))
    points = np.zeros((6, 3))  # the Gauss points of the edges
    points[np.arange(6)[:, None], ends] = np.column_stack([1 - along, along])
    t = UNIT_CORNERS[ends[:, 1]] - UNIT_CORNERS[ends[:, 0]]
    slopes = np.einsum("sai,si->sa", _gradients(points), t)
    gradients = _gradients(INTERIOR)
    samples = _interpolation(points, t)
    forms = np.einsum("pks,sa,sb->pkab", samples[:, :, :6], slopes, slopes)
    mean = _strain_forms(gradients).mean(axis=0)
    forms += np.einsum("pkl,lab->pkab", samples[:, :, 6:], mean)
    return slopes, gradients, samples, forms


def _covariant(K: np.ndarray) -> np.ndarray:
    """(…, 3, 3) the matrix from the components (11, 22, 12) of Ê to those of Kᵀ Ê K."""
    (a, b), (c, d) = np.moveaxis(K, (-2, -1), (0, 1))
    rows = [[a * a, c * c, 2 * a * c], [b * b, d * d, 2 * b * d], [a * b, c * d, a * d + b * c]]
    matrix: np.ndarray = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    return matrix


def _gradients(points: np.ndarray) -> np.ndarray:
    """(p, 6, 2) gradients ∂N_a/∂ξ of the shape functions at barycentric points (p, 3)."""
    return ELEMENTS["P2"].slopes_at(points[:, 1:].T).swapaxes(1, 2)


def _strain_forms(G: np.ndarray) -> np.ndarray:
    """(p, 3, 6, 6) the forms of the Green strain: E_k = ½ Σ_ab A^k_ab x_a · x_b − E⁰_k.

    k stands for 11, 22, 12, and G (p, 6, 2) are the gradients of the shape functions at p
    points: as F_i = Σ_a G_ai x_a, the forms are G_a1 G_b1, G_a2 G_b2 and the symmetric part
    of G_a1 G_b2.
    """
    G1, G2 = G[..., 0], G[..., 1]
    product = np.einsum("...a,...b->...ab", G1, G2)
    parts = [
        np.einsum("...a,...b->...ab", G1, G1),
        np.einsum("...a,...b->...ab", G2, G2),
        0.5 * (product + np.swapaxes(product, -1, -2)),
    ]
    stacked: np.ndarray = np.stack(parts, axis=1)
    return stacked


def _interpolation(points: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(3, 3, 9) the matrices that give E_h at the interior points from its nine data.

    t (6, 2) are the directions of the edges at their `points`. The unknowns in between are the
    values of E_h at the corners.
    """
    along = np.stack([t[:, 0] ** 2, t[:, 1] ** 2, 2 * t[:, 0] * t[:, 1]], axis=-1)
    data = np.empty((9, 3, 3))
    data[:6] = points[:, :, None] * along[:, None, :]
    data[6:] = np.eye(3)[:, None, :] / 3
    values = np.einsum("pc,kl->pkcl", INTERIOR, np.eye(3)).reshape(9, 9)
    matrix: np.ndarray = values @ np.linalg.inv(data.reshape(9, 9))
    return matrix.reshape(POINTS, 3, 9)


@inner
def gather(nodes: Array, e: int, x: Array, u: Array) -> None:
    """u (6, 3) = the positions of the nodes from the first node, which avoids round-off."""
    i = np.uintp(nodes[e, 0])
    for a in range(NODES):
        j = np.uintp(nodes[e, a])
        for c in range(3):
            u[a, c] = x[j, c] - x[i, c]


@inner
def fill_rows(A: Array, u: Array, B: Array) -> None:
    """Fill B (3, 6, 3) = Σ_a A_ab u_a at a point with the forms A (3, 6, 6).

    u (6, 3) are the positions of a triangle's nodes, see `gather`.
    """
    for k in range(3):
        for b in range(NODES):
            b0 = b1 = b2 = 0.0
            for a in range(NODES):
                b0 += A[k, b, a] * u[a, 0]
                b1 += A[k, b, a] * u[a, 1]
                b2 += A[k, b, a] * u[a, 2]
            B[k, b, 0] = b0
            B[k, b, 1] = b1
            B[k, b, 2] = b2


@inner
def contract_rows(B: Array, u: Array) -> Three:
    """B^k · u."""
    E11 = E22 = E12 = 0.0
    for b in range(NODES):
        for c in range(3):
            E11 += B[0, b, c] * u[b, c]
            E22 += B[1, b, c] * u[b, c]
            E12 += B[2, b, c] * u[b, c]
    return E11, E22, E12


@inner
def scatter_force(nodes: Array, e: int, w: float, S: Three, B: Array, f: Array) -> None:
    """f_b −= w S̃ · B_b."""
    S1, S2, S3 = w * S[0], w * S[1], 2.0 * w * S[2]
    for b in range(NODES):
        i = np.uintp(nodes[e, b])
        for c in range(3):
            f[i, c] -= S1 * B[0, b, c] + S2 * B[1, b, c] + S3 * B[2, b, c]


@inner
def scatter_material(
    slots: Array, e: int, w: float, B: Array, C: Six, right: Array, T: Array, J: Array
) -> None:
    """J_ab += w Σ_kl B^k_a ℂ̃_kl right^l_bᵀ for all pairs a, b of nodes of triangle e.

    B and `right` are (3, 6, 3), `slots` (m, 6, 6) are the blocks of J, and T (3, 6, 3) is work
    space for w ℂ̃ right. The factors 2 are there because ℂ is for 2 E12, ℂ̃ for E12.
    """
    C11, C22, C66, C12, C16, C26 = C
    for b in range(NODES):
        for c in range(3):
            r1 = w * right[0, b, c]
            r2 = w * right[1, b, c]
            r3 = 2.0 * w * right[2, b, c]
            T[0, b, c] = C11 * r1 + C12 * r2 + C16 * r3
            T[1, b, c] = C12 * r1 + C22 * r2 + C26 * r3
            T[2, b, c] = 2.0 * (C16 * r1 + C26 * r2 + C66 * r3)
    for a in range(NODES):
        for b in range(NODES):
            s = np.uintp(slots[e, a, b])
            for i in range(3):
                for j in range(3):
                    J[s, i, j] += (
                        B[0, a, i] * T[0, b, j] + B[1, a, i] * T[1, b, j] + B[2, a, i] * T[2, b, j]
                    )


@inner
def scatter_geometric(slots: Array, e: int, w: float, S: Three, A: Array, J: Array) -> None:
    """J_ab += w Σ_k S̃_k A^k_ab I₃."""
    S1, S2, S3 = w * S[0], w * S[1], 2.0 * w * S[2]
    for a in range(NODES):
        for b in range(NODES):
            s = np.uintp(slots[e, a, b])
            value = S1 * A[0, a, b] + S2 * A[1, a, b] + S3 * A[2, a, b]
            for i in range(3):
                J[s, i, i] += value


@inner
def add_sample_stress(M: Array, p: int, w: float, S: Three, sigma: Array) -> None:
    """sigma (9,) += the stress at point p on the nine data of E_h."""
    for s in range(9):
        normal = S[0] * M[3 * p, s] + S[1] * M[3 * p + 1, s]
        sigma[s] += w * (normal + 2.0 * S[2] * M[3 * p + 2, s])


@inner
def scatter_tension(
    slots: Array, e: int, scale: float, sigma: Array, H: Array, S: Three, G: Array, J: Array
) -> None:
    """J_ab += scale (Σ_s max(σ_s, 0) H_sa H_sb + ⅓ Σ_q G_a · S G_b) I₃, semi-definite if S is.

    σ_s are the stresses on t · Ê t at the Gauss points of the edges, the first six of `sigma`,
    with the slopes H (6, 6) there. S is the stress on the mean of Ê, with the gradients
    G (3, 6, 2) at the three points. `slots` (m, 6, 6) are the blocks of J.
    """
    for a in range(NODES):
        for b in range(NODES):
            total = 0.0
            for s in range(6):
                total += max(sigma[s], 0.0) * H[s, a] * H[s, b]
            for q in range(POINTS):
                g1 = S[0] * G[q, a, 0] + S[2] * G[q, a, 1]
                g2 = S[2] * G[q, a, 0] + S[1] * G[q, a, 1]
                total += (g1 * G[q, b, 0] + g2 * G[q, b, 1]) / 3.0
            block = np.uintp(slots[e, a, b])
            for i in range(3):
                J[block, i, i] += scale * total
