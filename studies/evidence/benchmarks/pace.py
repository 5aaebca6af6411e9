"""Implicit steps of a cloth in a CPU second, at a stated error, beside MuJoCo's.

    python -m studies.evidence.benchmarks.pace [--sizes N …] [--quick] [--write]

A square of 1 m × 1 m is held along its border and falls from rest for 0.1 s, with the membrane
alone (`StVK`) and with `PlateBending`. Seconds are CPU time of the steps, with what `march` does
beside them, on one thread. The methods take turns; of short runs the fastest of several counts.
The error is a root mean square over the nodes, the largest of ten times, over the largest such
displacement. It is an error in time: the reference is by central differences at half their largest
step, on the same mesh.

MuJoCo's flex has the same mesh, masses, material and pins. Its integrator `discrete` is the scheme
of `LinearlyImplicitEuler`, so that both have about the same error at the same step. It has its own
bending, of a thin plate too.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import fecloth as fc
from fecloth.study.result import markdown_table
from studies import harness

PAGE = Path(__file__).with_suffix(".md")
SIZES = {"800": 20, "1k": 22, "4k": 45, "16k": 90, "64k": 179}  # cells a side, of two triangles
T_END, SAMPLES = 0.1, 10
Y, NU, DENSITY, B = 1000.0, 0.3, 0.2, 1e-3  # N/m, 1, kg/m², N m
LINEARISED, PEER = "LinearlyImplicitEuler", "MuJoCo discrete"
METHODS = (  # and their steps [s]
    ("BDF2", 2.5e-3),
    ("GeneralizedAlpha", 5e-3),
    ("ImplicitMidpoint", 5e-3),
    (LINEARISED, 5e-3),
    (PEER, 5e-3),
    (LINEARISED, 1e-3),
    (PEER, 1e-3),
)
SMALL = 45  # cells a side up to which steps of 1 ms are taken
ENOUGH = 2.0  # CPU seconds after which a run is not repeated
MOST = 1.0  # the linearised step over MuJoCo's, on 800 triangles
Paths = np.ndarray
"""Positions (SAMPLES, n, 3) [m] at equal distances in time."""
Run = Callable[[], tuple[Paths, float]]
"""A run: its positions, and the CPU seconds of its steps."""


def make_system(cells: int, bends: bool) -> fc.System:
    """Return the square with that many cells a side."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=1 / cells, pattern="right")
    fabric = fc.Fabric(DENSITY, Y, NU, bending_rigidity=B)
    terms = [fc.StVK(), fc.Gravity(), *([fc.PlateBending()] if bends else [])]
    return fc.System(cloth, fabric, terms, ["boundary"], threads=1)


def run_reference(system: fc.System) -> Paths:
    """Return the positions by central differences at half of their largest step."""
    gap = T_END / SAMPLES
    each = int(2 * gap / fc.critical_dt(system, system.rest())) + 1
    states = [system.rest()]
    for _ in range(SAMPLES):
        begin = states[-1]
        end = begin.t + gap
        states.append(fc.run(system, fc.CentralDifference(), begin, gap / each, end).state)
    return np.array([state.x for state in states[1:]])


def run_fecloth(system: fc.System, method: str, dt: float) -> tuple[Paths, float]:
    """Return the positions, and the CPU seconds of all steps."""
    each = round(T_END / SAMPLES / dt)
    positions = []
    begin = time.process_time()
    for state, info in fc.march(system, getattr(fc, method)(), system.rest(), dt, T_END):
        if info.step % each == 0:
            positions.append(state.x)
    return np.array(positions), time.process_time() - begin


def prepare_mujoco(system: fc.System, bends: bool, dt: float) -> Run:
    """Return a function that runs MuJoCo's flex, as `run_fecloth` does."""
    import mujoco

    from studies.engines import mujoco_flex

    cloth = system.cloth
    fabric = {"areal_density": DENSITY, "tensile_stiffness": (Y, Y), "poisson_ratio": NU}
    case: dict[str, Any] = {
        "X": cloth.X,
        "triangles": cloth.triangles,
        "pins": cloth.nodes("boundary"),
        "gravity": (0.0, 0.0, -9.81),
        "fabric": fabric | {"bending_rigidity": B if bends else 0.0},
    }
    model = mujoco_flex.make_model(case, dt, explicit=False)
    data = mujoco.MjData(model)

    @harness.temporary_folder()
    def run() -> tuple[Paths, float]:
        mujoco.mj_resetData(model, data)
        seconds, positions = 0.0, []
        for _ in range(SAMPLES):
            begin = time.process_time()
            mujoco.mj_step(model, data, nstep=round(T_END / SAMPLES / dt))
            seconds += time.process_time() - begin
            positions.append(mujoco_flex.read(model, data))
        return np.array(positions), seconds

    return run


