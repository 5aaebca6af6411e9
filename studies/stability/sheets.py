"""Taut linear sheets: measured against predicted limits, and the growth of noise beyond them."""

from __future__ import annotations

import math

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.integrators import EXPLICIT, METHODS
from studies import harness

Rows = list[dict]
SIDE, TAUT, TINY = 0.5, 1.05, 1e-7  # [m]; stretch; [m], small enough for linear motion
GROWTH = 1.0  # log of the growth of noise above which a run is unstable
EXACT = fc.Newton(1e-12)
SHEET = {"h": 0.1, "Y": 1000.0, "damping": 0.0, "drag": 0.0}
DRAG = 1500.0  # [1/s]; forward Euler is unstable without


def make_method(name: str):
    """Return the method with its defaults; explicit methods may exceed their limit."""
    return EXPLICIT[name](beyond_limit=True) if name in EXPLICIT else METHODS[name]()


def sheet(h: float, Y: float, damping: float, drag: float = 0.0) -> tuple[fc.System, fc.State]:
    """Return a taut square with a pinned boundary, and its equilibrium."""
    cloth = fc.Cloth.rectangle(SIDE, SIDE, h, "right")
    terms = [fc.StVK()] + ([fc.StrainRateDamping(damping)] if damping else [])
    terms += [fc.MassDamping(drag)] if drag else []
    system = fc.System(cloth, fc.Fabric(0.2, Y, 0.3), terms, pins=["boundary"])
    return system, system.state(TAUT * system.rest().x)


def noise_growth(system: fc.System, rest: fc.State, method, dt: float, steps: int) -> float:
    """Return the log of the growth of noise over the last three quarters of the steps."""
    noise = np.random.default_rng(3).standard_normal(rest.x.shape)
    start = system.state(rest.x + TINY * system.constraints.project(noise))
    sizes, late = [], 1e4 * TINY
    options = {"solver": "direct", "newton": EXACT} if method.traits.stability == (0.0, 0.0) else {}
    for state, _ in fc.march(system, method, start, dt, steps * dt, **options):
        study.check_time_limit()
        sizes.append(np.linalg.norm(state.x - rest.x))
        if sizes[-1] > late:
            return math.inf
    quarter = len(sizes) // 4
    return math.log(max(sizes[-quarter:]) / max(sizes[:quarter]))


def measure_limit(
    method: str,
    h: float,
    Y: float,
    damping: float,
    drag: float = 0.0,
    within: float = 2.0,
    to: float = 1.01,
) -> dict:
    """Return the predicted limit of a taut sheet, and the dt above which noise grows.

    It is sought between the predicted one over `within` and times `within`, up to a factor `to`.
    """
    system, rest = sheet(h, Y, damping, drag)
    limit = fc.critical_dt(system, rest, method)
    row = {"predicted": limit, "by elements": fc.stability.element_bound(system, method)}
    if limit == 0:
        dt = 0.2 * fc.critical_dt(system, rest, "central_difference")
        return row | {"growth": noise_growth(system, rest, make_method(method), dt, 2000)}
    low, high = limit / within, limit * within
    steps = 2000 if method != "forward_euler" else 8000  # noise grows slowly close to the limit
    while high / low > to:
        middle = math.sqrt(low * high)
        if noise_growth(system, rest, make_method(method), middle, steps) > GROWTH:
            high = middle
        else:
            low = middle
    return row | {"measured": math.sqrt(low * high)}


def measure_growth(method: str, times: float) -> dict:
    """Return the growth of noise on a taut sheet at a multiple of the explicit limit."""
    system, rest = sheet(0.1, 1000.0, 0.0)
    dt = times * fc.critical_dt(system, rest, "central_difference")
    return {"dt": dt, "growth": noise_growth(system, rest, make_method(method), dt, 80)}


def sheet_cases(quick: bool) -> Rows:
    """List the settings of all linear sheets; with drag for forward Euler, except for one."""
    sizes = (0.1, 0.05) if quick else (0.1, 0.05, 0.025)
    stiff = (1000.0, 4000.0) if quick else (250.0, 1000.0, 4000.0, 16000.0)
    times = (0.02,) if quick else (1e-4, 1e-3, 1e-2, 0.02)
    listed = [{"method": "forward_euler", **SHEET}]
    for method in ("forward_euler", "central_difference") if quick else EXPLICIT:
        base = {"method": method, **SHEET, "drag": DRAG if method == "forward_euler" else 0.0}
        listed += [{**base, "h": h} for h in sizes] + [{**base, "Y": Y} for Y in stiff]
        if method != "forward_euler":
            listed += [{**base, "h": h, "damping": t} for t in times for h in sizes]
    few = {"within": 1.25, "to": 1.02} if quick else {}
    return [dict(row) | few for row in dict.fromkeys(tuple(row.items()) for row in listed)]


