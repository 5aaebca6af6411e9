"""Benchmarks of steps and whole runs: the trampoline, explicit steps, Newton's overhead."""

from __future__ import annotations

import os
import time

import numpy as np

import fecloth as fc
from studies.evidence.benchmarks.measure import FABRIC, Measured, fastest, square, stretched_state
from studies.references import falling_disk


def trampoline(h: float, limit: float) -> list[Measured]:
    """Return the error of the trampoline's mean deflection and the cost of the run."""
    cloth = fc.Cloth.disk(radius=0.5, h=h)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    run = {"dt": 1e-3, "t_end": 0.2}
    fc.run(system, fc.ImplicitMidpoint(), system.rest(), dt=1e-3, t_end=2e-3)
    begin = time.process_time()
    for _ in fc.march(system, fc.ImplicitMidpoint(), system.rest(), **run):
        pass
    cost = (time.process_time() - begin) / run["t_end"]
    result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), **run)
    mean = -result.observed["mean_displacement.z"]
    exact = falling_disk.trampoline(result.times[1:], elements=800).mean_deflection
    error = 100 * np.abs(mean[1:] - exact).max() / np.abs(exact).max()
    size = f"{len(cloth.triangles)} triangles, midpoint 1 ms"
    return [
        Measured(f"trampoline, {size}: error of the mean", error, "% of the peak", limit),
        Measured(f"trampoline, {size}: cost", cost, "CPU s/simulated s", 25),
    ]


def explicit_steps(small: int, large: int) -> list[Measured]:
    """Return ns per triangle and step of central differences in one compiled call.

    The ratio of two threads to one is meaningful only on two idle cores, because the threads
    wait for each other once per step.
    """
    figures = []
    for triangles in (small, large):
        system = fc.System(square(triangles), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
        start, m = stretched_state(system), len(system.cloth.triangles)
        steps = max(10, 400_000 // m)

        def run(threads, system=system, start=start, steps=steps):
            return fastest(lambda: fc.many_steps(system, start, 1e-6, steps, threads), 15)

        cost = 1e9 * run(1) / (steps * m)
        what = f"central differences in one call, {triangles} triangles"
        figures.append(Measured(what, cost, "ns/triangle/step", 28))
        if (os.cpu_count() or 1) > 1:
            ratio = run(2) / min(run(1), 1e-9 * cost * steps * m)
            figures.append(
                Measured(f"the same on two threads / on one, {triangles}", ratio, "ratio", 0.65)
            )
    return figures


def march_over_one_call(triangles: int, limit: float) -> list[Measured]:
    """Return the time of a step in `march` over the time of a step in one compiled call.

    The start of `march` does not count. Both take one thread and are measured in its seconds.
    """
    system = fc.System(square(triangles), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    start, method, steps = (
        stretched_state(system),
        fc.CentralDifference(),
        max(16, 200_000 // triangles),
    )
    states, clock = fc.march(system, method, start, 1e-6, 1.0), time.thread_time
    together = fastest(lambda: fc.many_steps(system, start, 1e-6, steps), 15, clock)
    single = fastest(lambda: [next(states) for _ in range(steps)], 15, clock)
    what = f"central differences, march / one call, {triangles} triangles"
    return [Measured(what, single / together, "ratio", limit)]


def explicit_trampoline(h: float, dt: float) -> list[Measured]:
    """Return error and cost of the trampoline with central differences, read every 2 ms."""
    cloth = fc.Cloth.disk(radius=0.5, h=h)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    every, mean, share = round(2e-3 / dt), [], system.nodal_mass / system.nodal_mass.sum()
    state = system.rest()
    fc.many_steps(system, state, dt, 1)
    begin = time.process_time()
    for _ in range(100):
        state = fc.many_steps(system, state, dt, every)
        mean.append(-share @ state.x[:, 2])
    cost = (time.process_time() - begin) / 0.2
    times = 2e-3 * np.arange(1, 101)
    exact = falling_disk.trampoline(times, elements=800).mean_deflection
    error = 100 * np.abs(mean - exact).max() / np.abs(exact).max()
    size = f"{len(cloth.triangles)} triangles, explicit {1e3 * dt:g} ms"
    return [
        Measured(f"trampoline, {size}: error of the mean", error, "% of the peak", 0.1),
        Measured(f"trampoline, {size}: cost", cost, "CPU s/simulated s", 1.6),
    ]


def iteration_overhead() -> list[Measured]:
    """Return the time of a Newton iteration without the linear solve, on 500 triangles."""
    system = fc.System(square(500), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    method, best = fc.ImplicitMidpoint(), np.inf
    for solver in ("direct", "direct", "direct"):
        begin, iterations, solving = time.perf_counter(), 0, 0.0
        for _, info in fc.march(system, method, system.rest(), 5e-3, 0.5, solver=solver):
            iterations += info.counts.newton
            solving += info.counts.seconds["factor"] + info.counts.seconds["solve"]
        best = min(best, (time.perf_counter() - begin - solving) / iterations)
    return [
        Measured("Newton iteration beyond the linear solve, 500 triangles", 1e3 * best, "ms", 1)
    ]
