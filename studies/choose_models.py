"""Which membrane and which bending when: the statements, by the numbers of the studies."""

from __future__ import annotations

import math

from choose_rule import Numbers, Rule, least, most, ruling, told
from choose_tables import Tables
from model_cases import FABRIC
from speed_cases import PAPER
from speed_cases import SWING as SPAN

STRETCH, COST = "stretch: force [N]", "Cost"
DRAPE, SWING = "drape: sag [m]", "swing: mean depth [m]"
OVER, PULLED = "over StVK's limit", "Stiffness against the direction of a pull"
SIMPLER, HINGES = "One thing simpler", "Bending carried by hinges"
RULES: list[Rule] = []
rule = ruling(RULES)


# --- which membrane -------------------------------------------------------------------------------


@rule(
    "a fabric's Y, ν and G",
    "`StVK`, on any mesh",
    "four patterns pull alike to {stvk} %; structural springs differ by {springs} %, van Gelder's "
    "pull {gelder} times as hard one way as another, Baraff and Witkin's conditions as published "
    "soften with order {published} in h",
    "models",
)
def fabric(t: Tables) -> Numbers:
    gelder = t.one(
        "models", PULLED, "highest / lowest", model="Springs van_gelder", pattern="right"
    )
    spread = "stretch: spread over patterns"
    soft = t.finding("models", "BaraffWitkin as published, shear: goes with h to the power")
    return {
        "stvk": most(100 * t.finding("models", f"StVK, {spread}"), 2),
        "springs": least(100 * t.finding("models", f"Springs structural, {spread}"), 10),
        "gelder": least(gelder, 1.5),
        "published": (soft, 1.9, 2.1),
    }


@rule(
    "springs in mind, for their speed",
    "`StVK` all the same",
    "a step takes them {low} to {high} times as long, other membranes no less than {best}; "
    'kind `"biquadratic"` is `StVK`, to {twins}',
    "models",
)
def springs(t: Tables) -> Numbers:
    cost = {row["model"]: row["over StVK"] for row in t.table("models", COST)}  # the finest
    ours = [value for name, value in cost.items() if name.startswith("Springs")]
    twins = t.finding("models", "biquadratic springs from StVK, all scenes, relative")
    return {
        "low": least(min(ours), 0.9),
        "high": told(max(ours)),
        "best": least(min(cost.values()), 0.9),
        "twins": most(twins, 1e-6),
    }


@rule(
    "a cloth that swings, hardly stretched",
    "`StVK`; the law matters little",
    "other laws change its depth by up to {swing} %; but a sag between four corners by {drape} %",
    "models",
)
def hardly_stretched(t: Tables) -> Numbers:
    def off(heading: str) -> float:
        laws = ("TensorCondition", "BaraffWitkin p = 1/2", "NeoHookean")
        rows = [r for r in t.table("models", heading) if r["model"] in laws]
        return max((100 * abs(row[OVER] - 1) for row in rows), default=math.nan)

    return {"swing": most(off(SWING), 1), "drape": most(off(DRAPE), 10)}


@rule(
    "stretches of a tenth and more",
    "the law that a tensile test of the cloth shows",
    "drawn out by a tenth between clamps, a strip of `NeoHookean` pulls with {neo}, of "
    "`BaraffWitkin` with {baraff} of `StVK`'s force; with `NeoHookean` a falling disk is {disk} % "
    "elsewhere",
    "models, speed_accuracy",
)
def stretched(t: Tables) -> Numbers:
    where = {"pattern": "unstructured"}
    disk = {"scene": "trampoline", "model": "NeoHookean"}
    away = t.all_of("speed_accuracy", "Space and model, at fine steps", "model [%]", **disk)
    return {
        "neo": most(t.one("models", STRETCH, OVER, model="NeoHookean", **where), 0.9),
        "baraff": most(t.one("models", STRETCH, OVER, model="BaraffWitkin p = 1/2", **where), 0.95),
        "disk": least(away[-1] if away else math.nan, 5),
    }


@rule(
    "wrinkles finer than the mesh, their mean asked for",
    "`TensionField`, if at all",
    "its force costs {force} times `StVK`'s, its tangent {tangent}; what it gains is not measured",
    "costs",
)
def wrinkles(t: Tables) -> Numbers:
    _, force, _, tangent = t.printed("costs", "TensionField") or [math.nan] * 4
    return {
        "force": told(round(force, 1)),
        "tangent": told(round(tangent, 1)),
    }  # runs differ by 5 %


# --- which bending --------------------------------------------------------------------------------


def number_of(t: Tables, scene: str) -> float:
    return t.one(f"needs/{scene}", "Numbers", "value", number="gravity / bending stiffness")


