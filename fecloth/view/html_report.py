"""report.html: what a run did on one page, which opens from disk and on a phone.

The last frame on the canvas of viewer.py, the energy ledger over time, the extremes of the strain,
step sizes, iterations, where the seconds went, warnings, and the scene. Written by the runner at
the end from the run's own tables; NumPy alone.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fecloth.output.atomic_files import replace_file
from fecloth.output.frame_reader import Frame
from fecloth.view.svg_chart import chart
from fecloth.view.web_page import filled, packed, shown_fields, title_of

MOST_ROWS = 4000  # of a table that are read for a chart
COLUMNS = ("t", "total")  # of the ledger that are no curve of it
PHASES = ("mesh", "bind", "compile", "choose", "assemble", "factor", "solve", "record", "output")
STRETCHES = ("smallest", "1 %", "median", "99 %", "largest")  # columns of strains.csv

Table = Mapping[str, np.ndarray]


def stretch_row(t: float, stretches: np.ndarray) -> dict[str, float]:
    """A row of strains.csv: extremes and percentiles of the principal stretches (m, 2).

    "1 %" is the stretch that one in a hundred triangles falls short of, by its smaller one; "99 %"
    the one that as many exceed, by their larger one; the median is of the larger ones.
    """
    smaller, larger = np.asarray(stretches).T
    values = smaller.min(), np.percentile(smaller, 1), np.median(larger)
    values += np.percentile(larger, 99), larger.max()
    return {"t": float(t)} | {k: float(v) for k, v in zip(STRETCHES, values, strict=True)}


def write_report(folder: Path, summary: Mapping, frame: Frame) -> Path:
    """Write ``folder``/report.html; returns it.

    Parameters
    ----------
    summary
        As in summary.json.
    frame
        The last one.
    """
    tables = {name: read_table(folder / f"{name}.csv") for name in ("steps", "energies", "strains")}
    data = packed([frame], shown_fields(frame))
    words = {"title": title_of(folder), "status": summary["status"], "note": _subtitle(summary)}
    parts = {
        "warnings": _warnings(folder, summary),
        "body": _tiles(summary, tables) + _charts(summary, tables) + _details(folder, summary),
    }
    page = filled("report.html", data, parts, **words)
    file = folder / "report.html"
    replace_file(file, page.encode())
    return file


def read_table(file: Path) -> dict[str, np.ndarray]:
    """Columns of a .csv of numbers; of a long one every k-th row and the last."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    if len(lines) < 2:
        return {}
    head, rows = lines[0].split(","), lines[1:]
    kept = rows[:: math.ceil(len(rows) / MOST_ROWS)]
    kept += [rows[-1]] if kept[-1] is not rows[-1] else []
    values = np.array([row.split(",") for row in kept])
    return {name: _numbers(values[:, i]) for i, name in enumerate(head)}


def _numbers(texts):
    return np.where(texts == "", "nan", texts).astype(float)


# --- words ----------------------------------------------------------------------------------------


def _subtitle(summary):
    words = f"{summary['nodes']} nodes, {summary['triangles']} triangles"
    return f"{words}; {summary['method']}" if summary.get("method") else words


def _warnings(folder, summary):
    """The failure, the doubt of the energy balance, and what the log has warned of."""
    kinds = (("error", "note failed"), ("warning", "note"))
    found = [(kind, item) for key, kind in kinds if (item := summary.get(key))]
    log = folder / "run.log"
    lines = log.read_text(encoding="utf-8").splitlines() if log.is_file() else ()
    told = (line.split(" warning: ", 1)[1] for line in lines if " warning: " in line)
    found += [("note", text) for text in dict.fromkeys(told) if text != summary.get("warning")]
    return "".join(f'<p class="{kind}">{html.escape(str(text))}</p>' for kind, text in found)


