"""Figures of the stability study."""

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
    "predicted: explicit limit": {"color": "black", "ls": "-"},
    "predicted: indefinite above": {"color": "black", "ls": "--"},
}


def draw_map(out, name: str, rows: list[dict], y: str, ylabel: str) -> None:
    """Draw a panel for each method: dt across, `y` up, cells as markers, the predicted limit."""
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
        draw_legend(axes.flat[len(ALL)], drawn)
        figure.supxlabel("time step [s]")
        figure.supylabel(ylabel)
        figure.suptitle(f"scene {rows[0]['scene']}")


def draw_legend(ax, drawn: set[str]) -> None:
    """Draw the legend of the classes and the drawn lines in an empty panel."""
    for outcome, look in LOOKS.items():
        ax.plot([], [], ls="", ms=7, label=outcome, **look)
    for label in sorted(drawn):
        ax.plot([], [], lw=2, label=label, **LINES[label])
    ax.legend(loc="center left", frameon=False, fontsize=11)


def draw_limits(out, rows: list[dict]) -> None:
    """Draw measured and predicted limits of linear sheets over mesh size, stiffness, damping."""
    labels = {"h": "edge length [m]", "Y": "tensile stiffness [N/m]"}
    labels |= {"damping": "strain-rate damping time [s]"}
    size = {"panels": (1, 3), "size": (10.0, 4.4), "sharey": True}
    with study.figure(out, "limits", ylabel="largest stable dt [s]", **size) as (figure, axes):
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
