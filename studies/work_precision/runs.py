"""Run one case of the work-precision study, and measure its seconds."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from scipy.interpolate import CubicHermiteSpline

import fecloth as fc
from fecloth import study
from fecloth.errors import SolveFailed, StepFailed
from fecloth.nonlinear.statistics import Counts
from studies.work_precision.scenes import SAMPLES, SCENES, Scene, clamp_shift

LONG = 1.0  # CPU seconds above which a run is not repeated


def run(
    scene: str,
    model: str,
    element: str,
    h: float,
    method: str,
    step: float | None = None,
    linear: str = "auto",
    repeats: int = 3,
) -> dict:
    """Run one case; return its paths, seconds and counts.

    `step` is dt [s], or rtol [1/s] for Adaptive and Auto. The row of a failed run has its seconds.
    """
    problem = SCENES[scene](model, element, h)
    return measure_run(problem, make_runner(problem, method, step, linear), repeats)


def measure_run(problem: Scene, runs: Callable[[float], tuple], repeats: int) -> dict:
    """Return the seconds and paths of `runs(t_end)` after a warm-up."""
    system = problem.system
    size = {"nodes": len(system.cloth.X), "triangles": len(system.cloth.triangles)}
    begin = time.perf_counter()
    with suppress(StepFailed, SolveFailed):  # the timed run reports it
        runs(0.02 * problem.t_end)
    row, spent = size | {"warm_up_seconds": time.perf_counter() - begin}, []
    while len(spent) < repeats and (not spent or min(spent)[0] < LONG):
        system.calls[0], wall, cpu = 0, time.perf_counter(), time.process_time()
        try:
            paths, counts = runs(problem.t_end)
        except (StepFailed, SolveFailed) as failure:
            seconds = {"seconds": time.process_time() - cpu, "wall": time.perf_counter() - wall}
            return row | seconds | {"failure": str(failure).splitlines()[0]}
        spent.append((time.process_time() - cpu, time.perf_counter() - wall))
    cpu, wall = min(spent)
    row |= {"seconds": cpu, "wall": wall, "runs": len(spent)} | counts
    return row | {"mean": paths[0].tolist(), "point": paths[1].tolist()}


def make_runner(problem: Scene, method: str, step: float | None, linear: str) -> Callable:
    """Return the function of the end time that runs the scene with a method."""
    if method == "equilibrium":
        return lambda t_end: solve_equilibrium(problem, linear)
    if method == "many_steps":
        return lambda t_end: march_fused(problem, step, t_end)
    chosen = make_method(method, step)
    dt = None if chosen.traits.chooses_dt else step
    return lambda t_end: march(problem, chosen, dt, linear, t_end)


def march(problem: Scene, method, dt: float | None, linear: str, t_end: float) -> tuple:
    """March; return the paths at the sample times by Hermite's cubics, and the counts."""
    start, counts, steps = problem.state, Counts(), 0
    times, values, rates = [start.t], [np.zeros(2)], [problem.values_of(start.v)]
    offset = problem.values_of(start.x - problem.system.rest().x)
    run_ = problem.system, method, start, dt, t_end
    for state, info in fc.march(*run_, solver=linear, **problem.options):
        counts, steps = counts.plus(info.counts), steps + 1
        times.append(state.t)
        values.append(problem.values_of(state.x - start.x))
        rates.append(problem.values_of(state.v))
        if steps % 64 == 0:
            study.check_time_limit()
    paths = offset[:, None] + CubicHermiteSpline(times, values, rates)(problem.times).T
    forces = problem.system.calls[0] + (steps if counts.newton else 0)  # the first residual's
    return paths, run_counts(steps, counts.newton, counts.linear, counts.factorisations, forces)


def march_fused(problem: Scene, dt: float, t_end: float) -> tuple:
    """March with fused explicit steps between samples, dt shortened to meet the samples."""
    gap = problem.t_end / SAMPLES
    each = int(np.ceil(gap / dt - 1e-9))
    state, paths = problem.state, []
    rest = problem.system.rest().x
    for _ in range(max(1, round(t_end / gap))):
        state = fc.many_steps(problem.system, state, gap / each, each)
        paths.append(problem.values_of(state.x - rest))
        study.check_time_limit()
    return np.array(paths).T, run_counts(each * SAMPLES, forces=(each + 1) * SAMPLES)


def solve_equilibrium(problem: Scene, linear: str) -> tuple:
    """Solve for the equilibrium with the pins at their end, as a constant path."""
    system, rest = problem.system, problem.system.rest().x
    x = rest.copy()
    x[:, 0] *= 1 + clamp_shift(problem.t_end)[0] / rest[:, 0].max()
    iterations = []
    solver = "direct" if linear == "auto" else linear
    start = system.state(x, t=problem.t_end)
    end = fc.equilibrium(system, start, solver=solver, report=iterations.append)
    paths = np.tile(problem.values_of(end.x - rest)[:, None], SAMPLES)
    return paths, run_counts(0, len(iterations), 0, len(iterations))


def run_counts(steps=0, newton=0, linear=0, factorisations=0, forces=None) -> dict[str, int]:
    """Return the counts of a run, which do not depend on the machine."""
    return {
        "steps": steps,
        "newton": newton,
        "linear_iterations": linear,
        "factorisations": factorisations,
        "force_evaluations": forces,
    }


def make_method(method: str, step: float | None):
    """Return the method of a name; `step` is the tolerance of Adaptive and Auto."""
    if method == "Auto":
        return fc.Auto(step)
    if method.startswith("Adaptive "):
        return fc.Adaptive(getattr(fc, method.split()[1])(), step)
    return getattr(fc, method)()
