"""Effective bending rigidity of hinges on each pattern: python -m studies.models.hinge_bias

Derived: the homogenised bending tensor of the infinite pattern, and from it B_eff/B of a strip
along X. Measured: a cantilever in small deflection under its own weight, B_eff = ρ g L⁴/(8 w), for
several widths and edge lengths. Two columns of nodes are pinned; the slope is zero half-way between
them, so the length counts from there.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import spsolve

import fecloth as fc
from fecloth.homogenisation import CELLS
from studies import harness

WIDTHS = (0.05, 0.25, 1.0, 2.0)  # of the length
SHEET = fc.Fabric(areal_density=1.0, tensile_stiffness=1.0, bending_rigidity=1.0)


def cantilever(pattern: str, along: int, width: float) -> float:
    """Return B_eff/B of a cantilever of length 1 with `along` edges."""
    h = 1.0 / along
    if pattern == "equilateral":  # a strip is at least one row of triangles high
        width = max(width, 0.5 * np.sqrt(3) * h)
    cloth = fc.Cloth.rectangle(1.0 + h, width, h, pattern)
    system = fc.System(cloth, SHEET, [fc.QuadraticBending()])
    free = np.flatnonzero(cloth.X[:, 0] > 1.01 * h)
    K = system.bound[0].matrix[free][:, free].tocsc()
    w = spsolve(K, system.nodal_mass[free])
    tip = w[np.isclose(cloth.X[free, 0], 1.0 + h)].mean()
    return (1.0 + 0.5 * h) ** 4 / (8 * tip)


def main() -> None:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="coarse meshes only")
    resolutions = (10, 20) if parser.parse_args().quick else (20, 40, 80)
    print("derived, B = 1: D of (κ11, κ22, 2 κ12); B_eff of a narrow strip, of a wide one")
    for pattern in CELLS:
        D = fc.bending_tensor(pattern)
        rows = "  ".join(" ".join(f"{d + 0.0:6.3f}" for d in row) for row in D.round(12))
        print(f"{pattern:<13} {rows}   {1 / np.linalg.inv(D)[0, 0]:.3f}  {D[0, 0]:.3f}")
    columns = "  ".join(f"{along:>5d}" for along in resolutions)
    print(f"\nmeasured B_eff/B; width/length, pattern, edges along: {columns}")
    for width in WIDTHS:
        for pattern in (*CELLS, "unstructured"):
            values = "  ".join(f"{cantilever(pattern, n, width):5.3f}" for n in resolutions)
            print(f"{width:<5} {pattern:<13} {values}")


if __name__ == "__main__":
    harness.run_main(main)
