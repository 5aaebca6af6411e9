"""Write the page of the curves that the laws give: python -m studies.laws

curves.py computes the pictures and the numbers. The files laws.md, laws.png and pictures/NAME.png
go into studies/laws, or into the folder of --out. --quick computes few points, into out/laws.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fecloth.study.result import markdown_table
from studies import harness
from studies.laws import curves as law_curves
from studies.laws import figures
from studies.laws.curves import NU, SPEED, Y

HERE = Path(__file__).parent
G = Y / (2 * (1 + NU))
HEAD = f"""# The laws in curves

See the force of each law, stretched, compressed, sheared and bent. The command
`python -m studies.laws` computes it from the terms' own forces, on a patch under one uniform
deformation, without a border. Formula, source, validity and cost are in `help(fc.StVK)` and so on.

![All laws on two axes](laws.png)

*One fabric, Y = {Y:g} N/m and ν = {NU:g} (G = {G:.0f} N/m), through all laws. `NeoHookean` is
incompressible, `Springs` are the edges of an equilateral mesh. Dotted: Y (λ − 1) and G γ.*"""
MEMBRANES = f"""## Membranes and springs

Force per unstretched width along the warp at the stretch λ, with free sides; simple shear by γ at
constant width and length; "×" is the secant over the tangent at rest. A compressed sheet would
buckle, which these numbers do not show. The orthotropic fabric has half of Y along the weft and
G = {0.1 * Y:g} N/m."""
BENDING = """## Bending

The cloth is rolled up along X, without twist, and its triangles keep their shape: κh is the angle
between neighbouring cells. Cloth with free sides has another stiffness: `help(fc.HingeBending)`."""


def page(curves: dict, moments: dict) -> str:
    """Return the whole page."""
    drawn = "BendingFriction", "Drag"
    pictures = {name: f"![{name}](pictures/{name}.png)" for name in (*curves, *moments, *drawn)}
    membranes = [
        {"law": f"{name}, {curve.label}", **describe(curve)}
        for name, own in curves.items()
        for curve in own
    ]
    bent = [
        f"- `{name}`, {pattern}: {describe_bending(M)}"
        for name, own in moments.items()
        for pattern, M in own.items()
    ]
    loops = [f"- `BendingFriction`, m = {m:g}: {describe_loop(m)}" for m in figures.SLIDERS]
    parts = [
        *(HEAD, MEMBRANES, markdown_table(membranes), *(pictures[name] for name in curves)),
        *(BENDING, "\n".join([*bent, *loops])),
        *(pictures[name] for name in (*moments, "BendingFriction")),
        *("## Drag", describe_drag(), pictures["Drag"]),
    ]
    return "\n\n".join(parts) + "\n"


def describe(curve: law_curves.Curve) -> dict[str, str]:
    """Return the numbers of a membrane curve, by the heading of their column."""
    s, P = curve.stretch, curve.tension
    one = int(np.argmin(abs(s - 1)))
    rest = slice(one - 2, one + 3) if abs(P[one - 1]) > 1e-6 * Y else slice(one, one + 5)
    tensile, shear = slope(s[rest], P[rest], 1.0), slope(curve.shear[:5], curve.shearing[:5], 0.0)
    nu = -slope(s[rest], curve.width[rest], 1.0)
    stiffer = P[-1] / (tensile * (s[-1] - 1)), curve.shearing[-1] / (shear * curve.shear[-1])
    return {
        "Y [N/m]": number(tensile),
        "ν": number(nu, 2),
        f"at λ = {s[-1]:g} [N/m]": f"{number(P[-1])} ({number(stiffer[0], 2)} ×)",
        "compressed [N/m]": describe_compression(s, P),
        "G [N/m]": number(shear),
        f"at γ = {curve.shear[-1]:g} [N/m]": (
            f"{number(curve.shearing[-1])} ({number(stiffer[1], 2)} ×)"
        ),
    }


def number(x: float, digits: int = 0) -> str:
    """Round halves up, without a negative zero, so that round-off does not show."""
    return f"{round(x * (1 + 1e-6), digits) + 0.0:.{digits}f}".replace("-", "−")


def slope(x, y, at: float) -> float:
    """Return dy/dx of the polynomial through the points."""
    return float(np.polynomial.Polynomial.fit(x, y, len(x) - 1).deriv()(at))


def describe_compression(s, P) -> str:
    """Describe what happens below a stretch of 1."""
    found = np.flatnonzero(np.isfinite(P))
    if found[0] > 0:
        return f"the net folds below λ = {s[found[0]]:.2f}"
    low = int(np.argmin(P))
    if P[low] > -1e-6 * Y:
        return "0"
    if low == 0:
        return f"{number(P[0])} at λ = {s[0]:g}"
    cubic = np.polynomial.Polynomial.fit(s[low - 2 : low + 3], P[low - 2 : low + 3], 3)
    at = min(cubic.deriv().roots().real, key=lambda r: abs(r - s[low]))
    return f"most {number(cubic(at))} at λ = {at:.3f}, then less"


def describe_bending(M) -> str:
    """Describe a bending curve."""
    top, folds = int(np.argmax(M)), law_curves.FOLDS
    peak = f"{number(M[-1], 2)} at κh = {folds[-1]:.2f}"
    if top < len(M) - 1:
        peak = f"largest ({number(M[top], 2)}) at κh = {folds[top]:.2f} and zero at a full fold"
    return f"M = {number(M[0] / folds[0], 2)} Bκ for small κh; M h/B is {peak}."


def describe_loop(m: float) -> str:
    """Describe the loop of a slider of the stiffness m in numbers."""
    path, M = law_curves.loop(m)
    turn, flat = int(np.argmax(path)), np.flatnonzero(path == 0.0)
    slope = (M[turn + 1] - M[turn]) / (path[turn + 1] - path[turn])
    return (
        f"the loop is {number(M[flat[-1]] - M[flat[-2]], 2)} HB high at κ = 0. After a turn the "
        f"sliders stick over 2 HB/(m B), with the slope {number(slope, 2)} B."
    )


def describe_drag() -> str:
    lift = law_curves.drag_and_lift(figures.PLATE, figures.DEGREES)[:, 1]
    best = figures.DEGREES[int(np.argmax(lift))]
    return (
        f"On flat cloth at {SPEED:g} m/s the lift is largest at {best:g}° (sin²α cos α: 54.7°). "
        "Only the normal force lifts; there is no stall."
    )


def main() -> None:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few points, into out/laws")
    parser.add_argument("--out", type=Path, help="folder of laws.md")
    options = parser.parse_args()
    out = options.out or (Path("out/laws") if options.quick else HERE)
    every = 5 if options.quick else 1
    curves, moments = law_curves.responses(every), law_curves.moments()
    (out / "pictures").mkdir(parents=True, exist_ok=True)
    (out / "laws.md").write_text(page(curves, moments), encoding="utf-8")
    figures.draw(out, curves, moments)
    print(f"wrote {out}/laws.md, laws.png and {len(curves) + len(moments) + 2} pictures")


if __name__ == "__main__":
    harness.run_main(main)
