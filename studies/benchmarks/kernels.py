"""The speed figures of fecloth, each printed with its limit.

    python -m studies.benchmarks.kernels [--quick]

Single-threaded but for the one line that says so; every time is the minimum of several runs after
a warm-up, and comparisons are ratios within one run. --quick takes small meshes and leaves out
what starts new processes.
"""

from __future__ import annotations

import os
import sys

if "numba" not in sys.modules:  # it refuses a change once its threads run
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # before NumPy and MKL read them
    os.environ["NUMBA_NUM_THREADS"] = "2"  # at most: only many_steps(threads=2) takes two

import argparse
import json
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numba  # noqa: F401  reads its number of threads before fecloth.study sets it to one
import numpy as np
import scipy.sparse as sparse
import skfem
from skfem.helpers import ddot, grad, transpose

import fecloth as fc
from fecloth import study
from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockMatrix
from studies.references import falling_disk

FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)
SCENES = Path(__file__).parents[1] / "scenes"


@dataclass(frozen=True)
class Figure:
    """One measured number and the limit it is held against."""

    what: str
    value: float
    unit: str
    limit: float
    at_least: bool = False

    @property
    def met(self) -> bool:
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def __str__(self) -> str:
        sign, verdict = (">=" if self.at_least else "<="), ("met" if self.met else "MISSED")
        return (
            f"{self.what:<62} {self.value:>10.4g} {sign} {self.limit:<6g} {self.unit:<18} {verdict}"
        )


def fastest(function, repeat: int = 7, clock=time.perf_counter) -> float:
    """Seconds of the fastest of several calls, after one that is not counted."""
    function()
    times = []
    for _ in range(repeat):
        begin = clock()
        function()
        times.append(clock() - begin)
    return min(times)


def square(triangles: int) -> fc.Cloth:
    """A unit square of about that many unstructured triangles."""
    return fc.Cloth.rectangle(1.0, 1.0, h=1.52 / np.sqrt(triangles))


def stretched(system: fc.System) -> fc.State:
    """2 % biaxial stretch and a shallow wave."""
    X = system.cloth.X
    x = np.column_stack([1.02 * X, 0.02 * np.sin(3 * X[:, 0])])
    return system.state(x)


def kernels(small: int, large: int) -> list[Figure]:
    """Force and tangent of StVK in ns a triangle, and the growth from a small to a large mesh."""
    per_triangle = {}
    for triangles in (small, large):
        system = fc.System(square(triangles), FABRIC, [fc.StVK()])
        state, m = stretched(system), len(system.cloth.triangles)
        J, f, term = BlockMatrix.zeros(system.pattern), np.zeros_like(state.x), system.bound[0]
        at = (state.x, state.v, state.t)
        force = fastest(lambda at=at, f=f, term=term: term.add_force(*at, f), 20)
        tangent = fastest(
            lambda at=at, J=J, term=term: term.add_tangent(*at, 1.0, 0.0, J, False), 10
        )
        per_triangle[triangles] = 1e9 * np.array([force, force + tangent]) / m
        if triangles == small:
            oracle = fastest(
                lambda state=state, system=system: scikit_fem_tangent(system, state), 2
            )
            speedup = oracle / tangent
    force, both = per_triangle[small]
    growth = (per_triangle[large] / per_triangle[small]).max()
    return [
        Figure(f"StVK force, {small} triangles", force, "ns/triangle", 30),
        Figure(f"StVK force and tangent, {small} triangles", both, "ns/triangle", 250),
        Figure(f"growth a triangle from {small} to {large} triangles", growth, "ratio", 1.3),
        Figure("tangent, times faster than a scikit-fem form", speedup, "ratio", 100, True),
    ]


def scikit_fem_tangent(system: fc.System, state: fc.State) -> sparse.spmatrix:
    """The same matrix through a generic BilinearForm on a vector element."""
    element = skfem.ElementVector(skfem.ElementTriP1(), dim=3)
    centroid = np.array([[1 / 3], [1 / 3]]), np.array([0.5])
    basis = skfem.Basis(system.cloth.mesh, element, quadrature=centroid)
    C11, C22, C66, C12, _, _ = FABRIC.moduli()

    def product(A, B):
        return np.einsum("ij...,jk...->ik...", A, B)

    def stress(E):
        S = np.empty_like(E)
        S[0, 0], S[1, 1] = C11 * E[0, 0] + C12 * E[1, 1], C12 * E[0, 0] + C22 * E[1, 1]
        S[0, 1] = S[1, 0] = 2 * C66 * E[0, 1]
        return S

    def strain(A, B):
        return 0.5 * (product(transpose(A), B) + product(transpose(B), A))

    def form(u, v, w):
        F = grad(w["x"])
        E = 0.5 * (product(transpose(F), F) - np.eye(2)[:, :, None, None])
        geometric = ddot(stress(E), product(transpose(grad(v)), grad(u)))
        return ddot(strain(F, grad(v)), stress(strain(F, grad(u)))) + geometric

    at = basis.interpolate(state.x.ravel())
    return skfem.BilinearForm(form).assemble(basis, x=at)


