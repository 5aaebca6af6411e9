"""Tables of the stability maps: the largest usable step of each method and scene."""

from __future__ import annotations

import math

from studies.stability.cases import ALL, STABLE, WRONG

Rows = list[dict]


def tables_of(rows: Rows) -> dict[str, Rows]:
    return {
        "Largest dt up to which all runs are stable and right": largest_steps(rows, (STABLE,)),
        "Largest dt up to which no run fails": largest_steps(rows, (STABLE, WRONG)),
    }


def largest_steps(rows: Rows, allowed: tuple[str, ...]) -> Rows:
    """Return for each scene and method the largest dt up to which all runs are allowed.

    A cell is a text: "25 ms", "≥ 25 ms" if that is the largest step that was tried, "< 49 µs" if
    not even the smallest one was allowed, "-" without a run; then the predicted limit.
    """
    own = [r for r in rows if r["over"] == "stiffness" and r["stiffness"] == 1.0]
    table = []
    for scene in dict.fromkeys(r["scene"] for r in own):
        line = {"scene": scene}
        for method in ALL:
            cells = cells_of(own, scene, method)
            line[method] = describe_step(*step_range(cells, allowed))
            limits = [r["limit"] for r in cells if r.get("limit")]
            if limits:
                line[method] += f" (predicted {in_seconds(limits[0])})"
        table.append(line)
    return table


def cells_of(rows: Rows, scene: str, method: str) -> Rows:
    """Return the cells of a method on a scene."""
    return [r for r in rows if (r["scene"], r.get("method")) == (scene, method)]


def step_range(cells: Rows, allowed: tuple[str, ...]) -> tuple[float, float]:
    """Return the largest dt at and below which all cells are allowed, and the next one tried.

    The first is 0 if the smallest dt is not allowed, the second infinite if all are, or if the next
    cell failed.

    Examples
    --------
    >>> ok = {"status": "ok", "outcome": "stable"}
    >>> cells = [ok | {"dt": 1, "steps": 4}, ok | {"dt": 2, "steps": 2}]
    >>> worse = {"dt": 4, "steps": 1, "status": "ok", "outcome": "blew up"}
    >>> step_range([*cells, worse], ("stable",)), step_range(cells, ("stable",))
    ((2, 4), (2, inf))
    >>> step_range([{"steps": 4, "status": "error"}, cells[1]], ("stable",))
    (0.0, inf)
    """
    largest = 0.0
    for cell in sorted(cells, key=lambda cell: -cell["steps"]):
        if cell["status"] != "ok":
            break
        if cell["outcome"] not in allowed:
            return largest, cell["dt"]
        largest = cell["dt"]
    return largest, math.inf


def describe_step(largest: float, above: float) -> str:
    """Return the text of a range from `step_range`.

    Examples
    --------
    >>> [describe_step(*r) for r in ((0.025, math.inf), (0.0, 4.9e-5), (0.01, 0.02), (0, math.inf))]
    ['≥ 25 ms', '< 49 µs', '10 ms', '-']
    """
    if largest == 0.0:
        return "-" if math.isinf(above) else f"< {in_seconds(above)}"
    return f"{'≥ ' * math.isinf(above)}{in_seconds(largest)}"


def in_seconds(dt: float) -> str:
    """Return a time with its unit, to two or three digits.

    Examples
    --------
    >>> in_seconds(0.025), in_seconds(3.125e-5), in_seconds(1.5)
    ('25 ms', '31.2 µs', '1.5 s')
    """
    for unit, factor in (("s", 1.0), ("ms", 1e3)):
        if dt * factor >= 1:
            return f"{dt * factor:.3g} {unit}"
    return f"{dt * 1e6:.3g} µs"


def describe_result(rows: Rows) -> str:
    """Return a sentence for each scene: the methods with the largest right steps."""
    own = [r for r in rows if r["over"] == "stiffness" and r["stiffness"] == 1.0]
    lines = []
    for scene in dict.fromkeys(r["scene"] for r in own):
        ranges = {
            method: step_range(cells, (STABLE,))
            for method in ALL
            if (cells := cells_of(own, scene, method))
        }
        most = max((largest for largest, _ in ranges.values()), default=0.0)
        if most == 0.0:
            lines.append(f"- {scene}: no method is right at any of the steps that were tried.")
            continue
        names = [method for method, (largest, _) in ranges.items() if largest == most]
        is_limit = math.isinf(ranges[names[0]][1])
        how = "the largest step that was tried" if is_limit else "the largest step that is right"
        verb = "is" if len(names) == 1 else "are"
        lines.append(f"- {scene}: {', '.join(names)} {verb} right up to {in_seconds(most)}, {how}.")
    return "\n".join(lines)
