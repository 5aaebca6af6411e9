"""Order of convergence under mesh refinement and in time, with a verdict on each.

In space: manufactured solutions (static and dynamic), closed forms (a strip under its own weight,
the lowest frequency of a taut sheet, that of a disk), on structured and Gmsh's meshes, with linear
and quadratic triangles. In time: every registered method on three motions that are known
otherwise. An order is the slope of the line fitted to the three finest, in time to the two. Where
nothing is exact, a swinging sheet with bending, it is Richardson's. The exit code is 1 if one is
missed. `--scene` halves h and dt of a scene of your own and tells what it is off by.

    python -m studies.convergence [--quick] [--jobs N] [--out DIR] [--scene my.toml]
"""

from __future__ import annotations

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.study import richardson
from studies.convergence.cases import in_time, space, swing
from studies.references import manufactured
from studies.references.time_problems import CASES

PATTERNS = ("right", "cross", "equilateral", "unstructured")
NORMS = {
    "L2": "‖x − exact‖ in L2 [m²]",
    "H1": "‖∇(x − exact)‖ in L2 [m]",
    "energy": "|energy − exact| [J]",
    "frequency": "|ω/exact − 1| [-]",
}
# Order and how far from it. The energy's error is a sum of either sign: it may fall faster.
ORDERS = {
    "P1": {"L2": (2, 0.1), "H1": (1, 0.1), "energy": (2, 0.2), "frequency": (2, 0.1)},
    "P2": {"L2": (3, 0.15), "H1": (2, 0.1), "energy": (4, 0.3), "frequency": (4, 0.15)},
}
DISK = (2, 0.1)  # P2 as well: its edges are straight
IN_MOTION = (3, 0.3)  # of P2's energy: the steps fall as h^1.5, their error as dt²
TIME = 0.15
# Of the swing; without bending a kink runs through the sheet, and P1 meets it as h^3/2 and h^1/2.
SWING = {"HingeBending": {"L2": (2, 0.15), "H1": (1, 0.1), "depth": (2, 0.15)}}
NO_ORDER = ("order of L2", "order of H1", "order of depth")  # where a mesh failed
SWING["QuadraticBending"] = SWING["HingeBending"]
SWING["none"] = {"L2": (1.5, 0.2), "H1": (0.5, 0.15)}
PROBLEMS = dict.fromkeys(("static", "dynamic", "strip"), ("L2", "H1", "energy"))
PROBLEMS |= dict.fromkeys(("frequency", "disk"), ("frequency",))
Rows = list[dict]


def asked(quick: bool) -> Rows:
    """The meshes of every problem."""
    meshes = (8, 16, 32) if quick else (8, 16, 32, 64)
    at = {(problem, element): meshes for problem in PROBLEMS for element in ORDERS}
    at["dynamic", "P1"] = (16, 32, 64) if quick else (8, 16, 32, 64)
    at["dynamic", "P2"] = (4, 8, 16) if quick else (4, 8, 16, 32)
    at["strip", "P1"] = at["strip", "P2"] = (16, 32, 64) if quick else (8, 16, 32, 64, 128)
    patterns = dict.fromkeys(PROBLEMS, ("right", "unstructured") if quick else PATTERNS)
    patterns["disk"] = ("unstructured",)
    if quick:
        patterns["dynamic"] = patterns["disk"]
    return [
        {"problem": problem, "element": element, "pattern": pattern, "n": n}
        for (problem, element), meshes in at.items()
        for pattern in patterns[problem]
        for n in meshes
    ]


def timed(quick: bool) -> Rows:
    """The steps of every method."""
    return [
        {"problem": problem, "method": method, "refined": k}
        for problem in ("pendulum", "wave", "swing")
        for method in CASES
        for k in ((0, 1) if quick else (-2, -1, 0, 1))
    ]


def swung(quick: bool) -> Rows:
    """The meshes of the swing: nested ones, on which hinges carry one bending rigidity."""
    return [
        {"bending": bending, "pattern": pattern, "n": n}
        for bending in (("HingeBending", "none") if quick else SWING)
        for pattern in (("right",) if quick else ("right", "cross"))
        for n in (16, 32, 64)
    ]


def path(rows: Rows, **key) -> Rows:
    """The rows with these settings that are sound, coarse to fine."""
    own = [r for r in rows if r["status"] == "ok" and all(r[k] == key[k] for k in key)]
    return sorted(own, key=lambda row: row.get("n", row.get("steps")))


