"""Orders of convergence under mesh refinement and in time, each compared with theory.

In space: manufactured solutions (static and dynamic) and closed forms (a strip under its own
weight, the lowest frequencies of a taut square and a taut disk), on structured and Gmsh's meshes,
with linear and quadratic triangles. In time: every method on three motions with known solutions.
An order is the slope of a line fitted to the three finest meshes or the two finest steps. For a
swinging sheet, which has no exact solution, it is the limit of `fc.study.converge`. The exit code
is 1 if an order is missed.

    python -m studies.convergence [--quick] [--jobs N] [--out DIR]
    fecloth converge my.toml          for a scene of yours
"""

from __future__ import annotations

import numpy as np

from fecloth import study
from studies import harness
from studies.convergence.cases import in_time, space
from studies.convergence.swing import conclude_swings, refine_swings
from studies.references import manufactured
from studies.references.time_problems import CASES

PATTERNS = ("right", "cross", "equilateral", "unstructured")
NORMS = {
    "L2": "‖x − exact‖ in L2 [m²]",
    "H1": "‖∇(x − exact)‖ in L2 [m]",
    "energy": "|energy − exact| [J]",
    "frequency": "|ω/exact − 1| [-]",
}
# Order and its tolerance. The energy's error is a sum with both signs: it may fall faster.
ORDERS = {
    "P1": {"L2": (2, 0.1), "H1": (1, 0.1), "energy": (2, 0.2), "frequency": (2, 0.1)},
    "P2": {"L2": (3, 0.15), "H1": (2, 0.1), "energy": (4, 0.3), "frequency": (4, 0.15)},
}
IN_MOTION = (3, 0.3)  # of P2's energy: dt ∝ h^1.5, and its error ∝ dt²
TIME = 0.15
TITLE = "Order of convergence"
PROBLEMS = dict.fromkeys(("static", "dynamic", "strip"), ("L2", "H1", "energy"))
PROBLEMS |= dict.fromkeys(("frequency", "disk"), ("frequency",))
Rows = list[dict]


def space_cases(quick: bool) -> Rows:
    """List the meshes of every problem."""
    meshes = (8, 16, 32) if quick else (8, 16, 32, 64)
    at = {(problem, element): meshes for problem in PROBLEMS for element in ORDERS}
    at["dynamic", "P1"] = (8, 12, 18) if quick else (8, 16, 32, 64)
    at["dynamic", "P2"] = (4, 6, 9) if quick else (4, 8, 16, 32)
    at["strip", "P1"] = at["strip", "P2"] = (16, 32, 64) if quick else (8, 16, 32, 64, 128)
    patterns = dict.fromkeys(PROBLEMS, ("unstructured",) if quick else PATTERNS)
    patterns["disk"] = ("unstructured",)
    return [
        {"problem": problem, "element": element, "pattern": pattern, "n": n}
        for (problem, element), meshes in at.items()
        for pattern in patterns[problem]
        for n in meshes
    ]


def time_cases(quick: bool) -> Rows:
    """List the steps of every method; tests/integrators/test_orders.py does so for --quick."""
    return [
        {"problem": problem, "method": method, "refined": k}
        for problem in ("pendulum", "wave", "swing")
        for method in (("backward_euler", "bdf2", "central_difference") if quick else CASES)
        for k in ((0, 1) if quick else (-2, -1, 0, 1))
    ]


def select_rows(rows: Rows, **key) -> Rows:
    """Return the successful rows with these settings, coarse to fine."""
    selected = [r for r in rows if r["status"] == "ok" and all(r[k] == key[k] for k in key)]
    return sorted(selected, key=lambda row: row.get("n", row.get("steps")))


