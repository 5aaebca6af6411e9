"""report.html: what a run did on one page, which opens from disk and on a phone.

The last frame on the canvas of `web_page`, the energy ledger over time, the extremes of the
strain, step sizes, iterations, where the seconds went, warnings, and the scene. Made at the
end of a run from its tables by page/report.html; needs NumPy alone.
"""

import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import amount
from fecloth.output.atomic_files import replace_file
from fecloth.output.frame_reader import Frame
from fecloth.output.obstacle_frames import Obstacles
from fecloth.view.svg_chart import chart, observed_charts
from fecloth.view.web_page import fill_template, pack_frames, shown_fields, title_of

MOST_ROWS = 4000  # of a table that are read for a chart, so that long runs do not delay it
STRETCHES = ("smallest", "1 %", "median", "99 %", "largest")  # columns of strains.csv
COLUMNS = ("t", "total")  # of the ledger that are no curve of it
PHASES = ("mesh", "bind", "compile", "choose", "assemble", "factor", "solve", "record", "output")

TABLES = ("steps", "energies", "observed", "strains")


def write_report(
    folder: Path, summary: Mapping, frame: Frame, obstacles: Obstacles | None = None
) -> Path:
    """Write ``folder``/report.html and return its path.

    Parameters
    ----------
    folder
        The folder of the run, with its tables.
    summary
        The contents of summary.json.
    frame, obstacles
        The last frame of the run, and its obstacles.
    """
    tables = {name: read_table(folder / f"{name}.csv") for name in TABLES}
    data = pack_frames([frame], shown_fields(frame), summary.get("unit", " s"), [obstacles])
    if _is_static(summary):
        charts = _static_charts(tables)
    else:
        charts = _charts(tables)
    # The line below the title: how large the run was.
    note = f"{summary['nodes']} nodes, {amount(summary['triangles'], 'triangle')}"
    if summary.get("method"):
        note += f"; {summary['method']}"
    status = summary["status"]
    badge = status  # the class of the mark beside the title, which gives its colour
    if doubtful(summary):
        status += ", with warnings"
        badge = "warned"
    values = {
        "title": title_of(folder),
        "status": status,
        "badge": badge,
        "note": note,
        "model": _model(folder),
        "warnings": _warnings(folder, summary),
        "tiles": _tiles(summary, tables),
        "charts": charts,
        "spent": f"Where {summary['seconds']['total']:.3g} s went",
        "bars": _bars(summary["seconds"]),
        "scene": _text(folder / "scene.resolved.toml"),
        "numbers": _remaining_entries(summary),
    }
    page = fill_template("report.html", data, values)
    file = folder / "report.html"
    replace_file(file, page.encode())
    return file


def _text(file: Path) -> str:
    """Return the text of a file, or "" if there is none."""
    if file.is_file():
        return file.read_text(encoding="utf-8")
    return ""


def read_table(file: Path, most: float = MOST_ROWS) -> dict[str, np.ndarray]:
    """Return the columns of a .csv of numbers by their names; {} without a file or rows.

    An empty cell is NaN. Of a table with more rows than `most`, the columns have every k-th row
    and the last row, where k is as small as possible.
    """
    head, *rows = _text(file).splitlines() or [""]
    if not rows:
        return {}
    sample = rows[:: math.ceil(len(rows) / min(most, len(rows)))]
    if sample[-1] is not rows[-1]:
        sample.append(rows[-1])
    format_of_csv: dict[str, Any] = {"delimiter": ",", "ndmin": 2, "encoding": None}
    values = np.loadtxt(sample, converters=lambda cell: float(cell or "nan"), **format_of_csv)
    return dict(zip(head.split(","), values.T.copy(), strict=True))


def doubtful(summary: Mapping) -> bool:
    """Return whether a run came to its end with warnings: its badge is then amber."""
    return summary["status"] == "done" and bool(summary.get("warnings"))


def _model(folder: Path) -> str:
    """Return the fabrics and terms of the scene in words, or "" without a fabric.

    The scene is read from the folder of the run.
    """
    scene = tomllib.loads(_text(folder / "scene.resolved.toml"))
    if not (fabric := scene.get("fabric")):
        return ""
    regions = fabric  # the fabric of each region by its name, or the constants of one fabric
    if "areal_density" in fabric:
        regions = {"Fabric": fabric}
    words = [f"{name}: {_constants(constants)}" for name, constants in regions.items()]
    terms = ", ".join(term["type"] for term in scene.get("terms", ())) or "none"
    return "; ".join([*words, f"terms: {terms}"])


def _constants(fabric: Mapping) -> str:
    """Return the main constants of a fabric in words; pairs of warp and weft as 1 × 2."""
    words = [f"{1000 * fabric['areal_density']:.4g} g/m²"]
    for key, unit in (("tensile_stiffness", "N/m"), ("bending_rigidity", "N m")):
        if value := fabric.get(key):
            numbers = value if isinstance(value, list) else [value]
            text = " × ".join(f"{number:.4g}" for number in numbers)
            words.append(f"{key.partition('_')[0]} {text} {unit}")
    return ", ".join(words)


def _warnings(folder, summary) -> Iterator[dict[str, str]]:
    """Yield the failure, the warnings of the summary, and warnings that only the log has."""
    if text := summary.get("error"):
        yield {"kind": "note failed", "text": str(text)}
    lines = _text(folder / "run.log").splitlines()
    logged = (line.split(" warning: ", 1)[1] for line in lines if " warning: " in line)
    for text in dict.fromkeys([*summary.get("warnings", ()), *logged]):
        yield {"kind": "note", "text": text}


