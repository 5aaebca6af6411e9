"""A sheet that falls on a ball, by fecloth and by MuJoCo: the change with the step, and the cost.

    python -m studies.evidence.contact.mujoco_drop [--quick]

Both take the mesh, the lumped masses, the membrane, the bending rigidity and the friction of
`studies/scenes/drop.toml`, here without self-contact. The two models of contact and of bending
differ, so that each run is compared with the same program's own run with the shortest step: rms of
the distances between the nodes at the end, over the rms of their displacements. "Inside" is how far
the deepest node is inside the ball; below zero all are outside. MuJoCo (pip install '.[peers]')
keeps a distance of 1 mm, the radius of its vertices, as fecloth keeps its gap.

The page studies/evidence/contact/maps.md has the table.
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth.errors import FeclothWarning
from fecloth.scene.scene import load_scene
from fecloth.study.result import markdown_table
from studies import harness
from studies.evidence.benchmarks.mujoco import make_flex, mujoco

SCENE = Path(__file__).parents[2] / "scenes" / "drop.toml"
CENTER, RADIUS, FALL = (0.2, 0.2, -0.1), 0.1, 1e-3  # m, of the scene
T_END, DAMPING = 0.3, 1e-3  # s
STEPS = {  # s, the last one for the reference
    "fecloth, BDF2": (5e-3, 2.5e-3, 1.25e-3, 6.25e-4, 3.125e-4),
    "fecloth, BackwardEuler": (5e-3, 2.5e-3, 1.25e-3, 6.25e-4, 3.125e-4),
    "MuJoCo, discrete": (2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4),
    "MuJoCo, Euler": (5e-5, 2.5e-5, 1.25e-5),
}


def without_self_contact() -> fc.System:
    """Return the system of the scene, with one contact term."""
    data = load_scene(SCENE)
    terms = tuple(term for term in data.terms if term.type != "SelfContact")
    return data.model_copy(update={"terms": terms}).build().system


def run_fecloth(system: fc.System, method, dt: float) -> np.ndarray:
    """Return the positions (n, 3) at the end [m]."""
    rest = system.rest()
    start = system.state(rest.x + [0, 0, FALL])
    with warnings.catch_warnings(action="ignore", category=FeclothWarning):
        for state, _ in fc.march(system, method, start, dt, T_END):
            last = state
    return last.x


@harness.temporary_folder()
def run_mujoco(system: fc.System, integrator: str, dt: float) -> np.ndarray:
    """Return the positions (n, 3) at the end [m]; NaN where a run became unstable."""
    fabric = system.fabric
    ratio = fabric.bending[0] / fabric.tensile[0]
    thickness = math.sqrt(12 * (1 - fabric.poisson_ratio**2) * ratio)
    at = CENTER[0], CENTER[1], CENTER[2] - FALL
    ball = f'<geom type="sphere" size="{RADIUS}" pos="{at[0]} {at[1]} {at[2]}" friction="0.3 0 0"/>'
    model = make_flex(system, dt, integrator, "", thickness, "both", ball, DAMPING)
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    for _ in range(round(T_END / dt)):
        mujoco.mj_step(model, data)
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:  # it begins anew
            return np.full_like(data.flexvert_xpos, math.nan)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_flex(model, data)
    return data.flexvert_xpos + [0, 0, FALL]


def table_of(what: str, system: fc.System, run: Callable, steps: tuple) -> list[dict]:
    """Return a row for each step [s]: seconds, distance to the run with the shortest, depth."""
    ends, seconds = [], []
    for dt in steps:
        begin = time.process_time()
        ends.append(run(dt))
        seconds.append(time.process_time() - begin)
    rest = system.rest().x
    size = _rms(ends[-1] - rest)
    rows = []
    for dt, x, cost in zip(steps, ends, seconds, strict=True):
        depth = RADIUS - np.linalg.norm(x - CENTER, axis=1).min()
        row = {"program": what, "dt [ms]": 1e3 * dt, "CPU s": round(cost, 2)}
        row["from its finest [%]"] = round(100 * _rms(x - ends[-1]) / size, 2)
        row["inside [mm]"] = round(1e3 * float(depth), 3)
        row["mean height [mm]"] = round(1e3 * float(x[:, 2].mean()), 2)
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
    return rows


def _rms(y: np.ndarray) -> float:
    return math.sqrt((y**2).sum(axis=1).mean())


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="two long steps, without backward Euler"
    )
    options = parser.parse_args()
    system = without_self_contact()
    methods = {"BDF2": fc.BDF2(), "BackwardEuler": fc.BackwardEuler()}
    rows = []
    if mujoco is None:
        print("without MuJoCo, which is not installed: pip install '.[peers]'")
    for what, steps in STEPS.items():
        if options.quick and what == "fecloth, BackwardEuler":
            continue
        program, name = what.split(", ")
        if program == "fecloth":
            run: Callable = partial(run_fecloth, system, methods[name])
            run(T_END / 2)  # compiles
        elif mujoco is None:
            continue
        else:
            run = partial(run_mujoco, system, name)
        rows += table_of(what, system, run, steps[:2] if options.quick else steps)
    print(markdown_table(rows))
    return 0


if __name__ == "__main__":
    harness.run_main(main)
