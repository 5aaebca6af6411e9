"""Write the page of the laws, with formula, validity and picture of each: python -m studies.laws

The text comes from the docstrings of the classes; curves.py computes the pictures and the numbers
below them. The files laws.md, laws.png and pictures/NAME.png go into studies/laws, or into the
folder of --out. --quick computes few points, into out/laws.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import numpy as np

import fecloth as fc
from studies import harness
from studies.laws import curves as law_curves
from studies.laws import figures
from studies.laws.curves import NU, SPEED, Y

HERE = Path(__file__).parent
FAMILIES = {
    "Membranes": (
        *("StVK", "TensorCondition", "NeoHookean", "TensionField", "MembraneTable"),
        "BaraffWitkin",
    ),
    "Springs and conditions": ("Springs", "Tether", "Condition"),
    "Bending": ("PlateBending", "HingeBending", "QuadraticBending", "BendingFriction"),
    "Damping": ("StrainRateDamping", "BendingDamping", "MassDamping"),
    "Loads": ("Gravity", "Pressure", "Gas", "Drag", "Wind", "PointForce", "UserForce"),
    "Contact": ("Obstacle", "MeshObstacle", "SelfContact"),
    "Constraints": ("Pin", "Slide"),
}
G = Y / (2 * (1 + NU))
HEAD = f"""# The laws

