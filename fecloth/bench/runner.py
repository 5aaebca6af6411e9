"""Adapters on cases: errors over CPU seconds, as lines, as JSON, and as a table with charts."""

import importlib.util
import json
import time
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.bench import quantities
from fecloth.bench.cases import NAMES, Map, at_level, read_case
from fecloth.errors import FAILED, InputError
from fecloth.output.atomic_files import replace_file
from fecloth.study import figures
from fecloth.study.result import markdown_table

DONE, CANNOT, FAILURE = "ok", "cannot", "failed"  # how a status begins


def load_adapter(text: str) -> dict[str, Any]:
    """Import FILE.py:FUNCTION; the file may say its VERSION and SETTINGS."""
    path, function = Path(text.rpartition(":")[0]), text.rpartition(":")[2]
    spec = importlib.util.spec_from_file_location(f"bench_{path.stem}", path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise InputError(f"--adapter {text!r}", "must be FILE.py:FUNCTION", "bench")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if not callable(run := getattr(module, function, None)):
        raise InputError(f"--adapter {text!r}", f"{path} has no function {function!r}", "bench")
    name = path.stem if function == "run" else f"{path.stem}:{function}"
    said = {key.lower(): str(getattr(module, key, "")) for key in ("VERSION", "SETTINGS")}
    return {"adapter": name, "run": run, **said}


def run_level(adapter: Map, said: Map, level: int) -> dict[str, Any]:
    """Return a row: error, its reference's uncertainty (both over the scale), CPU seconds, status.

    CPU seconds are those of the process in the call, with all that it sets up.
    """
    case, row = at_level(said, level), dict.fromkeys(("error", "cpu_seconds"))
    begin, shape = time.process_time(), (len(case["times"]), len(case["X"]), 3)
    try:
        x = np.asarray(adapter["run"](at_level(said, level)), float)
        row["cpu_seconds"] = time.process_time() - begin
        if x.shape != shape:
            raise ValueError(f"positions have the shape {x.shape}, not (times, n, 3) = {shape}")
        error, status = measure_error(said, case, x), DONE
        row["error"], status = (error, DONE) if error < np.inf else (None, f"{FAILURE}: not finite")
    except NotImplementedError as reason:
        status = f"{CANNOT}: {reason}"
    except Exception as reason:  # what another program raises is a failure of this case only
        status = f"{FAILURE}: {type(reason).__name__}: {reason}"
    row |= {"triangles": len(case["triangles"]), "status": " ".join(status.split())[:200]}
    row |= {"cpu_seconds": time.process_time() - begin, "uncertainty": scaled(said)[1]}
    return {"case": said["name"], "level": level, **row, **adapter, "run": None}


def scaled(said: Map) -> tuple[float, float]:
    """Return what errors are divided by, and the uncertainty of the reference over it."""
    known = said["reference"]
    scale = known.get("scale", np.abs(known["value"]).max())
    return float(scale), float(known["uncertainty"] / scale)


def measure_error(said: Map, case: Map, x: np.ndarray) -> float:
    """Return the largest |quantity − reference| over the times, over the scale."""
    function = getattr(quantities, said["quantity"]["name"])
    values = function(case, x, **{k: v for k, v in said["quantity"].items() if k != "name"})
    return float(np.abs(values - said["reference"]["value"]).max() / scaled(said)[0])


def run_levels(adapter: Map, said: Map, levels: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each level, after a call on the coarsest that does not count: it compiles."""
    row = run_level(adapter, said, 0)
    levels = 0 if row["status"].startswith(CANNOT) else min(levels, len(said["mesh"]["sizes"]))
    yield from (run_level(adapter, said, level) for level in range(levels))
    if not levels:
        yield row


def bench(options: Namespace) -> int:
    """Run adapters on cases, or list the cases; return the exit status."""
    cases, rows = [read_case(name) for name in options.case or NAMES], []
    if options.list:
        print(markdown_table([describe(said) for said in cases]))
        return 0
    if not options.adapter:
        raise InputError("--adapter", "is needed, or --list", "bench")
    for adapter in map(load_adapter, options.adapter):
        for said in cases:
            for row in run_levels(adapter, said, options.levels):
                rows.append(row)
                print(json.dumps(row) if options.json else show(row), flush=True)
    if options.output:
        write_report(Path(options.output), rows)
    return FAILED if any(row["status"].startswith(FAILURE) for row in rows) else 0


def describe(said: Map) -> dict[str, str]:
    """Return what a case asks, its known value and uncertainty, and where these are from."""
    known = said["reference"]
    value, scale = np.ravel(known["value"]), f"{scaled(said)[0]:.4g}"
    at = f"{value[0]:.4g}" if len(value) == 1 else f"{len(value)} values up to {scale}"
    at += f" ± {known['uncertainty']:.2g} {known['unit']}"
    return {"case": said["name"], "asks": said["asks"], "known": at, "source": known["source"]}


def show(row: Map) -> str:
    """Return a line of a row."""
    said = f"error {row['error']:.2e}" if row["status"] == DONE else row["status"]
    where = f"{row['case']:<10} {row['adapter']:<12} {row['level']} {row['triangles']:>6} triangles"
    return f"{where} {row['cpu_seconds']:8.3f} CPU s  {said}"


def write_report(folder: Path, rows: list[dict[str, Any]]) -> None:
    """Write table.md and a chart CASE.png of each case."""
    folder.mkdir(parents=True, exist_ok=True)
    adapters = {row["adapter"]: row for row in rows}
    said = [{k: row[k] for k in ("adapter", "version", "settings")} for row in adapters.values()]
    keys = ("case", "adapter", "triangles", "error", "uncertainty", "cpu_seconds", "status")
    table = [{key: row[key] for key in keys} for row in rows]
    replace_file(folder / "table.md", f"{markdown_table(said)}\n\n{markdown_table(table)}\n".encode())
    for name in dict.fromkeys(row["case"] for row in rows):
        draw(read_case(name), [row for row in rows if row["case"] == name], list(adapters), folder)


def draw(said: Map, rows: list[dict[str, Any]], adapters: list[str], folder: Path) -> None:
    """Draw error over CPU seconds, a line an adapter; in the band of the reference all are right."""
    drawing, ax = figures.new_figure()
    (scale, uncertainty), unit = scaled(said), said["reference"]["unit"]
    ax.set(xscale="log", yscale="log", xlabel="CPU seconds", title=said["asks"])
    ax.set_ylabel(f"error, of {scale:.3g} {unit}")
    for i, name in enumerate(adapters):
        mine, style = [row for row in rows if row["adapter"] == name], figures.line_style(i)
        done = [row for row in mine if row["status"] == DONE]
        label = " ".join([name, *({row["status"][:50] for row in mine} - {DONE})])
        xy = ([row[key] for row in done] for key in ("cpu_seconds", "error"))
        ax.plot(*xy, label=label, **style)
        lost = [row | {"status": FAILURE} for row in mine if row["status"].startswith(FAILURE)]
        figures.mark_failures(ax, lost, "cpu_seconds", style["color"])
    ax.axhspan(0, uncertainty, color="0.9", zorder=0, label="uncertainty of the reference")
    ax.legend(fontsize=8)
    drawing.savefig(folder / f"{said['name']}.png", dpi=100)
