"""Adapters on cases: errors over CPU seconds, as lines or JSON, and as a table with charts."""

import json
import runpy
import sys
import time
from argparse import Namespace
from collections.abc import Iterator
from contextlib import redirect_stdout
from itertools import product
from pathlib import Path

import numpy as np

from fecloth import validation
from fecloth.bench import quantities
from fecloth.bench.cases import CASES, at_level
from fecloth.errors import FAILED, InputError
from fecloth.output.atomic_files import replace_file
from fecloth.study import figures
from fecloth.study.result import markdown_table

SHOWN = ("case", "adapter", "triangles", "error", "uncertainty", "cpu_seconds", "status")


def load_adapter(text: str) -> dict:
    """Import FILE.py:FUNCTION; the file may say its VERSION and SETTINGS."""
    file, _, function = text.rpartition(":")
    sys.path.insert(0, str(Path(file).resolve().parent))  # it may import files beside it
    try:
        run = (module := runpy.run_path(file))[function]
    except Exception as error:  # whatever is wrong in a file of the user
        allowed = f"must be FILE.py:FUNCTION, and fails with {type(error).__name__}: {error}"
        raise InputError(f"--adapter {text!r}", allowed, "bench") from error
    validation.function(text, run, "my.py:run", "bench")
    said = {key.lower(): str(module.get(key, "not said")) for key in ("VERSION", "SETTINGS")}
    return {"adapter": Path(file).stem + f":{function}" * (function != "run"), "run": run, **said}


def run_level(adapter: dict, said: dict, level: int) -> dict:
    """Return a row; its error and uncertainty are over the reference's scale."""
    case = at_level(said, level)
    reference = said["reference"]
    asked = said["quantity"]
    row = {"case": said["name"], "level": level, **adapter, "triangles": len(case["triangles"])}
    row |= {"error": None, "uncertainty": reference["uncertainty"] / reference["scale"]}
    expected = (len(case["times"]), *case["x"].shape)
    begin = time.process_time()
    try:
        with redirect_stdout(sys.stderr):  # what it prints does not mix with the rows
            x = np.asarray(row.pop("run")(case), float)
        row["cpu_seconds"] = time.process_time() - begin
        if x.shape != expected:
            raise ValueError(f"positions have the shape {x.shape}, not (times, n, 3) = {expected}")
        case = at_level(said, level)  # whatever the adapter has changed
        moved = x - np.pad(case["X"], ((0, 0), (0, 1)))
        values = getattr(quantities, asked["name"])(case, moved, **asked["arguments"])
        error = float(np.abs(values - reference["value"]).max() / reference["scale"])
        if not np.isfinite(error):
            raise ValueError(f"the {asked['name']} of these positions is not a finite number")
        row |= {"error": error, "status": "ok"}
    except (Exception, SystemExit) as why:  # whatever a solver raises, the next case is run
        if isinstance(why, NotImplementedError):
            kind = "cannot"
        else:
            kind = f"failed: {type(why).__name__}"
        row |= {"cpu_seconds": time.process_time() - begin, "status": f"{kind}: {why}"[:200]}
    return row


def run_levels(adapter: dict, said: dict, levels: int) -> Iterator[dict]:
    """Yield a row for each level; where the adapter cannot do the case, one row."""
    first = run_level(adapter, said, 0)  # it compiles: the level is measured again
    cannot = first["status"].startswith("cannot")
    yield from [first] * cannot or (run_level(adapter, said, level) for level in range(levels))


def bench(options: Namespace) -> int:
    """Run adapters on cases, or list the cases; return the exit status."""
    for name in options.case:
        validation.known(f"case {name!r}", name, CASES, "bench")
    cases = [CASES[name] for name in dict.fromkeys(options.case or CASES)]
    rows = []
    if options.list or not options.adapter:
        keys = ("name", "asks", "known", "source")
        print(markdown_table([{key: said[key] for key in keys} for said in cases]))
    adapters = [load_adapter(text) for text in dict.fromkeys(options.adapter or [])]
    if folder := options.output and Path(options.output).resolve():
        folder.mkdir(parents=True, exist_ok=True)  # refused before anything is run
    try:
        for adapter, said in product(adapters, cases):
            for row in run_levels(adapter, said, options.levels):
                rows.append(row)
                line = " ".join(f"{key}={row[key]}" for key in SHOWN)
                print(json.dumps(row) if options.json else line, flush=True)
    finally:  # also of what an interruption leaves
        if folder and rows:
            write_report(folder, rows)
    if any(row["status"].startswith("failed") for row in rows):
        return FAILED
    return 0


def write_report(folder: Path, rows: list[dict]) -> None:
    """Write table.md, and a chart CASE.png of each case with a cross for each failure."""
    said = {row["adapter"]: "- {adapter}: {version}. {settings}".format(**row) for row in rows}
    table = markdown_table([{key: row[key] for key in SHOWN} for row in rows])
    replace_file(folder / "table.md", "\n".join([*said.values(), "", table, ""]).encode())
    for case in {row["case"]: CASES[row["case"]] for row in rows}.values():
        drawing, ax = figures.new_figure()
        ax.set(xlabel="CPU time [s]", ylabel="error, as a part of the scale", title=case["asks"])
        for i, name in enumerate(said):
            mine = [row for row in rows if (row["case"], row["adapter"]) == (case["name"], name)]
            done = [(row["cpu_seconds"], row["error"]) for row in mine if row["status"] == "ok"]
            label = " ".join([name, *{row["status"][:60] for row in mine} - {"ok"}])
            ax.loglog(*np.reshape(done, (-1, 2)).T, label=label, **figures.line_style(i))
            lost = [row | {"status": "failed"} for row in mine if row["status"][:6] == "failed"]
            figures.mark_failures(ax, lost, "cpu_seconds", figures.COLOURS[i % 7])
        about = case["reference"]
        ax.axhspan(0, about["uncertainty"] / about["scale"], color="0.9", label="uncertainty")
        ax.legend(fontsize=8)
        figures.use_plain_ticks(ax)
        drawing.savefig(folder / f"{case['name']}.png", dpi=100)
