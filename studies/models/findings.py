"""What models.py states, each statement a number and the range that it must lie in."""

from __future__ import annotations

import numpy as np

from fecloth import study
from studies.models.cases import FABRIC, models

SCENES = {"stretch": "force [N]", "shear": "shear stiffness [N/m]", "drape": "sag [m]"}
SCENES |= {"swing": "mean depth [m]"}
NAMES = tuple(models("right"))
Rows = list[dict]


def path(rows: Rows, scene: str, model: str, pattern: str, bending: bool = False) -> Rows:
    """The rows of one model on one pattern, coarse to fine."""
    key = (scene, model, pattern, bending)
    names = ("scene", "model", "pattern", "bending")
    own = [r for r in rows if tuple(r[n] for n in names) == key and r["status"] == "ok"]
    return sorted(own, key=lambda row: -row["h"])


def finest(rows: Rows, *key) -> float:
    """The answer on the finest mesh; NaN where there is none."""
    own = path(rows, *key)
    return own[-1]["value"] if own else float("nan")


def spread(rows: Rows, scene: str, model: str) -> float:
    """By how much the answers of the patterns differ on the finest meshes, of their mean."""
    patterns = {r["pattern"] for r in rows if r["scene"] == scene}
    values = [finest(rows, scene, model, pattern) for pattern in patterns]
    return float(np.ptp(values) / np.mean(values))


def power(rows: Rows, scene: str, model: str, pattern: str) -> float:
    """The p of value ∝ h^p over the last halving."""
    *_, coarse, fine = [{"value": np.nan, "h": 1.0}] * 2 + path(rows, scene, model, pattern)
    return float(np.log(coarse["value"] / fine["value"]) / np.log(coarse["h"] / fine["h"]))


def conclude(rows: Rows, hinges: Rows) -> list[study.Finding]:
    """The statements, each a number and its range."""
    F, found = study.Finding, []
    twins = [
        abs(finest(rows, scene, "Springs biquadratic", p) / finest(rows, scene, "StVK", p) - 1)
        for scene in SCENES
        for p in ("right", "unstructured")
    ]
    found.append(F("biquadratic springs from StVK, all scenes, relative", np.max(twins), high=1e-6))
    for scene, most in (("stretch", 0.02), ("shear", 1e-6)):
        found.append(
            F(f"StVK, {scene}: spread over patterns", spread(rows, scene, "StVK"), high=most)
        )
    found += conclude_springs(rows)
    soft = power(rows, "shear", "BaraffWitkin p = 1", "right")
    found.append(F("BaraffWitkin as published, shear: goes with h to the power", soft, 1.99, 2.01))
    firm = abs(power(rows, "shear", "BaraffWitkin p = 1/2", "right"))
    found.append(F("BaraffWitkin p = 1/2, shear: goes with h to the power", firm, high=0.05))
    G = finest(rows, "shear", "TensorCondition", "unstructured") / FABRIC.shear
    asked_for = 1 + FABRIC.poisson_ratio  # nu = 0: G = Y/2 for Y/(2 (1 + nu))
    found.append(F("TensorCondition: G over that asked", G, asked_for - 1e-6, asked_for + 1e-6))
    found += [*conclude_roses(rows), *conclude_hinges(hinges)]
    return found


def conclude_springs(rows: Rows) -> list[study.Finding]:
    """Springs settle under refinement, on another material for each pattern."""
    F, found = study.Finding, []
    for model, scene in (("Springs structural", "stretch"), ("Springs van_gelder", "shear")):
        off = abs(finest(rows, scene, model, "right") / finest(rows, scene, "StVK", "right") - 1)
        found.append(F(f"{model}, {scene}, right: away from StVK, relative", off, 0.1))
        drift = abs(power(rows, scene, model, "right"))
        found.append(F(f"{model}, {scene}, right: goes with h to the power", drift, high=0.02))
        found.append(F(f"{model}, {scene}: spread over patterns", spread(rows, scene, model), 0.1))
    return found


def conclude_roses(rows: Rows) -> list[study.Finding]:
    """Elements know no direction, springs have that of their pattern, as the derived moduli say."""
    F, found = study.Finding, []
    least = {"StVK": (1.0, 1 + 1e-9), "Springs structural": (1.15,), "Springs van_gelder": (3.0,)}
    for model, limits in least.items():
        value = finest(rows, "rose", model, "right")
        found.append(F(f"{model} on right: highest over lowest stiffness", value, *limits))
    off = np.max([farthest(rows, model, p) for model in NAMES for p in ("right", "cross")])
    found.append(F("roses from the derived ones on right and cross, relative", off, high=0.02))
    return found


def farthest(rows: Rows, model: str, pattern: str) -> float:
    """The largest relative difference of a measured rose from the derived one."""
    own = path(rows, "rose", model, pattern)
    return np.abs(np.divide(own[-1]["measured"], own[-1]["derived"]) - 1).max() if own else np.nan


def conclude_hinges(hinges: Rows) -> list[study.Finding]:
    """Every pattern carries another B, as derived, and refinement does not cure it."""
    good = [row for row in hinges if row["status"] == "ok"]
    fine = {row["pattern"]: row for row in sorted(good, key=lambda row: row["along"])}
    values = [row["value"] for row in fine.values()] or [np.nan]
    off = [
        max(row["narrow"] - row["value"], row["value"] - row["wide"], 0.0)
        for row in fine.values()
        if "narrow" in row
    ]
    F, differ = study.Finding, max(values) - min(values)
    return [
        F("hinges: B_eff/B of the stiffest pattern less the softest", differ, 0.15),
        F("hinges: B_eff/B on right", fine.get("right", {}).get("value", np.nan), 0.75, 0.85),
        F(
            "hinges: B_eff/B outside the derived of narrow and wide strips",
            max(off, default=np.nan),
            high=0.05,
        ),
    ]


def sentence(rows: Rows) -> str:
    """The conclusion in words."""
    force = finest(rows, "stretch", "Springs structural", "right")
    force /= finest(rows, "stretch", "StVK", "right")
    G = finest(rows, "shear", "Springs van_gelder", "right") / FABRIC.shear
    directions = finest(rows, "rose", "Springs van_gelder", "right")
    stretch = 100 * spread(rows, "stretch", "StVK")
    return (
        f"StVK comes to one answer on all meshes (stretch: {stretch:.2g} % apart), and biquadratic "
        "springs are StVK. Springs along the edges settle on another material for each pattern: "
        f"on right structural ones pull with {force:.3g} of the force, and van Gelder's shear with "
        f"{G:.3g} of the stiffness and pull {directions:.2g} times as hard in one direction as in "
        "another. Baraff and Witkin's conditions as published are no material: their stiffness "
        "goes with h². Hinges carry another B on each pattern, however fine it is."
    )
