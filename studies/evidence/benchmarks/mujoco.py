"""The trampoline computed by fecloth and by MuJoCo, in one process.

    python -m studies.evidence.benchmarks.mujoco [--quick]

Both use one mesh, one lumped mass, one material and one thread. The error is the error of the mean
deflection over t <= 0.2 s, in percent of its peak, against the radial solution of
`falling_disk.trampoline`. CPU seconds are the minimum of two runs after a warm-up.

MuJoCo (pip install '.[peers]') has the same element: its two-dimensional flex with
`elastic2d="stretch"` is the linear triangle of St. Venant and Kirchhoff. Its vertices get the
lumped masses of fecloth, and it starts with the velocity at the half step, so that its `Euler`
computes what central differences compute here, to round-off. Its `discrete` is the linearised
backward Euler step. --quick takes a coarse mesh and does not apply the limits.
"""

from __future__ import annotations

import os
import sys

if "numba" not in sys.modules:  # Numba refuses a change once its threads run
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"  # before NumPy and MKL read them

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import fecloth as fc
from studies import harness
from studies.evidence.benchmarks.measure import FABRIC, Measured, print_verdicts
from studies.references import falling_disk

try:
    import mujoco
except ImportError:
    mujoco = None

T_END, FINE, COARSE = 0.2, 1.25e-4, 1 / 240  # s
THICKNESS = 1e-3  # m; MuJoCo takes a bulk material, E = Y / thickness
FRICTION = 0.3  # on obstacles


@dataclass(frozen=True)
class Result:
    """Error [% of the peak], cost [CPU s per simulated s], mean deflection at `times` [m]."""

    what: str
    error: float
    cost: float
    times: np.ndarray
    mean: np.ndarray

    def __str__(self) -> str:
        return f"{self.what:<52} error {self.error:7.3f} %   {self.cost:8.3f} CPU s / s"


def measure_run(what: str, system: fc.System, run: Callable, elements: int) -> Result:
    """Return the faster of two runs; `run(share)` returns times and mean deflections."""
    share, costs = system.nodal_mass / system.nodal_mass.sum(), []
    for _ in range(2):
        begin = time.process_time()
        times, mean = run(share)
        costs.append((time.process_time() - begin) / T_END)
    times, mean = np.array(times), np.array(mean)
    exact = falling_disk.trampoline(times, elements=elements).mean_deflection
    error = 100 * np.abs(mean - exact).max() / np.abs(exact).max()
    result = Result(what, error, min(costs), times, mean)
    print(result, flush=True)
    return result


def explicit(system: fc.System, dt: float, every: int) -> Callable:
    """Return a run with central differences in compiled calls of `every` steps."""
    fc.many_steps(system, system.rest(), dt, 1)  # compiles

    def run(share):
        state, times, mean = system.rest(), [], []
        for _ in range(round(T_END / dt / every)):
            state = fc.many_steps(system, state, dt, every)
            times.append(state.t)
            mean.append(-share @ state.x[:, 2])
        return times, mean

    return run


def implicit(system: fc.System, method, dt: float, **options) -> Callable:
    """Return a run with `march`."""
    for _ in fc.march(system, method, system.rest(), dt, 2 * dt, **options):
        pass  # compiles

    def run(share):
        times, mean = [], []
        for state, _ in fc.march(system, method, system.rest(), dt, T_END, **options):
            times.append(state.t)
            mean.append(-share @ state.x[:, 2])
        return times, mean

    return run


def make_flex(
    system: fc.System,
    dt: float,
    integrator: str,
    pins: str = "boundary",
    thickness: float = THICKNESS,
    elastic: str = "stretch",
    obstacle: str = "",
    damping: float = 0.0,
):
    """Return a MuJoCo model of a sheet: each vertex is a body on three slides.

    With `elastic` = "both" it bends like a plate of that thickness, B = Y thickness²/(12 (1 − ν²)).
    It touches an `obstacle`, the XML of a geom, and not itself. `damping` is a time [s], as of
    `StrainRateDamping`. `pins` = "" holds no node.
    """
    cloth = system.cloth
    points = np.column_stack([cloth.X, np.zeros(len(cloth.X))])

    def text(values):
        return " ".join(repr(value) for value in np.ravel(values).tolist())

    fabric = system.fabric
    young = fabric.tensile[0] / thickness
    held = f'<pin id="{text(cloth.nodes(pins))}"/>' if pins else ""
    touches, friction = int(bool(obstacle)), FRICTION if obstacle else 0.0
    xml = f"""<mujoco>
      <option timestep="{dt!r}" gravity="0 0 -9.81" integrator="{integrator}">
        <flag contact="{"enable" if obstacle else "disable"}"/>
      </option>
      <worldbody>
        {obstacle}
        <flexcomp name="disk" type="direct" dim="2" dof="full" mass="1" radius="0.001"
                  point="{text(points)}" element="{text(cloth.triangles)}">
          <edge equality="false" damping="0"/>
          <elasticity young="{young!r}" poisson="{fabric.poisson_ratio!r}" damping="{damping!r}"
                      thickness="{thickness!r}" elastic2d="{elastic}"/>
          <contact selfcollide="none" contype="{touches}" conaffinity="{touches}"
                   friction="{friction} 0 0"/>
          {held}
        </flexcomp>
      </worldbody>
    </mujoco>"""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MuJoCo 4.0 misses a passive force that is there
        model = mujoco.MjSpec.from_string(xml).compile()
    free = model.flex_vertbodyid > 0  # pinned vertices belong to the world, body 0
    model.body_mass[model.flex_vertbodyid[free]] = system.nodal_mass[free]
    return model