def order(rows: Rows, step: str, error: str) -> float:
    """Slope of log error over log step through the three finest rows; NaN for less than two.

    Examples
    --------
    >>> order([{"h": h, "e": 3 * h**2} for h in (0.4, 0.2, 0.1)], "h", "e")
    2.0
    """
    finest = rows[-3:]
    if len(finest) < 2:
        return float("nan")
    h, e = ([row[name] for row in finest] for name in (step, error))
    return round(float(np.polyfit(np.log(h), np.log(e), 1)[0]), 6)


def families(rows: Rows, *keys: str) -> Rows:
    """The distinct settings of those keys."""
    return [
        dict(zip(keys, v, strict=True))
        for v in dict.fromkeys(tuple(r[k] for k in keys) for r in rows)
    ]


def expected(problem: str, element: str, norm: str) -> tuple[float, float]:
    """The order that theory gives, and how far from it an observed one may be."""
    if problem == "disk":
        return DISK
    return (
        IN_MOTION
        if (problem, element, norm) == ("dynamic", "P2", "energy")
        else ORDERS[element][norm]
    )


def conclude(rows: Rows) -> list[study.Finding]:
    """The order of each norm of each family of meshes."""
    found = []
    for family in families(rows, "problem", "element", "pattern"):
        problem, element, pattern = family.values()
        own = path(rows, **family)
        for norm in PROBLEMS[problem]:
            asked_for, off = expected(problem, element, norm)
            high = np.inf if norm == "energy" else asked_for + off
            what = f"{problem}, {element}, {pattern}: order of {norm}"
            found.append(study.Finding(what, order(own, "h", norm), asked_for - off, high))
    return found


def conclude_time(rows: Rows) -> list[study.Finding]:
    """The order of each method in the time step."""
    found = []
    for family in families(rows, "problem", "method"):
        claimed = CASES[family["method"]].traits.order
        what = f"{family['problem']}, {family['method']}: order in dt"
        value = order(path(rows, **family)[-2:], "dt", "end_error")
        found.append(study.Finding(what, value, claimed - TIME, claimed + TIME))
    return found


def compare(rows: Rows) -> Rows:
    """For each family of the swing: the distances of its meshes, orders, the depth's limit."""
    lines = []
    for family in families(rows, "bending", "pattern"):
        own = path(rows, **family)
        if len(own) < 3:
            lines.append({**family, **dict.fromkeys(NO_ORDER, float("nan"))})
            continue
        cloths = [fc.Cloth.rectangle(1.0, 0.5, row["h"], family["pattern"]) for row in own]
        ends, depths = [np.array(row["x"]) for row in own], np.array([row["depth"] for row in own])
        apart = {norm: richardson.distances(cloths, ends, norm.lower()) for norm in ("L2", "H1")}
        apart["depth"] = np.diff(depths)
        line = {f"order of {k}": float(richardson.orders(d)[-1]) for k, d in apart.items()}
        line |= {
            "depth [m]": depths[-1],
            "limit [m]": depths[-1] + richardson.remaining_error(np.diff(depths)),
        }
        off = richardson.remaining_error(apart["L2"])
        lines.append({**family, "finest h": own[-1]["h"], **line, "L2 error left [m²]": off})
    return lines


def conclude_swing(lines: Rows) -> list[study.Finding]:
    """The orders of self-convergence."""
    found = []
    for line in lines:
        for norm, (asked_for, off) in SWING[line["bending"]].items():
            what = f"swing, {line['bending']}, {line['pattern']}: order of {norm}"
            value = line[f"order of {norm}"]
            found.append(study.Finding(what, value, asked_for - off, asked_for + off))
    return found


def table(rows: Rows, step: str, errors: tuple[str, ...]) -> Rows:
    """The errors, each with its order since the row before."""
    lines, before = [], {}
    for row in rows:
        line = {k: row[k] for k in ("element", "pattern", "method", step, "nodes") if k in row}
        for name in (e for e in errors if e in row):
            family = (row.get("element"), row.get("pattern"), row.get("method"), name)
            line[name] = row[name]
            line[f"order of {name}"] = order([*before.get(family, ()), row], step, name)
            before[family] = [row]
        lines.append(line)
    return lines