def exponent_of(rows: Rows, method: str, over: str, **fixed: float) -> float:
    """Return the p of the measured limit ∝ (h or Y)^p over the last two values."""
    drag = DRAG if method == "forward_euler" else 0.0
    key = {**SHEET, "method": method, "drag": drag, **fixed}
    own = [r for r in rows if all(r[k] == v for k, v in key.items() if k != over)]
    own = sorted((r for r in own if "measured" in r), key=lambda r: r[over])
    if len(own) < 2:
        return math.nan
    first, last = own[:2] if over == "h" else own[-2:]
    return math.log(last["measured"] / first["measured"]) / math.log(last[over] / first[over])


def conclude_sheets(rows: Rows, free: Rows) -> list[harness.Finding]:
    F, findings = harness.Finding, []
    for method in dict.fromkeys(r["method"] for r in rows):
        own = [r for r in rows if r["method"] == method and "measured" in r]
        off = max((abs(r["measured"] / r["predicted"] - 1) for r in own), default=math.nan)
        findings.append(
            F(f"{method}: measured limit, relative distance from the predicted one", off, high=0.1)
        )
        p = 2.0 if method == "forward_euler" else 1.0
        findings.append(
            F(f"{method}: exponent of h", exponent_of(rows, method, "h"), p - 0.15, p + 0.15)
        )
        value = exponent_of(rows, method, "Y")
        findings.append(F(f"{method}: exponent of Y", value, -p / 2 - 0.05, -p / 2 + 0.05))
        if method != "forward_euler":
            value = exponent_of(rows, method, "h", damping=0.02)
            words = f"{method}: exponent of h where strain-rate damping governs"
            findings.append(F(words, value, 1.85, 2.15))
    (bare,) = [r for r in rows if r["method"] == "forward_euler" and r["drag"] == 0.0]
    findings.append(
        F("forward_euler undamped: predicted limit [s]", bare.get("predicted", math.nan), 0.0, 0.0)
    )
    words = "forward_euler undamped at a fifth of the others' limit: log of growth"
    findings.append(F(words, bare.get("growth", math.nan), GROWTH))
    for method in METHODS:
        growth = max(r.get("growth", math.nan) for r in free if r["method"] == method)
        words = f"{method}: log of growth at 1 to 100 times the explicit limit, linear"
        findings.append(F(words, growth, high=GROWTH))
    return findings


def draw_limits(out, rows: list[dict]) -> None:
    """Draw measured and predicted limits of linear sheets over mesh size, stiffness, damping."""
    labels = {"h": "edge length [m]", "Y": "tensile stiffness [N/m]"}
    labels |= {"damping": "strain-rate damping time [s]"}
    size = {"panels": (1, 3), "size": (10.0, 4.4), "sharey": True}
    with harness.figure(out, "limits", ylabel="largest stable dt [s]", **size) as (figure, axes):
        for ax, (over, label) in zip(axes, labels.items(), strict=True):
            ax.set_xlabel(label)
            for i, method in enumerate(EXPLICIT):
                own = sorted(select_rows(rows, method, over), key=lambda row: row[over])
                look, x = study.line_style(i), [row[over] for row in own]
                ax.plot(x, [row["predicted"] for row in own], "-", color=look["color"])
                look |= {"ls": "", "label": f"{method.replace('_', ' ')}, measured"}
                ax.plot(x, [row["measured"] for row in own], **look)
        axes[0].plot([], [], "-", color="0.3", label="predicted")
        axes[1].label_outer()
        axes[2].label_outer()
        handles = axes[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=2)


def select_rows(rows: list[dict], method: str, over: str) -> list[dict]:
    """Return the rows that differ from the middle sheet only in `over`."""
    middle = {"h": 0.1, "Y": 1000.0, "damping": 0.0}
    own = [row for row in rows if row["method"] == method and "measured" in row]
    same = [k for k in middle if k != over]
    selected = [row for row in own if all(row[k] == middle[k] for k in same)]
    return [row for row in selected if row[over] > 0]
