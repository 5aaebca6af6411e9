"""Cusick's drape test with its real support: the specimen lies between two disks.

Elsewhere in this study the specimen is held over the support, and clamped at its edge. Here nothing
of it is held but a spot in the middle, on the needle of the tester. It lies on a disk of 0.18 m and
under another one, and hangs over their sharp rims. The contact decides where it bends, and whether
it lifts off. The gap of both disks is 1 mm, and they are 1.9 gaps apart.

Each fabric is draped on four meshes: with the support held, from the same shape on all meshes; from
there between the disks, without friction.

    python -m studies.evidence.drape.support [--quick] [--fabric NAME ...] [--out DIR]
"""

from __future__ import annotations

import time
import warnings
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import fecloth as fc
from fecloth import study
from fecloth.errors import FeclothError, InputError
from fecloth.mesh.surface import count_intersections
from studies import harness
from studies.drape import between_meshes
from studies.drape.between_meshes import spread
from studies.drape.measures import count_folds, drape_coefficient
from studies.drape.meshes import MESHES, SUPPORT, cut_ring, mesh_specimen

BENT = [name for name in fc.Fabric.presets() if fc.Fabric.preset(name).bending]
GAP, APART, THICK = 1e-3, 1.9, 0.01  # of the disks: [m], in gaps, [m]
NEEDLE = 0.012  # radius around it within which nodes are held [m]
MOST = 600  # iterations
H = 0.008  # m
THINNER = ("polyester-tablecloth", "interlock", "trousers")  # with half of the gap too
UP = (0.0, 0.0, 1.0)
NOTE = (
    "The sources of these fabrics give no measured drape coefficient. "
    "– stands where the cloth did not come to rest."
)


def drape(fabric: str, mesh: str, gap: float, h: float) -> dict:
    """Coefficients of a fabric on a mesh, with the support held and between the disks."""
    warnings.simplefilter("ignore", fc.FeclothWarning)
    disk = specimen(mesh, h)
    ring = cut_ring(disk)
    held, row = drape_held(fabric, mesh, ring, h)
    system = between_disks(disk, fabric, gap)
    begin = time.process_time()
    try:
        rest = fc.equilibrium(
            system,
            system.state(start_outside(system, on_disk(disk, ring, held))),
            tolerance=between_meshes.TOLERANCE,
            max_iterations=MOST,
        )
    except FeclothError as error:
        return row | {"failure": str(error).splitlines()[0]}
    lower = system.bound[-2]
    f = np.zeros_like(rest.x)
    lower.add_push(rest.x, 0.0, f)
    return row | {
        "coefficient": drape_coefficient(disk.X, rest.x, disk.triangles),
        "folds": count_folds(disk.X, rest.x),
        "crossings": count_intersections(disk.triangles, rest.x),
        "least_distance": lower.least_distance(rest.x, 0.0),
        "pressed": f[:, 2].sum() / (9.81 * system.nodal_mass.sum()) - 1,  # weights of the cloth
        "iterations": rest.iterations,
        "seconds": time.process_time() - begin,
    }


def specimen(mesh: str, h: float) -> fc.Cloth:
    pattern, ratio = MESHES[mesh]
    return mesh_specimen(pattern, ratio * h)


def drape_held(fabric: str, mesh: str, ring: fc.Cloth, h: float) -> tuple[np.ndarray, dict]:
    """Positions of the ring, clamped at the edge of the support, and its row."""
    first = ring if mesh == next(iter(MESHES)) else cut_ring(specimen(next(iter(MESHES)), h))
    flat = between_meshes.lie_flat(first)
    x, row = between_meshes.drape(first, fabric, between_meshes.PLATE, flat)
    if first is not ring:
        start = between_meshes.carry(first, x, ring)
        x, row = between_meshes.drape(ring, fabric, between_meshes.PLATE, start)
    kept = ("coefficient", "folds", "iterations", "seconds")
    return x, {f"held_{name}": row[name] for name in kept}