One section for each term, written by `python -m studies.laws` from its docstring: formula, source,
validity, cost, parameters. [Symbols and units](../../README.md#symbols-units-signs) are as in
the README; costs in time are relative to `StVK`.

The pictures of membranes and springs have the same axes. All laws represent one fabric, Y =
{Y:g} N/m and ν = {NU:g} (G = {G:.0f} N/m); the straight lines Y (λ − 1) and G γ are drawn for
comparison. Left: the force per unstretched width along the warp at the stretch λ, with free sides.
Its width and its shear are computed such that there is no stress across. Right: simple shear by γ
at constant width and length. The curves come from the term's own forces on a patch under one
uniform deformation, without a border. They do not show that a compressed sheet would buckle. The
orthotropic fabric has half of Y along the weft and G = {0.1 * Y:g} N/m. In bending, the cloth is
rolled up along X and its triangles keep their shape: κh is the angle between neighbouring cells.

![All laws on two axes](laws.png)

*The straight lines are dotted. `NeoHookean` is incompressible; `Springs` are the edges of an
equilateral mesh. In tension `Springs` and `BaraffWitkin` lie on the straight line, and
`TensorCondition` and `TensionField` lie on `StVK`.*
"""
ROLLED = """The cloth is rolled up without twist. A cloth with free sides has a smaller or larger
stiffness: see the table of [HingeBending](#hingebending)."""
NOTES = {  # explanations below the pictures
    "StVK": """Simple shear along one direction stretches the other one by E = γ²/2, and the stress
is G γ + C γ³/2. C is C₂₂ for shear along the warp and C₁₁ for shear along the weft. The latter
curve is steeper, because the stiffer warp is stretched. The dotted lines belong to the isotropic
fabric.""",
    "HingeBending": ROLLED,
    "QuadraticBending": ROLLED,
}


def markdown(name: str) -> str:
    """Return a class's docstring as Markdown: paragraphs, formulas as code, a parameter list."""
    text = inspect.getdoc(getattr(fc, name))
    body, _, rest = text.partition("\nParameters\n----------\n")
    body = re.split(r"\n\w+\n-{5,}\n", body)[0]
    lines = [format_block(block) for block in re.split(r"\n\s*\n(?=\S)", body.strip())]
    parameters = re.split(r"\n\n\w+\n-{5,}\n", rest)[0]
    for item in re.findall(r"^(\S.*)\n((?:(?: {4}.*)?(?:\n|$))+)", parameters, re.M):
        names = ", ".join(f"`{n}`" for n in item[0].split(", "))
        lines.append(f"- {names}: " + " ".join(item[1].split()))
    return re.sub(r"\n\n(?=- `)", "\n", "\n\n".join(lines)).replace("\n- `", "\n\n- `", 1)


def format_block(block: str) -> str:
    """Return a paragraph with its indented part as a code block; Source and Valid are bold."""
    block = re.sub(r"^(Source:|Valid|Cost)", r"**\1**", block)
    plain, code = re.match(r"(.*?)((?:\n\n? {4}.*(?:\n\s*\n(?= {4}))?)*)\Z", block, re.S).groups()
    return block if not code else f"{plain.rstrip()}\n\n```\n{inspect.cleandoc(code)}\n```"


def page(curves: dict, moments: dict) -> str:
    """Return the whole page, from the docstrings and the curves."""
    parts = [HEAD]
    for family, names in FAMILIES.items():
        links = " · ".join(f"[{name}](#{name.lower()})" for name in names)
        parts.append(f"## {family}\n\n{links}\n")
        parts += [section(name, curves, moments) for name in names]
    text = re.sub(r"\n{3,}", "\n\n", "\n".join(parts)).rstrip() + "\n"
    return re.sub(r"(?<![\w-])-(?=\d)", "−", text)


def section(name: str, curves: dict, moments: dict) -> str:
    """Return the section of one term."""
    lines = []
    if name in curves:
        lines = [f"- {describe(curve)}" for curve in curves[name]]
    elif name in moments:
        lines = [f"- {describe_bending(pattern, M)}" for pattern, M in moments[name].items()]
    elif name == "Drag":
        lines = [describe_drag()]
    elif name == "BendingFriction":
        lines = [f"- {describe_loop(m)}" for m in figures.SLIDERS]
    picture = f"![{name}](pictures/{name}.png)\n\n" if lines else ""
    note = f"\n\n{NOTES[name]}" if name in NOTES else ""
    return f"### {name}\n\n{markdown(name)}\n\n{picture}" + "\n".join(lines) + note + "\n"


def describe(curve: law_curves.Curve) -> str:
    """Describe a membrane curve in numbers."""
    s, P = curve.stretch, curve.tension
    one = int(np.argmin(abs(s - 1)))
    rest = slice(one - 2, one + 3) if abs(P[one - 1]) > 1e-6 * Y else slice(one, one + 5)
    tensile, shear = slope(s[rest], P[rest], 1.0), slope(curve.shear[:5], curve.shearing[:5], 0.0)
    nu = -slope(s[rest], curve.width[rest], 1.0)
    stiffer = P[-1] / (tensile * (s[-1] - 1)), curve.shearing[-1] / (shear * curve.shear[-1])
    return (
        f"**{curve.label}**: Y = {number(tensile)} N/m and ν = {number(nu, 2)} at rest; "
        f"{number(P[-1])} N/m at λ = {s[-1]:g} ({number(stiffer[0], 2)} × the tangent at rest); "
        f"{describe_compression(s, P)}. Shear: G = {number(shear)} N/m; "
        f"{number(curve.shearing[-1])} N/m at γ = {curve.shear[-1]:g} "
        f"({number(stiffer[1], 2)} × the tangent)."
    )


def number(x: float, digits: int = 0) -> str:
    """Round halves up, without a negative zero, so that round-off does not show."""
    return f"{round(x * (1 + 1e-6), digits) + 0.0:.{digits}f}"


def slope(x, y, at: float) -> float:
    """Return dy/dx of the polynomial through the points."""
    return float(np.polynomial.Polynomial.fit(x, y, len(x) - 1).deriv()(at))


def describe_compression(s, P) -> str:
    """Describe what happens below a stretch of 1."""
    found = np.flatnonzero(np.isfinite(P))
    if found[0] > 0:
        return f"no equilibrium below λ = {s[found[0]]:.2f}: the net folds"
    low = int(np.argmin(P))
    if P[low] > -1e-6 * Y:
        return "no stress in compression"
    if low == 0:
        return f"{number(P[0])} N/m at λ = {s[0]:g}"
    cubic = np.polynomial.Polynomial.fit(s[low - 2 : low + 3], P[low - 2 : low + 3], 3)
    at = min(cubic.deriv().roots().real, key=lambda r: abs(r - s[low]))
    words = f"the largest compression is {number(cubic(at))} N/m at λ = {at:.3f}"
    return f"{words}; below it the stiffness is negative"


def describe_bending(pattern: str, M) -> str:
    """Describe a bending curve."""
    top, folds = int(np.argmax(M)), law_curves.FOLDS
    peak = f"{number(M[-1], 2)} at κh = {folds[-1]:.2f}"
    if top < len(M) - 1:
        peak = f"largest ({number(M[top], 2)}) at κh = {folds[top]:.2f} and zero at a full fold"
    return f"**{pattern}**: M = {number(M[0] / folds[0], 2)} Bκ for small κh; M h/B is {peak}."


def describe_loop(m: float) -> str:
    """Describe the loop of a slider of the stiffness m in numbers."""
    path, M = law_curves.loop(m)
    turn, flat = int(np.argmax(path)), np.flatnonzero(path == 0.0)
    slope = (M[turn + 1] - M[turn]) / (path[turn + 1] - path[turn])
    return (
        f"**m = {m:g}**: the loop is {number(M[flat[-1]] - M[flat[-2]], 2)} HB high at κ = 0. "
        f"After a turn the sliders stick over 2 HB/(m B), with the slope {number(slope, 2)} B."
    )


def describe_drag() -> str:
    lift = law_curves.drag_and_lift(figures.PLATE, figures.DEGREES)[:, 1]
    best = figures.DEGREES[int(np.argmax(lift))]
    return (
        f"- **flat cloth at {SPEED:g} m/s**: the lift is largest at {best:g}° (sin²α cos α: "
        "54.7°). Only the normal force lifts; there is no stall."
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
