"""Do everyday scenes of contact end, how wrong are they in time, and what do they cost?

A quarter of a second of each, with steps that are chosen by their error. The error is the root
mean square distance to a run with each of these steps halved, over the way.

    python -m studies.contact.everyday [--quick] [--only NAME ...] [--rtol 1e-3]
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from studies import harness
from studies.contact.motions import halved

S, UP, GAP, MU = fc.shapes, (0, 0, 1), 2e-3, 0.3
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=2e-5)
TERMS = (fc.StVK(), fc.PlateBending(), fc.StrainRateDamping(time=5e-3), fc.Gravity())
SELF = fc.SelfContact(1.5e-3, friction=MU)
T_END, QUICK = 0.25, ("napkin on a ball", "board", "card")
Scene = tuple[fc.System, fc.State, float]


def on(shape, **more) -> fc.Obstacle:
    return fc.Obstacle(shape, GAP, friction=MU, **more)


def sheet(width: float, height: float, h: float) -> fc.Cloth:
    return fc.Cloth.rectangle(width, height, h)


def scene(
    cloth, contacts, pins=(), x=None, fabric=FABRIC, v=(0, 0, 0), t_end=T_END, more=()
) -> Scene:
    """A cloth with its middle over the origin, a little above it unless `x` places it."""
    system = fc.System(cloth, fabric, [*TERMS, *more, *contacts], pins)
    x = level(cloth) if x is None else x
    return system, system.state(x, 0 * x + v), t_end


def level(cloth: fc.Cloth, height: float = 3e-3) -> np.ndarray:
    middle = (cloth.X.min(axis=0) + cloth.X.max(axis=0)) / 2
    return np.column_stack([cloth.X - middle, np.full(len(cloth.X), height)])


def upright(cloth: fc.Cloth) -> np.ndarray:
    """In the plane y = 0, with the upper edge at z = 0."""
    x = level(cloth)
    return np.column_stack([x[:, 0], 1e-4 * np.sin(20 * x[:, 0]), x[:, 1] - x[:, 1].max()])


def napkin() -> Scene:
    return scene(sheet(0.3, 0.3, 0.03), [on(S.Sphere((0, 0, -0.08), 0.08)), SELF])


def round_table() -> Scene:
    return scene(fc.Cloth.disk(0.25, 0.04), [on(S.Disk((0, 0, -0.01), UP, 0.15, 0.02)), SELF])


def curtain() -> Scene:
    cloth = sheet(0.4, 0.6, 0.05)
    wall = on(S.Plane((0, 0.05, 0), (0, -1, 0)))
    return scene(cloth, [wall], ["top"], upright(cloth), more=[fc.Wind((0, 3.0, 0), normal=1.0)])


def towel() -> Scene:
    rod = on(S.Cylinder((0.02, 0, -0.015), (0, 1, 0), 0.015))
    return scene(sheet(0.4, 0.2, 0.03), [rod, SELF])


def scarf() -> Scene:
    cloth = sheet(0.5, 0.08, 0.03)
    return scene(cloth, [on(S.Capsule((0, 0, -0.2), (0, 0, -0.055), 0.05)), SELF])


def flag() -> Scene:
    cloth = sheet(0.4, 0.25, 0.035)
    pole = on(S.Cylinder((-0.215, 0, 0), UP, 0.01))
    wind = fc.Wind((4.0, 1.0, 0), normal=1.0)
    return scene(cloth, [pole, SELF], ["left"], upright(cloth), more=[wind])


def sack() -> Scene:
    """A sheet that is held at four corners is pressed down by a ball."""
    ball = on(S.Sphere((0, 0, 0.065), 0.06, motion=(0, 0, "-0.15*t")))
    return scene(sheet(0.3, 0.3, 0.03), [ball], ["corners"])


def bed_cover() -> Scene:
    return scene(sheet(0.5, 0.4, 0.045), [on(S.Box((0, 0, -0.06), (0.36, 0.28, 0.12)))])


def hammock() -> Scene:
    ball = on(S.Sphere((0, 0, 0.055), 0.05, motion=(0, 0, "-0.1*t")))
    return scene(sheet(0.5, 0.2, 0.035), [ball], ["left", "right"])


def kerchief() -> Scene:
    """A square falls over its diagonal on a rod."""
    cloth = sheet(0.25, 0.25, 0.025)
    x = level(cloth)
    turn = math.sqrt(0.5) * np.array([[1, -1, 0], [1, 1, 0], [0, 0, math.sqrt(2)]])
    return scene(cloth, [on(S.Cylinder((0.01, 0, -0.01), (0, 1, 0), 0.01)), SELF], x=x @ turn)


def body() -> Scene:
    """A blanket falls on a lying body: a trunk and a head."""
    trunk = on(S.Capsule((-0.12, 0, -0.07), (0.08, 0, -0.07), 0.07))
    head = on(S.Sphere((0.2, 0, -0.06), 0.05))
    return scene(sheet(0.5, 0.35, 0.045), [trunk, head, on(S.Plane((0, 0, -0.14), UP))])


def drum() -> Scene:
    """A cloth in a laundry drum that turns, with a rib."""
    cloth = sheet(0.2, 0.15, 0.025)
    turn = fc.Rotation((0, 0, 0.12), (0, 1, 0), "6*t")
    inside = "0.15 - sqrt(x**2 + (z - 0.12)**2) + 0*y"
    wall = on(S.Sdf(inside, radius=0.15, rotate=turn))
    rib = on(S.Box((0, 0, -0.01), (0.02, 0.4, 0.06), rotate=turn))
    return scene(cloth, [wall, rib, SELF], x=level(cloth, 0.03))


def board() -> Scene:
    """A cloth slides down a tilted board."""
    slope = np.array([math.sin(0.5), 0, math.cos(0.5)])
    x = level(cloth := sheet(0.25, 0.2, 0.03), 0.0)
    x = x[:, :1] * [slope[2], 0, -slope[0]] + x[:, 1:2] * [0, 1, 0] + 1.05 * GAP * slope
    return scene(cloth, [on(S.Plane((0, 0, 0), tuple(slope.tolist())))], x=x)


def towels() -> Scene:
    """Two towels, one above the other, over a rod."""
    parts = sheet(0.35, 0.12, 0.03), sheet(0.3, 0.12, 0.033)
    cloth = fc.Cloth.join(parts, names=["lower", "upper"])
    x = np.vstack([level(part, z) for part, z in zip(parts, (3e-3, 8e-3), strict=True)])
    return scene(cloth, [on(S.Cylinder((0.02, 0, -0.015), (0, 1, 0), 0.015)), SELF], x=x)


def card() -> Scene:
    """A stiff card falls on the edge of a table."""
    stiff = fc.Fabric(0.3, 20000.0, 0.3, bending_rigidity=1e-2)
    table = on(S.Box((-0.1, 0, -0.02), (0.2, 0.3, 0.04)))
    return scene(sheet(0.2, 0.15, 0.03), [table, on(S.Plane((0, 0, -0.1), UP))], fabric=stiff)


SCENES: dict[str, Callable[[], Scene]] = {
    "napkin on a ball": napkin,
    "round table": round_table,
    "curtain and wall": curtain,
    "towel on a rod": towel,
    "scarf": scarf,
    "flag and pole": flag,
    "sack": sack,
    "bed cover": bed_cover,
    "hammock with a ball": hammock,
    "kerchief": kerchief,
    "blanket on a body": body,
    "laundry drum": drum,
    "board": board,
    "two towels": towels,
    "card": card,
}


def run_one(scene: str, rtol: float, quick: bool) -> dict:
    """A row of a scene: its error, cost and doubts."""
    warnings.simplefilter("ignore", fc.FeclothWarning)
    system, start, t_end = SCENES[scene]()
    return halved(system, start, fc.Auto(rtol=rtol), 0.1 * t_end if quick else t_end)


def main() -> int:
    """Run the scenes, and write the report."""
    only = {"nargs": "+", "choices": tuple(SCENES), "default": [], "metavar": "NAME"}
    rtol = {"type": float, "default": 1e-3, "help": "error of a step over the size (1e-3)"}
    options = harness.parse_arguments(__doc__, needs=["ipctk"], only=only, rtol=rtol)
    names = options.only or (QUICK if options.quick else list(SCENES))
    cases = [{"scene": name, "rtol": options.rtol, "quick": options.quick} for name in names]
    rows = study.run_cases(cases, run_one, time_limit=900.0, **harness.run_options(options))
    title, _ = harness.about(__doc__)
    harness.require_results(options, title, rows)
    done = [row for row in rows if row["status"] == "ok"]
    asked = 0.0 if options.quick else 0.8
    findings = [
        harness.Finding("part of the scenes that end", len(done) / len(rows), low=1.0),
        harness.Finding(
            "part with an error below 5 %", np.mean([row["error %"] < 5 for row in done]), low=asked
        ),
        harness.Finding(
            "scenes with doubts that spoil", sum(bool(row["doubts"]) for row in done), high=3
        ),
        harness.Finding(
            "CPU seconds a second of motion, mean", np.mean([row["CPU s a second"] for row in done])
        ),
    ]
    shown = (
        "scene",
        "triangles",
        "dt [ms]",
        "error %",
        "CPU s a second",
        "Newton a step",
        "doubts",
    )
    table = [{name: row.get(name) for name in shown} for row in rows]
    page = Path(__file__).with_suffix("")
    return harness.conclude(options, __doc__, page, rows, findings, {"Scenes": table})


if __name__ == "__main__":
    harness.run_main(main)
