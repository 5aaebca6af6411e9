"""The figure of friction in a fabric: loop of the law, shapes of a cantilever, when it matters."""

from __future__ import annotations

import numpy as np

from fecloth import study
from studies import harness
from studies.evidence.bending import friction_cases as cases

BLUE, RED, GREEN, _, _, SKY, _ = study.COLOURS
KNOWN = {"color": "0.35", "lw": 1.2, "ls": "--"}
LOAD, MOST = 1.8, 3.0  # the moment of the load over HB, the largest curvature over HB/B


def draw(out, shares: list[dict], n: int) -> None:
    """Write friction.png and friction.svg into the folder `out`."""
    size = (14.0, 4.8)
    with harness.figure(out, "friction", log=False, panels=(1, 3), size=size) as (_, axes):
        draw_loop(axes[0])
        draw_shapes(axes[1], n)
        draw_shares(axes[2], shares)


def draw_loop(ax) -> None:
    """The law's moment over HB in a closed loop, and where a load ends, laid and shaken."""
    up = np.linspace(-MOST, MOST, 1201)
    path = np.concatenate([np.linspace(0, MOST, 601), up[-2::-1], up[1:]])
    moments = cases.law(cases.B, cases.M, path)  # with HB = B, κ is in HB/B
    ax.plot(path, moments / cases.B, color=BLUE, lw=2.2)
    ax.plot(up, up, **KNOWN)
    ax.axhline(LOAD, color=RED, lw=1, ls=":")
    arrow = {"arrowstyle": "-", "color": "0.5"}
    for place, name, at, look in (
        (LOAD - 1, "laid", (-1.6, 3.0), RED),
        (LOAD, "shaken", (0.4, -2.0), GREEN),
        (LOAD + 1, "bent further,\nthen let go", (1.6, -3.4), "0.35"),
    ):
        ax.annotate(name, (place, LOAD), at, color=look, arrowprops=arrow)
        ax.plot([place], [LOAD], "o", color=look, ms=9, zorder=5)
    ax.annotate("", (-0.8, -1.85), (-0.8, 0.25), arrowprops={"arrowstyle": "<->", "color": "0.2"})
    ax.text(-0.8, -0.8, "2HB", ha="center", va="center", bbox={"fc": "w", "ec": "none", "pad": 1.5})
    ax.text(-3.1, LOAD + 0.12, "moment of a load", color=RED, fontsize=10)
    ax.text(0.5, 0.0, "Bκ", color="0.35")
    ax.set(xlim=(-3.2, 3.6), ylim=(-4.3, 4.3), title="The loop of the law, m = 20")
    ax.set(xlabel="curvature κ over HB/B", ylabel="moment per width over HB")


def draw_shapes(ax, n: int) -> None:
    """A cantilever under its weight: elastic, laid, shaken, beside the closed forms."""
    lines = (("elastic", 0.0, "laid", BLUE, "o"), ("shaken", cases.SHARE, "shaken", GREEN, "x"))
    for name, share, friction, colour, mark in (*lines, ("laid", cases.SHARE, "laid", RED, "s")):
        X, w = cases.cantilever("right", "P2", n // 2, share=share, friction=friction)
        order = np.argsort(X, kind="stable")[:: max(1, len(X) // 90)]
        ax.plot(X[order] / cases.L, -w[order] / cases.L, mark, color=colour, label=name, ms=6)
    for m, share, look in ((np.inf, 0.0, "--"), (cases.M, cases.SHARE, "--"), (np.inf, None, ":")):
        X, w = cases.deflections(m, cases.SHARE if share is None else share)
        name = {"--": "exact", ":": "exact, m → ∞"}[look] if share != 0.0 else None
        ax.plot(X / cases.L, -w / cases.L, color="0.25", lw=1.4, ls=look, label=name)
    ax.set(title=f"A cantilever under its weight, r = {cases.SHARE:g}")
    ax.set(xlabel="place X/L", ylabel="height over L", xlim=(0, 1.02))
    ax.legend(loc="lower left")


def draw_shares(ax, shares: list[dict]) -> None:
    """The deflection laid and shaken over the elastic one, over HB/B of the curvature."""
    at = np.geomspace(0.005, 1.0, 200)
    ax.plot(at, [cases.closed_form(s) / cases.closed_form(0.0) for s in at], color="0.25", lw=1.4)
    ax.text(0.0055, 0.9, "closed form, m → ∞:\n(1 − r)²", color="0.25", fontsize=10, va="top")
    for name, colour, mark in (("laid", RED, "s"), ("shaken", GREEN, "x")):
        points = [(row["r"], row[name]) for row in shares]
        ax.plot(*zip(*points, strict=True), mark, color=colour, label=name, ms=7)
    ax.axvline(0.1, color="0.5", lw=1, ls=":")
    ax.text(0.093, 0.1, "a tenth", rotation=90, ha="right", color="0.35")
    ax.set(xscale="log", xlim=(0.005, 1.0), ylim=(0, 1.08), title="When it matters")
    ax.set(xlabel="r = HB/B over the curvature at the clamp", ylabel="deflection over the elastic")
    ax.legend(loc="lower left")
