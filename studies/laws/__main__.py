"""The page of the laws, one section each with formula, validity and picture: python -m studies.laws

The text is that of the classes' own docstrings, the pictures and what they show are computed by
curves.py. Writes laws.md, laws.png and pictures/NAME.png into studies/laws, or with --out
another folder; --quick computes few points, into out/laws.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from studies.laws import curves as law_curves
from studies.laws import figures
from studies.laws.curves import NU, SPEED, Y

HERE = Path(__file__).parent
FAMILIES = {
    "Membranes": ("StVK", "TensorCondition", "NeoHookean", "TensionField", "BaraffWitkin"),
    "Springs and conditions": ("Springs", "Tether", "Condition"),
    "Bending": ("HingeBending", "QuadraticBending"),
    "Damping": ("StrainRateDamping", "BendingDamping", "MassDamping"),
    "Loads": ("Gravity", "Pressure", "Gas", "Drag", "Wind", "PointForce", "UserForce"),
    "Constraints": ("Pin", "Slide"),
}
G = Y / (2 * (1 + NU))
HEAD = f"""# The laws

One section for each term, made from its docstring by `python -m studies.laws`: formula, source,
validity, cost, parameters. [Symbols and units](../../README.md#symbols-units-signs) are those of
the README; prices in time are relative to `StVK`.

The pictures of membranes and springs have the same axes. All are asked to be one fabric, Y =
{Y:g} N/m and ν = {NU:g} (G = {G:.0f} N/m), and held against the straight lines Y (λ − 1) and G γ.
Left is the force per unstretched width along the warp at the stretch λ, with the sides free: the
width, and the slant, at which no stress is left across are solved for. Right is simple shear by γ,
at constant width and length. Each is a patch of the term's own forces under one uniform
deformation, without a border; that a sheet would rather buckle than be compressed is not in them.
The orthotropic fabric has half of Y along the weft and G = {0.1 * Y:g} N/m. Bending is that of a
cloth rolled up along X, whose triangles keep their shape: κh is the angle from cell to cell.

![All laws on two axes](laws.png)

*Dotted the straight lines. `NeoHookean` is the incompressible kind, `Springs` the edges of an
equilateral mesh, which in tension lie on the straight line as `BaraffWitkin` does;
`TensorCondition` and `TensionField` in tension on `StVK`.*
"""
ROLLED = """Rolled up without twist. A cloth whose sides are free bends with less or more: see the
table of [HingeBending](#hingebending)."""
NOTES = {  # what a picture does not say by itself
    "StVK": """Simple shear along one direction stretches the other, by E = γ²/2, and the stress is
G γ + C γ³/2: C is C₂₂ for shear along the warp, C₁₁ along the weft, whose curve is the steeper one
as it is the stiffer warp that is stretched. The dotted lines are those of the isotropic fabric.""",
    "HingeBending": ROLLED,
    "QuadraticBending": ROLLED,
}


def markdown(name: str) -> str:
    """A class's docstring as Markdown: paragraphs, formulas as code, parameters as a list."""
    text = inspect.getdoc(getattr(fc, name))
    body, _, rest = text.partition("\nParameters\n----------\n")
    body = re.split(r"\n\w+\n-{5,}\n", body)[0]
    lines = [fenced(block) for block in re.split(r"\n\s*\n(?=\S)", body.strip())]
    parameters = re.split(r"\n\n\w+\n-{5,}\n", rest)[0]
    for item in re.findall(r"^(\S.*)\n((?:(?: {4}.*)?(?:\n|$))+)", parameters, re.M):
        names = ", ".join(f"`{n}`" for n in item[0].split(", "))
        lines.append(f"- {names}: " + " ".join(item[1].split()))
    return re.sub(r"\n\n(?=- `)", "\n", "\n\n".join(lines)).replace("\n- `", "\n\n- `", 1)


def fenced(block: str) -> str:
    """A paragraph, its indented part as a code block; Source and Valid stand out."""
    block = re.sub(r"^(Source:|Valid|Cost)", r"**\1**", block)
    plain, code = re.match(r"(.*?)((?:\n\n? {4}.*(?:\n\s*\n(?= {4}))?)*)\Z", block, re.S).groups()
    return block if not code else f"{plain.rstrip()}\n\n```\n{inspect.cleandoc(code)}\n```"


def page(curves: dict, moments: dict) -> str:
    """The whole page, from the docstrings and the full curves."""
    parts = [HEAD]
    for family, names in FAMILIES.items():
        links = " · ".join(f"[{name}](#{name.lower()})" for name in names)
        parts.append(f"## {family}\n\n{links}\n")
        parts += [section(name, curves, moments) for name in names]
    text = re.sub(r"\n{3,}", "\n\n", "\n".join(parts)).rstrip() + "\n"
    return re.sub(r"(?<![\w-])-(?=\d)", "−", text)


def section(name: str, curves: dict, moments: dict) -> str:
    shows = []
    if name in curves:
        shows = [f"- {describe(curve)}" for curve in curves[name]]
    elif name in moments:
        shows = [f"- {bending(pattern, M)}" for pattern, M in moments[name].items()]
    elif name == "Drag":
        shows = [flight()]
    picture = f"![{name}](pictures/{name}.png)\n\n" if shows else ""
    note = f"\n\n{NOTES[name]}" if name in NOTES else ""
    return f"### {name}\n\n{markdown(name)}\n\n{picture}" + "\n".join(shows) + note + "\n"


def describe(curve: law_curves.Curve) -> str:
    """What a curve shows, in numbers."""
    s, P = curve.stretch, curve.tension
    one = int(np.argmin(abs(s - 1)))
    rest = slice(one - 2, one + 3) if abs(P[one - 1]) > 1e-6 * Y else slice(one, one + 5)
    tensile, shear = slope(s[rest], P[rest], 1.0), slope(curve.shear[:5], curve.shearing[:5], 0.0)
    nu = -slope(s[rest], curve.width[rest], 1.0)
    stiffer = P[-1] / (tensile * (s[-1] - 1)), curve.shearing[-1] / (shear * curve.shear[-1])
    return (
        f"**{curve.label}**: Y = {number(tensile)} N/m and ν = {number(nu, 2)} at rest; "
        f"{number(P[-1])} N/m at λ = {s[-1]:g} ({number(stiffer[0], 2)} × the tangent at rest); "
        f"{compression(s, P)}. Shear: G = {number(shear)} N/m; {number(curve.shearing[-1])} N/m at "
        f"γ = {curve.shear[-1]:g} ({number(stiffer[1], 2)} × the tangent)."
    )


def number(x: float, digits: int = 0) -> str:
    """Rounded, halves up and without a negative zero, so that round-off does not show."""
    return f"{round(x * (1 + 1e-6), digits) + 0.0:.{digits}f}"


def slope(x, y, at: float) -> float:
    """dy/dx of the polynomial through the points."""
    return float(np.polynomial.Polynomial.fit(x, y, len(x) - 1).deriv()(at))


def compression(s, P) -> str:
    """In words and numbers, what happens below a stretch of 1."""
    found = np.flatnonzero(np.isfinite(P))
    if found[0] > 0:
        return f"in compression no equilibrium below λ = {s[found[0]]:.2f}: the net folds up"
    low = int(np.argmin(P))
    if P[low] > -1e-6 * Y:
        return "no compression is borne"
    if low == 0:
        return f"{number(P[0])} N/m at λ = {s[0]:g}"
    cubic = np.polynomial.Polynomial.fit(s[low - 2 : low + 3], P[low - 2 : low + 3], 3)
    at = min(cubic.deriv().roots().real, key=lambda r: abs(r - s[low]))
    return f"loses stiffness at λ = {at:.3f}, with {number(cubic(at))} N/m, and gives way below"


def bending(pattern: str, M) -> str:
    """What a bending curve shows."""
    top, folds = int(np.argmax(M)), law_curves.FOLDS
    peak = f"{number(M[-1], 2)} at κh = {folds[-1]:.2f}"
    if top < len(M) - 1:
        peak = f"greatest ({number(M[top], 2)}) at κh = {folds[top]:.2f}, none at a full fold"
    return f"**{pattern}**: M = {number(M[0] / folds[0], 2)} Bκ for small κh; M h/B is {peak}."


def flight() -> str:
    lift = law_curves.blown(figures.PLATE, figures.DEGREES)[:, 1]
    best = figures.DEGREES[int(np.argmax(lift))]
    return (
        f"- **flat cloth at {SPEED:g} m/s**: the lift is greatest at {best:g}° (sin²α cos α: "
        "54.7°); a wing would have stalled long before, here the normal force alone lifts."
    )


def main() -> None:
    parser = study.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few points, into out/laws")
    parser.add_argument("--out", type=Path, help="folder of laws.md")
    options = parser.parse_args()
    study.require_packages("matplotlib")
    out = options.out or (Path("out/laws") if options.quick else HERE)
    every = 5 if options.quick else 1
    curves, moments = law_curves.responses(every), law_curves.moments()
    (out / "pictures").mkdir(parents=True, exist_ok=True)
    (out / "laws.md").write_text(page(curves, moments), encoding="utf-8")
    figures.draw(out, curves, moments)
    print(f"wrote {out}/laws.md, laws.png and {len(curves) + len(moments) + 1} pictures")


if __name__ == "__main__":
    study.run_main(main)