def change(t: Tables, scene: str, variant: str) -> float:
    """Of what the scene is asked for [%]."""
    return 100 * t.one(f"needs/{scene}", SIMPLER, "change", variant=variant)


@rule(
    "ρ g L³/B of {small} to {paper}: a strip that bends, a sheet of paper",
    "bending",
    "without it the strip ends {change} % elsewhere, and costs {longer} times as much; the paper's "
    "mean is {mean} % off, its free edge {edge} %",
    "needs, speed_accuracy",
)
def bends(t: Tables) -> Numbers:
    paper = {"scene": "swing", "model": "StVK"}
    off = {
        name: t.all_of("speed_accuracy", "Space and model, at fine steps", column, **paper)
        for name, column in (("mean", "all [%]"), ("edge", "beside it [%]"))
    }
    saved = t.one("needs/cantilever", SIMPLER, "saved", variant="without HingeBending")
    return {
        "small": most(number_of(t, "cantilever"), 100),
        "paper": most(PAPER.areal_density * 9.81 * SPAN**3 / PAPER.bending_rigidity, 100),
        "change": least(change(t, "cantilever", "without HingeBending"), 1),
        "longer": least(1 - saved, 1),
        "mean": least(off["mean"][-1] if off["mean"] else math.nan, 2),
        "edge": told(off["edge"][-1] if off["edge"] else math.nan),
    }


@rule(
    "ρ g L³/B of {low} and more, no wrinkles asked for",
    "no bending",
    "it changes the sag between corners by {drape} %, at {high} a taut square by {taut} % and a "
    "sheet in the wind by {wind} %; but a falling sheet, held along an edge, converges with order "
    "{kink} without it, {smooth} with it",
    "needs, models, convergence",
)
def needs_none(t: Tables) -> Numbers:
    order = "swing, {}, cross: order of L2"
    drape = t.one("models", "Bending", "change by bending", scene="drape", model="StVK")
    return {
        "low": least(FABRIC.areal_density * 9.81 / FABRIC.bending_rigidity, 1e4),
        "high": least(min(number_of(t, "taut"), number_of(t, "wind")), 1e4),
        "taut": most(change(t, "taut", "without HingeBending"), 1),
        "wind": most(change(t, "wind", "without QuadraticBending"), 1),
        "drape": most(100 * abs(drape), 1),
        "kink": most(t.finding("convergence", order.format("none")), 1.7),
        "smooth": least(t.finding("convergence", order.format("HingeBending")), 1.85),
    }


@rule(
    "bending of a cloth that is flat at rest",
    "`QuadraticBending`",
    "in place of hinges it changes the strip by {strip} % and saves {saved} % of the seconds, on "
    "the taut square {taut} %; the falling sheet's order stays {order}",
    "needs, convergence",
)
def quadratic(t: Tables) -> Numbers:
    variant = "QuadraticBending for hinges"
    saved = {
        s: 100 * t.one(f"needs/{s}", SIMPLER, "saved", variant=variant)
        for s in ("cantilever", "taut")
    }
    order = t.finding("convergence", "swing, QuadraticBending, cross: order of L2")
    return {
        "strip": most(change(t, "cantilever", variant), 1),
        "saved": least(saved["cantilever"], 5),
        "taut": least(saved["taut"], 5),
        "order": least(order, 1.85),
    }


@rule(
    "a measured bending rigidity",
    "an unstructured or equilateral mesh, and what is measured over {unstructured} for strips a "
    "quarter as wide as long, over {low} to {high} for a cloth twice as wide as long",
    "on such strips hinges carry {right} of B on `right`, {cross} on `cross`, {equilateral} on "
    "`equilateral`, {unstructured} unstructured, on the wide cloth {wide_right}, {wide_cross}, "
    "{high}, {low}, however fine",
    "models, bending_bias",
)
def rigidity(t: Tables) -> Numbers:
    def carried(pattern: str) -> float:
        return (t.all_of("models", HINGES, "value", pattern=pattern) or [math.nan])[-1]

    def wide(pattern: str) -> float:
        return (t.printed("bending_bias", "2.0", pattern) or [math.nan])[-1]

    return {
        "right": most(carried("right"), 0.9),
        "cross": least(carried("cross"), 1.05),
        "equilateral": (carried("equilateral"), 0.9, 1.1),
        "unstructured": (carried("unstructured"), 0.9, 1.1),
        "wide_right": most(wide("right"), 0.95),
        "wide_cross": least(wide("cross"), 1.05),
        "high": (wide("equilateral"), 0.95, 1.05),
        "low": (wide("unstructured"), 0.95, 1.05),
    }
