"""Strains of P2 where nothing bends: a slack strip at rest, a taut one that vibrates or swings.

    python -m studies.evidence.models.strains [--quick] [--jobs N] [--out DIR]

A membrane without bending, 1 m long and 0.25 m wide, is held at both ends, ν = 0. Its strain on P2
is interpolated, the default, or pointwise.

- slack: the ends are 0.8 m apart; the sag is compared with the sag of the catenary.
- taut: stretched by 1 %; its second frequency across is compared with c/L, c² = Y E/ρ, where E is
  the Green strain.
- swing: stretched by 1 % and released from a half sine of 0.1 m, a quarter of a second; the largest
  error of two points against the pointwise strain with h = 1/32, over the way. "damped" adds
  `StrainRateDamping` of 1 ms.

The slack strip locks with the pointwise strain, by 3 % at h = 1/4 and any stiffness. On the flat
strip both strains have the same linear forces, because the interpolated one keeps the mean of E in
a triangle. In the swing short waves along the strip compress it, so that nothing holds its shape
across: there the pointwise strain is too stiff, which keeps these waves small, and the
interpolated strain has up to 2.4 times the error. Damping holds them too, and then the
interpolated strain is as good. (Undamped, the finest runs with the two strains differ by 1 %.)
The table of a full run is in studies/evidence/models/strains.md.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

import fecloth as fc
from fecloth import study
from studies import harness

STIFFNESS, DENSITY = 1000.0, 0.2  # N/m, kg/m²
SPAN, WIDTH, STRETCH, AMPLITUDE = 0.8, 0.25, 1.01, 0.1
SECONDS, STEPS, FINE = 0.08, 160, 1 / 32
STRAINS = "interpolated", "pointwise"
LEVELS = 1 / 4, 1 / 8, 1 / 16


def strip(h: float, strain: str, stiffness: float, *terms) -> fc.System:
    cloth = fc.Cloth.rectangle(1.0, WIDTH, h, pattern="right", element="P2")
    fabric, membrane = fc.Fabric(DENSITY, stiffness, 0.0), fc.StVK(strain=strain)
    return fc.System(cloth, fabric, [membrane, *terms], ["left", "right"], threads=1)


def slack(h: float, strain: str, stiffness: float = 100 * STIFFNESS) -> float:
    """Relative error of the sag; the search begins at the catenary."""
    a = brentq(lambda a: np.sinh(a) / a - 1 / SPAN, 1e-3, 5.0)
    c = SPAN / (2 * a)
    system = strip(h, strain, stiffness, fc.Gravity())
    s, Y = system.cloth.X.T - [[0.5], [0.0]]
    z = np.hypot(c, s) - np.hypot(c, 0.5)
    start = system.state(np.column_stack([c * np.arcsinh(s / c) + SPAN / 2, Y, z]))
    x = fc.equilibrium(system, start).x
    middle = system.cloth.interpolator(np.array([[0.5, WIDTH / 2]])) @ x
    return -middle[0, 2] / (c * (np.cosh(a) - 1)) - 1


def taut(h: float, strain: str) -> float:
    """Relative error of the second frequency across."""
    system = strip(h, strain, STIFFNESS)
    X, Y = system.cloth.X.T
    modes = fc.modes(system, system.state(np.column_stack([STRETCH * X, Y, 0 * X])), count=12)
    exact = np.sqrt(STIFFNESS * 0.5 * (STRETCH**2 - 1) / DENSITY)
    return min(np.array(modes.frequencies) / exact - 1, key=abs)


@cache
def path(h: float, strain: str, damped: bool) -> np.ndarray:
    """Place over time of two points that swing."""
    system = strip(h, strain, STIFFNESS, *[fc.StrainRateDamping(1e-3)] * damped)
    X, Y = system.cloth.X.T
    start = system.state(np.column_stack([STRETCH * X, Y, AMPLITUDE * np.sin(np.pi * X)]))
    probes = [fc.Probe(name, point=(at, WIDTH / 2)) for name, at in (("q", 0.25), ("m", 0.5))]
    dt, method = SECONDS / STEPS, fc.EnergyMomentum()
    result = fc.run(system, method, start, dt, SECONDS, probes=probes, most_growth=np.inf)
    return np.stack([result.observed[f"{name}.{axis}"] for name in "qm" for axis in "xz"])


def swing(h: float, strain: str, damped: bool = False) -> float:
    """Largest error of the path over the way."""
    fine, coarse = path(FINE, "pointwise", damped), path(h, strain, damped)
    return abs(coarse - fine).max() / np.ptp(fine, axis=1).max()


PROBLEMS = {
    "slack": slack,
    "taut": taut,
    "swing": swing,
    "swing, damped": lambda h, strain: swing(h, strain, True),
}


def measure(problem: str, strain: str, h: float) -> dict:
    return {"error": float(PROBLEMS[problem](h, strain))}


def list_cases(quick: bool) -> list[dict]:
    problems, levels = (("slack", "taut"), LEVELS[:2]) if quick else (PROBLEMS, LEVELS)
    names = "problem", "strain", "h"
    return [
        dict(zip(names, (problem, strain, h), strict=True))
        for problem in problems
        for strain in STRAINS
        for h in levels
    ]


def error_table(rows: list[dict]) -> list[dict]:
    """One line for each problem and strain."""
    lines: dict[tuple, dict] = {}
    for row in rows:
        key = row["problem"], row["strain"]
        line = lines.setdefault(key, {"problem": key[0], "strain": key[1]})
        line[f"h = 1/{1 / row['h']:.0f}"] = f"{row.get('error', np.nan):.1e}"
    return list(lines.values())


def conclude(rows: list[dict]) -> list[harness.Finding]:
    """Return the findings: only the pointwise strain locks; about flat both are the same."""
    error = {(row["problem"], row["strain"], row["h"]): row.get("error", np.nan) for row in rows}
    ratio = error["taut", "interpolated", 1 / 8] / error["taut", "pointwise", 1 / 8]
    locked, free = (abs(error["slack", strain, 1 / 4]) for strain in ("pointwise", "interpolated"))
    findings = [
        harness.Finding("slack, pointwise strain, h = 1/4: |error|", locked, 0.03),
        harness.Finding("slack, interpolated strain, h = 1/4: |error|", free, high=5e-4),
        harness.Finding("taut, h = 1/8: interpolated / pointwise error", ratio, 0.99, 1.01),
    ]
    for problem, high in (("swing", 3.0), ("swing, damped", 1.1)):
        if (problem, "pointwise", 1 / 4) in error:
            pair = (error[problem, strain, 1 / 4] for strain in STRAINS)
            name = f"{problem}, h = 1/4: interpolated / pointwise error"
            findings.append(harness.Finding(name, next(pair) / next(pair), high=high))
    return findings


def main() -> int:
    options = harness.parse_arguments(__doc__)
    rows = study.run_cases(list_cases(options.quick), measure, **harness.run_options(options))
    title = "Strains of P2 where nothing bends"
    harness.require_results(options, title, rows)
    tables, findings = {"Relative errors": error_table(rows)}, conclude(rows)
    page = Path(__file__).with_suffix("")
    return harness.write_report(options, title, rows, tables=tables, findings=findings, page=page)


if __name__ == "__main__":
    harness.run_main(main)
