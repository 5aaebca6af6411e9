"""MuJoCo's flex in the scenes of this study: the same mesh, masses and material.

`Euler` starts with the half-step velocity, as the leapfrog does; `discrete` is the linearised
backward Euler step. Its bending is a thin plate's, with the thickness that gives B at the given Y.
"""

from __future__ import annotations

import time

import numpy as np

from fecloth import study
from studies import harness
from studies.work_precision.grid import MESHES, STABLE, case
from studies.work_precision.runs import LONG
from studies.work_precision.scenes import PAPER, SAMPLES, SCENES, Scene

Rows = list[dict]
PINS = {"trampoline": "boundary", "swing": "left"}
STEPS = (5e-3, 2.5e-3, 1.25e-3)  # s


def list_mujoco_cases(quick: bool) -> Rows:
    """List explicit steps near the limit, and long `discrete` steps."""
    found = []
    for scene in ("trampoline",) if quick else PINS:
        for h in MESHES[scene][1:2] if quick else MESHES[scene][1:3]:
            found.append(case(scene, h, "MuJoCo Euler", STABLE[scene] * h))
            found += [case(scene, h, "MuJoCo discrete", dt) for dt in STEPS]
    return found


def run_mujoco(scene, model, element, h, method, step, linear) -> dict:
    """Run MuJoCo; return the paths and the seconds."""
    problem = SCENES[scene](model, element, h)
    gap = problem.t_end / SAMPLES
    each = int(np.ceil(gap / step - 1e-9))
    model_, data = make_model(problem, scene, gap / each, method.split()[1])
    spent = []
    with harness.temporary_folder():
        run_once(problem, model_, data, 2, each)  # warm
        while len(spent) < 3 and (not spent or min(spent) < LONG):
            begin = time.process_time()
            paths = run_once(problem, model_, data, SAMPLES, each)
            spent.append(time.process_time() - begin)
    row = {"nodes": len(problem.system.cloth.X), "triangles": len(problem.system.cloth.triangles)}
    row |= {"seconds": min(spent), "runs": len(spent), "steps": each * SAMPLES}
    if not np.isfinite(paths).all():
        return row | {"failure": "a position is not finite"}
    return row | {"mean": paths[0].tolist(), "point": paths[1].tolist()}


def make_model(problem: Scene, scene: str, dt: float, integrator: str):
    """Return MuJoCo's model and the data of its state."""
    import mujoco

    from studies.engines import mujoco_flex

    cloth, fabric = problem.system.cloth, problem.system.fabric
    case = {
        "X": cloth.X,
        "triangles": cloth.triangles,
        "pins": cloth.nodes(PINS[scene]),
        "gravity": (0.0, 0.0, -9.81),
        "fabric": {
            "areal_density": fabric.areal_density,
            "tensile_stiffness": fabric.tensile,
            "poisson_ratio": fabric.poisson_ratio,
            "bending_rigidity": PAPER.bending[0] if scene == "swing" else 0.0,
        },
    }
    model = mujoco_flex.make_model(case, dt, explicit=integrator == "Euler")
    return model, mujoco.MjData(model)


def run_once(problem: Scene, model, data, samples: int, each: int) -> np.ndarray:
    """Run from the start; return the paths (2, samples)."""
    import mujoco

    mujoco.mj_resetData(model, data)
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER:
        mujoco.mj_forward(model, data)
        data.qvel[:] = -0.5 * model.opt.timestep * data.qacc
    rest, paths = problem.system.rest().x, []
    for _ in range(samples):
        mujoco.mj_step(model, data, nstep=each)
        mujoco.mj_kinematics(model, data)  # positions of the end of the step
        mujoco.mj_flex(model, data)
        paths.append(problem.values_of(data.flexvert_xpos - rest))
        study.check_time_limit()
    return np.array(paths).T