def between_disks(disk: fc.Cloth, fabric: str, gap: float) -> fc.System:
    """The specimen between two disks, on a needle."""
    middle = (APART * gap + THICK) / 2
    disks = [fc.shapes.Disk((0, 0, side * middle), UP, SUPPORT, THICK) for side in (-1, 1)]
    needle = np.flatnonzero(np.hypot(*disk.X.T) < NEEDLE)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), *(fc.Obstacle(d, gap) for d in disks)]
    return fc.System(disk, fc.Fabric.preset(fabric), terms, [fc.Slide(needle, direction=UP)])


def start_outside(system: fc.System, x: np.ndarray) -> np.ndarray:
    """The positions, or as much of the way to them from the flat cloth as is outside the disks."""
    flat = np.column_stack([system.cloth.X, np.zeros(len(x))])
    for share in (1.0, 0.95, 0.9, 0.8, 0.6):
        start = share * x + (1 - share) * flat
        try:
            for disk in system.bound[-2:]:
                disk.check_start(start, 0.0, "start")
        except InputError:
            continue
        return start
    return flat


def on_disk(disk: fc.Cloth, ring: fc.Cloth, held: np.ndarray) -> np.ndarray:
    """Positions of the specimen: flat over the support, beside it as in the held ring."""
    x = np.column_stack([disk.X, np.zeros(len(disk.X))])
    x[cKDTree(disk.X).query(ring.X)[1]] = held
    return x


def cases(fabrics: list[str], quick: bool) -> list[dict]:
    """Each fabric on each mesh, and `THINNER` with half of the gap on the first one."""
    h, meshes = (0.015, list(MESHES)[:2]) if quick else (H, list(MESHES))
    chosen = [(fabric, mesh, GAP) for fabric in fabrics for mesh in meshes]
    chosen += [] if quick else [(name, meshes[0], GAP / 2) for name in fabrics if name in THINNER]
    return [{"fabric": f, "mesh": mesh, "gap": gap, "h": h} for f, mesh, gap in chosen]


def summary(rows: list[dict]) -> list[dict]:
    """A line for each fabric: coefficients [%] on the meshes, their spread, folds."""
    lines = []
    for fabric in dict.fromkeys(row["fabric"] for row in rows):
        own = [row for row in rows if row["fabric"] == fabric]
        on = {row["mesh"]: row for row in own if row["gap"] == GAP}
        thin = [row for row in own if row["gap"] != GAP]
        line = {"fabric": fabric}
        for support, name in (("held", "held_coefficient"), ("disks", "coefficient")):
            values = [100 * row[name] for row in on.values() if row.get(name)]
            line |= {f"{support}, {mesh}": percent(row.get(name)) for mesh, row in on.items()}
            line[f"{support}, spread"] = f"{100 * spread(values):.1f} %" if values else "–"
        line["folds"] = " ".join(f"{row['folds']}" for row in on.values() if row.get("folds"))
        line["pairs that cross"] = sum(row.get("crossings") or 0 for row in on.values())
        line["disks, half of the gap"] = " ".join(percent(row.get("coefficient")) for row in thin)
        lines.append(line)
    return lines


def percent(value: float | None) -> str:
    return f"{100 * value:.1f}" if value else "–"


def main() -> int:
    """Run the cases, and write the report."""
    fabric = {"nargs": "+", "choices": BENT, "metavar": "NAME", "help": "only these fabrics"}
    options = harness.parse_arguments(__doc__, fabric=fabric)
    fabrics = options.fabric or (THINNER[:1] if options.quick else BENT)
    rows = study.run_cases(cases(fabrics, options.quick), drape, **harness.run_options(options))
    title = "Cusick's drape test between two disks"
    harness.require_results(options, title, rows)
    found = [row for row in rows if row.get("coefficient")]
    least = min((row["least_distance"] for row in found), default=float("nan"))
    findings = [
        harness.Finding("fabrics and meshes that came to rest", len(found), low=0.9 * len(rows)),
        harness.Finding("least distance from the lower disk [m]", least, low=0.0),
    ]
    return harness.write_report(
        options,
        title,
        rows,
        tables={"Drape coefficients in %": summary(rows)},
        findings=findings,
        conclusion=NOTE,
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
