"""What the operations of linear solvers and of steps cost, as "auto" counts them.

    python -m studies.evidence.benchmarks.prices [--write] [--quick]

Four matrices are measured, on one thread: of membranes, with 7 blocks in a row, and of plates, with
about 30; each with so few blocks that a core's cache holds them, and with so many that each product
reads them from memory. All prices are in block products of conjugate gradients on the same
matrix. What Python takes for a row and for an iteration of Newton's method is measured on 100
triangles. --write writes them to fecloth/linalg/prices.toml. CPU seconds, the least of several.

On another machine all operations are faster or slower together, and "auto" chooses as here. What
differs are the prices of arithmetic (tangent, factor) over the prices of reading memory (block
products, cycles, solves with a factor): by some ten percent, more where the cache holds none or
all of the matrices. Measure again after a change of a kernel of `fecloth.linalg` or of a term.
"""

from __future__ import annotations

import math
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator

import numpy as np

import fecloth as fc
from fecloth.linalg import multigrid
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.direct import Pardiso, Rslab, SuperLU
from fecloth.linalg.multigrid import Multigrid
from fecloth.linalg.pcg import PCG
from fecloth.linalg.prices import FILE
from fecloth.stability import estimate
from studies import harness
from studies.evidence.benchmarks.measure import square

FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
DT = 5e-3
BLOCKS = 16_000, 350_000
TRIANGLES_PER_BLOCK = {"membrane": 2 / 7, "plate": 2 / 22}
LOADING = """
import time, scipy.sparse
from fecloth.linalg import direct
begin = time.process_time()
direct.{solver}()
print(time.process_time() - begin)
"""


def cpu(call: Callable[[], object], least: float = 0.5, most: int = 1000) -> float:
    """CPU seconds of a call, the least of the calls in `least` seconds, of at most `most`.

    Unless it is called once, the first call only compiles.
    """
    if most > 1:
        call()
    best, begin = math.inf, time.process_time()
    for _ in range(most):
        before = time.process_time()
        call()
        now = time.process_time()
        best = min(best, now - before)
        if now - begin > least:
            break
    return best


def system_of(kind: str, blocks: int) -> fc.System:
    """A pinned sheet, a membrane or a plate, whose matrix has about that many blocks."""
    terms: list = [fc.StVK(), fc.Gravity()]
    if kind == "plate":
        terms += [fc.PlateBending(), fc.StrainRateDamping(0.02)]
    cloth = square(round(blocks * TRIANGLES_PER_BLOCK[kind]))
    return fc.System(cloth, FABRIC, terms, [fc.Pin("top")])


def seconds_of(system: fc.System) -> Iterator[tuple[str, float]]:
    """The CPU seconds of each operation on the matrix of a step, and the entries of factors."""
    state = system.rest()
    A = BlockMatrix.zeros(system.pattern)
    b = np.random.default_rng(0).standard_normal((len(system.pattern), 3))

    def assemble() -> None:
        system.project(system.assemble(A, state, wx=DT**2, wv=DT, wa=1.0))

    yield "tangent", cpu(assemble)
    yield "residual", cpu(lambda: system.force(state))
    dt = estimate(system, state, fc.CentralDifference())
    yield "fused", cpu(lambda: fc.many_steps(system, state, dt, 50, threads=1)) / 50
    yield "row", row_and_iterations(system, fc.CentralDifference(), 0.5 * dt, 40)[0]
    yield "implicit row", implicit_row(system, 6)
    yield from iterative(A, b, state.x)
    yield from direct(A, b)


def row_and_iterations(
    system: fc.System, method: object, dt: float, steps: int
) -> tuple[float, float]:
    """The CPU seconds of a step with its row, the median, and its Newton iterations."""
    ends: list[float] = []
    iterations: list[int] = []

    def note(info) -> None:
        ends.append(time.process_time())
        iterations.append(info.counts.newton)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fc.FeclothWarning)
        fc.run(system, method, system.rest(), dt, steps * dt, report=note, rows=10**6)
    return float(np.median(np.diff(ends))), float(np.mean(iterations))


def implicit_row(system: fc.System, steps: int) -> float:
    """The CPU seconds of the row of an implicit step, without the step, the median."""
    method, dt = fc.GeneralizedAlpha(), 2e-3
    ends = [time.process_time() for _ in fc.march(system, method, system.rest(), dt, steps * dt)]
    alone = float(np.median(np.diff(ends)))
    return row_and_iterations(system, method, dt, steps)[0] - alone


def in_python() -> dict[str, float]:
    """The CPU seconds of a row and of an iteration on a cloth so small that Python takes them."""
    system = system_of("membrane", 350)
    row, _ = row_and_iterations(system, fc.CentralDifference(), 1e-4, 40)
    step, iterations = row_and_iterations(system, fc.GeneralizedAlpha(), 1e-3, 40)
    implicit = implicit_row(system, 40)
    return {
        "row": row,
        "implicit row": implicit,
        "iteration": (step - implicit) / iterations,
    }


