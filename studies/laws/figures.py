"""The pictures of studies/laws/: the same axes for all laws, legible at 400 pixels."""

from __future__ import annotations

import io
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE
from studies.laws import curves as law_curves
from studies.laws.curves import NU, SPEED, Y

DEGREES = np.arange(0.0, 90.1, 2.5)
PLATE = fc.Drag(normal=0.7, tangential=0.006)
SLIDERS = (20.0, 3.0)  # stiffness m
LINE = {"color": "0.55", "lw": 1.2, "ls": ":"}
WIDTHS, DASHES = (3.2, 2.4, 2.2, 2.2, 2.0), ("-", "--", "-.", (0, (5, 1, 1, 1, 1, 1)), ":")
SHOWN = {  # one curve of each law for the picture of all
    "StVK": 0,
    "TensorCondition": 0,
    "NeoHookean": 0,
    "TensionField": 0,
    "BaraffWitkin": 0,
    "Springs": 3,
}


def draw(out: Path, curves: dict, moments: dict) -> None:
    """Write laws.png and pictures/NAME.png into the folder `out`."""
    for name, own in curves.items():
        below = 0.26 * ((len(own) + 2) // 2)  # inches of the legend
        with picture(out / "pictures" / f"{name}.png", 2, (8.0, 3.5 + below)) as (figure, axes):
            lines = draw_membrane(axes, own)
            figure.legend(handles=lines, loc="lower center", ncols=2, frameon=False)
            for ax, left in zip(axes, (0.105, 0.6), strict=True):  # the same size on every picture
                ax.set_position((left, (0.72 + below) / (3.5 + below), 0.38, 2.65 / (3.5 + below)))
    for name, own in moments.items():
        with picture(out / "pictures" / f"{name}.png", 1) as (figure, ax):
            draw_bending(ax, own)
    with picture(out / "pictures" / "BendingFriction.png", 1) as (figure, ax):
        draw_loops(ax)
    with picture(out / "pictures" / "Drag.png", 1) as (figure, ax):
        draw_drag(ax)
    with picture(out / "laws.png", 2, (9.0, 4.4)) as (figure, axes):
        draw_together(axes, {name: curves[name][i] for name, i in SHOWN.items()})


@contextmanager
def picture(path: Path, panels: int, size=None, rows: int = 1):
    """Yield a figure and its axes; write the picture with 64 colours at the end of the block."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from PIL import Image  # comes with Matplotlib

    with rc_context({"font.size": 13, "legend.fontsize": 12, "savefig.dpi": 100}, STYLE):
        size = size or (8.0, 4.0)
        figure = Figure(figsize=size, layout="constrained")
        yield figure, figure.subplots(rows, panels)
        figure.savefig(image := io.BytesIO())
    Image.open(image).convert("RGB").quantize(64).save(path, optimize=True)  # half the bytes


def set_axes(axes) -> None:
    """Set the axes that all membranes share, and draw the lines of the linear law."""
    left, right = axes
    s, g = law_curves.STRETCHES, law_curves.SHEARS
    left.plot(s, Y * (s - 1), **LINE)
    right.plot(g, Y / (2 * (1 + NU)) * g, **LINE)
    left.axhline(0, color="0.4", lw=0.8)
    left.set(xlim=(0.3, 1.5), ylim=(-600, 1000), xlabel="stretch λ", ylabel="force per width [N/m]")
    left.set(xticks=np.arange(0.4, 1.5, 0.2), yticks=np.arange(-500, 1001, 250))
    right.set(xlim=(0, 1), ylim=(0, 1000), xlabel="shear γ", ylabel="shear stress [N/m]")
    right.set(xticks=np.arange(0, 1.1, 0.2))


def draw_membrane(axes, curves) -> list:
    """Draw the curves of one law; return the lines for the legend."""
    set_axes(axes)
    lines = []
    for i, curve in enumerate(curves):
        look = {"color": COLOURS[i], "ls": DASHES[i], "lw": WIDTHS[i]}
        lines += axes[0].plot(curve.stretch, curve.tension, label=curve.label, **look)
        axes[1].plot(curve.shear, curve.shearing, **look)
    return [*lines, axes[0].plot([], [], label="Y (λ − 1) and G γ, isotropic", **LINE)[0]]


def draw_bending(ax, moments) -> None:
    folds = law_curves.FOLDS
    ax.plot([0, np.pi], [0, np.pi], label="B κ", **LINE)
    for i, (pattern, M) in enumerate(moments.items()):
        ax.plot(folds, M, label=pattern, color=COLOURS[i], ls=DASHES[i], lw=WIDTHS[i])
    ax.set(xlabel="curvature κh [rad from cell to cell], rolled without twist")
    ax.set(xlim=(0, np.pi), ylim=(0, 5), ylabel="moment per width M h/B")
    ax.legend(loc="upper left")


def draw_loops(ax) -> None:
    most = law_curves.LARGEST
    ax.plot([-most, most], [-most, most], label="B κ", **LINE)
    for i, m in enumerate(SLIDERS):
        look = {"color": COLOURS[i], "ls": DASHES[i], "lw": 2.4}
        ax.plot(*law_curves.loop(m), label=f"m = {m:g}", **look)
    ax.set(xlim=(-most, most), xlabel="curvature κ over HB/B", ylabel="moment per width over HB")
    ax.legend(loc="upper left")


def draw_drag(ax) -> None:
    forces = law_curves.drag_and_lift(PLATE, DEGREES)
    for i, name in enumerate(("drag", "lift")):
        ax.plot(DEGREES, forces[:, i], label=name, color=COLOURS[i], ls=DASHES[i], lw=2.4)
    ax.set(xlim=(0, 90), ylim=(0, None), xticks=range(0, 91, 15), ylabel="force per area [N/m²]")
    constants = f"{SPEED:g} m/s, k_n = {PLATE.normal:g} and k_t = {PLATE.tangential:g} Pa s²/m²"
    ax.set(xlabel=f"angle of attack [°] at {constants}")
    ax.legend(loc="upper left")


def draw_together(axes, curves) -> None:
    """Draw all laws on the two axes, each with a label at its end."""
    set_axes(axes)
    for i, curve in enumerate(curves.values()):
        look = {"color": COLOURS[i], "ls": DASHES[i % len(DASHES)], "lw": 4.0 - 0.45 * i}
        axes[0].plot(curve.stretch, curve.tension, **look)
        axes[1].plot(curve.shear, curve.shearing, **look)
    names = list(curves)
    label_ends(axes[0], [curve.tension[-1] for curve in curves.values()], names)
    label_ends(axes[1], [curve.shearing[-1] for curve in curves.values()], names)


def label_ends(ax, ends, names) -> None:
    """Write names beside the right ends of the lines, moved apart and below the upper border."""
    low, high = ax.get_ylim()
    gap, last = 0.062 * (high - low), np.inf
    for i in np.argsort(ends, kind="stable")[::-1]:
        last = min(ends[i], last - gap)
        at = {"transform": ax.get_yaxis_transform(), "va": "center", "fontsize": 12}
        ax.text(1.015, last, names[i], color=COLOURS[i], **at)
