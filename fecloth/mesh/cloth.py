"""The flat reference mesh and its finite-element discretisation, without material or time."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
import skfem
from numpy.typing import ArrayLike

from fecloth.errors import InputError, amount
from fecloth.mesh import elements, generate, norms, selection
from fecloth.mesh.child_process import TIME_LIMIT
from fecloth.mesh.edge_slopes import EdgeSlopes
from fecloth.mesh.flat_mesh import FlatMesh, quality
from fecloth.mesh.grading import Grading
from fecloth.mesh.hinges import HalfEdges, Hinges
from fecloth.mesh.numbering import join_meshes, renumber_mesh
from fecloth.mesh.read import read
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import LENGTH, TIME


@checks_arguments
@dataclass(frozen=True, eq=False)
class Cloth:
    """The flat reference shape of a cloth as a mesh of oriented triangles.

    Create one with `rectangle`, `disk`, `read` or `from_arrays`. These renumber nodes and
    triangles once, so that neighbours lie close together in memory. `source_nodes` and
    `source_triangles` give the numbers of the input mesh.

    The element is "P1" (linear triangles) or "P2" (quadratic triangles). The nodes of P2 are the
    corners, followed by the midpoints of the edges (`fecloth.mesh.elements`). The
    mass of P2 is consistent unless a system has ``mass="lumped"``, which explicit methods need.
    Each term states the elements that it supports.

    Examples
    --------
    >>> cloth = Cloth.rectangle(width=1.0, height=1.0, h=0.5, pattern="right")
    >>> len(cloth.X), len(cloth.triangles), cloth.nodes("left").size
    (9, 8, 3)
    >>> round(cloth.area, 12)
    1.0
    >>> cloth = Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right", element="P2")
    >>> len(cloth.X), cloth.stencil.shape, cloth.nodes("left").size
    (25, (8, 6), 5)

    Attributes
    ----------
    X
        (n, 2) reference coordinates of the nodes along warp and weft [m].
    triangles
        (m, 3) int32 corners, counter-clockwise (the corners in scikit-fem's ``mesh.t`` are
        sorted).
    node_sets
        Named node indices.
    edge_sets
        Named (k, 2) pairs of corners.
    source_nodes
        Node i is node ``source_nodes[i]`` of the input mesh, or −1 for the midpoint of an
        edge.
    source_triangles
        Likewise for triangles.
    element
        "P1" or "P2".
    triangle_sets
        Named triangles (regions).
    start
        (n, 3) positions in space [m] that a file has beside the flat coordinates, for
        ``system.state(cloth.start)``; else None.
    notes
        What was done to a file or to arrays, a sentence each.
    """

    X: np.ndarray
    triangles: np.ndarray
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)
    edge_sets: dict[str, np.ndarray] = field(default_factory=dict)
    source_nodes: np.ndarray | None = None
    source_triangles: np.ndarray | None = None
    element: str = "P1"
    triangle_sets: dict[str, np.ndarray] = field(default_factory=dict)
    start: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    # --- constructors -------------------------------------------------------------------------

    @classmethod
    @checks_arguments
    def rectangle(
        cls,
        width: Annotated[float, LENGTH],
        height: Annotated[float, LENGTH],
        h: Annotated[float, LENGTH],
        pattern: str = "unstructured",
        element: str = "P1",
        grading: Sequence[Grading] = (),
    ) -> "Cloth":
        """Mesh the rectangle [0, width] × [0, height]; sets: its sides, corners and boundary.

        The node sets are left, right, bottom, top, corners and boundary. Raises `InputError` for
        arguments out of range, an unknown pattern, or a grading with another pattern than
        "unstructured".

        Parameters
        ----------
        width, height
            Sides along X and Y [m].
        h
            Edge length [m].
        pattern
            "unstructured" (Gmsh), "right" (each cell cut along the same diagonal), "cross" (each
            cell cut along both diagonals) or "equilateral".
        element
            "P1" or "P2".
        grading
            Places towards which the triangles of an unstructured mesh become smaller.
        """
        mesh = generate.rectangle(width, height, h, pattern, grading)
        return cls._from_mesh(mesh, element, corner_sets=["corners"])

    @classmethod
    @checks_arguments
    def disk(
        cls,
        radius: Annotated[float, LENGTH],
        h: Annotated[float, LENGTH],
        element: str = "P1",
        grading: Sequence[Grading] = (),
    ) -> "Cloth":
        """Mesh a disk around the origin by Gmsh with edge length `h` [m]; node set: boundary.

        All nodes of the border lie on the circle. So the edges of P2 there are parabolas, whose
        distance from the circle is of order h⁴; of P1 they are chords, and of order h².
        """
        cloth = cls._from_mesh(generate.disk(radius, h, grading), element)
        if element == "P1":
            return cloth
        X = cloth.X.copy()
        border = cloth.nodes("boundary")
        X[border] *= radius / np.linalg.norm(X[border], axis=1, keepdims=True)
        return replace(cloth, X=X)

    @classmethod
    @checks_arguments
    def read(
        cls,
        path: str | Path,
        h: Annotated[float | None, LENGTH] = None,
        element: str | None = None,
        trust: bool = False,
        time_limit: Annotated[float, TIME] = TIME_LIMIT,
        grading: Sequence[Grading] = (),
        merge: bool = False,
        reference: str | None = None,
        scale: float = 1.0,
    ) -> "Cloth":
        """Read a mesh of another program, or mesh a .geo file by Gmsh.

        Physical groups become node sets, edge sets and regions. A mesh with three coordinates
        is accepted if all nodes lie in one plane. `notes` of the cloth say what was done to the
        file. Raises `MeshError` for a file that is missing, cannot be read or is not a valid
        flat mesh, and `InputError` for arguments that do not fit the file.

        Parameters
        ----------
        path
            A .geo file, or a mesh file.
        h
            Edge length [m] of a .geo file. Default: the sizes in the file.
        element
            "P1" or "P2". Default: P2 for quadratic triangles with straight edges, else P1.
        trust
            Whether a .geo file may have any command. It is a program; by default it may have
            only commands of geometry and mesh sizes.
        time_limit
            Seconds after which Gmsh or meshio is stopped.
        grading
            Places towards which the triangles become smaller, for a .geo file with h.
        merge
            Whether nodes at the same position become one node.
        reference
            Of an .obj, "v" or "vt": the coordinates that are the flat cloth. With "vt" the
            coordinates `v` are `start`. Default: "vt" if all its edges are as long as those of
            `v` within 20 %, else "v", which must be flat.
        scale
            Metres of a unit of the coordinates in the file; with the reference "vt", of `vt`
            alone.
        """
        mesh = read(path, h, trust, time_limit, grading, merge, reference, scale)
        return cls._from_mesh(mesh, element or mesh.element)

    @classmethod
    @checks_arguments
    def from_arrays(
        cls,
        X: ArrayLike,
        triangles: ArrayLike,
        sets: dict | None = None,
        renumber: bool = True,
        regions: dict | None = None,
        element: str = "P1",
    ) -> "Cloth":
        """Create a cloth from coordinates, triangles, named node sets and named regions.

        For P2 too the nodes are the corners only; the midpoints of the edges are added. A node
        set gets the midpoints of the edges that have both ends in the set. A node set with the
        name of a region gets the midpoints of the edges of the region's triangles. Raises
        `MeshError` for arrays that are not a valid flat mesh; see `fecloth.mesh.flat_mesh`.

        Parameters
        ----------
        X : (n, 2) array
            Coordinates [m].
        triangles : (m, 3) integer array
            Corners of each triangle.
        sets : dict of str to (k,) integer arrays, optional
            Named nodes.
        renumber : bool
            Whether to renumber nodes and triangles.
        regions : dict of str to (k,) integer arrays, optional
            Named triangles.
        element : str
            "P1" or "P2".
        """
        mesh = FlatMesh.from_arrays(
            X, triangles, node_sets=sets, triangle_sets=regions, where="from_arrays"
        )
        return cls._from_mesh(mesh, element, renumber)

    @classmethod
    def join(cls, pieces: "Sequence[Cloth]", names: Sequence[str]) -> "Cloth":
        """Make one cloth of several pieces that share no node, such as two layers that touch.

        Each piece keeps its coordinates, which may overlap, because each piece is flat by
        itself. The sets of a piece are named NAME/SET, as "top/left"; NAME is the set of its
        nodes and the region of its triangles. Raises `InputError` for fewer than two pieces,
        for names that are not different and as many as the pieces, and for pieces of different
        elements.

        Examples
        --------
        >>> layer = Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")
        >>> both = Cloth.join([layer, layer], names=["top", "apron"])
        >>> len(both.X), both.nodes("apron/left").tolist() == (9 + layer.nodes("left")).tolist()
        (18, True)
        """
        mesh = join_meshes([piece._flat_mesh for piece in pieces], names)
        if len({piece.element for piece in pieces}) > 1:
            what = "pieces of P1 and of P2"
            remedy = "Make all pieces with one element."
            raise InputError(what, "must have one element", "Cloth.join", remedy)
        # `join_meshes` has set the numbers, and nothing is renumbered after it.
        return cls._from_flat_mesh(
            mesh,
            pieces[0].element,
            source_nodes=np.arange(len(mesh.X)),
            source_triangles=np.arange(len(mesh.triangles)),
        )

    @classmethod
    def _from_flat_mesh(
        cls,
        mesh: FlatMesh,
        element: str,
        source_nodes: np.ndarray,
        source_triangles: np.ndarray,
    ) -> "Cloth":
        """Return the cloth of a mesh, to which the midpoints are already added if it is P2.

        The other arguments are attributes of the cloth, see `Cloth`.
        """
        return cls(
            X=mesh.X,
            triangles=mesh.triangles,
            node_sets=mesh.node_sets,
            edge_sets=mesh.edge_sets,
            source_nodes=source_nodes,
            source_triangles=source_triangles,
            element=element,
            triangle_sets=mesh.triangle_sets,
            start=mesh.start,
            notes=mesh.notes,
        )

    @property
    def _flat_mesh(self) -> FlatMesh:
        return FlatMesh(
            X=self.X,
            triangles=self.triangles,
            node_sets=self.node_sets,
            edge_sets=self.edge_sets,
            triangle_sets=self.triangle_sets,
            start=self.start,
            notes=self.notes,
        )

    @classmethod
    def _from_mesh(
        cls,
        mesh: FlatMesh,
        element: str,
        renumber: bool = True,
        corner_sets: Collection[str] = (),
    ) -> "Cloth":
        """Return the cloth of a mesh whose nodes are the corners only; P2 gets its midpoints.

        With `renumber` the nodes and triangles get new numbers. The node sets named in
        `corner_sets` get no midpoints. Raises `InputError` for an unknown element.
        """
        elements.find_element(element, "Cloth")  # only to refuse an unknown name
        source_nodes = np.arange(len(mesh.X))
        source_triangles = np.arange(len(mesh.triangles))
        if renumber:
            mesh, source_nodes, source_triangles = renumber_mesh(mesh)
        if element == "P2":
            mesh = elements.add_midpoints(mesh, corner_sets)
            midpoints = len(mesh.X) - len(source_nodes)
            source_nodes = np.append(source_nodes, np.full(midpoints, -1))
        return cls._from_flat_mesh(mesh, element, source_nodes, source_triangles)

    # --- nodes, regions and geometry ----------------------------------------------------------

    nodes = selection.nodes
    half_edges = selection.half_edges
    region = selection.region

    @property
    def area(self) -> float:
        """Reference area [m²]."""
        return float(self.weights.sum())

    @cached_property
    def quality(self) -> np.ndarray:
        """(m,) shape of each reference triangle, 4√3 A / Σ l²: 1 equilateral, 0 degenerate."""
        return quality(self.X, self.triangles)

    @cached_property
    def extent(self) -> float:
        """The larger of the widths along X and Y [m]."""
        return float(np.ptp(self.X, axis=0).max())

    @cached_property
    def hinges(self) -> Hinges:
        """The interior edges, each with its two triangles."""
        return Hinges.from_triangles(self.X, self.triangles)

    @cached_property
    def edge_slopes(self) -> EdgeSlopes:
        """The slopes of the edges of each triangle; for P2, of its four `parts`.

        Each combination of named regions, such as "in a and in b but not in c", is a region of
        its own.
        """
        region = np.zeros(len(self.triangles), int)
        for triangles in self.triangle_sets.values():
            is_inside = np.zeros(len(region), int)
            is_inside[triangles] = 1
            # Numbered from 0 again, so that the numbers do not double with each named region.
            region = np.unique(2 * region + is_inside, return_inverse=True)[1]
        if self.element == "P1":
            return EdgeSlopes(HalfEdges(self.X, self.triangles, self.hinges), region)
        edges = HalfEdges.from_triangles(self.X, self.parts)
        return EdgeSlopes(edges, np.repeat(region, len(self.kind.parts)))

    @property
    def parts(self) -> np.ndarray:
        """(m, 3) triangles between neighbouring nodes; for P2 (4m, 3), four per triangle."""
        return self.cells[:, self.kind.parts].reshape(-1, 3)

    # --- scikit-fem ---------------------------------------------------------------------------

    @property
    def kind(self) -> elements.Element:
        """The element: shape functions, quadrature rule and mass."""
        return elements.find_element(self.element, "Cloth")

    @cached_property
    def mesh(self) -> skfem.MeshTri:
        """The scikit-fem mesh, with curved edges if any midpoint is off the middle of its edge.

        It sorts the vertices inside each triangle.
        """
        if self.element == "P1":
            return elements.skfem_mesh(self.X, self.triangles)
        return elements.skfem_quadratic_mesh(self.X, self.triangles)

    @cached_property
    def cells(self) -> np.ndarray:
        """(m, k) int32 nodes in VTK's order: corners, for P2 then midpoints of 01, 12, 20."""
        if self.element == "P1":
            return self.triangles
        return elements.oriented_cells(self.mesh, self.triangles)

    def basis(self, order: int) -> skfem.CellBasis:
        """A scalar scikit-fem basis whose quadrature is exact to polynomial degree `order`."""
        return self.kind.basis(self.mesh, order)

    @cached_property
    def _kernel_arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.kind.arrays(self.mesh)

    @property
    def stencil(self) -> np.ndarray:
        """(m, k) int32 nodes: the corners, ascending; for P2 then midpoints of 01, 12, 02."""
        return self._kernel_arrays[0]

    @property
    def gradients(self) -> np.ndarray:
        """(m, q, k, 2) gradients ∂N_a/∂X at each quadrature point [1/m]."""
        return self._kernel_arrays[1]

    @property
    def values(self) -> np.ndarray:
        """(q, k) shape functions N_a at each quadrature point."""
        return self.kind.values

    @property
    def weights(self) -> np.ndarray:
        """(m, q) quadrature weights [m²]; their sum is the area."""
        return self._kernel_arrays[2]

    @property
    def shape(self) -> tuple[tuple, tuple]:
        """Tuples of k and of q zeros: kernels know their lengths when they are compiled."""
        _, q, k, _ = self.gradients.shape
        return (0,) * k, (0,) * q

    @property
    def usual_mass(self) -> str:
        """The default kind of mass: "lumped" for P1, "consistent" for P2."""
        if self.element == "P1":
            return "lumped"
        return "consistent"

    @property
    def least_mass(self) -> float:
        """Largest c with: consistent mass ≥ c `diagonal_mass`, for triangles of any shape."""
        return self.kind.least_mass

    # --- fields on the cloth ------------------------------------------------------------------

    # A method is the function of the same name, whose first argument is the cloth.
    interpolator = norms.interpolator
    interpolate = norms.interpolate
    load = norms.load
    weighted_load = norms.weighted_load
    mass = norms.mass
    diagonal_mass = norms.diagonal_mass
    l2_norm = norms.l2_norm
    l2_difference = norms.l2_difference
    h1_difference = norms.h1_difference
    l2_error = norms.l2_error
    h1_error = norms.h1_error

    def __repr__(self) -> str:
        kind = f"{len(self.X)} nodes, {amount(len(self.triangles), f'{self.element} triangle')}"
        sets = ", ".join(sorted(self.node_sets)) or "none"
        return f"<Cloth of {kind}, {self.area:.4g} m²; node sets: {sets}>"