def iterative(A: BlockMatrix, b: np.ndarray, x: np.ndarray) -> Iterator[tuple[str, float]]:
    """The CPU seconds of conjugate gradients and of multigrid."""

    def iterate(solver: PCG) -> float:
        """The seconds of a solve over its iterations."""
        _, info = solver.solve(b, fc.Newton().forcing)
        return cpu(lambda: solver.solve(b, fc.Newton().forcing)) / info.iterations

    pcg = PCG()
    pcg.prepare(A)
    yield "iteration", iterate(pcg)
    yield "grids", cpu(lambda: multigrid.make_grids(A.pattern), most=3)
    solver = Multigrid()
    solver.begin(1.0, 1.0, x)

    def rebuild() -> None:
        solver.drop()
        solver.begin(1.0, 1.0, x)
        solver.prepare(A)

    coarse = cpu(rebuild, most=5)
    refill = cpu(lambda: solver.prepare(A))
    yield "refill", refill
    yield "coarse", coarse - refill
    yield "cycle", iterate(solver)


def direct(A: BlockMatrix, b: np.ndarray) -> Iterator[tuple[str, float]]:
    """The CPU seconds of the direct solvers, and the entries of their factors."""
    for solver in (Pardiso(), Rslab(), SuperLU()):
        factor = first = cpu(lambda s=solver: s.prepare(A), most=1)
        if not isinstance(solver, SuperLU):  # which repeats the analysis
            factor = cpu(lambda s=solver: s.prepare(A), most=20)
            yield f"{solver.name} analysis", first - factor
        yield f"{solver.name} entries", solver.entries
        yield f"{solver.name} factor", factor / solver.entries
        yield f"{solver.name} solve", cpu(lambda s=solver: s._apply(b)) / solver.entries


def prices_of(
    kind: str, blocks: int, loads: dict[str, float], python: dict[str, float]
) -> dict[str, float]:
    """The prices of a matrix in block products, as `fecloth.linalg.prices` reads them.

    `loads` are the seconds in which packages are loaded, `python` what Python takes for rows.
    """
    system = system_of(kind, blocks)
    count = len(system.pattern.indices)
    seconds = {**dict(seconds_of(system)), **loads}
    for name in ("row", "implicit row"):
        seconds[name] = max(seconds[name] - python[name], 0.1 * seconds[name])
    product = seconds.pop("iteration") / count
    prices = {"blocks in a row": count / len(system.pattern), "ns of a product": 1e9 * product}
    for name, value in seconds.items():
        if name.endswith("entries"):
            prices[name] = value / count
        elif name.endswith(("load", "factor", "solve")):
            prices[name] = value / product
        else:
            prices[name] = value / product / count
    return prices


def seconds_of_loading(solver: str) -> float:
    """The CPU seconds in which a new process loads a solver's package, the least of three."""
    command = [sys.executable, "-c", LOADING.format(solver=solver)]
    runs = [subprocess.run(command, capture_output=True, check=True) for _ in range(3)]
    return min(float(run.stdout) for run in runs)


def to_toml(table: dict[str, dict[str, list[float]]], python: dict[str, float]) -> str:
    """The text of the file of prices: a line for each price, and what its numbers are."""
    processor = harness.hardware()["processor"]
    lines = [
        "# What operations cost, in block products of conjugate gradients on the same matrix:",
        "# Prices and StepPrices of fecloth.linalg.prices say of what each is the price.",
        "# Each kind of matrix has two numbers: in a cache of the processor, and too large for it.",
        "# Written by: python -m studies.evidence.benchmarks.prices --write",
        f"# Processor: {processor}",
        f"blocks = {list(BLOCKS)}",
    ]
    numbers = ", ".join(f'"{name}" = {price:.3g}' for name, price in python.items())
    lines.append(f'"products in Python" = {{ {numbers} }}')
    for name, kinds in table.items():
        numbers = ", ".join(
            f"{kind} = [{', '.join(f'{value:.3g}' for value in values)}]"
            for kind, values in kinds.items()
        )
        lines.append(f'"{name}" = {{ {numbers} }}' if " " in name else f"{name} = {{ {numbers} }}")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help=f"write {FILE.name} anew")
    parser.add_argument("--quick", action="store_true", help="small matrices only")
    options = parser.parse_args()
    sizes = (BLOCKS[0] // 8, BLOCKS[0]) if options.quick else BLOCKS
    loads = {f"{name.lower()} load": seconds_of_loading(name) for name in ("Pardiso", "Rslab")}
    seconds = in_python()
    table: dict[str, dict[str, list[float]]] = {}
    for kind in TRIANGLES_PER_BLOCK:
        for blocks in sizes:
            for name, price in prices_of(kind, blocks, loads, seconds).items():
                table.setdefault(name, {}).setdefault(kind, []).append(price)
    product = 1e-9 * table["ns of a product"]["membrane"][0]
    text = to_toml(table, {name: value / product for name, value in seconds.items()})
    print(text)
    if options.write:
        FILE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    harness.run_main(main)
