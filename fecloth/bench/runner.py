"""Adapters on cases: errors over CPU seconds, as lines or JSON, and as a table with charts."""

import json
import runpy
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.bench import quantities
from fecloth.bench.cases import NAMES, Map, at_level, read_case
from fecloth.errors import FAILED, InputError
from fecloth.output.atomic_files import replace_file
from fecloth.study.chart_result import Chart
from fecloth.study.command import missing_package
from fecloth.study.result import Table, markdown_table

SHOWN = ("case", "adapter", "triangles", "error", "uncertainty", "cpu_seconds", "status")


def load_adapter(text: str) -> dict[str, Any]:
    """Import FILE.py:FUNCTION; the file may say its VERSION and SETTINGS."""
    file, _, function = text.rpartition(":")
    try:
        module = runpy.run_path(file) if Path(file).is_file() else {}
    except ImportError as error:
        raise missing_package(str(error.name)) from error
    if not callable(module.get(function)):
        allowed = "must name a file and a function in it, as my.py:run"
        raise InputError(f"--adapter {text!r}", allowed, "bench")
    said = {key.lower(): str(module.get(key, "")) for key in ("VERSION", "SETTINGS")}
    name = Path(file).stem if function == "run" else function
    return {"adapter": name, "run": module[function], **said}


def run_level(adapter: Map, said: Map, level: int) -> dict[str, Any]:
    """Return a row; its error and uncertainty are over the reference's scale."""
    case, reference = at_level(said, level), said["reference"]
    row = {key: value for key, value in adapter.items() if key != "run"}
    row |= {"case": said["name"], "level": level, "triangles": len(case["triangles"])}
    row |= {"error": None, "uncertainty": reference["uncertainty"] / reference["scale"]}
    expected, begin = (len(case["times"]), len(case["X"]), 3), time.process_time()
    try:
        x = np.asarray(adapter["run"](case), float)
        row |= {"cpu_seconds": time.process_time() - begin, "status": "ok"}
        if x.shape != expected:
            raise ValueError(f"positions have the shape {x.shape}, not (times, n, 3) = {expected}")
        error = measure(said["quantity"], at_level(said, level), x) - reference["value"]
        row["error"] = float(np.abs(error).max() / reference["scale"])
        if not np.isfinite(row["error"]):
            raise ValueError("positions, or what is asked of them, are not finite")
    except Exception as reason:  # whatever a solver raises, the next case is run
        cannot = isinstance(reason, NotImplementedError)
        why = f"cannot: {reason}" if cannot else f"failed: {type(reason).__name__}: {reason}"
        row |= {"error": None, "cpu_seconds": time.process_time() - begin, "status": why[:200]}
    return row


def measure(asked: Map, case: Map, x: np.ndarray) -> np.ndarray:
    """Return the quantity of a case, one value a time."""
    arguments = {key: value for key, value in asked.items() if key != "name"}
    return getattr(quantities, asked["name"])(case, x, **arguments)


def run_levels(adapter: Map, said: Map, levels: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each level; a call on the coarsest before does not count, as it compiles."""
    first = run_level(adapter, said, 0)
    sizes = said["mesh"]["sizes"][: 0 if first["status"].startswith("cannot") else levels]
    yield from [first] if not sizes else (run_level(adapter, said, i) for i in range(len(sizes)))


def bench(options: Namespace) -> int:
    """Run adapters on cases, or list the cases; return the exit status."""
    cases, rows = [read_case(name) for name in options.case or NAMES], []
    if options.list:
        keys = ("known", "source")
        about = [[(k, said[k]) for k in ("name", "asks")] for said in cases]
        known = [[(k, said["reference"][k]) for k in keys] for said in cases]
        print(markdown_table([dict(a + b) for a, b in zip(about, known, strict=True)]))
        return 0
    if not options.adapter:
        raise InputError("--adapter", "is needed, or --list", "bench")
    for adapter in map(load_adapter, options.adapter):
        for row in (row for said in cases for row in run_levels(adapter, said, options.levels)):
            rows.append(row)
            line = " ".join(f"{key}={row[key]}" for key in SHOWN)
            print(json.dumps(row) if options.json else line, flush=True)
    if options.output:
        write_report(Path(options.output), rows)
    return FAILED if any(row["status"].startswith("failed") for row in rows) else 0


def write_report(folder: Path, rows: Sequence[Map]) -> None:
    """Write table.md and a chart CASE.png of each case."""
    folder.mkdir(parents=True, exist_ok=True)
    said = {row["adapter"]: row for row in rows}
    settings = [{k: row[k] for k in ("adapter", "version", "settings")} for row in said.values()]
    tables = map(markdown_table, [settings, [{k: row[k] for k in SHOWN} for row in rows]])
    replace_file(folder / "table.md", ("\n\n".join(tables) + "\n").encode())
    for name in dict.fromkeys(row["case"] for row in rows):
        draw(read_case(name), [row for row in rows if row["case"] == name], folder / f"{name}.png")


def draw(said: Map, rows: Sequence[Map], path: Path) -> None:
    """Draw errors over CPU seconds, and say below who gave none."""
    parts = [
        {"method": row["adapter"], "element": "", "seconds": row["cpu_seconds"]} for row in rows
    ]
    for part, row in zip(parts, rows, strict=True):
        part |= row | {f"{k} %": 100 * (row[k] or 0.0) for k in ("error", "uncertainty")}
    lost = {f"{row['adapter']} {row['status'][:60]}" for row in rows if row["status"] != "ok"}
    drawing = Chart(said["asks"], "", Table(tuple(parts)), quantity=said["name"]).figure()
    drawing.text(0.01, -0.01, "\n".join(sorted(lost)), va="top", fontsize=8)
    drawing.savefig(path, dpi=100, bbox_inches="tight")