def newton_iteration(triangles: int) -> list[Figure]:
    """A whole Newton iteration with the direct solver over factor + solve of the same matrix."""
    from fecloth.nonlinear import newton

    system = fc.System(square(triangles), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    method, dt = fc.BackwardEuler(), 0.01
    start = stretched(system)
    options = fc.Newton(tolerance=1e-10, reuse=False)
    solver, _ = fc.solver_for(system, method, dt, "direct", options)
    stage = method.stage(start, dt)
    whole, bare = [], []
    for _ in range(4):
        begin = time.perf_counter()
        _, counts = newton.solve(system, stage, solver)
        whole.append((time.perf_counter() - begin) / counts.newton)
        bare.append(bare_factor_and_solve(solver))
    ratio = min(whole[1:]) / min(bare[1:])
    return [
        Figure(
            f"Newton iteration / {solver.linear.name} factor + solve, {triangles} triangles",
            ratio,
            "ratio",
            1.25,
        )
    ]


def bare_factor_and_solve(solver) -> float:
    """Seconds of numeric factor + solve alone, on the matrix that Newton left."""
    A = solver.matrix
    n = len(A.pattern)
    b = np.ones((n, 3))
    try:
        import pypardiso
    except ImportError:
        chosen = select.SuperLU(symmetric=True)
        return fastest(lambda: (chosen.prepare(A), chosen.solve(b)), 1)
    upper = sparse.triu(A.to_scipy().tocsr(), format="csr")
    upper.sort_indices()
    pardiso = pypardiso.PyPardisoSolver(mtype=2)
    pardiso.set_phase(11)
    pardiso._call_pardiso(upper, b.ravel())

    def factor_and_solve():
        pardiso.set_phase(22)
        pardiso._call_pardiso(upper, b.ravel())
        pardiso.set_phase(33)
        pardiso._call_pardiso(upper, b.ravel())

    seconds = fastest(factor_and_solve, 2)
    pardiso.free_memory()
    return seconds


def trampoline(h: float, limit: float) -> list[Figure]:
    """Mean deflection of the trampoline disk against the radial solution, and its cost."""
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
        Figure(f"trampoline, {size}: error of the mean", error, "% of the peak", limit),
        Figure(f"trampoline, {size}: cost", cost, "CPU s/simulated s", 25),
    ]


