"""fecloth, its springs, MuJoCo, Newton and torch-fem on the cases of `fecloth bench`.

    python -m studies.engines [--quick] [--draw] [--python PYTHON]

Each engine runs each case in a process of its own, on one thread, coarse to fine, for at most
LIMIT seconds of CPU a case; where it is over, the finer levels are failures. An engine that is not
installed has a line that says so. PYTHON is an interpreter with fecloth and the engines
(pip install '.[peers]'); without it this one is taken. The charts, table.md and results.jsonl are
written beside this file; --draw makes the first two from the last. --quick runs fecloth and its
springs on three cases on two coarse meshes, and writes nothing.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fecloth.bench.cases import CASES
from fecloth.bench.runner import SHOWN, load_adapter, run_level, write_report
from fecloth.study.result import markdown_table
from studies import harness

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
ENGINES = {  # adapter: the package that it needs
    "fecloth_p1.py:run": "fecloth",
    "fecloth_springs.py:run": "fecloth",
    "mujoco_flex.py:run": "mujoco",
    "torch_fem.py:run": "torchfem",
    "newton_cloth.py:newton_semi_implicit": "newton",
    "newton_cloth.py:newton_vbd": "newton",
}
QUICK = ("flight", "hanging", "cantilever")
LIMIT = 45  # CPU seconds
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


def run_engine(engine: str, case: str, levels: int, python: str) -> list[dict[str, Any]]:
    """Return the rows of an engine on a case, from a process of its own."""
    command = [python, "-m", "fecloth", "bench", "--json", "--levels", str(levels)]
    command += ["--adapter", f"{HERE / engine.split(':')[0]}:{engine.split(':')[1]}", case]
    one_thread = dict.fromkeys(THREADS, "1") | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | one_thread,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT + 5)),
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    rows = [json.loads(line) for line in lines]
    return rows + missing_rows(rows, engine, case, levels, done)


def missing_rows(
    rows: Sequence[dict], engine: str, case: str, levels: int, done: subprocess.CompletedProcess
) -> list[dict[str, Any]]:
    """Return a row for each level that a process did not come to."""
    said = CASES[case]
    if rows and rows[0]["status"].startswith("cannot"):
        return []
    name = engine.replace(".py", "").removesuffix(":run")  # as the runner calls it
    status = f"failed: more than {LIMIT} s of CPU time in all levels"
    if "No module named" in done.stderr:
        status = f"cannot: {ENGINES[engine]} is not installed"
    elif done.returncode >= 0 and not rows:
        status = f"failed: {(done.stderr.splitlines() or ['no answer'])[-1]}"[:200]
    known = {"version": "", "settings": ""} | {
        k: rows[0][k] for k in ("version", "settings") if rows
    }
    common = {"case": case, "adapter": name, "triangles": 0, "error": None, "status": status}
    common |= {"uncertainty": uncertainty(said), "cpu_seconds": LIMIT}
    missing = range(len(rows), min(levels, len(said["mesh"]["sizes"])))
    if status.startswith("cannot"):
        missing = missing[:1]
    return [common | known | {"level": level} for level in missing]


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fecloth and its springs only")
    parser.add_argument("--draw", action="store_true", help="draw results.jsonl again")
    parser.add_argument("--python", default=sys.executable, help="interpreter with the engines")
    options = parser.parse_args()
    if options.quick:
        return quick()
    rows: list[dict[str, Any]] = []
    if options.draw:
        lines = (HERE / "results.jsonl").read_text(encoding="utf-8").splitlines()
        draw([json.loads(line) for line in lines])
        return 0
    for engine in ENGINES:
        for case in CASES:
            rows += run_engine(engine, case, 3, options.python)
            print(f"{case} {engine}: {rows[-1]['status']} {rows[-1]['error']}", flush=True)
            text = "".join(json.dumps(row) + "\n" for row in rows)
            (HERE / "results.jsonl").write_text(text, encoding="utf-8")
    draw(rows)
    return 0


def draw(rows: Sequence[dict[str, Any]]) -> None:
    """Write the charts and table.md, which has the finest mesh of each engine."""
    write_report(HERE, list(rows))
    text = (HERE / "table.md").read_text(encoding="utf-8")
    said = [line for line in text.splitlines() if line.startswith("- ")]
    engines = list(dict.fromkeys(row["adapter"] for row in rows))
    lines = []
    for case, said in CASES.items():
        line = {"case": case, "uncertainty": f"{uncertainty(said):.2g}"}
        for engine in engines:
            mine = [row for row in rows if (row["case"], row["adapter"]) == (case, engine)]
            line[engine] = finest(mine)
        lines.append(line)
    head = (
        "# Errors and CPU seconds of each engine on each case\n\n"
        "Made by `python -m studies.engines`. "
        "Errors are parts of the scale of the known value, as its standard uncertainty is. "
        "Error (CPU seconds) on the finest mesh; all meshes in `results.jsonl`.\n\n"
    )
    parts = [head + markdown_table(lines), "What the engines are:", "\n".join(said) + "\n"]
    (HERE / "table.md").write_text("\n\n".join(parts), encoding="utf-8")


def uncertainty(said: Mapping[str, Any]) -> float:
    """Return the uncertainty of a known value over its scale."""
    return said["reference"]["uncertainty"] / said["reference"]["scale"]


def finest(rows: Sequence[dict[str, Any]]) -> str:
    """Return error and CPU seconds on the finest mesh with an error, or how the engine failed."""
    done = [row for row in rows if row["status"] == "ok"]
    lost = "" if len(done) == len(rows) else rows[-1]["status"].split(":")[0]
    if not done:
        return lost
    coarse = f", level {done[-1]['level']}; then {lost}" if lost else ""
    return f"{done[-1]['error']:.2g} ({done[-1]['cpu_seconds']:.2g}{coarse})"


def quick() -> int:
    """Run fecloth and its springs in this process, on two coarse meshes."""
    adapters = [f"{HERE / name}.py:run" for name in ("fecloth_p1", "fecloth_springs")]
    rows = []
    for name in QUICK:
        for adapter in map(load_adapter, adapters):
            rows += [run_level(adapter, CASES[name], level) for level in range(2)]
    print(markdown_table([{key: row[key] for key in SHOWN} for row in rows]))
    worst = max(row["error"] for row in rows[1::4])
    finding = harness.Finding("fecloth, largest error on the second mesh", worst, high=0.01)
    print(finding)
    return 0 if finding.is_met else 1


if __name__ == "__main__":
    harness.run_main(main)