def rms(x: Paths) -> np.ndarray:
    """Return the root mean square over the nodes at each time, (SAMPLES,)."""
    return np.sqrt((x**2).sum(axis=2).mean(axis=1))


def measure(runs: dict[Any, Run]) -> dict[Any, tuple[Paths, float]]:
    """Return the positions and the CPU seconds of the fastest of several runs; they take turns."""
    spent = dict.fromkeys(runs, 0.0)
    best: dict[Any, tuple[Paths, float]] = dict.fromkeys(runs, (np.empty(0), np.inf))
    while min(spent.values()) < ENOUGH:
        for name, run in runs.items():
            if spent[name] < ENOUGH:
                positions, seconds = run()
                spent[name] += seconds
                best[name] = positions, min(best[name][1], seconds)
    return best


def methods_of(size: str) -> list[tuple[str, float]]:
    """Return the methods and steps for a mesh; short steps take minutes on the large ones."""
    if size == "800":
        return [(method, dt) for method, dt in METHODS if method in (LINEARISED, PEER)]
    return [(method, dt) for method, dt in METHODS if dt > 1e-3 or SIZES[size] <= SMALL]


def rows_of(size: str, bends: bool, has_mujoco: bool) -> list[dict[str, Any]]:
    """Return the rows of a mesh, with or without bending."""
    system = make_system(SIZES[size], bends)
    reference = run_reference(system)
    extent = rms(reference - system.rest().x).max()
    methods = methods_of(size)
    runs: dict[tuple[str, float], Run] = {}
    for method, dt in methods:
        if method != PEER:
            runs[method, dt] = partial(run_fecloth, system, method, dt)
        elif has_mujoco:
            runs[method, dt] = prepare_mujoco(system, bends, dt)
    small = make_system(4, bends)
    for method, dt in methods:
        if method != PEER:
            run_fecloth(small, method, dt)  # compiles
    measured = measure(runs)
    rows = []
    for method, dt in methods:
        row = {
            "triangles": len(system.cloth.triangles),
            "terms": "StVK, PlateBending" if bends else "StVK",
            "method": method,
            "dt [ms]": 1e3 * dt,
        }
        if (method, dt) in measured:
            positions, seconds = measured[method, dt]
            row["error [%]"] = 100 * float(rms(positions - reference).max() / extent)
            row["steps a CPU second"] = round(T_END / dt) / seconds
            row["CPU seconds for a second"] = seconds / T_END
            rows.append(row)
        else:
            rows.append(row | {"steps a CPU second": "not installed"})
    return rows


def findings_of(rows: list[dict[str, Any]]) -> list[harness.Finding]:
    """Return the linearised step over MuJoCo's on the smallest mesh; none without MuJoCo."""
    findings = []
    for terms in dict.fromkeys(row["terms"] for row in rows):
        rates = {
            row["method"]: row["steps a CPU second"]
            for row in rows
            if (row["terms"], row["dt [ms]"]) == (terms, 5.0) and row["triangles"] == 800
        }
        if isinstance(rates.get(PEER), float):
            what = f"a linearised step over MuJoCo's, 800 triangles, {terms}"
            findings.append(harness.Finding(what, rates[PEER] / rates[LINEARISED], high=MOST))
    return findings


def write_page(rows: list[dict[str, Any]], findings: list[harness.Finding]) -> None:
    """Write the page beside this file."""
    machine = ", ".join(f"{name} {value}" for name, value in harness.hardware().items())
    question, _, what = __doc__.split("\n\n", 2)
    parts = (
        f"# {question.removesuffix('.')}",
        "`python -m studies.evidence.benchmarks.pace --write`; MuJoCo's rows need "
        "`pip install '.[peers]'`.",
        what.strip(),
        markdown_table(rows),
        "\n".join(f"- {finding}" for finding in findings),
        f"Ran on: {machine}.",
    )
    PAGE.write_text("\n\n".join(part for part in parts if part) + "\n", encoding="utf-8")


def main() -> int:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--sizes", nargs="+", choices=SIZES, default=list(SIZES), help="some of the meshes")
    add("--quick", action="store_true", help="the smallest mesh; nothing is judged")
    add("--write", action="store_true", help="write the page beside this file anew")
    options = parser.parse_args()
    has_mujoco = find_spec("mujoco") is not None
    rows = []
    for size in ["800"] if options.quick else options.sizes:
        for bends in (False, True):
            for row in rows_of(size, bends, has_mujoco):
                rows.append(row)
                print(row, flush=True)
    findings = findings_of(rows)
    print(markdown_table(rows), *findings, sep="\n")
    if options.write:
        write_page(rows, findings)
    return 0 if options.quick or all(finding.is_met for finding in findings) else 1


if __name__ == "__main__":
    harness.run_main(main)
