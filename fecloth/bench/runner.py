"""Adapters on cases: errors over CPU seconds, as lines or JSON, and as a table with charts."""

import json
import runpy
import sys
import time
from collections.abc import Iterator, Sequence
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
    """Import FILE.py:FUNCTION; return its name, its function, and what the file states.

    These are the keys "adapter", "run", "version" and "settings". The file may state its VERSION
    and SETTINGS. The folder of the file is put on `sys.path`. Raises `InputError` if it cannot
    be imported or FUNCTION is no function.
    """
    file, _, function = text.rpartition(":")
    sys.path.insert(0, str(Path(file).resolve().parent))  # it may import files beside it
    try:
        run = (module := runpy.run_path(file))[function]
    except (Exception, SystemExit) as error:  # whatever is wrong in a file of the user
        allowed = f"must be FILE.py:FUNCTION, and fails with {type(error).__name__}: {error}"
        raise InputError(f"--adapter {text!r}", allowed, "bench") from error
    validation.function(text, run, "my.py:run", "bench")
    name = Path(file).stem
    if function != "run":
        name += f":{function}"
    version = str(module.get("VERSION", "not said"))
    settings = str(module.get("SETTINGS", "not said"))
    return {"adapter": name, "run": run, "version": version, "settings": settings}


def run_level(adapter: dict, stated: dict, level: int) -> dict:
    """Run an adapter on a case on the mesh of a level; return a row with the error and the cost.

    The row has the keys `SHOWN` and some more; the error is None if the run has none. The error
    and its uncertainty are relative to the scale of the reference. If the adapter fails, or
    cannot do the case, the status of the row says why. What the adapter prints goes to standard
    error.
    """
    case = at_level(stated, level)
    reference = stated["reference"]
    quantity = stated["quantity"]
    row = {"case": stated["name"], "level": level, **adapter}
    row["triangles"] = len(case["triangles"])
    row |= {"error": None, "uncertainty": reference["uncertainty"] / reference["scale"]}
    expected_shape = (len(case["times"]), *case["x"].shape)
    begin = time.process_time()
    try:
        with redirect_stdout(sys.stderr):  # what it prints does not mix with the rows
            x = np.asarray(row.pop("run")(case), float)
        row["cpu_seconds"] = time.process_time() - begin
        if x.shape != expected_shape:
            allowed = f"(times, n, 3) = {expected_shape}"
            raise ValueError(f"positions have the shape {x.shape}, not {allowed}")
        case = at_level(stated, level)  # anew, as the adapter may have changed it
        displacements = x - np.pad(case["X"], ((0, 0), (0, 1)))
        compute = getattr(quantities, quantity["name"])
        values = compute(case, displacements, **quantity["arguments"])
        error = float(np.abs(values - reference["value"]).max() / reference["scale"])
        if not np.isfinite(error):
            raise ValueError(f"the {quantity['name']} of these positions is not a finite number")
        row |= {"error": error, "status": "ok"}
    except (Exception, SystemExit) as why:  # whatever a solver raises, the next case is run
        if isinstance(why, NotImplementedError):  # so an adapter says that it has no such law
            failure = "cannot"
        else:
            failure = f"failed: {type(why).__name__}"
        row |= {"cpu_seconds": time.process_time() - begin, "status": f"{failure}: {why}"[:200]}
    return row


def run_levels(adapter: dict, stated: dict, levels: int) -> Iterator[dict]:
    """Yield a row for each level; if the adapter cannot do the case, one row."""
    first = run_level(adapter, stated, 0)  # it compiles: the level is measured again
    if first["status"].startswith("cannot"):
        yield first
        return
    for level in range(levels):
        yield run_level(adapter, stated, level)


def bench(
    names: Sequence[str],
    adapters: Sequence[str],
    *,
    describe: bool,
    levels: int,
    as_json: bool,
    output: str | None,
) -> int:
    """Run adapters on cases, or describe the cases; return the exit status.

    Each row is printed as soon as it is there. With an output folder, write table and charts at
    the end, also after an interruption. The status is `FAILED` if an adapter has failed. Raises
    `InputError` for an unknown case, and for an adapter that cannot be imported.
    """
    for name in names:
        validation.known(f"case {name!r}", name, CASES, "bench")
    cases = [CASES[name] for name in dict.fromkeys(names or CASES)]
    rows = []
    if describe or not adapters:
        keys = ("name", "asks", "known", "source")
        print(markdown_table([{key: case[key] for key in keys} for case in cases]))
    loaded = [load_adapter(text) for text in dict.fromkeys(adapters)]
    if folder := output and Path(output).resolve():
        folder.mkdir(parents=True, exist_ok=True)  # refused before anything is run
    try:
        for adapter, case in product(loaded, cases):
            for row in run_levels(adapter, case, levels):
                rows.append(row)
                if as_json:
                    line = json.dumps(row)
                else:
                    line = " ".join(f"{key}={row[key]}" for key in SHOWN)
                print(line, flush=True)
    finally:  # also after an interruption
        if folder and rows:
            write_report(folder, rows)
    if any(row["status"].startswith("failed") for row in rows):
        return FAILED
    return 0


def write_report(folder: Path, rows: list[dict]) -> None:
    """Write table.md, and a chart CASE.png of each case with a cross for each failure."""
    notes = {row["adapter"]: "- {adapter}: {version}. {settings}".format(**row) for row in rows}
    table = markdown_table([{key: row[key] for key in SHOWN} for row in rows])
    replace_file(folder / "table.md", "\n".join([*notes.values(), "", table, ""]).encode())
    for name in dict.fromkeys(row["case"] for row in rows):
        of_case = [row for row in rows if row["case"] == name]
        _draw_chart(folder, CASES[name], of_case, list(notes))


def _draw_chart(folder: Path, case: dict, rows: list[dict], adapters: list[str]) -> None:
    """Draw errors over CPU time of all adapters on a case, as ``folder``/CASE.png.

    `rows` are the rows of this case. The band is the uncertainty of the reference.
    """
    drawing, ax = figures.new_figure()
    ax.set(xlabel="CPU time [s]", ylabel="error, as a part of the scale", title=case["asks"])
    for i, adapter in enumerate(adapters):
        rows_of_adapter = [row for row in rows if row["adapter"] == adapter]
        done = [row for row in rows_of_adapter if row["status"] == "ok"]
        seconds = [row["cpu_seconds"] for row in done]
        errors = [row["error"] for row in done]
        # The legend says why an adapter has failed; the cross has the word "failed" only.
        label = " ".join([adapter, *{row["status"][:60] for row in rows_of_adapter} - {"ok"}])
        ax.loglog(seconds, errors, label=label, **figures.line_style(i))
        failures = [row for row in rows_of_adapter if row["status"].startswith("failed")]
        failed = [row | {"status": "failed"} for row in failures]
        figures.mark_failures(ax, failed, "cpu_seconds", figures.COLOURS[i % 7])
    reference = case["reference"]
    uncertainty = reference["uncertainty"] / reference["scale"]
    ax.axhspan(0, uncertainty, color="0.9", label="uncertainty")
    ax.legend(fontsize=8)
    figures.use_plain_ticks(ax)
    drawing.savefig(folder / f"{case['name']}.png", dpi=100)
