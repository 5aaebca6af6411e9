"""Findings of the stability study: numbers and their expected ranges."""

from __future__ import annotations

import math

from fecloth import study
from fecloth.integrators import EXPLICIT, METHODS
from studies.stability.cases import BLOWN, ENERGY, GROWTH

Rows = list[dict]
CLEAN = ("courant", "sliver")  # scenes in which explicit runs fail only beyond the limit
MAKES = ("implicit_midpoint", "newmark", "generalized_alpha")  # make energy in the stiff swing
KEEPS = ("energy_momentum", "backward_euler", "bdf2")
SHEET = {"h": 0.1, "Y": 1000.0, "damping": 0.0, "drag": 0.0}
DRAG = 1500.0  # [1/s]; forward Euler is unstable without


def conclude_maps(rows: Rows) -> list[study.Finding]:
    """Return the number of explicit cells, 10 % or more from the limit, that contradict it.

    Such a cell blew up below the limit, or did not blow up above it.
    """
    own = [r for r in rows if r.get("method") in ("symplectic_euler", "central_difference")]
    own = [r for r in own if r["scene"] in CLEAN and r["status"] == "ok"]
    own = [r for r in own if not 0.9 < r["dt"] / r["limit"] < 1.1]
    wrong = [r for r in own if (r["outcome"] == BLOWN) != (r["dt"] > r["limit"])]
    where = " and ".join(dict.fromkeys(r["scene"] for r in own))
    words = f"of {len(own)} explicit cells on {where}: contradictions to the predicted limit"
    return [study.Finding(words, len(wrong), high=0)]


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


def conclude_sheets(rows: Rows, free: Rows) -> list[study.Finding]:
    F, findings = study.Finding, []
    for method in EXPLICIT:
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


def conclude_swing(rows: Rows) -> list[study.Finding]:
    """Return the findings on which A-stable methods make energy on the nonlinear swing."""
    F, findings = study.Finding, []
    for row in (row for row in rows if row["status"] == "ok"):
        limits = (-math.inf, math.inf)  # no expectation: the linearised step makes none or much
        if row["method"] in (*MAKES, *KEEPS):
            limits = (ENERGY, math.inf) if row["method"] in MAKES else (-math.inf, ENERGY)
        words = f"{row['method']} on the stiff swing at {1e3 * row['dt']:.2g} ms: energy made"
        findings.append(F(f"{words}, relative to the energy that moved", row["made"], *limits))
    return findings