def mujoco_run(system: fc.System, dt: float, integrator: str, every: int) -> Callable:
    """Return a run with MuJoCo, `every` steps per call; `Euler` starts at the half step."""
    model = make_flex(system, dt, integrator)
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)

    @harness.temporary_folder()
    def run(share):
        mujoco.mj_resetData(model, data)
        if integrator == "Euler":
            mujoco.mj_forward(model, data)
            data.qvel[:] = -0.5 * dt * data.qacc
        times, mean = [], []
        for _ in range(round(T_END / dt / every)):
            mujoco.mj_step(model, data, nstep=every)
            mujoco.mj_kinematics(model, data)  # positions of the end of the step
            mujoco.mj_flex(model, data)
            times.append(data.time)
            mean.append(-share @ data.flexvert_xpos[:, 2])
        return times, mean

    return run


def compare(h: float, elements: int) -> list[Measured]:
    """Run everything on one mesh; return the measured numbers and their limits."""
    cloth = fc.Cloth.disk(radius=0.5, h=h)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    print(f"{len(cloth.triangles)} triangles")

    def result(what, run):
        return measure_run(what, system, run, elements)

    fast = result("fecloth, CentralDifference, 0.125 ms", explicit(system, FINE, 32))
    method, clamped = fc.EnergyMomentum(), fc.Newton(definiteness="clamp")  # the disk stays taut
    slow = result(
        "fecloth, EnergyMomentum, 1/240 s, clamped, PCG",
        implicit(system, method, COARSE, solver="pcg", newton=clamped),
    )
    for what, run in {
        "fecloth, EnergyMomentum, 1/240 s, direct": implicit(system, method, COARSE),
        "fecloth, GeneralizedAlpha(0.8), 1/240 s, PCG": implicit(
            system, fc.GeneralizedAlpha(0.8), COARSE, solver="pcg"
        ),
        "fecloth, LinearlyImplicitEuler, 1/240 s": implicit(
            system, fc.LinearlyImplicitEuler(), COARSE
        ),
    }.items():
        result(what, run)
    found = [
        Measured("explicit: error of the mean", fast.error, "% of the peak", 0.1),
        Measured("explicit: cost", fast.cost, "CPU s/simulated s", 1.6),
        Measured("EnergyMomentum at 1/240 s: error", slow.error, "% of the peak", 0.8),
        Measured("EnergyMomentum at 1/240 s: over explicit", slow.cost / fast.cost, "ratio", 6),
    ]
    if mujoco is None:
        return found
    version = f"MuJoCo {mujoco.__version__}"
    other = result(f"{version}, Euler, 0.125 ms", mujoco_run(system, FINE, "Euler", 32))
    result(f"{version}, discrete, 1/240 s", mujoco_run(system, COARSE, "discrete", 1))
    apart = 100 * np.abs(other.mean - fast.mean).max() / np.abs(fast.mean).max()
    return [
        *found,
        Measured("MuJoCo's Euler from the explicit run", apart, "% of the peak", 1e-6),
        Measured("explicit: times cheaper than MuJoCo", other.cost / fast.cost, "ratio", 8, True),
    ]


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh, some seconds")
    options = parser.parse_args()
    if mujoco is None:
        print("without MuJoCo, which is not installed: pip install '.[peers]'")
    h, elements = (0.05, 400) if options.quick else (0.0152, 800)
    return print_verdicts([lambda: compare(h, elements)], options.quick)


if __name__ == "__main__":
    harness.run_main(main)
