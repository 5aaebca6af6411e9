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
from fecloth.study.result import Table, markdown_table

SHOWN = ("case", "adapter", "triangles", "error", "uncertainty", "cpu_seconds", "status")


def load_adapter(text: str) -> dict[str, Any]:
    """Import FILE.py:FUNCTION; the file may say its VERSION and SETTINGS."""
    file, _, function = text.rpartition(":")
    module = runpy.run_path(file) if Path(file).is_file() else {}
    if not callable(module.get(function)):
        allowed = "must name a file and a function in it, as my.py:run"
        raise InputError(f"--adapter {text!r}", allowed, "bench")
    said = {key.lower(): str(module.get(key, "")) for key in ("VERSION", "SETTINGS")}
    name = Path(file).stem if function == "run" else function
    return {"adapter": name, "run": module[function], **said}


def run_level(adapter: Map, said: Map, level: int) -> dict[str, Any]:
    """Return a row; its error and uncertainty are over the reference's scale."""
    case, reference, asked = at_level(said, level), said["reference"], said["quantity"]
    row = {"case": said["name"], "level": level, **adapter, "triangles": len(case["triangles"])}
    row |= {"error": None, "uncertainty": reference["uncertainty"] / reference["scale"]}
    expected, begin = (len(case["times"]), len(case["X"]), 3), time.process_time()
    try:
        x = np.asarray(row.pop("run")(case), float)
        row |= {"cpu_seconds": time.process_time() - begin, "status": "ok"}
        if x.shape != expected:
            raise ValueError(f"positions have the shape {x.shape}, not (times, n, 3) = {expected}")
        case = at_level(said, level)  # whatever the adapter has changed
        moved = x - np.pad(case["X"], ((0, 0), (0, 1)))
        values = getattr(quantities, asked["name"])(case, moved, **asked["arguments"])
        row["error"] = float(np.abs(values - reference["value"]).max() / reference["scale"])
        if not np.isfinite(row["error"]):
            raise ValueError("positions, or what is asked of them, are not finite")
    except Exception as why:  # whatever a solver raises, the next case is run
        kind = "cannot" if isinstance(why, NotImplementedError) else f"failed: {type(why).__name__}"
        row |= {"cpu_seconds": time.process_time() - begin, "status": f"{kind}: {why}"[:200]}
        row["error"] = None
    return row


def run_levels(adapter: Map, said: Map, levels: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each level; the first call, on the coarsest, compiles and is left out."""
    first, count = run_level(adapter, said, 0), min(levels, len(said["mesh"]["sizes"]))
    cannot = first["status"].startswith("cannot")
    yield from [first] if cannot else (run_level(adapter, said, level) for level in range(count))


def bench(options: Namespace) -> int:
    """Run adapters on cases, or list the cases; return the exit status."""
    cases, rows = [read_case(name) for name in options.case or NAMES], []
    if options.list:
        keys = ("name", "asks", "known", "source")
        print(markdown_table([{key: said[key] for key in keys} for said in cases]))
    elif not options.adapter:
        raise InputError("--adapter", "is needed, or --list", "bench")
    for adapter in map(load_adapter, options.adapter or []):
        for row in (row for said in cases for row in run_levels(adapter, said, options.levels)):
            rows.append(row)
            line = " ".join(f"{key}={row[key]}" for key in SHOWN)
            print(json.dumps(row) if options.json else line, flush=True)
    if options.output:
        write_report(Path(options.output), rows)
    return FAILED if any(row["status"].startswith("failed") for row in rows) else 0


def write_report(folder: Path, rows: Sequence[Map]) -> None:
    """Write table.md, and a chart CASE.png of each case that says below it who gave no error."""
    folder.mkdir(parents=True, exist_ok=True)
    said = dict.fromkeys(f"- {r['adapter']}: {r['version']}. {r['settings']}" for r in rows)
    table = markdown_table([{key: row[key] for key in SHOWN} for row in rows])
    replace_file(folder / "table.md", "\n".join([*said, "", table, ""]).encode())
    for name in dict.fromkeys(row["case"] for row in rows):
        mine = [row for row in rows if row["case"] == name]
        lost = {f"{row['adapter']} {row['status'][:60]}" for row in mine if row["status"] != "ok"}
        chart = Chart(read_case(name)["asks"], "", Table(tuple(map(point, mine))), quantity=name)
        drawing = chart.figure()
        drawing.text(0.01, -0.01, "\n".join(sorted(lost)), va="top", fontsize=8)
        drawing.savefig(folder / f"{name}.png", dpi=100, bbox_inches="tight")


def point(row: Map) -> dict[str, Any]:
    """Return a row with the keys of a chart's."""
    parts = {f"{key} %": 100 * (row[key] or 0.0) for key in ("error", "uncertainty")}
    return {**row, **parts, "method": row["adapter"], "element": "", "seconds": row["cpu_seconds"]}