def draw(ax, rows: Rows, norm: str) -> None:
    """A norm's errors against h: a colour for each pattern, P1 in full lines and P2 in dashes."""
    for family in families(rows, "element", "pattern"):
        own = path(rows, **family)
        look = study.line_style(PATTERNS.index(family["pattern"]))
        look["ls"] = "-" if family["element"] == "P1" else "--"
        points = [(row["h"], row[norm]) for row in own]
        ax.plot(*np.transpose(points), label=" ".join(family.values()), **look)
    ax.set_ylabel(NORMS[norm])


def slopes(ax, orders: list[float]) -> None:
    """A triangle for each expected slope."""
    low, high = ax.get_ylim()
    ax.set_ylim(low / 3, high)
    for i, order_ in enumerate(sorted(set(orders))):
        study.draw_slope_triangle(ax, order_, at=(0.62 + 0.25 * i, 0.06), width=0.14)


def draw_space(out, rows: Rows, name: str, shown: list[tuple[str, str]]) -> None:
    """A panel for each (problem, norm)."""
    panels = (-(-len(shown) // 2), 2)
    size = {"panels": panels, "size": (9.0, 3.9 * panels[0] + 0.6)}
    with study.figure(out, name, "edge length h [m]", **size) as (figure, axes):
        figure.get_layout_engine().set(wspace=0.05, hspace=0.05)
        for ax, (problem, norm) in zip(axes.ravel(), shown, strict=True):
            draw(ax, [row for row in rows if row["problem"] == problem], norm)
            ax.set_title(problem if problem == norm else f"{problem}: {norm}")
            slopes(ax, [expected(problem, element, norm)[0] for element in ORDERS])
        figure.legend(
            *axes.ravel()[0].get_legend_handles_labels(), loc="outside lower center", ncols=4
        )


def draw_time(out, rows: Rows) -> None:
    """A panel for each problem, a line for each method, the legend in the last."""
    problems = list(dict.fromkeys(row["problem"] for row in rows))
    size = {"panels": (2, 2), "size": (9.0, 7.8)}
    with study.figure(out, "time", "time step [ms]", **size) as (figure, axes):
        figure.get_layout_engine().set(wspace=0.05, hspace=0.05)
        *panels, last = axes.ravel()
        for ax, problem in zip(panels, problems, strict=True):
            own = [row | {"dt": 1e3 * row["dt"]} for row in path(rows, problem=problem)]
            study.draw_lines(ax, own, x="dt", y="end_error", by="method", legend=False)
            ax.set(title=problem, ylabel="‖(x, T v) − exact‖ [m]")
            slopes(ax, [1, 2])
        last.axis("off")
        last.legend(*panels[0].get_legend_handles_labels(), loc="center", fontsize=11)


def main() -> int:
    options = study.parse_arguments(__doc__)
    if options.scene:
        return richardson.refine_scene(options)
    running = study.run_options(options)
    rows = study.run_cases(asked(options.quick), space, **running, time_limit=300)
    steps = study.run_cases(timed(options.quick), in_time, **running, time_limit=300)
    swings = study.run_cases(swung(options.quick), swing, **running, time_limit=300)
    compared = compare(swings)
    least = manufactured.least_stress()
    findings = [study.Finding("manufactured: least principal stress [N/m]", least, 1.0)]
    findings += conclude(rows) + conclude_time(steps) + conclude_swing(compared)
    static = [("static", norm) for norm in ("L2", "H1", "energy")]
    draw_space(options.out, rows, "convergence", [*static, ("frequency", "frequency")])
    draw_space(options.out, rows, "dynamic", [("dynamic", "L2"), ("dynamic", "H1")])
    draw_space(options.out, rows, "strip", [("strip", "L2"), ("strip", "H1")])
    draw_time(options.out, steps)
    tables = {
        problem: table([r for r in rows if r["problem"] == problem], "h", tuple(NORMS))
        for problem in PROBLEMS
    }
    tables["swing, by itself"] = compared
    for problem in dict.fromkeys(row["problem"] for row in steps):
        own = [row for row in steps if row["problem"] == problem]
        tables[f"{problem}, in time"] = table(own, "dt", ("end_error",))
    return study.write_report(
        options,
        "Order of convergence",
        rows + steps + [{"problem": "swing", **row} for row in swings],
        tables=tables,
        figures=("convergence", "dynamic", "strip", "time"),
        findings=findings,
        conclusion=f"{sum(f.is_met for f in findings)} of {len(findings)} are as expected.",
    )


if __name__ == "__main__":
    raise SystemExit(main())
