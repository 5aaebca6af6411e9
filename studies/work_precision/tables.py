"""Tables of the work-precision study: the cheapest settings, parts of the error, solvers."""

from __future__ import annotations

import math

LEVELS = (0.1, 0.01, 0.001, 0.0001)
Rows = list[dict]


def describe_settings(row: dict) -> str:
    """Describe the settings of a run in words."""
    parts = [row["method"]]
    if row.get("step"):
        adaptive = row["method"].startswith(("Adaptive", "Auto"))
        parts.append(f"rtol {row['step']:g}" if adaptive else f"dt {1e3 * row['step']:.3g} ms")
    parts += [f"h {row['h']:g}", row["element"]]
    parts += [row["model"]] if row["model"] != "StVK" else []
    parts += [row["linear"]] if row["linear"] != "auto" else []
    return ", ".join(parts)


def cheapest(rows: Rows, scene: str, level: float, among=lambda row: True) -> dict | None:
    """Return the row with the fewest seconds whose error is within the level, or None."""
    good = [r for r in rows if r["scene"] == scene and r["status"] == "ok" and among(r)]
    good = [r for r in good if r["total_error"] <= level]
    return min(good, key=lambda row: row["seconds"]) if good else None


def seconds(row: dict | None) -> float:
    return row["seconds"] if row else math.inf


def table_of_cheapest(rows: Rows, scene: str) -> Rows:
    """Return a table of the cheapest settings for each level of error."""
    lines = []
    for level in LEVELS:
        row, line = cheapest(rows, scene, level), {"error at most": f"{100 * level:g} %"}
        if row is None:
            lines.append(line | {"cheapest": "none of these"})
            continue
        line |= {"cheapest": describe_settings(row), "CPU seconds": row["seconds"]}
        line |= {"error [%]": 100 * row["total_error"], "point [%]": 100 * row["point_error"]}
        for name in ("steps", "newton", "factorisations", "force_evaluations"):
            line[name.replace("_", " ")] = row.get(name)
        lines.append(line)
    return lines


def table_of_parts(fine: Rows) -> Rows:
    """Return a table of the errors in space and of the model on each mesh."""
    return [
        {
            "scene": row["scene"],
            "model": row["model"],
            "element": row["element"],
            "h [m]": row["h"],
            "triangles": row["triangles"],
            "space [%]": 100 * row["space_error"],
            "model [%]": 100 * row["model_error"],
            "total [%]": 100 * row["total_error"],
            "point [%]": 100 * row["point_error"],
        }
        for row in fine
        if row["status"] == "ok" and "space_error" in row
    ]


def table_of_solvers(rows: Rows) -> Rows:
    """Return a table of the seconds of the same runs with each linear solver."""
    named = [r for r in rows if r.get("linear", "auto") != "auto" and r["status"] == "ok"]
    same = ("scene", "h", "method", "step", "element", "model")
    lines = {}
    for row in rows:
        at = tuple(row[name] for name in same)
        if row["status"] == "ok" and any(at == tuple(r[name] for name in same) for r in named):
            line = lines.setdefault(at, dict(zip(same[:3], at, strict=False)))
            line |= {"dt [ms]": 1e3 * row["step"], row["linear"] + " [s]": row["seconds"]}
    return list(lines.values())