def explicit_steps(small: int, large: int) -> list[Figure]:
    """Central differences in one compiled call, ns a triangle and step, and what two threads save.

    The two threads meet once a step, so their line means something on two idle cores only.
    """
    figures = []
    for triangles in (small, large):
        system = fc.System(square(triangles), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
        start, m = stretched(system), len(system.cloth.triangles)
        steps = max(10, 400_000 // m)

        def run(threads, system=system, start=start, steps=steps):
            return fastest(lambda: fc.many_steps(system, start, 1e-6, steps, threads), 15)

        cost = 1e9 * run(1) / (steps * m)
        what = f"central differences in one call, {triangles} triangles"
        figures.append(Figure(what, cost, "ns/triangle/step", 28))
        if (os.cpu_count() or 1) > 1:
            ratio = run(2) / min(run(1), 1e-9 * cost * steps * m)
            figures.append(
                Figure(f"the same on two threads / on one, {triangles}", ratio, "ratio", 0.65)
            )
    return figures


def marched(triangles: int, limit: float) -> list[Figure]:
    """A step of central differences in `march`, without its start, over one of those in one call.

    Both of one thread, in its own seconds.
    """
    system = fc.System(square(triangles), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    start, method, steps = stretched(system), fc.CentralDifference(), max(16, 200_000 // triangles)
    states, clock = fc.march(system, method, start, 1e-6, 1.0), time.thread_time
    together = fastest(lambda: fc.many_steps(system, start, 1e-6, steps), 15, clock)
    single = fastest(lambda: [next(states) for _ in range(steps)], 15, clock)
    what = f"central differences, march / one call, {triangles} triangles"
    return [Figure(what, single / together, "ratio", limit)]


def explicit_trampoline(h: float, dt: float) -> list[Figure]:
    """The trampoline by central differences, the mean deflection taken every 2 ms."""
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
        Figure(f"trampoline, {size}: error of the mean", error, "% of the peak", 0.1),
        Figure(f"trampoline, {size}: cost", cost, "CPU s/simulated s", 1.6),
    ]


def overhead() -> list[Figure]:
    """Everything of a Newton iteration but the linear solve, on 500 triangles."""
    system = fc.System(square(500), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    method, best = fc.ImplicitMidpoint(), np.inf
    for solver in ("direct", "direct", "direct"):
        begin, iterations, solving = time.perf_counter(), 0, 0.0
        for _, info in fc.march(system, method, system.rest(), 5e-3, 0.5, solver=solver):
            iterations += info.counts.newton
            solving += info.counts.seconds["factor"] + info.counts.seconds["solve"]
        best = min(best, (time.perf_counter() - begin - solving) / iterations)
    return [Figure("Newton iteration beyond the linear solve, 500 triangles", 1e3 * best, "ms", 1)]


def first_step() -> list[Figure]:
    """Seconds from the start of `fecloth run` to its first step, without and with compiled code."""
    figures = []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        for what, limit in (("nothing compiled yet", 30), ("a second run", 4)):
            out = Path(folder) / what.replace(" ", "_")
            command = [sys.executable, "-m", "fecloth", "run", str(SCENES / "benchmark_flag.toml")]
            command += ["-o", str(out), "--quiet", "--set", "time.t_end=0.05"]
            seconds = until_first_row(command, environment, out / "steps.csv")
            figures.append(Figure(f"flag scene: first step, {what}", seconds, "s", limit))
    return figures


def until_first_row(command, environment, table: Path) -> float:
    """Seconds from the start of a process until its table has a row besides the header."""
    begin = time.perf_counter()
    process = subprocess.Popen(command, env=environment)
    while process.poll() is None:
        if table.exists() and table.read_text(encoding="utf-8").count("\n") > 1:
            break
        time.sleep(0.01)
    seconds = time.perf_counter() - begin
    if process.wait():
        raise SystemExit(f"{' '.join(command)} failed")
    return seconds


def memory() -> list[Figure]:
    """Slope of the peak memory over the number of triangles, without a factor (PCG)."""
    peaks = {}
    for triangles in (50_000, 200_000):
        command = [sys.executable, "-m", "studies.benchmarks.kernels", "--peak-of", str(triangles)]
        peaks[triangles] = np.array(
            json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        )
    (peak, count), (peak_large, count_large) = peaks.values()
    slope = 1e3 * (peak_large - peak) / (count_large - count)
    return [Figure("peak memory besides a factor, 50,000 to 200,000", slope, "kB/triangle", 2)]


def peak_of(triangles: int) -> None:
    """Print [peak MB, triangles] of a short PCG run in this process."""
    from fecloth.runs.environment import peak_memory

    system = fc.System(square(triangles), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    for _ in fc.march(system, fc.ImplicitMidpoint(), system.rest(), 1e-4, 3e-4, solver="pcg"):
        pass
    print(json.dumps([peak_memory(), len(system.cloth.triangles)]))


def main() -> int:
    parser = study.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small meshes, under a minute")
    parser.add_argument("--peak-of", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak_of:
        peak_of(options.peak_of)
        return 0
    jobs = [
        lambda: kernels(2_000, 8_000),
        lambda: newton_iteration(4_000),
        lambda: trampoline(0.03, limit=1.0),
        lambda: explicit_steps(2_000, 8_000),
        lambda: marched(8_000, limit=2),
        overhead,
    ]
    if not options.quick:
        jobs = [
            lambda: kernels(8_000, 200_000),
            lambda: newton_iteration(50_000),
            lambda: trampoline(0.0152, limit=0.3),
            lambda: explicit_steps(8_000, 200_000),
            lambda: marched(500, limit=5) + marched(8_000, limit=2) + marched(50_000, limit=1.6),
            lambda: explicit_trampoline(0.0152, dt=1.25e-4),
            overhead,
            first_step,
            memory,
        ]
    figures = []
    for job in jobs:
        for figure in job():
            print(figure, flush=True)
            figures.append(figure)
    missed = sum(not figure.met for figure in figures)
    print(f"{len(figures) - missed} of {len(figures)} figures met")
    return 1 if missed and not options.quick else 0


if __name__ == "__main__":
    study.run_main(main)
