"""Newton (NVIDIA's) on the CPU: block descent, as its cloth examples take, and explicit steps.

Both have the neo-Hookean membrane of Smith et al. (2018) in the plane, with tri_ke = μ and
tri_ka = λ + μ of plane stress, so that small strains have the fabric's Y and ν, and hinges. All
numbers are of single precision. What rests is marched with damping until it rests.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import newton
import numpy as np
import warp as wp

from studies.engines.wave_time import crossing_time

wp.config.quiet = True
wp.init()

VERSION = f"Newton {newton.__version__}, Warp {wp.__version__}"
SETTINGS = (
    "CPU, float32; vbd: 10 iterations a step, as its examples, and steps of 1/600, 1/1200, "
    "1/2400 s by level, 0.3 s at most to rest; semi_implicit: 0.3 of the stable step, contact off"
)
COURANT, FRAME, ITERATIONS, LONGEST, RAMP = 0.3, 1 / 600, 10, 0.3, 0.1
AT_REST = 1e-5  # extents/s, what single precision allows


def newton_vbd(case: Mapping[str, Any]) -> np.ndarray:
    """Return the positions (times, n, 3) [m] by vertex block descent."""
    model = make_model(case, hinge_stiffness(case))
    solver = newton.solvers.SolverVBD(model, iterations=ITERATIONS)
    return march(case, model, solver, FRAME / 2 ** case["level"])


def newton_semi_implicit(case: Mapping[str, Any]) -> np.ndarray:
    """Return the positions (times, n, 3) [m] by symplectic Euler steps, without contact."""
    if case["static"]:
        raise NotImplementedError("explicit steps come to rest too slowly")
    model = make_model(case, hinge_stiffness(case))
    solver = newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False)
    return march(case, model, solver, COURANT * crossing_time(case))


def make_model(case: Mapping[str, Any], bending: Callable) -> newton.Model:
    """Return the model of an isotropic fabric; pins have no mass."""
    fabric, nu = case["fabric"], case["fabric"]["poisson_ratio"]
    Y, weft = fabric["tensile_stiffness"]
    G = Y / (2 * (1 + nu))
    if weft != Y or not math.isclose(fabric["shear_stiffness"], G):
        raise NotImplementedError("these membranes are isotropic")
    builder = newton.ModelBuilder(gravity=tuple(case["gravity"].tolist()))
    builder.add_cloth_mesh(
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        scale=1.0,
        vel=wp.vec3(0.0, 0.0, 0.0),
        vertices=[wp.vec3(*point, 0.0) for point in case["X"].tolist()],
        indices=case["triangles"].ravel().tolist(),
        density=fabric["areal_density"],
        tri_ke=G,
        tri_ka=Y * nu / (1 - nu**2) + G,
        tri_kd=0.0,
        edge_ke=0.0,
        edge_kd=0.0,
        particle_radius=1e-4,
    )
    for node in case["pins"].tolist():
        builder.particle_mass[node] = 0.0
    builder.color(include_bending=True)
    model = builder.finalize(device="cpu")
    model.particle_grid = None  # no contact of particles
    edges = model.edge_indices.numpy()
    stiffness = np.column_stack([bending(edges), np.zeros(len(edges))])
    model.edge_bending_properties.assign(stiffness.astype(np.float32))
    return model


def hinge_stiffness(case: Mapping[str, Any]) -> Callable:
    """Return a function of edges (e, 4): B l/(A₁ + A₂), of the energy ½ k l θ² of a hinge [N]."""
    B, X = case["fabric"]["bending_rigidity"], case["X"]

    def stiffness(edges: np.ndarray) -> np.ndarray:
        values = np.zeros(len(edges))
        inner = (edges >= 0).all(axis=1)
        a, b, c, d = X[edges[inner]].transpose(1, 0, 2)
        areas = [np.abs(np.linalg.det(np.stack([c - p, d - p], axis=1))) / 2 for p in (a, b)]
        values[inner] = B * np.linalg.norm(d - c, axis=1) / sum(areas)
        return values

    return stiffness


def march(case: Mapping[str, Any], model: Any, solver: Any, longest: float) -> np.ndarray:
    """Return the positions at the times; of a static case at rest."""
    states, control, contacts = [model.state(), model.state()], model.control(), None
    for state in states:
        state.particle_q.assign(case["x"].astype(np.float32))
        state.particle_qd.assign(case["v"].astype(np.float32))

    graphs: dict[float, Any] = {}

    def two_steps(dt: float) -> None:
        for now, then in (states, states[::-1]):
            now.clear_forces()
            solver.step(now, then, control, contacts, dt)

    def step(dt: float, count: int) -> None:
        """Take `count` steps, an even number, as a recorded graph."""
        if dt not in graphs:
            with wp.ScopedCapture(device="cpu") as capture:
                two_steps(dt)
            graphs[dt] = capture.graph
        for _ in range(count // 2):
            wp.capture_launch(graphs[dt])

    def positions() -> np.ndarray:
        return states[0].particle_q.numpy().astype(float)

    if case["static"]:
        return settle(case, states, step, positions, longest)[None]
    found, gaps = [], np.diff(case["times"], prepend=0.0)
    for gap in gaps:
        count = 2 * math.ceil(gap / longest / 2 - 1e-9)
        step(round(float(gap), 9) / count, count)
        found.append(positions())
    return np.array(found)


def settle(
    case: Mapping[str, Any], states: list, step: Callable, positions: Callable, dt: float
) -> np.ndarray:
    """Return the positions at rest; pins that move go there in the first `RAMP` seconds."""
    start, motion, t = case["x"][case["pins"]], case["motion"], 0.0
    end = start if motion is None else motion[-1]
    extent = np.ptp(case["X"], axis=0).max()
    while t < LONGEST:
        before = positions()
        before[case["pins"]] = start + min((t + 2 * dt) / RAMP, 1.0) * (end - start)
        for state in states:
            state.particle_q.assign(before.astype(np.float32))
        step(dt, 2)
        t += 2 * dt
        if t > RAMP and np.abs(positions() - before).max() < AT_REST * extent * 2 * dt:
            break
    return positions()
