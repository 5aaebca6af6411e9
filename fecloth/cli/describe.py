"""Descriptions of a cloth in words: its mesh, its sets, and the sources of its fabrics."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fecloth.fabric.fabric import Fabric
from fecloth.mesh.cloth import Cloth


def describe_cloth(cloth: Cloth) -> list[str]:
    """Return lines on size, edges and quality of the triangles, and one line for each set."""
    corners = cloth.X[cloth.triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    (x0, y0), (x1, y1) = cloth.X.min(axis=0), cloth.X.max(axis=0)
    return [
        f"{_nodes(len(cloth.X))}, {_triangles(cloth)}, area {cloth.area:.6g} m²",
        f"X {x0:g} to {x1:g} m, Y {y0:g} to {y1:g} m",
        f"edges {edges.min():.4g} to {edges.max():.4g} m, mean {edges.mean():.4g} m",
        f"quality {cloth.quality.min():.3f} to {cloth.quality.max():.3f}, "
        f"mean {cloth.quality.mean():.3f} (1 is equilateral)",
        *(f"set {name}: {_nodes(len(nodes))}" for name, nodes in sorted(cloth.node_sets.items())),
    ]


def _nodes(count: int) -> str:
    return "1 node" if count == 1 else f"{count} nodes"


def _triangles(cloth: Cloth) -> str:
    return f"{len(cloth.triangles)} {'quadratic ' * (cloth.element == 'P2')}triangles"


def sources(fabric: Fabric | Mapping[str, Fabric]) -> list[str]:
    """Return a line with the source of each fabric that has one."""
    regions = fabric if isinstance(fabric, Mapping) else {"fabric": fabric}
    return [f"{name}: {one.source}" for name, one in regions.items() if one.source]
