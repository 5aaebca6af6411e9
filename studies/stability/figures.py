"""The figures of stability.py."""

from __future__ import annotations

from fecloth import study
from fecloth.integrators import EXPLICIT
from studies.stability.cases import ALL, BLOWN, NEWTON, STABLE, WRONG

LOOKS = {
    STABLE: {"marker": "o", "color": "#0072B2"},
    WRONG: {"marker": "^", "color": "#E69F00"},
    NEWTON: {"marker": "s", "color": "#CC79A7"},
    BLOWN: {"marker": "X", "color": "#D55E00"},
}
LINES = {
    "foretold: explicit limit": {"color": "black", "ls": "-"},
    "foretold: indefinite beyond": {"color": "black", "ls": "--"},
}


def draw_map(out, name: str, rows: list[dict], y: str, ylabel: str) -> None:
    """A panel for each method: dt across, `y` up, a marker for each cell, the limit foretold."""
    size = {"panels": (4, 3), "size": (9.0, 9.6), "sharex": True, "sharey": True}
    with study.figure(out, name, **size) as (figure, axes):
        drawn = set()
        for ax, method in zip(axes.flat, ALL, strict=False):
            own = [row for row in rows if row.get("method") == method and "dt" in row]
            ax.set_title(method.replace("_", " "), fontsize=11)
            for outcome, look in LOOKS.items():
                at = [(row["dt"], row[y]) for row in own if row["outcome"] == outcome]
                ax.plot(*zip(*at, strict=True) if at else ((), ()), ls="", ms=7, **look)
            line = sorted({(row[y], row["limit"]) for row in own if row["limit"]})
            kind = list(LINES)[method not in EXPLICIT]
            if line:
                ax.plot([dt for _, dt in line], [at for at, _ in line], lw=2, **LINES[kind])
                drawn.add(kind)
        for ax in axes.flat[len(ALL) :]:
            ax.set_axis_off()
        legend(axes.flat[len(ALL)], drawn)
        figure.supxlabel("time step [s]")
        figure.supylabel(ylabel)
        figure.suptitle(f"scene {rows[0]['scene']}")


def legend(ax, drawn: set[str]) -> None:
    """The classes and those lines that are drawn, in an empty panel."""
    for outcome, look in LOOKS.items():
        ax.plot([], [], ls="", ms=7, label=outcome, **look)
    for label in sorted(drawn):
        ax.plot([], [], lw=2, label=label, **LINES[label])
    ax.legend(loc="center left", frameon=False, fontsize=11)


def draw_limits(out, rows: list[dict]) -> None:
    """Limits of linear sheets over mesh size, stiffness and damping: measured and foretold."""
    labels = {"h": "edge length [m]", "Y": "tensile stiffness [N/m]"}
    labels |= {"damping": "strain-rate damping time [s]"}
    size = {"panels": (1, 3), "size": (10.0, 4.4), "sharey": True}
    with study.figure(out, "limits", ylabel="largest stable dt [s]", **size) as (figure, axes):
        for ax, (over, label) in zip(axes, labels.items(), strict=True):
            ax.set_xlabel(label)
            for i, method in enumerate(EXPLICIT):
                own = sorted(path(rows, method, over), key=lambda row: row[over])
                look, x = study.line_style(i), [row[over] for row in own]
                ax.plot(x, [row["foretold"] for row in own], "-", color=look["color"])
                look |= {"ls": "", "label": f"{method.replace('_', ' ')}, measured"}
                ax.plot(x, [row["measured"] for row in own], **look)
        axes[0].plot([], [], "-", color="0.3", label="foretold")
        axes[1].label_outer()
        axes[2].label_outer()
        handles = axes[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=2)


def path(rows: list[dict], method: str, over: str) -> list[dict]:
    """The measured limits that differ in `over` alone from the sheet that is in the middle."""
    middle = {"h": 0.1, "Y": 1000.0, "damping": 0.0}
    own = [row for row in rows if row["method"] == method and "measured" in row]
    same = [k for k in middle if k != over]
    found = [row for row in own if all(row[k] == middle[k] for k in same)]
    return [row for row in found if row[over] > 0]