def _tiles(summary, tables) -> dict[str, str]:
    """Return the main results of a run as texts by their titles, one for each tile of the page.

    `tables` are the tables of `TABLES` by their names. What the run did not have is left out.
    """
    seconds = summary["seconds"]["total"]
    tiles = {
        "simulated": f"{summary['t']:.4g} of {summary['t_end']:.4g}{summary.get('unit', ' s')}",
        "took": f"{seconds:.3g} s",
        "steps": f"{summary['steps']}",
        "Newton iterations": f"{summary['newton']}",
        "linear iterations": f"{summary['linear']}",
        **_doubts(summary, tables["steps"]),
        "error in space": _error(summary, "space"),
        "frames": f"{summary['frames']}",
    }
    if strains := tables["strains"]:
        smallest = strains["smallest"].min()
        largest = strains["largest"].max()
        tiles["stretch, all frames"] = f"{smallest:.4g} – {largest:.4g}"
    if (pairs := summary.get("intersecting_pairs")) is not None:
        tiles["pairs that intersect"] = str(pairs)
    if turned := summary.get("inverted_triangles"):
        tiles["triangles turned over"] = str(turned)
    if summary.get("peak_memory_MB"):
        tiles["memory"] = f"{summary['peak_memory_MB']:.0f} MB"
    return tiles


def _is_static(summary) -> bool:
    """Return whether the run was static: then t is the part of the loads."""
    return summary.get("unit", " s") != " s"


def _doubts(summary, steps) -> dict[str, str]:
    """Return tiles on how wrong a run may be in time; for a static one, whether it is stable.

    They are texts by their titles; `steps` is the table of the steps.
    """
    if not _is_static(summary):
        energy = _unexplained(summary, steps)
        return {"energy unexplained": energy, "error in time": _error(summary, "time")}
    words = summary["time_error_in_words"].removeprefix("equilibrium: ")
    least = summary.get("least_eigenvalue")
    if least is None:
        return {"equilibrium": words}
    words = words.partition(";")[0]  # what follows states the eigenvalue, which has a tile here
    return {"equilibrium": words, "least eigenvalue of K": f"{least:.4g} N/m"}


def _error(summary, of):
    """Return the estimate of the error in time or space in words; older runs have none."""
    words = summary.get(f"{of}_error_in_words", "no estimate").removeprefix(f"error in {of}")
    return words.partition(";")[0].partition(", as")[0].removeprefix(":").strip()


def _unexplained(summary, steps):
    """Return the ledger's remainder, and its part of the energy that has moved."""
    words = f"{summary['ledger']['remainder']:.2g} J"
    if "drift" in steps:
        return f"{words}, {100 * abs(steps['drift'][-1]):.2g} %"
    return words


def _remaining_entries(summary) -> dict[str, str]:
    """Return as text the entries of the summary that are not elsewhere on the page, and versions.

    An entry has its key, and a version has the name of its program.
    """
    elsewhere = ("error", "warning", "warnings", "seconds", "ledger")
    entries = {}
    for key, value in summary.items():
        if key in elsewhere:
            continue
        if key == "versions":  # not as one row, but as one row for each program, below
            continue
        if not isinstance(value, str):
            value = json.dumps(value, ensure_ascii=False, default=str)
        entries[key] = value
    return entries | {name: str(value) for name, value in summary.get("versions", {}).items()}


def _charts(tables) -> list[str]:
    """Return the charts of a run over time as HTML, with "" for a chart without curves."""
    steps, energies, observed, strains = (tables[name] for name in TABLES)
    figures = [*observed_charts(observed), _energies(energies), _remainder(energies)]
    if strains:
        curves = {name: (strains["t"], strains[name]) for name in STRETCHES if name in strains}
        figures.append(chart("Principal stretches, at the frames", curves, "t [s]", "stretch"))
    if steps:
        t = steps["t"]
        sizes = {"dt": (t, steps["dt"])}
        figures.append(chart("Step size", sizes, "t [s]", "dt [s]", log=True))
        counts = {"Newton": (t, steps["newton"]), "linear": (t, steps["linear"])}
        # A count that is zero throughout, as with an explicit method, has no curve.
        counts = {name: curve for name, curve in counts.items() if curve[1].any()}
        figures.append(chart("Iterations a step", counts, "t [s]", "iterations", log=True))
    return figures


def _static_charts(tables) -> list[str]:
    """Return the charts over the part of the loads, without steps and unexplained energy."""
    tables_without_steps = tables | {"steps": {}}
    figures = _charts(tables_without_steps)
    drawn = [figure for figure in figures if "Energy that stays" not in figure]
    return [figure.replace("t [s]", "part of the loads") for figure in drawn]


def _energies(table):
    """Draw the columns of the ledger that are not zero throughout."""
    curves = {
        name: (table["t"], values)
        for name, values in table.items()
        if name not in COLUMNS and np.any(values != 0)
    }
    return chart("Energy ledger", curves, "t [s]", "energy [J]")


def _remainder(table):
    """Draw the energy that the ledger cannot explain."""
    if not table:
        return ""
    curves = {"|remainder|": (table["t"], np.abs(table["remainder"]))}
    return chart("Energy that stays unexplained", curves, "t [s]", "[J]", log=True)


def _bars(seconds) -> Iterator[dict[str, str]]:
    """Yield a bar for each phase that took time."""
    total = seconds["total"]
    shares = {name: seconds[name] for name in PHASES if seconds.get(name)}
    shares["other"] = max(total - sum(shares.values()), 0.0)
    for name, value in shares.items():
        width = f"{100 * value / max(shares.values()):.1f}"
        text = f"{value:.3g} s · {100 * value / total:.0f} %"
        yield {"name": name, "width": width, "text": text}
