"""Two fabrics, 10 : 1, with a zigzag seam: the deflection of one mesh.

* "line cut by triangles": the fabrics meet at X = ½, but each triangle is of one fabric, so that
  the seam is a zigzag as fine as the mesh. The exact solution is a beam of two parts.
* "zigzag on cross", "zigzag on unstructured": a clamped square whose seam has corners of 90° and
  lies along edges. The reference is Morley's element of scikit-fem, extrapolated.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import fecloth as fc
from studies.bending.cases import deflection, largest_error, uniform_load
from studies.bending.meshes import on_sides
from studies.references import morley, plates

LINE, CROSS, GMSH = "line cut by triangles", "zigzag on cross", "zigzag on unstructured"
PLATE, MORLEY = "PlateBending", "Morley of scikit-fem"
RIGIDITY = {"soft": 1.0, "stiff": 10.0}


def run_seam(seam: str, model: str, n: int) -> dict:
    """Return the error of `line`, or the mean deflection of `zigzag`, with edges of 1/n m."""
    if seam == LINE:
        return line(n) | {"h": 1 / n}
    cloth = zigzag(seam, n)
    w = plate_deflection(cloth) if model == PLATE else morley_deflection(cloth)
    return {"mean": float(uniform_load(cloth) @ w), "h": 1 / n}


def zigzag(seam: str, n: int) -> fc.Cloth:
    """Mesh the unit square along the seam; on "cross" n must be a multiple of 8."""
    if seam == GMSH:
        return fc.Cloth.read(Path(__file__).parent / "zigzag.geo", 1 / n)
    cloth = fc.Cloth.rectangle(1.0, 1.0, 1 / n, "cross")
    return with_parts(cloth, is_soft(centres(cloth)))


def is_soft(X: np.ndarray) -> np.ndarray:
    """Return (m,) whether points lie left of the zigzag (5/8, 0), (3/8, 1/4), (5/8, 1/2), …"""
    return X[:, 0] < 0.375 + np.abs(X[:, 1] % 0.5 - 0.25)


def centres(cloth: fc.Cloth) -> np.ndarray:
    return cloth.X[cloth.triangles].mean(axis=1)


def with_parts(cloth: fc.Cloth, soft: np.ndarray) -> fc.Cloth:
    parts = {"soft": np.flatnonzero(soft), "stiff": np.flatnonzero(~soft)}
    return fc.Cloth.from_arrays(cloth.X, cloth.triangles, regions=parts)


def fabrics(nu: float) -> dict[str, fc.Fabric]:
    """Return the fabric of each part."""
    return {
        name: fc.Fabric(1.0, 1e3, bending_rigidity=B, bending_poisson_ratio=nu)
        for name, B in RIGIDITY.items()
    }


def plate_deflection(cloth: fc.Cloth) -> np.ndarray:
    held = on_sides(cloth.X)
    pins = [fc.Pin(np.flatnonzero(held), clamp=True)]
    system = fc.System(cloth, fabrics(0.3), [fc.PlateBending()], pins)
    return deflection(system, uniform_load(cloth), held)


def morley_deflection(cloth: fc.Cloth) -> np.ndarray:
    D = np.empty((len(cloth.triangles), 3, 3))
    for name, fabric in fabrics(0.3).items():
        D[cloth.region(name)] = fabric.plate()
    return morley.deflection(cloth.X, cloth.triangles, D, on_sides(cloth.X), clamp=True)


def line(n: int) -> dict:
    """Return the largest error of w of a strip on two supports, over the largest w.

    "error" is that against fabrics that meet at ½; "from the mean seam" is that against fabrics
    that meet where the parts have the areas of the mesh.
    """
    cloth = fc.Cloth.rectangle(1.0, 0.5, 1 / n)
    cloth = with_parts(cloth, centres(cloth)[:, 0] < 0.5)
    system = fc.System(cloth, fabrics(0.0), [fc.PlateBending()])
    held = (cloth.X[:, 0] < 1e-9) | (cloth.X[:, 0] > 1 - 1e-9)
    w = deflection(system, uniform_load(cloth), held)
    mean = area_of(cloth, "soft") / cloth.area
    exact = [plates.beam_of_two(cloth.X[:, 0], *RIGIDITY.values(), at) for at in (0.5, mean)]
    keys = ("error", "from the mean seam")
    return {key: largest_error(w, one) for key, one in zip(keys, exact, strict=True)}


def area_of(cloth: fc.Cloth, part: str) -> float:
    """Area of a part of the cloth."""
    inside = np.zeros(len(cloth.triangles))
    inside[cloth.region(part)] = 1.0
    return float(cloth.weighted_load(inside).sum())
