"""Networks of springs on a cloth: which nodes they join, and their stiffness."""

from dataclasses import dataclass

import numpy as np

from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth

EDGE, WARP, WEFT, SHEAR, BEND = range(5)


@dataclass(frozen=True, eq=False)
class Net:
    """A network of s springs between pairs of nodes.

    Attributes
    ----------
    nodes
        The two nodes (s, 2) of each spring, as int32.
    vectors
        The way (s, 2) from its node 0 to its node 1 in the flat cloth [m].
    kind
        The class (s,) of each spring: EDGE (of no class), WARP or WEFT (stretch along X or Y),
        SHEAR or BEND.
    sides
        The triangles (s, 2) of whose area the spring has a share; −1 for none.
    """

    nodes: np.ndarray
    vectors: np.ndarray
    kind: np.ndarray
    sides: np.ndarray

    def sum_over_sides(self, values: np.ndarray) -> np.ndarray:
        """(s,) values (m,) of triangles, summed over the one or two at each spring."""
        return np.append(values, 0.0)[self.sides].sum(axis=1)

    def van_gelder_stiffness(self, panel: Panel) -> np.ndarray:
        """Stiffness k = Y Σ A / l² (s,) [N/m], with the Y of each triangle."""
        Y = panel.each(_isotropic)[:, 0] * panel.cloth.weights.sum(axis=1)
        return self.sum_over_sides(Y) / np.sum(self.vectors**2, axis=1)

    def structural_stiffness(self, panel: Panel, stiffness: tuple) -> np.ndarray:
        """Return the stiffness k (s,) [N/m] of the springs of a structural network.

        `stiffness` has three values [N/m], for stretch, shear and bend. Where one is None, it
        follows from the fabric. Raises `InputError` for a fabric that these springs cannot
        model.
        """
        stretch, shear, bend = stiffness
        k_of_class = {EDGE: stretch, WARP: stretch, WEFT: stretch, SHEAR: shear, BEND: bend}
        k = np.zeros(len(self.nodes))
        for kind, class_k in k_of_class.items():
            is_of_class = self.kind == kind
            if not is_of_class.any():
                continue
            if class_k is None:
                k[is_of_class] = self._derive_stiffness(panel, kind)[is_of_class]
            else:
                k[is_of_class] = class_k
        return k

    def _derive_stiffness(self, panel, kind):
        """Return k (s,) [N/m] from the fabric, as if all springs were of the class `kind`.

        Only the entries of this class are meant to be used. The formulas are in `Springs`. The
        springs of a class share the area of the whole cloth, in proportion to the area of the
        triangles beside them. Raises `InputError` if warp and weft differ where they must not.
        """
        area = panel.cloth.weights.sum(axis=1)
        squared_length = np.sum(self.vectors**2, axis=1)
        if kind == EDGE:
            Y = panel.each(_isotropic)[:, 0]
            return np.sqrt(0.75) * self.sum_over_sides(Y * area) / self.sum_over_sides(area)
        # Springs of warp and weft lie along X and Y, where a turned grain does not.
        if panel.grain.any():
            for fabric in panel.fabrics:
                _isotropic(fabric)
        values = panel.each(lambda fabric: np.array([*fabric.tensile, fabric.shear]))
        modulus = values[:, (WARP, WEFT, SHEAR).index(kind)]
        area_beside_class = self.sum_over_sides(area)[self.kind == kind].sum()
        modulus_times_area = self.sum_over_sides(modulus * area)
        k = area.sum() / area_beside_class * modulus_times_area / squared_length
        if kind != SHEAR:
            return k
        cs = np.prod(self.vectors, axis=1) / squared_length  # cosine times sine of the direction
        return k / np.where(cs == 0, 1.0, cs**2)  # 0 for springs of other classes only


