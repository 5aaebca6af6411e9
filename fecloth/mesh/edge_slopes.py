"""Slopes of the edges of a plate, reconstructed from the hinge angles around each edge.

Across an interior edge with the dihedral angle θ the slopes of its two triangles are

    α_left = θ/2 + φ,   α_right = θ/2 − φ.

Morley's plate has one unknown φ for each edge. Here φ = Σ w_f θ_f over the hinges f of the two
triangles, with the weights w of least norm that are exact for every constant curvature. Two
properties follow:

- The mean of the curvature over the mesh does not depend on φ. So a constant moment does no
  work on a local deflection.
- The deflections are a part of Morley's deflections. So the energy is at least Morley's energy,
  and only affine motions are without energy.

A clamped edge of the boundary is one more hinge, between its triangle and a plane that is held;
its slope is its angle. Free edges have no moment; whoever uses the slopes eliminates theirs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.hinges import HalfEdges

# A patch is widened if the least singular value of its Λ, in edge lengths, is smaller: then its
# angles hardly determine one of the curvatures.
LEAST_SINGULAR_VALUE = 0.15
# If an eigenvalue of ΛᵀΛ is smaller, the weights are the shortest least-squares solution. The
# round-off of these matrices is far below it, the square of `LEAST_SINGULAR_VALUE` far above it.
LEAST_EIGENVALUE = 1e-6
# Weights below it are zero up to round-off.
LEAST_WEIGHT = 1e-12
# φ̂ below it is zero up to round-off: the two triangles are mirror images of each other.
LEAST_ANGLE_OF_CURVATURE = 1e-11


@dataclass(frozen=True, eq=False)
class EdgeSlopes:
    """The slopes α of the half-edges of a mesh as a linear function C of its hinge angles θ.

    Attributes
    ----------
    edges
        The half-edges and hinges of the mesh.
    region
        (m,) equal where two triangles lie in the same named regions. The material may change
        only between triangles of different regions.
    """

    edges: HalfEdges
    region: np.ndarray

    @cached_property
    def patches(self) -> sparse.csr_matrix:
        """(h, m) the patch of each interior edge: nonzero for the triangles that determine its φ.

        φ is a sum over the hinges of these triangles. Usually these are the two triangles of
        the edge. If they have fewer than three hinges, all triangles at the four nodes of the
        edge's hinge are added. If their angles hardly determine one of the curvatures, all
        triangles at the two ends of the edge are added.
        """
        plate = self._plain
        edges = self.edges
        patches = plate.in_triangle.T.tocsr()  # the two triangles of each hinge
        hinges_of_patch = (patches @ plate.in_triangle).tocsr()
        *_, gram = _gram(plate, hinges_of_patch)
        # Three curvatures need three angles.
        has_too_few = np.diff(hinges_of_patch.indptr) < 3
        # The eigenvalues of ΛᵀΛ are the squares of the singular values of Λ.
        is_poor = _least_eigenvalue(gram) < LEAST_SINGULAR_VALUE**2
        for is_widened, corners in ((has_too_few, 4), (is_poor & ~has_too_few, 2)):
            rows = np.flatnonzero(is_widened)
            # The first two nodes of a hinge are the ends of the edge.
            nodes = edges.hinges.nodes[rows, :corners]
            data = np.ones(nodes.size), (np.repeat(rows, corners), nodes.ravel())
            at_node = sparse.csr_matrix(data, shape=(patches.shape[0], len(edges.X)))
            patches = patches + at_node @ edges.at_node
        return patches

    @cached_property
    def plain(self) -> sparse.csr_matrix:
        """(3m, h) C of one material and no clamp; the rows of free half-edges are empty."""
        return self._slopes(self._plain, self._plain_weights)

    @cached_property
    def _plain_weights(self) -> sparse.csr_matrix:
        return self._weights(self._plain)

    @cached_property
    def pairs(self) -> np.ndarray:
        """(p, 2) int32 pairs i < j of nodes that the slopes of one triangle couple.

        The pairs are the same for any plate on this mesh. On regular meshes many weights are
        zero in a plate of one material. The weights of the edges in `_changing` may still be
        nonzero in another plate; therefore their slopes count with all hinges of their patches.
        """
        m = len(self.edges.triangles)
        h = len(self.edges.of_hinge)
        if not h:  # one triangle alone: the angles of its clamps depend on its three corners
            return np.sort(self.edges.triangles)[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2)
        nodes = self.edges.hinges.nodes
        changing = sparse.diags(self._changing.astype(float))
        hinges_of_patch = changing @ self.patches @ self._plain.in_triangle
        # `slopes` (3m, h): nonzero where the slope of a half-edge depends on a hinge. `abs`, so
        # that no two terms cancel.
        slopes = abs(self.plain) + abs(self._sides) @ hinges_of_patch
        slopes.data[:] = 1.0
        of_triangle = sparse.csr_matrix(
            (np.ones(3 * m), np.arange(3 * m), np.arange(0, 3 * m + 1, 3)), shape=(m, 3 * m)
        )
        nodes_of_hinge = sparse.csr_matrix(
            (np.ones(4 * h), nodes.ravel(), np.arange(0, 4 * h + 1, 4)),
            shape=(h, len(self.edges.X)),
        )
        # (m, n): nonzero where the slopes of a triangle depend on a node.
        nodes_of_triangle = of_triangle @ slopes @ nodes_of_hinge
        pairs = sparse.triu(nodes_of_triangle.T @ nodes_of_triangle, k=1, format="coo")
        return np.column_stack([pairs.row, pairs.col]).astype(np.int32)

    @property
    def _changing(self) -> np.ndarray:
        """(h,) whether the weights of an edge depend on seams and clamps.

        They do at a seam between two regions. They also do where φ is not zero and the patch
        has an edge that may be a seam or a clamp, which is an edge between two regions or on
        the boundary.
        """
        sides = self.edges.hinges.sides
        seam = self.region[sides[:, 0]] != self.region[sides[:, 1]]
        has_such_edge = np.zeros(len(self.edges.triangles), bool)
        has_such_edge[np.flatnonzero(self.edges.hinge < 0) // 3] = True
        has_such_edge[sides[seam]] = True
        has_weights = np.diff(self._plain_weights.indptr) > 0
        return seam | (has_weights & (self.patches @ has_such_edge.astype(float) > 0))

    def of_plate(
        self, rigidity: np.ndarray, material: np.ndarray, clamped: np.ndarray
    ) -> tuple[sparse.csr_matrix, np.ndarray]:
        """C (3m, h + c) of a plate, and the hinge of each half-edge (3m,), −1 where it is free.

        Across a seam between two materials φ is exact for a constant moment.

        Parameters
        ----------
        rigidity
            (m, 3, 3) D of each triangle [N m] on (κ₁₁, κ₂₂, 2κ₁₂) in X and Y.
        material
            (m,) equal where two triangles have the same D.
        clamped
            (c,) half-edges on the boundary whose slope is held; they are the hinges
            h … h + c − 1.
        """
        plate = _Plate(self.edges, clamped, rigidity, material)
        if not len(clamped) and (material == material[0]).all():
            return self.plain, plate.hinge
        return self._slopes(plate, self._weights(plate)), plate.hinge

    @property
    def _plain(self) -> "_Plate":
        """The plate of one material without a clamp."""
        m = len(self.edges.triangles)
        return _Plate(
            self.edges,
            clamped=np.empty(0, int),
            rigidity=np.broadcast_to(np.eye(3), (m, 3, 3)),
            material=np.zeros(m, int),
        )

    def _slopes(self, plate: "_Plate", weights: sparse.csr_matrix) -> sparse.csr_matrix:
        """(3m, h + c) C, with α = C θ: the slopes of all half-edges from the hinge angles.

        α = θ/2 ± φ with φ = W θ at interior edges, and α = θ at clamped edges. `weights` is
        W (h, h + c).
        """
        h = len(self.edges.of_hinge)
        c = len(plate.clamped)
        half_edges = np.concatenate(self.edges.of_hinge.T)
        hinges = np.tile(np.arange(h), 2)
        rows = np.concatenate([half_edges, plate.clamped])
        columns = np.concatenate([hinges, h + np.arange(c)])
        shares = np.concatenate([np.full(2 * h, 0.5), np.ones(c)])
        mean = sparse.csr_matrix((shares, (rows, columns)), shape=(len(plate.hinge), h + c))
        return (mean + self._sides @ weights).tocsr()

    @property
    def _sides(self) -> sparse.csr_matrix:
        """(3m, h) 1 for the left and −1 for the right half-edge of each interior edge."""
        h = len(self.edges.of_hinge)
        size = 3 * len(self.edges.triangles)
        place = np.concatenate(self.edges.of_hinge.T), np.tile(np.arange(h), 2)
        return sparse.csr_matrix((np.repeat([1.0, -1.0], h), place), shape=(size, h))

    def _weights(self, plate: "_Plate") -> sparse.csr_matrix:
        """(h, h + c) W with φ = W θ at the interior edges.

        For a constant curvature κ let θ_f = Λ_f · κ and φ = φ̂ · κ. The shortest w with
        Σ w_f Λ_f = φ̂ is Λ (ΛᵀΛ)⁻¹ φ̂.
        """
        patch = (self.patches @ plate.in_triangle).tocsr()
        row, angle, gram = _gram(plate, patch)
        hinges = np.arange(patch.shape[0])
        slope = self.edges.slopes_of_curvature
        left, right = self.edges.of_hinge.T
        # φ = (α_left − α_right)/2, with both slopes from the curvature of the left triangle.
        slope_right = plate.across(hinges, hinges, triangle=right // 3, rows=slope[right])
        phi = 0.5 * (slope[left] - slope_right)
        phi /= self.edges.hinges.length[:, None]  # Λ in `_gram` is in edge lengths, too
        # Round-off is set to zero, so that W stays as sparse as the mesh allows.
        phi[np.abs(phi).max(axis=1) < LEAST_ANGLE_OF_CURVATURE] = 0.0
        weights = np.einsum("ei,ei->e", angle, _solve(gram, phi)[row])
        weights[np.abs(weights) < LEAST_WEIGHT] = 0.0
        W = sparse.csr_matrix((weights, patch.indices, patch.indptr), shape=patch.shape)
        W.eliminate_zeros()
        return W


@dataclass(frozen=True, eq=False)
class _Plate:
    """A mesh with clamped half-edges and materials; for the fields see `EdgeSlopes.of_plate`."""

    edges: HalfEdges
    clamped: np.ndarray
    rigidity: np.ndarray
    material: np.ndarray

    @cached_property
    def hinge(self) -> np.ndarray:
        """(3m,) hinge of each half-edge; −1 for a free edge."""
        hinge = self.edges.hinge.copy()
        hinge[self.clamped] = len(self.edges.of_hinge) + np.arange(len(self.clamped))
        return hinge

    @cached_property
    def in_triangle(self) -> sparse.csr_matrix:
        """(m, h + c) 1 where a hinge is an edge of the triangle."""
        used = np.flatnonzero(self.hinge >= 0)
        place = used // 3, self.hinge[used]
        shape = len(self.edges.triangles), len(self.edges.of_hinge) + len(self.clamped)
        return sparse.csr_matrix((np.ones(len(used)), place), shape=shape)

    def angles(self, centre: np.ndarray, hinge: np.ndarray) -> np.ndarray:
        """(p, 3) rows Λ with θ = Λ · κ: the angle of each `hinge` (p,) for a constant κ.

        κ is the curvature in the left triangle of the hinge `centre` (p,), around which the
        patch lies. Across seams it continues as `continue_curvature` says.
        """
        h = len(self.edges.of_hinge)
        slope = self.edges.slopes_of_curvature
        # The angle of an interior hinge is the sum of the slopes of its two half-edges. A
        # clamped one has a single half-edge, in a triangle that is taken as the left one.
        left = np.concatenate([self.edges.of_hinge[:, 0], self.clamped])[hinge]
        rows = self.across(centre, hinge, triangle=left // 3, rows=slope[left])
        interior = np.flatnonzero(hinge < h)
        centre = centre[interior]
        hinge = hinge[interior]
        right = self.edges.of_hinge[hinge, 1]
        rows[interior] += self.across(centre, hinge, triangle=right // 3, rows=slope[right])
        return rows

    def across(self, centre, hinge, triangle, rows) -> np.ndarray:
        """Turn rows (p, 3) on κ of `triangle` into rows on κ of the left side of `centre`.

        The two curvatures differ where a seam lies between: the hinge `centre` if it is a seam,
        else the hinge `hinge`. `centre`, `hinge` and `triangle` are indices (p,). `rows` is
        overwritten and returned.
        """
        sides = self.edges.hinges.sides[centre]
        material = self.material[sides[:, 0]]
        differing = np.flatnonzero(material != self.material[triangle])
        if len(differing):
            is_centre_seam = material[differing] != self.material[sides[differing, 1]]
            # A clamped hinge lies on the boundary, so it cannot be the seam.
            is_centre_seam |= hinge[differing] >= len(self.edges.of_hinge)
            seam = np.where(is_centre_seam, centre[differing], hinge[differing])
            T = continue_curvature(
                self.edges.hinges.vector[seam],
                a=self.rigidity[sides[differing, 0]],
                b=self.rigidity[triangle[differing]],
            )
            rows[differing] = np.einsum("pi,pij->pj", rows[differing], T)
        return rows


def _gram(plate: _Plate, patch: sparse.csr_matrix):
    """Return the row of each nonzero entry of `patch`, its Λ, and the matrix ΛᵀΛ of each row.

    `patch` (h, h + c) has in row e the hinges of the patch of edge e. Λ (entries, 3), see
    `_Plate.angles`, is divided by the length of edge e. ΛᵀΛ is (h, 3, 3).
    """
    row = np.repeat(np.arange(patch.shape[0]), np.diff(patch.indptr))
    angle = plate.angles(centre=row, hinge=patch.indices)
    angle = angle / plate.edges.hinges.length[row, None]
    products = (angle[:, :, None] * angle[:, None, :]).reshape(-1, 9)
    if len(row):
        gram = np.add.reduceat(products, patch.indptr[:-1], axis=0)
    else:
        gram = products  # `reduceat` refuses empty arrays
    return row, angle, gram.reshape(-1, 3, 3)


def _least_eigenvalue(A: np.ndarray) -> np.ndarray:
    """(p,) least eigenvalue of symmetric matrices (p, 3, 3), in closed form (trigonometric)."""
    mean = np.trace(A, axis1=1, axis2=2) / 3
    B = A - mean[:, None, None] * np.eye(3)
    size = np.sqrt(np.sum(B * B, axis=(1, 2)) / 6)
    cosine = np.linalg.det(B) / (2 * np.maximum(size, 1e-300) ** 3)
    return mean + 2 * size * np.cos(np.arccos(np.clip(cosine, -1, 1)) / 3 + 2 * np.pi / 3)


def _solve(gram: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """y (h, 3) with gram y = phi; for singular matrices the shortest least-squares solution."""
    singular = _least_eigenvalue(gram) < LEAST_EIGENVALUE
    y = np.empty_like(phi)
    y[~singular] = np.linalg.solve(gram[~singular], phi[~singular, :, None])[..., 0]
    inverse = np.linalg.pinv(gram[singular], rcond=LEAST_EIGENVALUE, hermitian=True)
    y[singular] = np.einsum("pij,pj->pi", inverse, phi[singular])
    return y


def continue_curvature(seam: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(p, 3, 3) T with κ(b) = T κ(a) across straight seams, both as (κ₁₁, κ₂₂, 2κ₁₂).

    Let n and t be the normal and the tangent of a seam. κ_tt, κ_nt and the moment M_nn are
    continuous across it, and κ_nn jumps.

    Parameters
    ----------
    seam
        (p, 2) vectors along the seams.
    a, b
        (p, 3, 3) D on the two sides [N m].
    """
    normal = np.arctan2(-seam[:, 0], seam[:, 1])  # the angle of n from the first axis
    to_seam = turn_curvature(normal)
    back = turn_curvature(-normal)
    # Row 0 of D along n and t: M_nn from (κ_nn, κ_tt, 2κ_nt).
    moment_a, moment_b = (
        np.einsum("pki,pkl,plj->pij", back, D, back, optimize=True)[:, 0] for D in (a, b)
    )
    # κ_nn(b) follows from M_nn(a) = M_nn(b), with κ_tt and κ_nt equal on both sides.
    T = np.broadcast_to(np.eye(3), a.shape).copy()
    T[:, 0] = moment_a - moment_b
    T[:, 0, 0] = moment_a[:, 0]
    T[:, 0] /= moment_b[:, :1]
    return np.einsum("pik,pkl,plj->pij", back, T, to_seam, optimize=True)


def turn_curvature(angle: np.ndarray) -> np.ndarray:
    """(p, 3, 3) R with R κ the curvature (κ₁₁, κ₂₂, 2κ₁₂) along axes turned by `angle` (p,)."""
    c = np.cos(angle)
    s = np.sin(angle)
    rows = np.array(
        [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    )
    return np.moveaxis(rows, -1, 0)
