"""Speed of kernels, steps and whole runs, each number printed with its limit.

    python -m studies.evidence.benchmarks.kernels [--quick]

All run on one thread, except the line about two threads. Every time is the minimum of several runs
after a warm-up, and comparisons are ratios within one run. --quick takes small meshes and starts no
processes.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import scipy.sparse as sparse
import skfem
from skfem.helpers import ddot, grad, transpose

import fecloth as fc
from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockMatrix
from studies import harness
from studies.evidence.benchmarks.marching import (
    explicit_steps,
    explicit_trampoline,
    iteration_overhead,
    march_over_one_call,
    trampoline,
)
from studies.evidence.benchmarks.measure import (
    FABRIC,
    Measured,
    fastest,
    print_verdicts,
    square,
    stretched_state,
)
from studies.evidence.benchmarks.processes import first_step, memory, print_peak


def stvk_kernels(small: int, large: int) -> list[Measured]:
    """Return ns per triangle of StVK's force and tangent, and their growth with the mesh."""
    per_triangle = {}
    for triangles in (small, large):
        system = fc.System(square(triangles), FABRIC, [fc.StVK()])
        state, m = stretched_state(system), len(system.cloth.triangles)
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
        Measured(f"StVK force, {small} triangles", force, "ns/triangle", 30),
        Measured(f"StVK force and tangent, {small} triangles", both, "ns/triangle", 250),
        Measured(f"growth per triangle from {small} to {large} triangles", growth, "ratio", 1.3),
        Measured("tangent, times faster than a scikit-fem form", speedup, "ratio", 100, True),
    ]


def scikit_fem_tangent(system: fc.System, state: fc.State) -> sparse.spmatrix:
    """Assemble the same matrix with a BilinearForm of scikit-fem on a vector element."""
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


def newton_iteration(triangles: int) -> list[Measured]:
    """Return the time of a Newton iteration over factor + solve of the same matrix, direct."""
    from fecloth.nonlinear import newton

    system = fc.System(square(triangles), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    method, dt = fc.BackwardEuler(), 0.01
    start = stretched_state(system)
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
        Measured(
            f"Newton iteration / {solver.linear.name} factor + solve, {triangles} triangles",
            ratio,
            "ratio",
            1.25,
        )
    ]


def bare_factor_and_solve(solver) -> float:
    """Return the seconds of numeric factor + solve alone, on the last matrix of Newton."""
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


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small meshes, seconds")
    parser.add_argument("--peak-of", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak_of:
        print_peak(options.peak_of)
        return 0
    jobs = [
        lambda: stvk_kernels(500, 2_000),
        lambda: newton_iteration(500),
        lambda: trampoline(0.06, limit=1.0),
        lambda: explicit_steps(500, 2_000),
        lambda: march_over_one_call(500, limit=2),
        iteration_overhead,
    ]
    if not options.quick:
        jobs = [
            lambda: stvk_kernels(8_000, 200_000),
            lambda: newton_iteration(50_000),
            lambda: trampoline(0.0152, limit=0.3),
            lambda: explicit_steps(8_000, 200_000),
            lambda: (
                march_over_one_call(500, limit=5)
                + march_over_one_call(8_000, limit=2)
                + march_over_one_call(50_000, limit=1.6)
            ),
            lambda: explicit_trampoline(0.0152, dt=1.25e-4),
            iteration_overhead,
            first_step,
            memory,
        ]
    return print_verdicts(jobs, options.quick)


if __name__ == "__main__":
    harness.run_main(main)
