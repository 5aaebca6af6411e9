"""Which element, method, step and linear solver when: the statements, by the studies' numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

from choose_rule import Numbers, Rule, least, most, never, ruling, told
from choose_tables import Tables, explicit, first_order, implicit, second_order, still

SOLVED = "Linear solvers, CPU seconds"
SIMPLER = "One thing simpler"
STEADY = "Largest dt [s] that is stable and right, with all smaller ones"
RULES: list[Rule] = []
rule = ruling(RULES)


# --- which element, which method ------------------------------------------------------------------


@rule(
    "a taut cloth at rest, nothing of which bends",
    '`element = "P2"`, `equilibrium`',
    "a stretched strip to 1 % in {one} s, on P1 in {linear} s; to 0.1 % in {tenth} s, on "
    "P1 at no h tried; the order in L2 is {p2}, on P1 {p1}",
    "speed_accuracy, convergence",
)
def at_rest(t: Tables) -> Numbers:
    def seconds(level: float, element: str) -> float:
        return t.cheapest("stretch", level, lambda r: still(r) and r["element"] == element)

    one, linear = seconds(0.01, "P2"), seconds(0.01, "P1")
    order = "static, {}, unstructured: order of L2"
    return {
        "one": most(one, linear),
        "linear": told(linear),
        "tenth": told(seconds(0.001, "P2")),
        "tenth on P1": never(seconds(0.001, "P1")),
        "p2": least(t.finding("convergence", order.format("P2")), 2.85),
        "p1": told(t.finding("convergence", order.format("P1"))),
    }


@rule(
    "only the end of a motion in mind",
    "`equilibrium`",
    "the strip that bends ends {off} % elsewhere and saves {saved} % of the seconds; the stretched "
    "strip takes the cheapest march to 1 % {march} times as long",
    "needs, speed_accuracy",
)
def only_the_end(t: Tables) -> Numbers:
    march = t.cheapest("stretch", 0.01, lambda r: not still(r))
    off, saved = (
        100 * t.one("needs/cantilever", SIMPLER, column, variant="equilibrium")
        for column in ("change", "saved")
    )
    return {
        "off": most(off, 1),
        "saved": least(saved, 10),
        "march": least(march / t.cheapest("stretch", 0.01, still), 1),
    }


@rule(
    "motion of a membrane as soft as fabric, no bending",
    "P1 and `many_steps`, else `CentralDifference` without dt",
    "a falling disk to 1 % in {disk} s, implicitly in {implicit} times that, on P2 in {p2}, a wave "
    "implicitly in {wave}; the disk to 0.1 % in {tenth} s, where no implicit run came",
    "speed_accuracy",
)
def soft(t: Tables) -> Numbers:
    def ratio(scene: str, among: Callable) -> float:
        return t.cheapest(scene, 0.01, among) / t.cheapest(scene, 0.01, explicit)

    p2 = ratio("trampoline", lambda r: r["element"] == "P2")
    return {
        "disk": told(t.cheapest("trampoline", 0.01, explicit)),
        "implicit": least(ratio("trampoline", implicit), 1.5),
        "p2": least(p2, 1.5),
        "wave": least(ratio("wave", implicit), 1.5),
        "tenth": told(t.cheapest("trampoline", 0.001, explicit)),
        "tenth, implicit": never(t.cheapest("trampoline", 0.001, implicit)),
    }


@rule(
    "motion of a cloth as stiff as paper",
    "`ImplicitMidpoint`",
    "the paper's fall of 0.3 s to 1 % in {paper} s, with dt = {dt} ms; explicitly in {explicit} "
    "times that",
    "speed_accuracy",
)
def stiff(t: Tables) -> Numbers:
    def midpoint(row: Mapping) -> bool:
        return row["method"] == "ImplicitMidpoint"

    paper = t.cheapest("swing", 0.01, midpoint)
    return {
        "paper": most(paper, t.cheapest("swing", 0.01, second_order)),
        "dt": told(1e3 * t.run("swing", 0.01, midpoint).get("step", math.nan)),
        "explicit": least(t.cheapest("swing", 0.01, explicit) / paper, 1.5),
    }


@rule(
    "fast waves that no step is to resolve",
    "`BDF2`; `EnergyMomentum` where energy counts",
    "within 10 % on the stiff swing at steps to {bdf2} ms, `EnergyMomentum` to {keeps} ms, "
    "`LinearlyImplicitEuler` to {linearised} ms, the midpoint rule to {midpoint} ms: at 9.7 ms it "
    "makes energy from nothing",
    "stability",
)
def unresolved(t: Tables) -> Numbers:
    def right(method: str) -> float:
        return 1e3 * t.one("stability", STEADY, method, scene="stiff_swing")

    made = "{} on the stiff swing at 9.7 ms: energy made of what moved"
    return {
        "bdf2": least(right("bdf2"), 1.5 * right("implicit_midpoint")),
        "keeps": least(right("energy_momentum"), 1.5 * right("implicit_midpoint")),
        "midpoint": told(right("implicit_midpoint")),
        "linearised": most(right("linearly_implicit_euler"), right("bdf2")),
        "made by midpoint": (
            t.finding("stability", made.format("implicit_midpoint")),
            0.05,
            math.inf,
        ),
        "made by EnergyMomentum": most(
            t.finding("stability", made.format("energy_momentum")), 0.05
        ),
    }


@rule(
    "no dt in mind",
    "none: explicit steps know theirs, implicit ones take `rtol = 1e-2`",
    "limits foretold are measured to {limit} %, and {cells} of {runs} runs contradict them; with "
    "that rtol generalised-α is off by {disk} % in time on the disk, {paper} % on the paper; but a "
    "wave of 10⁻⁴ of its strip even at 1e-3 by {wave} %",
    "stability, speed_accuracy",
)
def steps(t: Tables) -> Numbers:
    def in_time(scene: str, rtol: float = 0.01) -> float:
        name = "Adaptive GeneralizedAlpha"
        run = t.run(scene, 1.0, lambda r: (r["method"], r["step"]) == (name, rtol))
        return 100 * run.get("time_error", math.nan)

    limit = t.finding(
        "stability", "central_difference: measured limit from that foretold, relative"
    )
    cells = r"- of (\d+) explicit cells on .*, against what was foretold: (\S+)"
    wrong = re.search(cells, t.text("stability"))
    return {
        "limit": most(100 * limit, 10),
        "cells": (float(wrong[2]) if wrong else math.nan, 0.0, 0.0),
        "runs": told(float(wrong[1]) if wrong else math.nan),
        "disk": most(in_time("trampoline"), 2),
        "paper": most(in_time("swing"), 2),
        "wave": told(in_time("wave", 0.001)),
    }


@rule(
    "`BackwardEuler` or `LinearlyImplicitEuler` in mind",
    "one of second order",
    "at no step tried did they come to 1 % on disk, wave or paper; to 5 % the paper takes them "
    "{first} s, second order {second} s",
    "speed_accuracy",
)
def euler(t: Tables) -> Numbers:
    first, second = (t.cheapest("swing", 0.05, order) for order in (first_order, second_order))
    scenes = {name: t.cheapest(name, 0.01, first_order) for name in ("trampoline", "wave", "swing")}
    never_there = {f"1 % on {name}": never(value) for name, value in scenes.items()}
    return never_there | {"first": told(first), "second": most(second, first)}


@rule(
    "no wish to choose method and step",
    "`Auto(rtol)`",
    "on {close} of {scenes} scenes at most 1.5 times as long as the fastest of seven options, on "
    "the worst {worst} times; to 1 % of the disk {disk} times as long as the best fixed step, of "
    "the paper {paper} times",
    "auto, speed_accuracy",
)
def automatic(t: Tables) -> Numbers:
    def over(scene: str) -> float:
        auto = t.cheapest(scene, 0.01, lambda r: r["method"] == "Auto")
        return auto / t.cheapest(scene, 0.01, lambda r: explicit(r) or implicit(r))

    ratios = [float(r) for r in re.findall(r"choose: (\S+) of the best", t.text("auto"))]
    close = [ratio for ratio in ratios if ratio <= 1.5]
    return {
        "close": least(len(close), max(1, len(ratios) / 2)),
        "scenes": told(len(ratios)),
        "worst": told(max(ratios, default=math.nan)),
        "disk": told(over("trampoline")),
        "paper": told(over("swing")),
    }


@rule(
    "a linear system to solve",
    '`linear = "auto"`',
    'at most {auto} times as long as the best on seven scenes; `"direct"` takes {disk} times as '
    'long as `"pcg"` on the disk, `"pcg"` {paper} times as long as `"direct"` on the paper',
    "solvers, speed_accuracy",
)
def linear(t: Tables) -> Numbers:
    def direct_over_pcg(scene: str) -> float:
        rows = [r for r in t.table("speed_accuracy", SOLVED) if r["scene"] == scene]
        finest = min(rows, key=lambda r: (r["h"], -r["dt [ms]"]), default={})
        return finest.get("direct [s]", math.nan) / finest.get("pcg [s]", math.nan)

    return {
        "auto": most(t.finding("solvers", "auto over the best"), 1.5),
        "disk": least(direct_over_pcg("trampoline"), 1.2),
        "paper": least(1 / direct_over_pcg("swing"), 1.2),
    }