def edges(cloth: Cloth) -> Net:
    """Return the network of a spring on each edge of the triangles, sorted by their nodes.

    An edge is a side of one triangle or of two. Its springs have the class EDGE.
    """
    # The sides of all triangles, three for each: side number s belongs to the triangle s // 3.
    start = cloth.triangles.ravel().astype(np.int64)
    end = np.roll(cloth.triangles, -1, axis=1).ravel().astype(np.int64)
    # A key is the same for both directions of an edge, and divmod gives the two nodes back.
    keys = np.minimum(start, end) * len(cloth.X) + np.maximum(start, end)
    edge_keys, first_side, edge_of_side, side_counts = np.unique(
        keys, return_index=True, return_inverse=True, return_counts=True
    )
    nodes = np.stack(np.divmod(edge_keys, len(cloth.X)), axis=1).astype(np.int32)
    last_side = np.empty_like(first_side)
    last_side[edge_of_side] = np.arange(len(keys))  # the last one written stays
    second_triangle = np.where(side_counts > 1, last_side // 3, -1)
    sides = np.stack([first_side // 3, second_triangle], axis=1)
    return _make_net(cloth, nodes, np.full(len(nodes), EDGE), sides)


def structural(cloth: Cloth, shear: float | None = None, bend: float | None = None) -> Net:
    """Return springs of Provot's classes on a grid; on other meshes, the springs of `edges`.

    `shear` and `bend` are stiffnesses [N/m]. With 0 there are no such springs. With None there
    are shear springs, which follow from the fabric, and no bend springs, for which nothing
    follows from it. Raises `InputError` for a stiffness of shear or bend on a mesh that is no
    grid.
    """
    net = edges(cloth)
    dx, dy = np.abs(net.vectors.T)
    # Below 1e-9 of the other component, a component is round-off.
    is_along_x = dy < 1e-9 * dx
    is_along_y = dx < 1e-9 * dy
    is_oblique = ~(is_along_x | is_along_y)
    if not _is_grid(net.vectors, is_along_x, is_along_y, is_oblique):
        _refuse_without_grid(shear=shear, bend=bend)
        return net
    kind = np.select([is_along_x, is_along_y], [WARP, WEFT], SHEAR)
    groups = [(net.nodes, kind, net.sides)]  # as the fields nodes, kind and sides of `Net`
    if len(_directions(net.vectors[is_oblique])) == 1:  # cells have one diagonal: add the other
        is_inner = is_oblique & (net.sides[:, 1] >= 0)
        nodes = _opposite_nodes(cloth, net.nodes[is_inner], net.sides[is_inner])
        groups.append((nodes, np.full(len(nodes), SHEAR), net.sides[is_inner]))
    if bend:
        for axis, is_along in ((0, is_along_x), (1, is_along_y)):
            nodes = _next_but_one(cloth.X[:, axis], net.nodes[is_along])
            no_sides = np.full(nodes.shape, -1)  # a given stiffness needs no area
            groups.append((nodes, np.full(len(nodes), BEND), no_sides))
    nodes, kind, sides = (np.concatenate(arrays) for arrays in zip(*groups, strict=True))
    is_stiff = (kind != SHEAR) | (shear != 0.0)
    return _make_net(cloth, nodes[is_stiff], kind[is_stiff], sides[is_stiff])


def _refuse_without_grid(**stiffness: float | None) -> None:
    """Raise `InputError` for a stiffness of springs that only a grid has."""
    for name, value in stiffness.items():
        if value:
            remedy = 'Leave it out, or use the pattern "right" or "cross".'
            raise InputError(f"{name} = {value!r}", "needs a grid", "Springs", remedy)


def _make_net(cloth, nodes, kind, sides) -> Net:
    """The network of springs between nodes (s, 2) of a cloth."""
    nodes = np.ascontiguousarray(nodes, dtype=np.int32)
    vectors = cloth.X[nodes[:, 1]] - cloth.X[nodes[:, 0]]
    return Net(nodes, vectors, kind, sides)


def _directions(vectors):
    """Return the distinct vectors; two that differ by their sign, or by round-off, are one.

    They are rounded to, and returned in, parts of 1e-6 of the largest component.
    """
    sign = np.where((vectors[:, 0] < 0) | ((vectors[:, 0] == 0) & (vectors[:, 1] < 0)), -1, 1)
    rounded = np.round(vectors * sign[:, None] / np.abs(vectors).max() * 1e6)
    return np.unique(rounded, axis=0)


def _is_grid(vectors, *groups) -> bool:
    """Whether all vectors of each group are equal, up to the signs of their components.

    A group is a mask (s,) of vectors (s, 2). They may differ by 1e-6 of the largest component.
    """
    rounded = np.round(np.abs(vectors) / np.abs(vectors).max() * 1e6)
    return all(len(np.unique(rounded[group], axis=0)) == 1 for group in groups)


def _opposite_nodes(cloth, pairs, sides):
    """Return the nodes (e, 2) opposite each edge, one in each of the two triangles beside it.

    `pairs` (e, 2) are the nodes of the edges, `sides` (e, 2) the numbers of the triangles.
    """
    triangles = cloth.triangles[sides]  # (e, 2, 3)
    is_on_edge = (triangles == pairs[:, :1, None]) | (triangles == pairs[:, 1:, None])
    # Only one node of a triangle is not on the edge: the sum of these is its number.
    return np.where(is_on_edge, 0, triangles).sum(axis=2).astype(np.int32)


def _next_but_one(coordinate, pairs):
    """Return the ends (b, 2) of every two edges that follow each other in a straight line.

    `pairs` (s, 2) are the nodes of all edges along one axis, and `coordinate` (n,) has the
    coordinates of the nodes on this axis.
    """
    is_forward = coordinate[pairs[:, 0]] < coordinate[pairs[:, 1]]
    forward = np.where(is_forward[:, None], pairs, pairs[:, ::-1])
    next_node = np.full(len(coordinate) + 1, -1)  # −1: at the end of a line
    next_node[forward[:, 0]] = forward[:, 1]
    next_but_one = next_node[forward[:, 1]]
    ends = np.stack([forward[:, 0], next_but_one], axis=1)
    return ends[next_but_one >= 0].astype(np.int32)


def _isotropic(fabric) -> np.ndarray:
    """Return the tensile stiffness Y (1,) [N/m] of a fabric, as `Panel.each` needs it.

    Raises `InputError` where warp and weft differ.
    """
    warp, weft = fabric.tensile
    if warp != weft:
        what = f"tensile_stiffness = {fabric.tensile}"
        allowed = "must be one number: these springs do not know warp and weft"
        pattern = 'the pattern "right" or "cross" without grain'
        remedy = f'Use StVK, or kind = "structural" on {pattern}.'
        raise InputError(what, allowed, "Springs", remedy)
    return np.array([warp])
