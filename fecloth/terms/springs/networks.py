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
        """Stiffness k (s,) [N/m] of a structural network.

        `stiffness` has a number for stretch, shear and bend, or None where the fabric gives it.
        """
        stretch, shear, bend = stiffness
        given = {EDGE: stretch, WARP: stretch, WEFT: stretch, SHEAR: shear, BEND: bend}
        k = np.zeros(len(self.nodes))
        for kind, value in given.items():
            is_of_class = self.kind == kind
            if not is_of_class.any():
                continue
            if value is None:
                k[is_of_class] = self._derive_stiffness(panel, kind)[is_of_class]
            else:
                k[is_of_class] = value
        return k

    def _derive_stiffness(self, panel, kind):
        """k (s,) from the fabric, as for springs of one class.

        The springs of a class share the area of the whole cloth, in proportion to the area of
        the triangles beside them.
        """
        area = panel.cloth.weights.sum(axis=1)
        square = np.sum(self.vectors**2, axis=1)
        if kind == EDGE:
            Y = panel.each(_isotropic)[:, 0]
            return np.sqrt(0.75) * self.sum_over_sides(Y * area) / self.sum_over_sides(area)
        if panel.grain.any():
            for fabric in panel.fabrics:
                _isotropic(fabric)
        values = panel.each(lambda fabric: np.array([*fabric.tensile, fabric.shear]))
        modulus = values[:, (WARP, WEFT, SHEAR).index(kind)]
        area_beside_class = self.sum_over_sides(area)[self.kind == kind].sum()
        k = area.sum() / area_beside_class * self.sum_over_sides(modulus * area) / square
        if kind != SHEAR:
            return k
        cs = np.prod(self.vectors, axis=1) / square  # cosine times sine of the direction
        return k / np.where(cs == 0, 1.0, cs**2)


def edges(cloth: Cloth) -> Net:
    """Make springs of all edges of the triangles, in the order of the cloth's nodes.

    An edge belongs to one triangle, or to two: `first` and `last` are its numbers among all
    sides of triangles, three for each.
    """
    start = cloth.triangles.ravel().astype(np.int64)
    end = np.roll(cloth.triangles, -1, axis=1).ravel().astype(np.int64)
    keys = np.minimum(start, end) * len(cloth.X) + np.maximum(start, end)
    unique, first, number, times = np.unique(
        keys, return_index=True, return_inverse=True, return_counts=True
    )
    nodes = np.stack(np.divmod(unique, len(cloth.X)), axis=1).astype(np.int32)
    last = np.empty_like(first)
    last[number] = np.arange(len(keys))
    sides = np.stack([first // 3, np.where(times > 1, last // 3, -1)], axis=1)
    return _make_net(cloth, nodes, np.full(len(nodes), EDGE), sides)


def structural(cloth: Cloth, shear: float | None = None, bend: float | None = None) -> Net:
    """Make springs of Provot's classes on a grid; on other meshes, springs of the edges.

    There are no springs of stiffness 0. With `shear` = None there are shear springs, with
    `bend` = None there are no bend springs. Raises `InputError` for a stiffness of shear or
    bend on a mesh that is no grid.
    """
    net = edges(cloth)
    dx, dy = np.abs(net.vectors.T)
    is_along_x = dy < 1e-9 * dx
    is_along_y = dx < 1e-9 * dy
    is_oblique = ~(is_along_x | is_along_y)
    if not _is_grid(net.vectors, is_along_x, is_along_y, is_oblique):
        _refuse_without_grid(shear=shear, bend=bend)
        return net
    kind = np.select([is_along_x, is_along_y], [WARP, WEFT], SHEAR)
    parts = [(net.nodes, kind, net.sides)]
    if len(_directions(net.vectors[is_oblique])) == 1:  # cells have one diagonal: add the other
        is_inner = is_oblique & (net.sides[:, 1] >= 0)
        nodes = _opposite_nodes(cloth, net.nodes[is_inner], net.sides[is_inner])
        parts.append((nodes, np.full(len(nodes), SHEAR), net.sides[is_inner]))
    if bend:
        for axis, is_along in ((0, is_along_x), (1, is_along_y)):
            nodes = _next_but_one(cloth.X[:, axis], net.nodes[is_along])
            parts.append((nodes, np.full(len(nodes), BEND), np.full(nodes.shape, -1)))
    nodes, kind, sides = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
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
    """The distinct vectors, up to their sign and 1e-6 of the longest."""
    sign = np.where((vectors[:, 0] < 0) | ((vectors[:, 0] == 0) & (vectors[:, 1] < 0)), -1, 1)
    rounded = np.round(vectors * sign[:, None] / np.abs(vectors).max() * 1e6)
    return np.unique(rounded, axis=0)


def _is_grid(vectors, *groups) -> bool:
    """Whether all vectors of each group are equal, up to the signs of their components."""
    rounded = np.round(np.abs(vectors) / np.abs(vectors).max() * 1e6)
    return all(len(np.unique(rounded[group], axis=0)) == 1 for group in groups)


def _opposite_nodes(cloth, pairs, sides):
    """The nodes (e, 2) opposite each edge, of the two triangles beside it."""
    triangles = cloth.triangles[sides]  # (e, 2, 3)
    is_on_edge = (triangles == pairs[:, :1, None]) | (triangles == pairs[:, 1:, None])
    return np.where(is_on_edge, 0, triangles).sum(axis=2).astype(np.int32)


def _next_but_one(coordinate, pairs):
    """The ends (b, 2) of two edges in a row, for edges along a `coordinate` (n,)."""
    is_forward = coordinate[pairs[:, 0]] < coordinate[pairs[:, 1]]
    forward = np.where(is_forward[:, None], pairs, pairs[:, ::-1])
    following = np.full(len(coordinate) + 1, -1)
    following[forward[:, 0]] = forward[:, 1]
    second = following[forward[:, 1]]
    return np.stack([forward[:, 0], second], axis=1)[second >= 0].astype(np.int32)


def _isotropic(fabric) -> np.ndarray:
    """(1,) Y of a fabric; raises `InputError` where warp and weft differ."""
    warp, weft = fabric.tensile
    if warp != weft:
        what = f"tensile_stiffness = {fabric.tensile}"
        allowed = "must be one number: these springs do not know warp and weft"
        pattern = 'the pattern "right" or "cross" without grain'
        remedy = f'Use StVK, or kind = "structural" on {pattern}.'
        raise InputError(what, allowed, "Springs", remedy)
    return np.array([warp])
