"""report.html: what a run did on one page, which opens from disk and on a phone.

The last frame on the canvas of `web_page`, warnings, main results, charts of the tables, where
the seconds went, the scene and the summary. Made at the end of a run by page/report.html.
"""

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import amount
from fecloth.output.atomic_files import replace_file
from fecloth.output.frame_reader import Frame
from fecloth.output.obstacle_frames import Obstacles
from fecloth.view.charts import Chart, draw, observed_charts
from fecloth.view.web_page import fill_template, pack_frames, shown_fields, title_of

STRETCHES = ("smallest", "1 %", "median", "99 %", "largest")  # columns of strains.csv
PHASES = ("mesh", "bind", "compile", "choose", "assemble", "factor", "solve", "record", "output")

Table = Mapping[str, np.ndarray]


def write_report(
    folder: Path,
    summary: Mapping[str, Any],
    tables: Mapping[str, Table],
    frame: Frame,
    obstacles: Obstacles | None = None,
    answers: Mapping[str, tuple[str, ...]] | None = None,
    checks: Sequence[str] = (),
) -> Path:
    """Write ``folder``/report.html and return its path.

    Parameters
    ----------
    folder
        The folder of the run.
    summary
        The contents of summary.json.
    tables
        The columns of the tables of the run, by their names without .csv.
    frame, obstacles
        The last frame of the run, and its obstacles.
    answers
        By the name of each quantity: its value with its error in words, and lines below it; an
        empty line does not show. The answers are the first tiles.
    checks
        Sentences on what may be a mistake in the set-up; they stand below the warnings.
    """
    unit = summary["unit"]
    # The line below the title: how large the run was.
    sizes = f"{summary['nodes']} nodes, {amount(summary['triangles'], 'triangle')}"
    status = summary["status"]
    badge = status  # the class of the mark beside the title, which gives its colour
    if status == "done" and summary["warnings"]:
        status += ", with warnings"
        badge = "warned"
    is_static = unit != " s"
    values = {
        "title": title_of(folder),
        "status": status,
        "badge": badge,
        "note": f"{sizes}; {summary['method']}",
        "error": summary["error"],
        "warnings": [*summary["warnings"], *checks],
        "results": [text for key, text in summary.items() if key.endswith("_in_words")],
        "answers": answers or {},
        "tiles": _tiles(summary, tables["steps"]),
        "charts": draw(_charts(tables, is_static), "part of the loads" if is_static else "t [s]"),
        "seconds": summary["seconds"]["total"],
        "bars": _bars(summary["seconds"]),
        "scene": (folder / "scene.resolved.toml").read_text(encoding="utf-8"),
        "summary": json.dumps(summary, indent=2, ensure_ascii=False, default=str),
    }
    data = pack_frames([frame], shown_fields(frame), unit, [obstacles])
    file = folder / "report.html"
    replace_file(file, fill_template("report.html", data, values).encode())
    return file


def read_table(file: Path) -> dict[str, np.ndarray]:
    """Return the columns of a .csv of numbers by their names; {} without rows or file.

    An empty cell is NaN.
    """
    if not file.is_file():
        return {}
    head, *rows = file.read_text(encoding="utf-8").splitlines() or [""]
    if not rows:
        return {}
    format_of_csv: dict[str, Any] = {"delimiter": ",", "ndmin": 2, "encoding": None}
    values = np.loadtxt(rows, converters=lambda cell: float(cell or "nan"), **format_of_csv)
    names = next(csv.reader([head]))  # a name with a comma stands in quotes
    return dict(zip(names, values.T.copy(), strict=True))


def _tiles(summary: Mapping[str, Any], steps: Table) -> dict[str, object]:
    """Return the main numbers of a run by their titles, without those that it did not count.

    A count of 0 is left out. `steps` is the table of the steps.
    """
    remainder = f"{summary['ledger']['remainder']:.2g} J"
    if "drift" in steps:  # relative to the energy that has moved
        remainder += f", {100 * abs(steps['drift'][-1]):.2g} %"
    tiles = {
        "simulated": f"{summary['t']:.4g} of {summary['t_end']:.4g}{summary['unit']}",
        "took": f"{summary['seconds']['total']:.3g} s",
        "steps": summary["steps"],
        "Newton iterations": summary["newton"],
        "linear iterations": summary["linear"],
        "energy unexplained": remainder,
        "frames": summary["frames"],
        "stretch": f"{summary['least_stretch']:.4g} – {summary['largest_stretch']:.4g}",
        "pairs that intersect": summary["intersecting_pairs"],
        "triangles turned over": summary["inverted_triangles"],
    }
    return {title: value for title, value in tiles.items() if value}


def _charts(tables: Mapping[str, Table], is_static: bool) -> Iterator[Chart]:
    """Yield the charts of a run; of a static one without steps and unexplained energy."""
    yield from observed_charts(tables["observed"])
    if energies := tables["energies"]:
        t = energies["t"]
        curves = {name: y for name, y in energies.items() if name not in ("t", "total") and y.any()}
        yield Chart("Energy ledger", "energy [J]", t, curves)
    if strains := tables["strains"]:
        curves = {name: strains[name] for name in STRETCHES}
        yield Chart("Principal stretches, at the frames", "stretch", strains["t"], curves)
    if energies and not is_static:
        curves = {"|remainder|": np.abs(energies["remainder"])}
        yield Chart("Energy that stays unexplained", "energy [J]", t, curves, log=True)
    if (steps := tables["steps"]) and not is_static:
        t = steps["t"]
        yield Chart("Step size", "dt [s]", t, {"dt": steps["dt"]}, log=True)
        # A count that is zero throughout, as with an explicit method, has no curve.
        curves = {name: steps[name] for name in ("newton", "linear")}
        yield Chart("Iterations a step", "iterations", t, curves, log=True)


def _bars(seconds: Mapping[str, float]) -> Iterator[dict[str, str]]:
    """Yield a bar for each phase that took time."""
    total = seconds["total"]
    shares = {name: seconds[name] for name in PHASES if seconds.get(name)}
    shares["other"] = max(total - sum(shares.values()), 0.0)
    for name, value in shares.items():
        width = f"{100 * value / max(shares.values()):.1f}"
        text = f"{value:.3g} s · {100 * value / total:.0f} %"
        yield {"name": name, "width": width, "text": text}
