"""Drape coefficients on several meshes: what the mesh changes, and what the start changes.

A draped cloth has many states at rest, with other folds. So that meshes and models are compared in
the same state, each starts from the drape of the first mesh with `PlateBending`, interpolated to
its nodes. That first drape starts flat. What the choice of the state does is measured apart: on
the first mesh, from flat starts with small random heights.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

import fecloth as fc
from fecloth.errors import FeclothError
from studies.drape.measures import count_folds, drape_coefficient
from studies.drape.meshes import (
    MESHES,
    SPECIMEN,
    SUPPORT,
    cut_ring,
    make_quadratic,
    mesh_specimen,
)

PLATE, HINGES = "PlateBending", "HingeBending"
QUADRATIC = "P2, Gmsh"
SEEDS = (1, 2, 3, 4)
HEIGHT = 1e-4  # standard deviation of the disturbed starts [m]
MOST = 2000  # iterations
TOLERANCE = 1e-6  # of the forces; 1e-9 changes a coefficient by less than 1e-5
COLUMNS = ("fabric", "mesh", "model", "triangles", "coefficient", "folds", "iterations", "seconds")


def compare_meshes(fabrics: Sequence[str], disturbed: Sequence[str], h: float) -> Iterator[dict]:
    """Drape each fabric on each mesh with both models, and `disturbed` ones from other starts."""
    disks = {name: mesh_specimen(pattern, ratio * h) for name, (pattern, ratio) in MESHES.items()}
    cloths = {(name, HINGES): disk for name, disk in disks.items()}
    cloths |= {(name, PLATE): cut_ring(disk) for name, disk in disks.items()}
    cloths[QUADRATIC, PLATE] = make_quadratic(cut_ring(mesh_specimen("Gmsh", 2 * h)))
    first = cloths[next(iter(MESHES)), PLATE]
    for fabric in fabrics:
        begin, row = drape(first, fabric, PLATE, lie_flat(first))
        for (name, model), cloth in cloths.items():
            start = carry(first, begin, cloth)
            found = row if cloth is first else drape(cloth, fabric, model, start)[1]
            yield {"fabric": fabric, "mesh": name, **found}
        for seed in SEEDS if fabric in disturbed else ():
            found = drape(first, fabric, PLATE, lie_flat(first, seed))[1]
            yield {"fabric": fabric, "mesh": f"disturbed {seed}", **found}


def drape(cloth: fc.Cloth, fabric: str, model: str, start: np.ndarray) -> tuple[np.ndarray, dict]:
    """Return the positions at rest that Newton's iteration reaches, and a row of the table."""
    terms = [fc.StVK(), getattr(fc, model)(), fc.Gravity((0, 0, -9.81))]
    pin = fc.Pin("support", clamp=model == PLATE)
    system = fc.System(cloth, fc.Fabric.preset(fabric), terms, pins=[pin])
    row = {"model": model, "triangles": len(cloth.triangles)}
    clock = time.process_time()
    try:
        rest = fc.equilibrium(system, system.state(start), tolerance=TOLERANCE, max_iterations=MOST)
    except FeclothError:
        return start, row | dict.fromkeys(COLUMNS[4:], math.nan)
    seconds, triangles = time.process_time() - clock, plane_triangles(cloth)
    coefficient = drape_coefficient(cloth.X, rest.x, triangles)
    return rest.x, row | {
        "coefficient": coefficient,
        "folds": count_folds(cloth.X, rest.x),
        "iterations": rest.iterations,
        "seconds": seconds,
    }


def plane_triangles(cloth: fc.Cloth) -> np.ndarray:
    """Return the triangles; on P2 the four parts of each."""
    if cloth.element == "P1":
        return cloth.triangles
    a, b, c, ab, bc, ca = cloth.cells.T
    parts = (a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def lie_flat(cloth: fc.Cloth, seed: int | None = None) -> np.ndarray:
    """Return the flat positions; with a seed the hanging nodes have random heights."""
    z = np.zeros(len(cloth.X))
    if seed is not None:
        hangs = np.hypot(*cloth.X.T) > SUPPORT + 1e-9
        z[hangs] = HEIGHT * np.random.default_rng(seed).standard_normal(hangs.sum())
    return np.c_[cloth.X, z]


def carry(old: fc.Cloth, x: np.ndarray, new: fc.Cloth) -> np.ndarray:
    """Return positions of one mesh, interpolated to another; the support stays flat."""
    from scipy.interpolate import LinearNDInterpolator

    if old is new:
        return x
    angles = np.sort(np.arctan2(*old.X[np.hypot(*old.X.T) > SPECIMEN - 1e-6].T))
    inside = 0.9999 * math.cos(np.diff(angles).max() / 2)  # because the old rim is a polygon
    carried = LinearNDInterpolator(old.X, x)(inside * new.X)
    support = new.nodes("support")
    carried[support] = np.c_[new.X[support], np.zeros(len(support))]
    return carried


def spread(values: list[float]) -> float:
    """Return (largest − least)/mean."""
    return (max(values) - min(values)) / (sum(values) / len(values))


def summarise(rows: list[dict]) -> list[dict]:
    """Return a line for each fabric and model: coefficients in %, spread, folds, seconds.

    – stands where `MOST` iterations did not come to rest.
    """
    lines = []
    for fabric, model in product(dict.fromkeys(row["fabric"] for row in rows), (PLATE, HINGES)):
        mine = [row for row in rows if (row["fabric"], row["model"]) == (fabric, model)]
        on = {row["mesh"]: row for row in mine}
        four = [on[name] for name in MESHES if name in on]
        line = {"fabric": fabric, "model": model}
        for name in (*MESHES, QUADRATIC):
            line[name] = percent(on[name]["coefficient"]) if name in on else ""
        line["spread of four"] = f"{percent(spread([row['coefficient'] for row in four]))} %"
        line["folds"] = " ".join(f"{row['folds']:.0f}" for row in four)
        line["CPU s"] = " ".join(f"{row['seconds']:.1f}" for row in four)
        line["of disturbed starts"] = " ".join(
            f"{percent(row['coefficient'])} ({row['folds']:.0f})"
            for row in mine
            if row["mesh"].startswith("disturbed")
        )
        lines.append({key: text.replace("nan", "–") for key, text in line.items()})
    return lines


def percent(part: float) -> str:
    return f"{100 * part:.1f}"