def _tiles(summary, tables):
    """The figures one asks for first."""
    seconds = summary["seconds"]["total"]
    tiles = {
        "simulated": f"{summary['t']:.4g} of {summary['t_end']:.4g} s",
        "took": f"{seconds:.3g} s",
        "steps": f"{summary['steps']}",
        "Newton iterations": f"{summary['newton']}",
        "linear iterations": f"{summary['linear']}",
        "energy unexplained": _unexplained(summary, tables["steps"]),
        "frames": f"{summary['frames']}",
    }
    if strains := tables["strains"]:
        extremes = strains["smallest"].min(), strains["largest"].max()
        tiles["stretch, all frames"] = "{:.4g} – {:.4g}".format(*extremes)
    if summary.get("peak_memory_MB"):
        tiles["memory"] = f"{summary['peak_memory_MB']:.0f} MB"
    cells = "".join(
        f"<div><b>{html.escape(value)}</b><span>{html.escape(name)}</span></div>"
        for name, value in tiles.items()
    )
    return f'<div class="tiles">{cells}</div>'


def _unexplained(summary, steps):
    """The ledger's remainder, and how much that is of what has moved."""
    words = f"{summary['ledger']['remainder']:.2g} J"
    return f"{words}, {100 * abs(steps['drift'][-1]):.2g} %" if "drift" in steps else words


def _details(folder, summary):
    """Settings, versions and files, folded away."""
    scene = folder / "scene.resolved.toml"
    text = scene.read_text(encoding="utf-8") if scene.is_file() else ""
    rest = {
        key: value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
        for key, value in summary.items()
        if key not in ("error", "warning", "seconds", "versions", "ledger")
    }
    rows = rest | dict(summary.get("versions", {}))
    table = "".join(
        f"<tr><td>{html.escape(key)}</td><td>{html.escape(str(value))}</td></tr>"
        for key, value in rows.items()
    )
    return (
        f"<details><summary>Scene</summary><pre>{html.escape(text)}</pre></details>"
        f"<details><summary>Numbers and versions</summary><table>{table}</table></details>"
    )


# --- charts ---------------------------------------------------------------------------------------


def _charts(summary, tables):
    steps, energies, strains = (tables[name] for name in ("steps", "energies", "strains"))
    figures = [_energies(energies), _remainder(energies)]
    if strains:
        curves = {name: (strains["t"], strains[name]) for name in STRETCHES}
        figures.append(chart("Principal stretches, at the frames", curves, "t [s]", "stretch"))
    if steps:
        at = steps["t"]
        figures.append(chart("Step size", {"dt": (at, steps["dt"])}, "t [s]", "dt [s]", log=True))
        counts = {"Newton": (at, steps["newton"]), "linear": (at, steps["linear"])}
        counts = {name: curve for name, curve in counts.items() if curve[1].any()}
        figures.append(chart("Iterations a step", counts, "t [s]", "iterations", log=True))
    figures.append(_seconds(summary["seconds"]))
    return f'<div class="charts">{"".join(figures)}</div>'


def _energies(table):
    """The columns of the ledger that are not zero throughout."""
    curves = {
        name: (table["t"], values)
        for name, values in table.items()
        if name not in COLUMNS and np.any(values != 0)
    }
    return chart("Energy ledger", curves, "t [s]", "energy [J]")


def _remainder(table):
    if not table:
        return ""
    curve = table["t"], np.abs(table["remainder"])
    return chart("Energy that stays unexplained", {"|remainder|": curve}, "t [s]", "[J]", log=True)


def _seconds(seconds):
    """Bars of where the time went."""
    total = seconds["total"]
    shares = {name: seconds[name] for name in PHASES if seconds.get(name)}
    shares["other"] = max(total - sum(shares.values()), 0.0)
    rows = "".join(
        f'<span>{name}</span><i style="width:{100 * value / max(shares.values()):.1f}%"></i>'
        f"<span>{value:.3g} s · {100 * value / total:.0f} %</span>"
        for name, value in shares.items()
    )
    head = f"Where {total:.3g} s went"
    return f'<figure><figcaption>{head}</figcaption><div class="bars">{rows}</div></figure>'
