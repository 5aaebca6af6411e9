"""MuJoCo's two-dimensional flex: linear triangles of St. Venant and Kirchhoff's law.

What moves takes `Euler`, which is symplectic, at a fraction of the stable step, from the velocity
at the half step; what rests takes `discrete`, a linearised backward Euler step, which damps, until
it rests. Pins are vertices of the world, and their places there are where the pins are.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from studies import harness
from studies.engines.wave_time import crossing_time

VERSION = f"MuJoCo {mujoco.__version__}"
SETTINGS = (
    "flex of P1, elastic2d; dynamics: Euler at 0.3 of the stable step; statics: discrete at 10 ms "
    "until the speed is below 1e-7 extents/s, 2000 steps at most"
)
STEP, MOST, AT_REST, RAMP = 1e-2, 2000, 1e-7, 50
COURANT = 0.3


@harness.temporary_folder()
def run(case: Mapping[str, Any]) -> np.ndarray:
    """Return the positions (times, n, 3) [m] of a flex."""
    refuse(case)
    explicit = not case["static"]
    dt = COURANT * crossing_time(case) if explicit else STEP
    gaps = np.diff(case["times"], prepend=0.0)
    counts = np.ceil(gaps / dt - 1e-9).astype(int)
    model = make_model(case, float(gaps[0] / counts[0]) if explicit else dt, explicit)
    data, free = mujoco.MjData(model), model.flex_vertbodyid > 0
    flat = np.pad(case["X"], ((0, 0), (0, 1)))
    model.flex_vert[~free] = case["x"][~free]
    data.qpos[:] = (case["x"] - flat)[free].ravel()
    data.qvel[:] = case["v"][free].ravel()
    forces = np.zeros_like(flat)
    for load in case["loads"]:
        forces[load["nodes"]] += np.array(load["force"]) / len(load["nodes"])
    data.qfrc_applied[:] = forces[free].ravel()
    if not explicit:
        return settle(case, model, data)[None]
    mujoco.mj_forward(model, data)
    data.qvel[:] -= 0.5 * model.opt.timestep * data.qacc
    positions = []
    for gap, count in zip(gaps, counts, strict=True):
        assert abs(gap / count - model.opt.timestep) < 1e-9  # times at equal distances
        mujoco.mj_step(model, data, nstep=count)
        refuse_unstable(data)
        positions.append(read(model, data))
    return np.array(positions)


def refuse(case: Mapping[str, Any]) -> None:
    """Raise `NotImplementedError` for what a flex has not."""
    fabric = case["fabric"]
    (warp, weft), nu = fabric["tensile_stiffness"], fabric["poisson_ratio"]
    if warp != weft or not math.isclose(fabric["shear_stiffness"], warp / (2 * (1 + nu))):
        raise NotImplementedError("a flex is isotropic")


def lumped_mass(case: Mapping[str, Any]) -> np.ndarray:
    """Return the mass of each node, a third of its triangles' [kg]."""
    corners = case["X"][case["triangles"]]
    area = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 2
    shares = np.repeat(area / 3, 3)
    return case["fabric"]["areal_density"] * np.bincount(case["triangles"].ravel(), shares)


def make_model(case: Mapping[str, Any], dt: float, explicit: bool) -> mujoco.MjModel:
    """Return the model; its bulk material has the thickness that its bending rigidity asks for."""
    fabric, nu = case["fabric"], case["fabric"]["poisson_ratio"]
    Y, B = fabric["tensile_stiffness"][0], fabric["bending_rigidity"]
    thickness = math.sqrt(12 * (1 - nu**2) * B / Y) if B else 1e-3
    held = f'<pin id="{text(case["pins"])}"/>' if len(case["pins"]) else ""
    xml = f"""<mujoco>
      <option timestep="{dt!r}" gravity="{text(case["gravity"])}"
              integrator="{"Euler" if explicit else "discrete"}">
        <flag contact="disable"/>
      </option>
      <worldbody>
        <flexcomp name="cloth" type="direct" dim="2" dof="full" mass="1" radius="1e-4"
                  point="{text(np.pad(case["X"], ((0, 0), (0, 1))))}"
                  element="{text(case["triangles"])}">
          <edge equality="false" damping="0"/>
          <elasticity young="{Y / thickness!r}" poisson="{nu!r}" damping="0"
                      thickness="{thickness!r}" elastic2d="{"both" if B else "stretch"}"/>
          <contact selfcollide="none" contype="0" conaffinity="0"/>
          {held}
        </flexcomp>
      </worldbody>
    </mujoco>"""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = mujoco.MjSpec.from_string(xml).compile()
    bodies = model.flex_vertbodyid
    model.body_mass[bodies[bodies > 0]] = lumped_mass(case)[bodies > 0]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def settle(case: Mapping[str, Any], model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return the positions at rest; pins that move go there in the first `RAMP` steps."""
    start, motion = case["x"][case["pins"]], case["motion"]
    end = start if motion is None else motion[-1]
    extent = np.ptp(case["X"], axis=0).max()
    for step in range(1, MOST + 1):
        model.flex_vert[case["pins"]] = start + min(step / RAMP, 1.0) * (end - start)
        mujoco.mj_step(model, data)
        refuse_unstable(data)
        if step > RAMP and np.abs(data.qvel).max(initial=0.0) < AT_REST * extent:
            break
    return read(model, data)


def refuse_unstable(data: mujoco.MjData) -> None:
    if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
        raise RuntimeError("MuJoCo: the accelerations are huge or not finite")


def read(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return the positions of the vertices (n, 3) at the end of the step [m]."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_flex(model, data)
    return data.flexvert_xpos.copy()


def text(values: Any) -> str:
    return " ".join(repr(value) for value in np.ravel(values).tolist())