def order(rows: Rows, step: str, error: str) -> float:
    """Return the slope of log error over log step of the three finest rows; NaN for less than two.

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
    """Return the distinct settings of the keys."""
    return [
        dict(zip(keys, v, strict=True))
        for v in dict.fromkeys(tuple(r[k] for k in keys) for r in rows)
    ]


def expected(problem: str, element: str, norm: str) -> tuple[float, float]:
    """Return the theoretical order and the tolerance of the observed one."""
    return (
        IN_MOTION
        if (problem, element, norm) == ("dynamic", "P2", "energy")
        else ORDERS[element][norm]
    )


def conclude_space(rows: Rows) -> list[harness.Finding]:
    """Return a finding for the order of each norm on each family of meshes."""
    findings = []
    for family in families(rows, "problem", "element", "pattern"):
        problem, element, pattern = family.values()
        group = select_rows(rows, **family)
        for norm in PROBLEMS[problem]:
            theory, tolerance = expected(problem, element, norm)
            high = np.inf if norm == "energy" else theory + tolerance
            what = f"{problem}, {element}, {pattern}: order of {norm}"
            findings.append(
                harness.Finding(what, order(group, "h", norm), theory - tolerance, high)
            )
    return findings


def conclude_time(rows: Rows) -> list[harness.Finding]:
    """Return a finding for the order of each method in the time step."""
    findings = []
    for family in families(rows, "problem", "method"):
        claimed = CASES[family["method"]].traits.order
        what = f"{family['problem']}, {family['method']}: order in dt"
        value = order(select_rows(rows, **family)[-2:], "dt", "end_error")
        findings.append(harness.Finding(what, value, claimed - TIME, claimed + TIME))
    return findings


def table(rows: Rows, step: str, errors: tuple[str, ...]) -> Rows:
    """Return the errors, each with its order against the previous row."""
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


def draw_errors(ax, rows: Rows, norm: str) -> None:
    """Draw errors against h: a colour for each pattern, solid lines for P1, dashed for P2."""
    for family in families(rows, "element", "pattern"):
        group = select_rows(rows, **family)
        look = study.line_style(PATTERNS.index(family["pattern"]))
        look["ls"] = "-" if family["element"] == "P1" else "--"
        points = [(row["h"], row[norm]) for row in group]
        ax.plot(*np.transpose(points), label=" ".join(family.values()), **look)
    ax.set_ylabel(NORMS[norm])


def draw_slopes(ax, orders: list[float]) -> None:
    """Draw a triangle for each expected slope."""
    low, high = ax.get_ylim()
    ax.set_ylim(low / 3, high)
    for i, value in enumerate(sorted(set(orders))):
        harness.draw_slope_triangle(ax, value, at=(0.62 + 0.25 * i, 0.06), width=0.14)


def draw_space(out, rows: Rows, name: str, shown: list[tuple[str, str]]) -> None:
    """Draw a panel for each (problem, norm)."""
    panels = (-(-len(shown) // 2), 2)
    size = {"panels": panels, "size": (9.0, 3.9 * panels[0] + 0.6)}
    with harness.figure(out, name, "edge length h [m]", **size) as (figure, axes):
        figure.get_layout_engine().set(wspace=0.05, hspace=0.05)
        for ax, (problem, norm) in zip(axes.ravel(), shown, strict=True):
            draw_errors(ax, [row for row in rows if row["problem"] == problem], norm)
            ax.set_title(problem if problem == norm else f"{problem}: {norm}")
            draw_slopes(ax, [expected(problem, element, norm)[0] for element in ORDERS])
        figure.legend(
            *axes.ravel()[0].get_legend_handles_labels(), loc="outside lower center", ncols=4
        )


def draw_time(out, rows: Rows) -> None:
    """Draw a panel for each problem, a line for each method, and the legend in the last panel."""
    problems = list(dict.fromkeys(row["problem"] for row in rows))
    size = {"panels": (2, 2), "size": (9.0, 7.8)}
    with harness.figure(out, "time", "time step [ms]", **size) as (figure, axes):
        figure.get_layout_engine().set(wspace=0.05, hspace=0.05)
        *panels, last = axes.ravel()
        for ax, problem in zip(panels, problems, strict=True):
            group = [row | {"dt": 1e3 * row["dt"]} for row in select_rows(rows, problem=problem)]
            harness.draw_lines(ax, group, x="dt", y="end_error", by="method", legend=False)
            ax.set(title=problem, ylabel="‖(x, T v) − exact‖ [m]")
            draw_slopes(ax, [1, 2])
        last.axis("off")
        last.legend(*panels[0].get_legend_handles_labels(), loc="center", fontsize=11)


def main() -> int:
    options = harness.parse_arguments(__doc__)
    running = harness.run_options(options)
    rows = study.run_cases(space_cases(options.quick), space, **running, time_limit=300)
    steps = study.run_cases(time_cases(options.quick), in_time, **running, time_limit=300)
    harness.require_results(options, TITLE, rows + steps)
    swings = refine_swings(options)
    least = manufactured.least_stress()
    findings = [harness.Finding("manufactured: least principal stress [N/m]", least, 1.0)]
    findings += conclude_space(rows) + conclude_time(steps) + conclude_swings(swings)
    static = [("static", norm) for norm in ("L2", "H1", "energy")]
    draw_space(options.out, rows, "convergence", [*static, ("frequency", "frequency")])
    draw_time(options.out, steps)
    tables = {
        problem: table([r for r in rows if r["problem"] == problem], "h", tuple(NORMS))
        for problem in PROBLEMS
    }
    tables["swing, by fc.study.converge"] = swings
    for problem in dict.fromkeys(row["problem"] for row in steps):
        group = [row for row in steps if row["problem"] == problem]
        tables[f"{problem}, in time"] = table(group, "dt", ("end_error",))
    return harness.write_report(
        options,
        TITLE,
        rows + steps + [{"problem": "swing", **row} for row in swings],
        tables=tables,
        figures=("convergence", "time"),
        findings=findings,
        conclusion=f"{sum(f.is_met for f in findings)} of {len(findings)} are as expected.",
    )


if __name__ == "__main__":
    harness.run_main(main)
