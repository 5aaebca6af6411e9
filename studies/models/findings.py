"""Findings of the models study: numbers and their expected ranges."""

from __future__ import annotations

import numpy as np

from studies import harness
from studies.models.cases import FABRIC, models

SCENES = {"stretch": "force [N]", "shear": "shear stiffness [N/m]", "drape": "sag [m]"}
SCENES |= {"swing": "mean depth [m]"}
NAMES = tuple(models("right"))
Rows = list[dict]


def select_rows(rows: Rows, scene: str, model: str, pattern: str, bending: bool = False) -> Rows:
    """Return the successful rows of one model on one pattern, coarse to fine."""
    key = (scene, model, pattern, bending)
    names = ("scene", "model", "pattern", "bending")
    own = [r for r in rows if tuple(r[n] for n in names) == key and r["status"] == "ok"]
    return sorted(own, key=lambda row: -row["h"])


def finest(rows: Rows, *key) -> float:
    """Return the value on the finest mesh; NaN if there is none."""
    own = select_rows(rows, *key)
    return own[-1]["value"] if own else float("nan")


def spread(rows: Rows, scene: str, model: str) -> float:
    """Return the range of the values on the finest meshes of all patterns, over their mean."""
    patterns = {r["pattern"] for r in rows if r["scene"] == scene}
    values = [finest(rows, scene, model, pattern) for pattern in patterns]
    return float(np.ptp(values) / np.mean(values))


def exponent_of_h(rows: Rows, scene: str, model: str, pattern: str) -> float:
    """Return the p of value ∝ h^p over the last halving."""
    *_, coarse, fine = [{"value": np.nan, "h": 1.0}] * 2 + select_rows(rows, scene, model, pattern)
    return float(np.log(coarse["value"] / fine["value"]) / np.log(coarse["h"] / fine["h"]))


def conclude(rows: Rows, hinges: Rows) -> list[harness.Finding]:
    """Return all findings."""
    F, findings = harness.Finding, []
    twins = [
        abs(finest(rows, scene, "Springs biquadratic", p) / finest(rows, scene, "StVK", p) - 1)
        for scene in SCENES
        for p in ("right", "unstructured")
    ]
    findings.append(
        F("biquadratic springs: relative distance from StVK, all scenes", np.max(twins), high=1e-6)
    )
    for scene, most in (("stretch", 0.02), ("shear", 1e-6)):
        findings.append(
            F(f"StVK, {scene}: spread over patterns", spread(rows, scene, "StVK"), high=most)
        )
    findings += conclude_springs(rows)
    soft = exponent_of_h(rows, "shear", "BaraffWitkin p = 1", "right")
    findings.append(F("BaraffWitkin as published, shear: exponent of h", soft, 1.99, 2.01))
    firm = abs(exponent_of_h(rows, "shear", "BaraffWitkin p = 1/2", "right"))
    findings.append(F("BaraffWitkin p = 1/2, shear: exponent of h", firm, high=0.05))
    G = finest(rows, "shear", "TensorCondition", "unstructured") / FABRIC.shear
    expected = 1 + FABRIC.poisson_ratio  # nu = 0: G = Y/2 for Y/(2 (1 + nu))
    findings.append(F("TensorCondition: G over the fabric's", G, expected - 1e-6, expected + 1e-6))
    findings += [*conclude_roses(rows), *conclude_hinges(hinges)]
    return findings


def conclude_springs(rows: Rows) -> list[harness.Finding]:
    """Return the findings that springs converge to another material on each pattern."""
    F, findings = harness.Finding, []
    for model, scene in (("Springs structural", "stretch"), ("Springs van_gelder", "shear")):
        off = abs(finest(rows, scene, model, "right") / finest(rows, scene, "StVK", "right") - 1)
        findings.append(F(f"{model}, {scene}, right: relative distance from StVK", off, 0.1))
        drift = abs(exponent_of_h(rows, scene, model, "right"))
        findings.append(F(f"{model}, {scene}, right: exponent of h", drift, high=0.02))
        findings.append(
            F(f"{model}, {scene}: spread over patterns", spread(rows, scene, model), 0.1)
        )
    return findings


def conclude_roses(rows: Rows) -> list[harness.Finding]:
    """Return the findings on isotropy: elements are isotropic, springs follow their pattern."""
    F, findings = harness.Finding, []
    least = {"StVK": (1.0, 1 + 1e-9), "Springs structural": (1.15,), "Springs van_gelder": (3.0,)}
    for model, limits in least.items():
        value = finest(rows, "rose", model, "right")
        findings.append(F(f"{model} on right: highest over lowest stiffness", value, *limits))
    off = np.max([largest_deviation(rows, model, p) for model in NAMES for p in ("right", "cross")])
    findings.append(
        F(
            "stiffness against direction: relative distance from derived values, right and cross",
            off,
            high=0.02,
        )
    )
    return findings


def largest_deviation(rows: Rows, model: str, pattern: str) -> float:
    """Return the largest relative difference of the measured stiffness from the derived one."""
    own = select_rows(rows, "rose", model, pattern)
    return np.abs(np.divide(own[-1]["measured"], own[-1]["derived"]) - 1).max() if own else np.nan


def conclude_hinges(hinges: Rows) -> list[harness.Finding]:
    """Return the findings on hinges: each pattern has another B, as derived, also when refined."""
    good = [row for row in hinges if row["status"] == "ok"]
    fine = {row["pattern"]: row for row in sorted(good, key=lambda row: row["along"])}
    values = [row["value"] for row in fine.values()] or [np.nan]
    off = [
        max(row["narrow"] - row["value"], row["value"] - row["wide"], 0.0)
        for row in fine.values()
        if "narrow" in row
    ]
    F, differ = harness.Finding, max(values) - min(values)
    return [
        F("hinges: B_eff/B of the stiffest pattern minus the softest", differ, 0.15),
        F("hinges: B_eff/B on right", fine.get("right", {}).get("value", np.nan), 0.75, 0.85),
        F(
            "hinges: B_eff/B outside the range derived for narrow and wide strips",
            max(off, default=np.nan),
            high=0.05,
        ),
    ]


def describe_result(rows: Rows) -> str:
    """Return the conclusion in sentences."""
    force = finest(rows, "stretch", "Springs structural", "right")
    force /= finest(rows, "stretch", "StVK", "right")
    G = finest(rows, "shear", "Springs van_gelder", "right") / FABRIC.shear
    directions = finest(rows, "rose", "Springs van_gelder", "right")
    stretch = 100 * spread(rows, "stretch", "StVK")
    return (
        f"StVK has the same limit on all meshes (stretch: {stretch:.2g} % apart), and biquadratic "
        "springs equal StVK. Springs along the edges converge to another material on each "
        f"pattern: on right, structural springs pull with {force:.3g} of the force; van Gelder's "
        f"have {G:.3g} of the shear stiffness and are {directions:.2g} times as stiff in one "
        "direction as in another. Baraff and Witkin's conditions as published are no material: "
        "their stiffness goes with h². Hinges have another B on each pattern, also when refined."
    )
